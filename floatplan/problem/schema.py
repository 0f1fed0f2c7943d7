"""The tables of a problem file: the parts of a problem, and what is in no part of one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, TypeAlias

from floatplan.arguments import FINITE, by_name
from floatplan.keys import ANGLE, Key, Keyed, json_schema, tables
from floatplan.problem.jump import JumpRequest
from floatplan.problem.parts import Flight, Limits, Motion, Obstacle, Posture, SelfClearance
from floatplan.robot.robot import Coupling

Unit: TypeAlias = Annotated[Literal["rad", "deg"], Key("Unit of all angles and rates in this file")]
Name: TypeAlias = Annotated[
    str | None, Key("Of the problem, and of the folder of its results; the file's name where left out")
]


@dataclass(frozen=True)
class RobotRequest(Keyed):
    """``[robot]``: the URDF and the choices that it leaves open."""

    urdf: Annotated[str, Key("Path from this file's folder, or `example-robot-data:` and a path in that package")]
    plane: Annotated[
        str | None, Key('Horizontal and vertical axis, such as "xz"; found from the joints where left out')
    ] = None
    joints: Annotated[
        Sequence[str] | None,
        Key("Joints to plan, in the order of all lists; all that turn about the plane's normal if left out"),
    ] = None
    coupled: Annotated[
        Mapping[str, str | Coupling] | Literal["mirror"],
        Key('Joints that follow others: a leader\'s name (with a minus, mirrored), a table, or "mirror"'),
    ] = field(default_factory=dict)
    locked: Annotated[
        Mapping[str, float],
        Key("Joints that stay where they are, by name", f"{ANGLE}, m of those that slide", check=by_name(FINITE)),
    ] = field(default_factory=dict)
    reference: Annotated[
        str | None, Key("Posture of an SRDF file beside the URDF, where joints that are not planned are locked")
    ] = None
    armature: Annotated[
        float | Mapping[str, float] | None,
        Key("Inertia of rotors as their joints feel it: of every motor, or by joint", "kg m^2"),
    ] = None
    damping: Annotated[
        float | Mapping[str, float] | None,
        Key("Torque lost by a joint's rate, in simulators: of every motor, or by joint", "N m s/rad"),
    ] = None

    def choices(self) -> dict[str, Any]:
        """Return the keyword arguments of ``Robot.from_urdf``."""
        chosen = {name: getattr(self, name) for name in self.keys if name != "urdf"}
        return {**chosen, "coupled": self.coupled or None, "locked": self.locked or None}


@dataclass(frozen=True, kw_only=True)
class ProblemTables(Keyed):
    """A problem file less its ``[robot]``."""

    name: Name = None
    angles: Unit = "rad"
    ground: Annotated[bool, Key("Whether the robot stays above the line that it takes off from")] = False
    start: Annotated[Posture, Key("Takeoff")]
    goal: Annotated[Posture, Key("Landing")]
    flight: Annotated[Flight, Key("The flight")]
    motion: Annotated[Motion, Key("How joints may move, and what is best")] = field(default_factory=Motion)
    limits: Annotated[Limits, Key("What motors and joints can do, at all times")] = field(default_factory=Limits)
    obstacles: Annotated[Sequence[Obstacle], Key("What to keep clear of")] = ()
    self_clearance: Annotated[Sequence[SelfClearance], Key("Two links to keep apart")] = ()
    jump: Annotated[JumpRequest | None, Key("A whole jump around the flight, [jumps](jump.md)")] = None


@dataclass(frozen=True, kw_only=True)
class ProblemFile(ProblemTables):
    """A whole problem file."""

    robot: Annotated[RobotRequest, Key("The robot: its URDF, and the choices that it leaves open")]


@dataclass(frozen=True, kw_only=True)
class RobotFile(Keyed):
    """A file that names a robot, and asks nothing of it yet."""

    name: Name = None
    angles: Unit = "rad"
    robot: Annotated[RobotRequest, Key("The robot")]


ABOUT = "The whole file"
TABLES: dict[str, tuple[type[Keyed], str]] = {  # by their places, with what they are about; the robot's first
    "": (ProblemFile, ABOUT),
    **dict(sorted(tables(ProblemFile).items(), key=lambda table: not table[0].startswith("robot"))),
}


def problem_schema() -> dict[str, Any]:
    """Return the JSON Schema of problem files, for editors."""
    return json_schema(ProblemFile, "floatplan problem", ABOUT)
