"""Disturbances of a replay (of h at takeoff, of masses, of torques), and joint feedback against them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin

from floatplan.arguments import SEED, Check, Checked, number
from floatplan.arrays import Array, read_only
from floatplan.errors import InputError
from floatplan.robot.planar.model import BASE_COORDINATES
from floatplan.simulation.reduced_model import ReducedModel
from floatplan.tables import Range

FASTEST = 1e4  # [rad/s] bandwidth of feedback
LARGEST = 0.9  # [-] of a relative error: masses and torques keep their sign


@dataclass(frozen=True)
class Disturbance(Checked):
    """Relative errors: of the angular momentum at takeoff, of the bodies' masses, of the joints' torques.

    Masses (with their inertias) and torques each become larger or smaller by that much, by a coin tossed with ``seed``.
    """

    h: float = 0.0
    mass: float = 0.0
    torque: float = 0.0
    seed: int = 0
    checks: ClassVar[Mapping[str, Check]] = {
        **dict.fromkeys(("h", "mass", "torque"), number(Range(-LARGEST, LARGEST, ""))),
        "seed": SEED,
    }

    @property
    def any(self) -> bool:
        """Whether any of them is not zero."""
        return any((self.h, self.mass, self.torque))

    def factors(self, count: int, error: float) -> Array:
        """Return factors (count,), ``1 + error`` or ``1 - error``."""
        return np.asarray(1.0 + error * np.random.default_rng(self.seed).choice((-1.0, 1.0), count))

    def disturbed(self, reduced: ReducedModel) -> Any:
        """Return a copy of the model with other masses."""
        model = reduced.model.copy()
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
        A name is unknown or comes twice, or what follows is not a number.
    """
    errors: dict[str, float] = {}
    for part in filter(None, (part.strip() for part in text.split(","))):
        name, _, value = (word.strip() for word in part.partition("="))
        if name not in ("h", "mass", "torque"):
            raise InputError(f"cannot disturb {name!r}", element="perturb", advice="give h, mass or torque")
        if name in errors:
            raise InputError(f"{name} is given twice", element="perturb", advice="keep one of them")
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


def feedback_of(reduced: ReducedModel, posture: Array, bandwidth: float) -> Feedback:
    """Return critically damped gains for a bandwidth, rad/s, from the inertia that each joint turns at a posture.

    That inertia is ``1 / (M^-1)_jj``: what a torque on the joint alone feels while the robot floats.
    """
    inverse = pin.computeMinverse(reduced.model, reduced.model.createData(), np.asarray(posture))
    inertia = 1.0 / np.diagonal(inverse)[BASE_COORDINATES:]
    return Feedback(read_only(bandwidth**2 * inertia), read_only(2.0 * bandwidth * inertia))
