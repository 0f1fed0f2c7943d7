"""What a problem can limit and minimise: one row each, read by problem files, search, certificate, pictures and help.

A row names its quantity as :class:`~floatplan.motion.flight_state.FlightState` does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

Objective: TypeAlias = Literal["coefficients", "torque", "acceleration"]


@dataclass(frozen=True)
class ObjectiveRow:
    """What can be minimised.

    Attributes
    ----------
    unit : of its value
    description : for a person
    quantity : the joints' quantity whose square is integrated over the flight; None for the norm of (17)
    """

    unit: str
    description: str
    quantity: str | None = None


OBJECTIVE_TABLE: dict[Objective, ObjectiveRow] = {
    "coefficients": ObjectiveRow("mixed", "norm of the polynomials' coefficients"),
    "torque": ObjectiveRow("N^2 m^2 s", "integral of the squared joint torques", "torques"),
    "acceleration": ObjectiveRow("rad^2/s^3", "integral of the squared joint accelerations", "accelerations"),
}
OBJECTIVES: tuple[Objective, ...] = get_args(Objective)


LimitKey: TypeAlias = Literal["velocity", "acceleration", "torque", "orientation_rate"]


@dataclass(frozen=True)
class LimitRow:
    """A limit of the magnitude of a quantity, at all times.

    Attributes
    ----------
    key : in ``[limits]``; findings are about ``<key> <joint>``, peaks and utilisations begin with it
    quantity : what is limited
    unit : of quantity and limit
    title : above its curves
    of : "joints", "motors" or "base": whose quantity it is
    in_urdf : whether "urdf" stands for the URDF's own
    always : whether it is proved and drawn also where nothing limits it, and plan files claim its peaks
    base : quantity of the base that is drawn with that of the joints
    """

    key: LimitKey
    quantity: str
    unit: str
    title: str
    of: Literal["joints", "motors", "base"]
    in_urdf: bool = False
    always: bool = False
    base: str | None = None


_LIMITS = (
    LimitRow("velocity", "velocities", "rad/s", "Rates", "joints", in_urdf=True, always=True, base="orientation_rate"),
    LimitRow("acceleration", "accelerations", "rad/s^2", "Accelerations", "joints"),
    LimitRow("torque", "motor_torques", "N m", "Torques", "motors", in_urdf=True, always=True),
    LimitRow("orientation_rate", "orientation_rate", "rad/s", "Rates", "base"),
)
LIMIT_TABLE: dict[LimitKey, LimitRow] = {row.key: row for row in _LIMITS}
JOINT_LIMITS: tuple[LimitRow, ...] = tuple(row for row in _LIMITS if row.of == "joints")
