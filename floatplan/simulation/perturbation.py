"""What a plan or a jump does not know: another momentum, other masses, friction, noise and delay; sampled by seed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np

from floatplan.arguments import Check, Checked, made, number, optional
from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.tables import Range

RELATIVE = number(Range(-0.9, 0.9, "")), {"%": 0.01, "": 1.0}  # masses and torques keep their sign
KINDS: dict[str, tuple[Check, dict[str, float]]] = {  # what a number may be, and what one of each unit is in SI units
    **dict.fromkeys(("h", "mass", "inertia", "torque", "rise", "friction"), RELATIVE),
    "armature": (number(Range(0.0, 1e3, "kg m^2")), {"kg m^2": 1.0, "": 1.0}),
    "noise": (number(Range(0.0, 1.0, "rad")), {"deg": math.radians(1), "rad": 1.0, "": 1.0}),
    "rate_noise": (optional(number(Range(0.0, 1.0, "rad/s"))), {"deg/s": math.radians(1), "rad/s": 1.0, "": 1.0}),
    "delay": (number(Range(0.0, 1.0, "s")), {"ms": 1e-3, "s": 1.0, "": 1.0}),
}
MEASURED = ("noise", "rate_noise", "delay")  # of measurements, which `fp.replay` without `--replan` has no use for
OF_TAKEOFF = ("h", "rise")  # of plans only: the stance of a jump makes its takeoff
WITH_CONTACT = ("friction", "armature")  # of motions with contact: jumps, and clips on the bench


@dataclass(frozen=True)
class Perturbation(Checked):
    """Sizes of what differs between the simulated robots and the model; each relative error has a random sign.

    Attributes
    ----------
    h, mass, inertia, torque, rise : relative
        ``h`` is of the angular momentum at takeoff; ``mass`` of each body's mass and moment of inertia, by one factor;
        ``inertia`` of both too, by two independent factors; ``torque`` of each joint's torque; ``rise`` of the vertical
        velocity at takeoff, with which the centre of mass is measured too.
    friction : relative
        Of the ground under a jump or a clip.
    armature : kg m^2
        Of all joints of a robot on the ground, in addition to the model's; each robot has its own, uniformly
        distributed between 0 and this.
    noise, rate_noise : rad, rad/s
        Standard deviations of all measured angles and rates; left out, ``rate_noise`` is 10/s times ``noise``.
    delay : s
        Between a measurement and the correction that uses it; on the ground also between it and the joints' feedback.

    Raises
    ------
    InputError
        A number is out of its range.
    """

    h: float = 0.0
    mass: float = 0.0
    inertia: float = 0.0
    torque: float = 0.0
    rise: float = 0.0
    friction: float = 0.0
    armature: float = 0.0
    noise: float = 0.0
    rate_noise: float | None = None
    delay: float = 0.0

    checks: ClassVar[Mapping[str, Check]] = {name: check for name, (check, _) in KINDS.items()}

    @property
    def any(self) -> bool:
        """Whether any of them is not zero."""
        return any(getattr(self, name) for name in KINDS)

    @property
    def noise_of_rates(self) -> float:
        """Standard deviation of measured rates, rad/s."""
        per_second = 10.0  # [1/s] over that of angles
        return per_second * self.noise if self.rate_noise is None else self.rate_noise

    def sampled(self, seed: int, number: int, joints: int, bodies: int) -> Sample:
        """Sample the robot of one run; the same for the same numbers."""
        rng = np.random.default_rng((seed, number))

        def factors(size: float, count: int) -> Array:
            return np.asarray(1.0 + size * rng.choice((-1.0, 1.0), count))

        # The order decides which random numbers each gets, and where the noise of measurements begins. The first five
        # are always sampled; what was added later only where its size is not zero, so that robots and noise of a
        # seed stay as they were.
        momentum = float(factors(self.h, 1)[0])
        # `inertia` is of mass and moment of inertia, independently; `mass` is the same factor on both.
        mass_of_inertia = factors(self.inertia, bodies)
        moment_of_inertia = factors(self.inertia, bodies)
        torque = factors(self.torque, joints)
        rise = float(factors(self.rise, 1)[0])
        mass_and_moment = factors(self.mass, bodies) if self.mass else np.ones(bodies)
        friction = float(factors(self.friction, 1)[0]) if self.friction else 1.0
        armature = float(rng.uniform(0.0, self.armature)) if self.armature else 0.0
        return Sample(
            momentum=momentum,
            mass=mass_of_inertia * mass_and_moment,
            inertia=moment_of_inertia * mass_and_moment,
            torque=torque,
            rise=rise,
            friction=friction,
            armature=armature,
            noise=rng,
        )

    def in_words(self) -> list[str]:
        """Name, size and unit of each that is not zero; the unit is the first of its row in ``KINDS``."""
        words = []
        for name, size in asdict(self).items():
            if size:
                unit, scale = next(iter(KINDS[name][1].items()))
                words.append(f"{name} {abs(size) / scale:.3g} {unit}".strip())
        return words

    def refuse(self, kinds: Iterable[str], reason: str, advice: str | None = None) -> None:
        """Raise InputError where the size of one of these kinds is not zero."""
        for name in kinds:
            if getattr(self, name):
                raise InputError(reason, element=f"perturb: {name}", advice=advice)


@dataclass(frozen=True, eq=False)
class Sample:
    """The robot of one run: factors of h, bodies' masses and inertias (njoints,), torques (m,), rise and friction.

    ``armature`` is in kg m^2; ``noise`` is the generator of the measurements' noise.
    """

    momentum: float
    mass: Array
    inertia: Array
    torque: Array
    rise: float
    friction: float
    armature: float
    noise: np.random.Generator

    def perturbed(self, model: Any) -> Any:
        """Return a copy of a ``pinocchio.Model`` with these masses and inertias."""
        model = model.copy()
        for joint in range(model.njoints):
            body = model.inertias[joint].copy()  # a new one would be refused where a moment of zero was rounded
            body.mass = body.mass * self.mass[joint]
            body.inertia = body.inertia * self.inertia[joint]
            model.inertias[joint] = body
        return model


def given_perturbation(perturb: str | Perturbation) -> Perturbation:
    """Return the perturbation that was passed, or read ``h=10%,inertia=5%,noise=0.1deg,delay=5ms``.

    Raises
    ------
    InputError
        A name is unknown or comes twice, or what follows is no number with one of its units.
    """
    if not isinstance(perturb, str):
        perturbation: Perturbation = made(Perturbation)(perturb, "perturb")
        return perturbation
    sizes: dict[str, float] = {}
    for item in filter(None, map(str.strip, perturb.split(","))):
        name, _, value = map(str.strip, item.partition("="))
        if name not in KINDS:
            raise InputError(f"cannot perturb {name!r}", element="perturb", advice=f"give {', '.join(KINDS)}")
        if name in sizes:
            raise InputError(f"{name} is given twice", element="perturb", advice="keep one of them")
        sizes[name] = KINDS[name][0](_number(name, value), f"perturb: {name}")
    return Perturbation(**sizes)


def _number(name: str, text: str) -> float:
    _, units = KINDS[name]
    longest_first = sorted(units, key=len, reverse=True)  # the last of them is ""
    unit = next(filter(text.endswith, longest_first))
    try:
        value = float(text.removesuffix(unit)) * units[unit]
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        shown = " or ".join(filter(None, units))
        raise InputError(f"{text!r} is no number with its unit", element=f"perturb: {name}", advice=f"units: {shown}")
    return value
