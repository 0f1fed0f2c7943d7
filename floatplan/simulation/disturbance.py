"""What goes wrong in a replay on purpose: a wrong takeoff, masses that are not as stated, weak motors; and feedback."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, read_only
from floatplan.errors import InputError
from floatplan.simulation.held_model import BASE, HeldModel

LARGEST = 0.9  # [-] of a relative error: masses and torques keep their sign


@dataclass(frozen=True)
class Disturbance:
    """Relative errors: of the angular momentum at takeoff, of the bodies' masses, of the joints' torques.

    Masses (with their inertias) and torques each become larger or smaller by that much, by a coin tossed with ``seed``.
    """

    h: float = 0.0
    mass: float = 0.0
    torque: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("h", "mass", "torque"):
            if not abs(getattr(self, name)) <= LARGEST:
                raise InputError(f"an error of {getattr(self, name):.3g} is more than {LARGEST:.0%}", element=name)

    @property
    def any(self) -> bool:
        """Whether something is wrong at all."""
        return any((self.h, self.mass, self.torque))

    def factors(self, count: int, error: float) -> Array:
        """Return factors (count,), ``1 + error`` or ``1 - error``."""
        return np.asarray(1.0 + error * np.random.default_rng(self.seed).choice((-1.0, 1.0), count))

    def disturbed(self, held: HeldModel) -> Any:
        """Return a copy of the model with other masses."""
        model = held.model.copy()
        if self.mass:
            for joint, factor in enumerate(self.factors(model.njoints, self.mass)):
                body = model.inertias[joint]
                model.inertias[joint] = pin.Inertia(body.mass * factor, body.lever, body.inertia * factor)
        return model


def parse_disturbance(text: str, seed: int = 0) -> Disturbance:
    """Read ``h=1%,mass=2%,torque=0.01``.

    Raises
    ------
    InputError
        A name is unknown or comes twice, or what follows is no number.
    """
    errors: dict[str, float] = {}
    for part in filter(None, (part.strip() for part in text.split(","))):
        name, _, value = (word.strip() for word in part.partition("="))
        if name not in ("h", "mass", "torque"):
            raise InputError(f"{name!r} cannot be perturbed", element="perturb", advice="known are h, mass, torque")
        if name in errors:
            raise InputError(f"{name} is given twice", element="perturb")
        errors[name] = _relative(name, value)
    return Disturbance(**errors, seed=seed)


def _relative(name: str, text: str) -> float:
    try:
        value = float(text.removesuffix("%")) / (100.0 if text.endswith("%") else 1.0)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{text!r} is not a number", element=f"perturb: {name}", advice="write it as 1% or 0.01")
    return value


@dataclass(frozen=True, eq=False)
class Feedback:
    """Joint torques that pull the joints to their paths: ``stiffness (q_d - q) + damping (q_d' - q')``, (m,) each."""

    stiffness: Array
    damping: Array

    def torques(self, position_error: Array, velocity_error: Array) -> Array:
        """Torques (m,), N m."""
        return np.asarray(self.stiffness * position_error + self.damping * velocity_error)


def feedback_of(held: HeldModel, posture: Array, bandwidth: float) -> Feedback:
    """Return critically damped gains for a bandwidth, rad/s, from the inertia that each joint turns at a posture.

    That inertia is ``1 / (M^-1)_jj``: what a torque on the joint alone feels while the robot floats.
    """
    if not 0.0 < bandwidth < math.inf:
        raise InputError(f"{bandwidth} rad/s is not positive", element="feedback")
    inverse = pin.computeMinverse(held.model, held.model.createData(), np.asarray(posture))
    inertia = 1.0 / np.diagonal(inverse)[BASE:]
    return Feedback(read_only(bandwidth**2 * inertia), read_only(2.0 * bandwidth * inertia))
