"""What a problem can limit and minimise, and how large its numbers may be: one row each, read by all rooms.

A row names its quantity as :class:`~floatplan.motion.dynamics.FlightState` does.
"""

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

# What is satisfied: one tolerance for one statement, the same for search and certificate. The search aims inside its
# constraints (``back_off`` of ``kernel/tolerances.py``); what it ends with is judged by these, as the certificate does.
ORIENTATION = 1e-8  # [rad] at the end of the flight
BOUNDARY = (1e-8, 1e-7, 1e-5)  # [rad, rad/s, rad/s^2] of (13)
CLEARANCE = 1e-8  # [m] also of the frames and feet at takeoff and landing, where it is 0
POINT_FEET = 4e-3  # [m] that feet may be in the ground where a jump stands on points: they rotate about their frames
FRAME_SPEED = 1e-9  # [m/s] of a frame that leaves or meets the ground still
# [m/s] of one whose rates a file gives in six digits: an upward 1 m/s^2 stops it within CLEARANCE.
ROUNDED_FRAME_SPEED = 1e-4
RELATIVE = 1e-9  # [-] of every limit of a magnitude: velocity, acceleration, torque, orientation rate
RANGE = 1e-12  # [rad] of joint ranges
# [rad] of three angles about axes; near 90 degrees the first and the third are not defined.
LARGEST_MIDDLE_ANGLE = math.radians(70)
A_TURN_OFF = 1.0  # [rad] from the requested angles: less is what the search corrects, more are other rotations

# The event at an end of the flight, and the word for rates of a still frame.
FLIGHT_EVENTS: dict[str, Literal["takeoff", "landing"]] = {"start": "takeoff", "goal": "landing"}

GRAVITY = 9.81  # [m/s^2] unless a problem says another
LARGEST_TILT = 1e-3  # [rad] between an axis and the normal that it is taken for: "1.5708" for pi/2 is 4e-6 off
INDEPENDENT = 1e-3  # [-] sine of the angle between axes, or volume that three unit vectors span: below it, they are one
FREE_TYPES = ("floating", "planar")  # of a URDF's joints: those with more than one degree of freedom
JOINT_VALUES = ("positions", "velocities", "accelerations")  # what a state says of the joints

Base: TypeAlias = Literal["planar", "free-flyer"]  # how a robot's base moves
Unit: TypeAlias = Literal["rad", "deg"]  # of angles
RobotKind: TypeAlias = Literal["urdf", "mjcf"]  # what a robot's file is
ROBOT_KINDS: tuple[RobotKind, ...] = get_args(RobotKind)

Objective: TypeAlias = Literal["coefficients", "torque", "acceleration", "clip", "robust"]


@dataclass(frozen=True)
class ObjectiveRow:
    """What can be minimised.

    Attributes
    ----------
    unit : of its value
    description : for a person
    quantity : the joints' quantity whose square is integrated over the flight; None for the norm of (17), for how far
        the joints are from a recorded motion, and for how errors at takeoff grow
    """

    unit: str
    description: str
    quantity: str | None = None


OBJECTIVE_TABLE: dict[Objective, ObjectiveRow] = {
    "coefficients": ObjectiveRow("mixed", "norm of the polynomials' coefficients"),
    "torque": ObjectiveRow("N^2 m^2 s", "integral of the squared joint torques", "torques"),
    "acceleration": ObjectiveRow("rad^2/s^3", "integral of the squared joint accelerations", "accelerations"),
    "clip": ObjectiveRow("rad", "root mean square of the joints' differences from a recorded motion, clip"),
    "robust": ObjectiveRow("rad", "size of the motion and of what errors at takeoff grow to, in space"),
}
OBJECTIVES: tuple[Objective, ...] = (
    "coefficients",
    "torque",
    "acceleration",
)  # in a plane and in space, that need nothing but the problem


def describe_objectives(mark: str = "") -> str:
    """Name, meaning and unit of all objectives in a line, each name between two marks."""
    rows = [f"{mark}{name}{mark}: {row.description} ({row.unit})" for name, row in OBJECTIVE_TABLE.items()]
    return "; ".join(rows)


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
    of : "joints", "motors" or "base": whose quantity it is; of motors their torques alone, of the base its rate
    in_urdf : whether "urdf" stands for the URDF's own
    always : whether it is proved and plotted also where nothing limits it, and plan files claim its peaks
    base : quantity of the base that is plotted with that of the joints
    """

    key: LimitKey
    quantity: str
    unit: str
    title: str
    of: Literal["joints", "motors", "base"]
    in_urdf: bool = False
    always: bool = False
    base: str | None = None

    def __post_init__(self) -> None:
        quantities = {"motors": "motor_torques", "base": "orientation_rate"}
        if self.quantity != quantities.get(self.of, self.quantity):
            raise ValueError(f"a limit of {self.of} is of {quantities[self.of]}, not of {self.quantity}")


_LIMITS = (
    LimitRow("velocity", "velocities", "rad/s", "Rates", "joints", in_urdf=True, always=True, base="orientation_rate"),
    LimitRow("acceleration", "accelerations", "rad/s^2", "Accelerations", "joints"),
    LimitRow("torque", "motor_torques", "N m", "Torques", "motors", in_urdf=True, always=True),
    LimitRow("orientation_rate", "orientation_rate", "rad/s", "Rates", "base"),
)
LIMIT_TABLE: dict[LimitKey, LimitRow] = {row.key: row for row in _LIMITS}
JOINT_LIMITS: tuple[LimitRow, ...] = tuple(row for row in _LIMITS if row.of == "joints")


LEAST = math.ulp(0.0)  # the least number above zero


@dataclass(frozen=True)
class Range:
    """Numbers from ``low`` to ``high``, both included, in ``unit``."""

    low: float
    high: float
    unit: str

    def __str__(self) -> str:
        """As a message says it."""
        return f"{0.0 if self.low == LEAST else self.low:g} to {self.high:g} {self.unit}".rstrip()


def _within(largest: float, unit: str) -> Range:
    return Range(-largest, largest, unit)


MOST_OBSTACLES = 200  # [-] of a problem, and as many pairs of links to keep apart
# What every number of a problem or plan file may be, by key: beyond it nobody means what is written, and doubles
# overflow. URDF files have their own bounds, floatplan.robot.urdf.tree.
RANGES: dict[str, Range] = {
    "duration": Range(1e-3, 1e3, "s"),
    "orientation": _within(1e4, "rad"),
    "quaternion_xyzw": _within(1e6, ""),
    "positions": _within(1e4, "rad"),
    "velocities": _within(1e8, "rad/s"),
    "accelerations": _within(1e12, "rad/s^2"),
    "angular_momentum": _within(1e9, "kg m^2/s"),
    "horizontal_velocity": _within(1e4, "m/s"),
    "gravity": Range(0.0, 1e4, "m/s^2"),
    "place": _within(1e6, "m"),  # also of keys that are not here
    "position": _within(1e6, "m"),
    "height": _within(1e6, "m"),
    "radius": Range(0.0, 1e6, "m"),
    "margin": Range(0.0, 1e3, "m"),
    "velocity": _within(1e4, "m/s"),
    "window": _within(1e6, "s"),
    "limit": Range(1e-9, 1e12, ""),
    "slope": Range(0.0, 1e12, "N m s/rad"),
    "armature": Range(0.0, 1e6, "kg m^2"),
    "mass": Range(1e-15, 1e9, "kg"),
    "damping": Range(0.0, 1e9, "N m s/rad"),
}
