"""What a problem can limit and minimise, how large its numbers may be, and what keys mean that several rooms describe.

One row each, read by all rooms, and by ``floatplan --help``: this module imports nothing that takes long. A row names
its quantity as :class:`~floatplan.motion.dynamics.FlightState` does.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias, get_args

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


# Names among which arguments and options choose, and what each stands for.
Engine: TypeAlias = Literal["pinocchio", "mujoco"]
StanceMethod: TypeAlias = Literal["bent", "planned"]
RepairName: TypeAlias = Literal["retime", "raise", "auto"]
CHOICES: Mapping[str, Mapping[str, str]] = {
    "method": {"kernel": "floatplan's own", "reference": "the paper's, in Python"},
    "simulator": {"pinocchio": "in the air only", "mujoco": "on the ground too, as jumps need"},
    "workers": {"processes": "of this machine", "dask": "for many machines"},
    "stances": {"bent": "to meet the flights", "planned": "within friction, torques and rates, by CasADi"},
    "repair": {
        "retime": "postures and heights stay",
        "raise": "the duration stays",
        "auto": "retime where limits hold, else raise",
    },
    "quaternion": {"xyzw": "the scalar last", "wxyz": "the scalar first"},
}


def describe_objectives(mark: str = "") -> str:
    """Name, meaning and unit of all objectives in a line, each name between two marks."""
    rows = [f"{mark}{name}{mark}: {row.description} ({row.unit})" for name, row in OBJECTIVE_TABLE.items()]
    return "; ".join(rows)


# What an angular momentum may be instead of a number: in a plane, and in a plane or in space.
MomentumWordInPlane: TypeAlias = Literal["midpoint", "free"]
MomentumWord: TypeAlias = Literal[MomentumWordInPlane, "suggested"]
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
LARGEST_SEED = 2**63 - 1  # [-] the largest 64-bit integer
LOWEST_DEGREE = 5  # [-] that the six boundary conditions (13) take
HIGHEST_DEGREE = 15  # [-] above it, the doubles of a plan file no longer hold (13) and the orientation to 1e-8 rad


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
    "friction": Range(0.0, 10.0, ""),
    "edge": Range(-10.0, 10.0, "m"),
    "degree": Range(LOWEST_DEGREE, HIGHEST_DEGREE, ""),
    "starts": Range(1, 1000, ""),  # of a search, a jump or a row of a study
    "seed": Range(0, LARGEST_SEED, ""),
    "count": Range(1, LARGEST_SEED, ""),  # of what a study has
}

ANGLE = "rad or deg"
RATE = "rad/s or deg/s"
ACCELERATION = "rad/s^2 or deg/s^2"


@dataclass(frozen=True)
class Key:
    """A key of a table in files, as metadata of its field's type.

    Attributes
    ----------
    meaning : for a person; what the class's docstring says of the parameter follows it in files
    unit : empty where it has none; angles are in the file's unit
    numbers : range of its numbers, or its key in :data:`RANGES`; that of its own name if left out, and a pair without
        one has that of a position
    check : of the field, from a value and the element that a message names to the value stored, where its type and its
        numbers do not say all
    default : of the field, of a key in :data:`KEY_TABLE`
    """

    meaning: str = ""
    unit: str = ""
    numbers: str | Range = ""
    check: Callable[[Any, str], Any] | None = None
    default: Any = None

    @property
    def about(self) -> str:
        """Meaning and unit."""
        return f"{self.meaning} [{self.unit}]" if self.unit else self.meaning

    def bounds(self, name: str = "") -> Range | None:
        """Return the range that it names, or that of a name; None of angles, whose unit a file chooses."""
        allowed = self.numbers or name
        limits = RANGES.get(allowed) if isinstance(allowed, str) else allowed
        return limits if limits is not None and limits.unit == self.unit else None

    def with_check(self, check: Callable[[Any, str], Any]) -> "Key":
        """Return the same key with a check of its own."""
        return replace(self, check=check)


# Keys of problem and study files that the command line has options for, by their paths. The records of files take
# their rows from here, and say in their docstrings only what is of files.
KEY_TABLE: Mapping[str, Key] = {
    "angles": Key("Unit of all angles and rates", default="rad"),
    "start": Key("Orientation and joints at takeoff"),
    "goal": Key("Orientation and joints at landing"),
    **dict.fromkeys(
        ("start.velocities", "goal.velocities"),
        Key(
            'Rates of the joints, written as positions are; or "takeoff" at the start, "landing" at the goal: those '
            "with which the frame leaves, or meets, the still ground",
            RATE,
            default=0.0,
        ),
    ),
    **dict.fromkeys(
        ("start.accelerations", "goal.accelerations"),
        Key('Accelerations of the joints, written as positions are; or "free"', ACCELERATION, default=0.0),
    ),
    "flight.duration": Key("Time from takeoff to landing", "s", "duration"),
    "flight.angular_momentum": Key(
        'About the centre of mass: a number, in space three; or "midpoint", "suggested" or, chosen by the '
        'search, "free"',
        "kg m^2/s",
        default="midpoint",
    ),
    "flight.takeoff.frame": Key("Link or joint that leaves the ground last"),
    "flight.landing.frame": Key("Link or joint that meets the ground first"),
    "flight.horizontal_velocity": Key("Of the centre of mass", "m/s", default=0.0),
    "motion.degree": Key(
        'Degree of the polynomials: one number for all joints, one for each, or "auto"', numbers="degree", default=7
    ),
    "motion.objective": Key(f"What is least. {describe_objectives('`')}", default="coefficients"),
    "robot.plane": Key('Horizontal and vertical axis, such as "xz"; chosen by the joints where left out'),
    "robot.coupled": Key(
        'Joints that follow others: a leader\'s name, with a minus where mirrored; or "mirror", left and right'
    ),
    "robot.locked": Key("Joints that stay where they are, by name", "as `angles`; m of those that slide"),
    "robot.reference": Key(
        "Posture of an SRDF file next to the URDF, or keyframe of the MJCF, where joints not planned are locked"
    ),
    "robot.balance_inertias": Key(
        "Inertias that no body can have get equal principal moments, as MuJoCo's balanceinertia does"
    ),
    **dict.fromkeys(
        ("jump.takeoff.contacts", "jump.landing.contacts"),
        Key("Frames that stand in each phase, one or two in order of time, with those coupled to them"),
    ),
    "jump.takeoff.from": Key("Posture in which it stands, the base level", ANGLE, "positions", default="standing"),
    "jump.friction": Key(
        "Coefficient of the ground's friction", numbers=Range(LEAST, RANGES["friction"].high, ""), default=0.6
    ),
    "result.folder": Key("Where results go, from the working directory; else runs/<name of the study>"),
}
