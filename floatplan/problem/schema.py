"""The tables of a problem file as pydantic models: which keys there are; :mod:`.values` says what each may hold."""

from __future__ import annotations

import math
from dataclasses import MISSING, fields
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, Union, get_type_hints

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, create_model

from floatplan.problem import parts as asked
from floatplan.problem.values import (
    Accelerations,
    Angle,
    AngularMomentum,
    Degree,
    JointAngles,
    Number,
    Place,
    PositionLimits,
    Velocities,
    any_of,
    limits_by_joint,
)
from floatplan.robot.robot import Coupling
from floatplan.tables import LIMIT_TABLE, Objective


class Table(BaseModel):
    """A table of the file: unknown keys are refused."""

    model_config = ConfigDict(defer_build=True, extra="forbid", frozen=True)


class CouplingTable(Table):
    """``{ leader = "q1", ratio = -1, offset = 0 }``."""

    leader: str
    ratio: Number = 1.0
    offset: Angle = 0.0

    def coupling(self) -> Coupling:
        """Return what the table says."""
        return Coupling(self.leader, self.ratio, self.offset)


CoupledJoint: TypeAlias = Annotated[
    Annotated[CouplingTable, Tag("<table>")] | Annotated[str, Tag("<word>")],
    any_of("the name of the joint that leads, or a table with leader, ratio, offset"),
]
CoupledJoints: TypeAlias = Annotated[
    Annotated[dict[str, CoupledJoint], Tag("<table>")] | Annotated[Literal["mirror"], Tag("<word>")],
    any_of("a table of joints and their leaders, or 'mirror'"),
]


class RobotTable(Table):
    """``[robot]``: the URDF and the choices that it leaves open."""

    urdf: str
    plane: str | None = None
    joints: list[str] | None = None
    coupled: CoupledJoints = Field(default_factory=dict)
    locked: dict[str, Angle] = Field(default_factory=dict)
    reference: str | None = None

    def choices(self) -> dict[str, Any]:
        """Return the keyword arguments of ``Robot.from_urdf``."""
        return {
            "plane": self.plane,
            "joints": self.joints,
            "coupled": self.coupled if isinstance(self.coupled, str) else self._couplings(self.coupled),
            "locked": dict(self.locked) or None,
            "reference": self.reference,
        }

    def _couplings(self, coupled: dict[str, CouplingTable | str]) -> dict[str, str | Coupling] | None:
        leaders = {name: leader if isinstance(leader, str) else leader.coupling() for name, leader in coupled.items()}
        return leaders or None


class PostureTable(Table):
    """``[start]`` or ``[goal]``."""

    orientation: Angle
    positions: JointAngles
    velocities: Velocities = 0.0
    accelerations: Accelerations = 0.0

    def posture(self) -> asked.Posture:
        """Return what the table says."""
        return asked.Posture.unchecked(**self.stated())

    def stated(self) -> dict[str, Any]:
        """The fields of the posture."""
        return {name: getattr(self, name) for name in ("orientation", "positions", "velocities", "accelerations")}


class RecordedPostureTable(PostureTable):
    """``start`` or ``goal`` of a plan file: with the words that its numbers stand for, where words were asked for."""

    velocities_asked: Literal["takeoff", "landing"] | None = None
    accelerations_asked: Literal["free"] | None = None

    def stated(self) -> dict[str, Any]:
        """The fields of the posture."""
        stated = super().stated()
        if not (self.velocities_asked or self.accelerations_asked):
            return stated
        return stated | {
            "velocities": self.velocities_asked or self.velocities,
            "accelerations": self.accelerations_asked or self.accelerations,
            "settled": (_numbers(self.velocities), _numbers(self.accelerations)),
        }


def _numbers(values: asked.JointValues | str) -> asked.JointValues | None:
    return None if isinstance(values, str) else values


class TakeoffTable(Table):
    """``takeoff = { frame = "foot", position = [0, 0] }``."""

    frame: str
    position: Place = (0.0, 0.0)

    def takeoff(self) -> asked.Takeoff:
        """Return what the table says."""
        return asked.Takeoff.unchecked(frame=self.frame, position=self.position)


class LandingTable(Table):
    """``landing = { frame = "hand", height = 0 }``."""

    frame: str
    height: Number | None = None

    def landing(self) -> asked.Landing:
        """Return what the table says."""
        return asked.Landing.unchecked(frame=self.frame, height=self.height)


class FlightTable(Table):
    """``[flight]``."""

    duration: Number
    angular_momentum: AngularMomentum = "midpoint"
    takeoff: TakeoffTable | None = None
    landing: LandingTable | None = None
    horizontal_velocity: Number = 0.0
    gravity: Number = 9.81

    def flight(self) -> asked.Flight:
        """Return what the table says."""
        return asked.Flight.unchecked(
            duration=self.duration,
            angular_momentum=self.angular_momentum,
            takeoff=self.takeoff.takeoff() if self.takeoff else None,
            landing=self.landing.landing() if self.landing else None,
            horizontal_velocity=self.horizontal_velocity,
            gravity=self.gravity,
        )


class MotionTable(Table):
    """``[motion]``."""

    degree: Degree = 7
    objective: Objective = "coefficients"

    def motion(self) -> asked.Motion:
        """Return what the table says."""
        return asked.Motion.unchecked(degree=self.degree, objective=self.objective)


class MotorTable(Table):
    """``{ stall = 8, slope = 0.4 }``."""

    stall: Number
    slope: Number


class _Limits(Table):
    """``[limits]``, less those of the table of limits that are by joint."""

    position: PositionLimits = "urdf"
    motor: dict[str, MotorTable] = Field(default_factory=dict)
    orientation_rate: Angle | None = None

    def limits(self) -> asked.Limits:
        """Return what the table says; ``null`` or ``"none"`` in a list is no limit."""
        by_joint = {key: _unlimited(getattr(self, key)) for key in _BY_JOINT}
        motors = {name: asked.Motor.unchecked(stall=each.stall, slope=each.slope) for name, each in self.motor.items()}
        return asked.Limits.unchecked(
            position=self.position, **by_joint, motor=motors, orientation_rate=self.orientation_rate
        )


_BY_JOINT: dict[str, Any] = {
    row.key: (limits_by_joint(Angle if row.unit.startswith("rad") else Number, row.in_urdf), "none")
    for row in LIMIT_TABLE.values()
    if row.of != "base"
}

if TYPE_CHECKING:

    class LimitsTable(_Limits):
        """``[limits]``."""
else:
    LimitsTable = create_model("LimitsTable", __base__=_Limits, **_BY_JOINT)


class RecordedLimitsTable(LimitsTable):
    """``limits`` of a plan file: where a joint has several motors, with the limit of each one's own torque."""

    motor_torque: dict[str, Number] | None = None

    def limits(self) -> asked.Limits:
        """Return what the table says; the motors' own limits contain those of the generalised torques."""
        limits = super().limits()
        return limits if self.motor_torque is None else limits.changed(torque=self.motor_torque)


def _unlimited(values: Any) -> Any:
    return [math.inf if value in (None, "none") else value for value in values] if isinstance(values, list) else values


class ObstacleTable(Table):
    """One of ``[[obstacles]]``: its kind, and the fields of that kind's class."""

    kind: str

    def obstacle(self) -> asked.Obstacle:
        """Return what the table says."""
        values = {name: getattr(self, name) for name in type(self).model_fields if name != "kind"}
        return asked.OBSTACLE_KINDS[self.kind].unchecked(**values)


_TYPES: dict[Any, Any] = {float: Number, tuple[float, float]: Place, tuple[float, float] | None: Place | None}


def _obstacle_table(kind: type[asked.Obstacle]) -> type[ObstacleTable]:
    """The table whose keys are the fields of a class of obstacles."""
    hints = get_type_hints(kind)
    keys: dict[str, Any] = {
        each.name: (_TYPES[hints[each.name]], ... if each.default is MISSING else each.default) for each in fields(kind)
    }
    keys["kind"] = (Literal[kind.kind], ...)
    table: type[ObstacleTable] = create_model(f"{kind.__name__}Table", __base__=ObstacleTable, **keys)
    return table


def _obstacle_kind(value: Any) -> str | None:
    kind = value.get("kind") if isinstance(value, dict) else None
    return f"<{kind}>" if isinstance(kind, str) else None


def _any_obstacle() -> Any:
    """The tables of all kinds, told apart by their kind."""
    tagged = [Annotated[_obstacle_table(known), Tag(f"<{kind}>")] for kind, known in asked.OBSTACLE_KINDS.items()]
    *first, last = map(repr, asked.OBSTACLE_KINDS)
    message = f"is not a table with kind = {', '.join(first)} or {last}"
    told = Discriminator(_obstacle_kind, custom_error_type="wrong_kind", custom_error_message=message)
    return Annotated[Union[tuple(tagged)], told]  # noqa: UP007


if TYPE_CHECKING:
    AnyObstacle: TypeAlias = ObstacleTable
else:
    AnyObstacle = _any_obstacle()


class SelfClearanceTable(Table):
    """``[[self_clearance]]``."""

    links: tuple[str, str]
    margin: Number = 0.0


class ProblemTable(Table):
    """A problem file less its ``[robot]``."""

    name: Annotated[str, Field(min_length=1)] | None = None
    angles: Literal["rad", "deg"] = "rad"
    ground: Annotated[bool, Field(strict=True)] = False
    start: PostureTable
    goal: PostureTable
    flight: FlightTable
    motion: MotionTable = Field(default_factory=MotionTable)
    limits: LimitsTable = Field(default_factory=LimitsTable)
    obstacles: list[AnyObstacle] = Field(default_factory=list)
    self_clearance: list[SelfClearanceTable] = Field(default_factory=list)


class RecordedProblemTable(ProblemTable):
    """The problem in a plan file."""

    start: RecordedPostureTable
    goal: RecordedPostureTable
    limits: RecordedLimitsTable = Field(default_factory=RecordedLimitsTable)


class ProblemFileTable(ProblemTable):
    """A whole problem file."""

    robot: RobotTable


class RobotFileTable(Table):
    """A file that names a robot, and asks nothing of it yet."""

    name: str | None = None
    angles: Literal["rad", "deg"] = "rad"
    robot: RobotTable
