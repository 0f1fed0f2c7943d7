"""What corrections in flight hand back: what became of a measurement, and what the joints are to do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal, TypeAlias

from floatplan.arguments import Outlined
from floatplan.arrays import Array
from floatplan.inflight.motion import RemainingMotion
from floatplan.inflight.update import Corrected

REACHED = 0.01  # [rad] of the goal: a landing within half a degree

Status: TypeAlias = Literal["applied", "limited", "refused", "invalid"]


@dataclass(frozen=True, eq=False, repr=False)
class Correction(Outlined):
    """What became of a measurement.

    Attributes
    ----------
    status : "applied", "limited", "refused" or "invalid"
        The motion was corrected, keeps all limits and obstacles and lands within ``REACHED`` of the goal; it was
        corrected in part, or lands further off, or breaks a limit that the last one breaks too; no part of a correction
        keeps the limits and the last motion stays; the measurement cannot be one, or is late, and changes nothing.
    reason : why it is not "applied"
    landing : s
        When the robot lands.
    angular_momentum : kg m^2/s
        As it is estimated.
    """

    status: Status
    reason: str
    corrected: Corrected
    landing: float
    angular_momentum: float
    shown: ClassVar[Sequence[str]] = ("status", "reason", "predicted_miss", "landing", "angular_momentum")

    @property
    def motion(self) -> RemainingMotion:
        """The joints' motion from now on."""
        return self.corrected.motion

    @property
    def predicted_miss(self) -> float:
        """Orientation at landing less the goal, under that motion, rad."""
        return self.corrected.miss

    @property
    def torque_peak(self) -> Array:
        """Largest magnitude (m,) N m of each motor's torque for the rest of the flight, in ``robot.motors``' order."""
        return self.corrected.prediction.torque_peak


@dataclass(frozen=True, eq=False, repr=False)
class Reference(Outlined):
    """What the joints are to do at a time.

    Attributes
    ----------
    positions, velocities, accelerations : (n,) rad, rad/s, rad/s^2
    feedforward : (n,) N m
        Generalised torques: a leader's moves its followers too.
    motors : (m,) N m
        Each motor's own torque, in the order of ``robot.motors``.
    """

    positions: Array
    velocities: Array
    accelerations: Array
    feedforward: Array
    motors: Array
