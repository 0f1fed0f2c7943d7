"""What a problem is made of: states, flight, motion, limits and obstacles, as the user gives them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Literal, Self, TypeAlias

from floatplan.arguments import (
    FINITE,
    Check,
    Checked,
    by_joint,
    by_name,
    made,
    number,
    one_of,
    optional,
    pair,
    text,
    whole,
)
from floatplan.arrays import Array
from floatplan.tables import LIMIT_TABLE, OBJECTIVES, REST, Objective, Range

JointValues: TypeAlias = Mapping[str, float] | Sequence[float] | Array | float
PLACE = pair(number("place"))
DIRECTION = pair(number("place"))

SHORTEST_NORMAL = 1e-9  # as written
LOWEST_DEGREE = 5
TOO_STIFF = "six boundary conditions per joint need degree 5; one more at least is needed to steer, (16)"
HIGHEST_DEGREE = 15  # above it, the doubles of a plan file no longer hold (13) and the orientation to 1e-8 rad


@dataclass(frozen=True, eq=False)
class Posture(Checked):
    """Base orientation and joints at one end of the flight, as the user gives them.

    Parameters
    ----------
    orientation : float
        Absolute angle of the base, rad; unbounded, 2 pi more is one somersault more.
    positions, velocities, accelerations : mapping, (n,) sequence, or one number for all joints
        rad, rad/s, rad/s^2.

        Velocities may be "takeoff" at the start and "landing" at the goal: those with which the takeoff frame leaves,
        or the landing frame meets, the ground at rest, with the least largest share of the joints' limits. They follow
        from the angular momentum. Accelerations may be "free".
    settled : pair of (n,) sequences, optional
        Velocities and accelerations that a plan has come to, where these are words; the planner fills it in.
    """

    orientation: float
    positions: JointValues
    velocities: JointValues | Literal["takeoff", "landing"] = 0.0
    accelerations: JointValues | Literal["free"] = 0.0
    settled: tuple[JointValues | None, JointValues | None] | None = None
    checks: ClassVar[Mapping[str, Check]] = {
        "orientation": number("orientation"),
        "positions": by_joint(number("positions")),
        "velocities": by_joint(number("velocities"), *REST.values()),
        "accelerations": by_joint(number("accelerations"), "free"),
        "settled": optional(pair(optional(by_joint(FINITE)), "sequences")),
    }

    @classmethod
    def degrees(
        cls,
        orientation: float,
        positions: JointValues,
        velocities: JointValues | Literal["takeoff", "landing"] = 0.0,
        accelerations: JointValues | Literal["free"] = 0.0,
    ) -> Posture:
        """Return the posture whose angles and rates are given in degrees: deg, deg/s, deg/s^2.

        Raises
        ------
        InputError
            A number is none, or out of its range.
        """
        converted = by_joint(_radians, *REST.values(), "free")
        return cls(
            _radians(orientation, "orientation"),
            converted(positions, "positions"),
            converted(velocities, "velocities"),
            converted(accelerations, "accelerations"),
        )


def _radians(degrees: float, element: str) -> float:
    return math.radians(FINITE(degrees, element))


@dataclass(frozen=True, eq=False)
class JointState:
    """A :class:`Posture` resolved to arrays (n,) in the order of the robot's joints.

    ``frame_rests`` where the velocities are those with which the frame is at rest, ``free_accelerations`` where the
    search chooses them: NaN until a plan has settled them.
    """

    orientation: float
    positions: Array
    velocities: Array
    accelerations: Array
    frame_rests: bool = False
    free_accelerations: bool = False


@dataclass(frozen=True)
class Takeoff(Checked):
    """The frame that leaves the ground last, and where it is at t = 0, m (horizontal, vertical)."""

    frame: str
    position: tuple[float, float] = (0.0, 0.0)
    checks: ClassVar[Mapping[str, Check]] = {"frame": text, "position": PLACE}


@dataclass(frozen=True)
class Landing(Checked):
    """The frame that lands first, and its height at t = T, m.

    Left out, its link's shapes rest on the ground where the problem has one; else the height is 0.
    """

    frame: str
    height: float | None = None
    checks: ClassVar[Mapping[str, Check]] = {"frame": text, "height": optional(number("height"))}


@dataclass(frozen=True)
class Flight(Checked):
    """The flight as a whole.

    Parameters
    ----------
    duration : float
        Time from takeoff to landing, s.
    angular_momentum : float, "midpoint" or "free"
        About the centre of mass and the plane's normal, kg m^2/s; the midpoint of (9) is (10). Where it is free the
        search chooses it, in (9) or outside.
    takeoff, landing : optional
        Left out, the base link takes off from the origin, and the takeoff frame lands: at the height it left, or
        resting on the ground where the problem has one.
    horizontal_velocity : float
        Of the centre of mass, m/s.
    gravity : float
        m/s^2, downwards positive.
    """

    duration: float
    angular_momentum: float | Literal["midpoint", "free"] = "midpoint"
    takeoff: Takeoff | None = None
    landing: Landing | None = None
    horizontal_velocity: float = 0.0
    gravity: float = 9.81
    checks: ClassVar[Mapping[str, Check]] = {
        "duration": number("duration"),
        "angular_momentum": one_of("midpoint", "free", or_number=number("angular_momentum")),
        "takeoff": optional(made(Takeoff)),
        "landing": optional(made(Landing)),
        "horizontal_velocity": number("horizontal_velocity"),
        "gravity": number("gravity", advice="downwards is positive"),
    }


@dataclass(frozen=True, eq=False)
class Motion(Checked):
    """The class of motions searched, (12), and the objective.

    Parameters
    ----------
    degree : int, (n,) ints, or "auto"
        k_i of (12), at least 5; "auto" starts at 7 and raises it where nothing else helps.
    objective : str
        One of the table of objectives, :data:`floatplan.tables.OBJECTIVE_TABLE`; "coefficients" is (17).
    """

    degree: int | Sequence[int] | Literal["auto"] = 7
    objective: Objective = "coefficients"
    checks: ClassVar[Mapping[str, Check]] = {
        "degree": by_joint(whole(Range(LOWEST_DEGREE, HIGHEST_DEGREE, ""), TOO_STIFF), "auto", mapping=False),
        "objective": one_of(*OBJECTIVES),
    }


@dataclass(frozen=True, eq=False)
class Motor(Checked):
    """Speed-dependent torque limit ``|torque| + slope |velocity| <= stall``, N m and N m s/rad."""

    stall: float
    slope: float
    checks: ClassVar[Mapping[str, Check]] = {"stall": number("limit"), "slope": number("slope")}


@dataclass(frozen=True, eq=False)
class Limits(Checked):
    """What the robot can do.

    Parameters
    ----------
    position : "urdf", "full" or mapping joint -> (low, high)
        Joint ranges, rad; "full" is the paper's [-pi, pi]. A joint that a mapping leaves out keeps the URDF's range,
        and one without a range in the URDF has the full one.
    velocity, torque : "none", "urdf", one number, mapping or (n,) sequence
        rad/s and N m. A number is for each motor of ``robot.motors``, a mapping by their names; a leader's value holds
        for followers that are not named, and motors left out have no limit. A sequence is by planned coordinate:
        torques are then the generalised ones, of a leader and its followers together.
    acceleration : "none", one number, mapping or (n,) sequence
        rad/s^2, as ``velocity``; a URDF knows no such limit.
    motor : mapping motor -> Motor
        A leader's holds for followers that are not named.
    orientation_rate : float, optional
        Largest ``|orientation_rate|``, rad/s.
    """

    position: Literal["urdf", "full"] | Mapping[str, Sequence[float]] | Sequence[Sequence[float]] = "urdf"
    velocity: Literal["none", "urdf"] | JointValues = "none"
    torque: Literal["none", "urdf"] | JointValues = "none"
    motor: Mapping[str, Motor] = field(default_factory=dict)
    orientation_rate: float | None = None
    acceleration: Literal["none"] | JointValues = "none"
    checks: ClassVar[Mapping[str, Check]] = {
        "position": by_joint(pair(number("positions")), "urdf", "full", single=False),
        **{
            row.key: by_joint(number("limit", infinite=True), *(["urdf"] if row.in_urdf else []), "none")
            for row in LIMIT_TABLE.values()
            if row.of != "base"
        },
        "motor": by_name(made(Motor)),
        "orientation_rate": optional(number("limit")),
    }


@dataclass(frozen=True, kw_only=True)
class Obstacle(Checked):
    """What all obstacles share.

    Parameters
    ----------
    margin : float
        Clearance to keep, m: the paper's epsilon.
    velocity : (float, float)
        m/s; at time t the obstacle stands ``velocity * t`` away from where it is given.
    window : (float, float), optional
        Times between which it exists, s; left out, for the whole flight.
    """

    kind: ClassVar[str]
    margin: float = 0.0
    velocity: tuple[float, float] = (0.0, 0.0)
    window: tuple[float, float] | None = None
    checks: ClassVar[Mapping[str, Check]] = {
        "margin": number("margin"),
        "velocity": pair(number("velocity")),
        "window": optional(pair(number("window"))),
    }

    @classmethod
    def example(cls, place: complex, size: float) -> Self:
        """Return one at a place, beside a robot of some size, m."""
        raise NotImplementedError

    @property
    def pieces(self) -> tuple[Obstacle, ...]:
        """What it is made of, with its velocity: what is away from all of them is away from it."""
        return (self,)

    @property
    def bounded(self) -> bool:
        """Whether a picture can hold all of it."""
        return all(piece.bounded for piece in self.pieces)

    @property
    def thickness(self) -> float:
        """Least width, m: a point that moves less between two instants cannot have passed through unseen."""
        return min(piece.thickness for piece in self.pieces)

    @property
    def where(self) -> str:
        """Where it stands and how large it is, for a person."""
        return " and ".join(piece.where for piece in self.pieces)

    @classmethod
    def places(cls) -> tuple[str, ...]:
        """Names of the fields that are places, m."""
        return tuple(name for name, check in cls.checks.items() if check is PLACE)

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """Those of every obstacle."""
        if self.window is not None and not self.window[0] < self.window[1]:
            start, end = self.window
            yield "window", f"the window ends ({end} s) before it begins ({start} s)"


@dataclass(frozen=True, kw_only=True)
class Circle(Obstacle):
    """A disc: centre (horizontal, vertical) and radius, m."""

    kind: ClassVar[str] = "circle"
    center: tuple[float, float]
    radius: float
    checks: ClassVar[Mapping[str, Check]] = {**Obstacle.checks, "center": PLACE, "radius": number("radius")}
    bounded = True

    @classmethod
    def example(cls, place: complex, size: float) -> Self:
        """A disc of a tenth of the size."""
        return cls(center=(place.real, place.imag), radius=0.1 * size)

    @property
    def thickness(self) -> float:
        """The diameter."""
        return 2 * self.radius

    @property
    def where(self) -> str:
        """Centre and radius."""
        return f"at {_pair(self.center)} m, radius {self.radius:g} m"


@dataclass(frozen=True, kw_only=True)
class HalfPlane(Obstacle):
    """Ground or a wall: solid where ``normal . (x - point) < 0``; the normal is made a unit vector."""

    kind: ClassVar[str] = "half-plane"
    point: tuple[float, float] = (0.0, 0.0)
    normal: tuple[float, float] = (0.0, 1.0)
    checks: ClassVar[Mapping[str, Check]] = {**Obstacle.checks, "point": PLACE, "normal": DIRECTION}
    bounded = False

    @classmethod
    def example(cls, place: complex, size: float) -> Self:
        """A ceiling."""
        return cls(point=(place.real, place.imag), normal=(0.0, -1.0))

    @property
    def thickness(self) -> float:
        """Nothing passes through a half-plane."""
        return math.inf

    @property
    def where(self) -> str:
        """Point and normal."""
        return f"at {_pair(self.point)} m, normal {_pair(self.normal)}"

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """Those of every obstacle, and a normal that has no direction."""
        yield from super().contradictions()
        if math.hypot(*self.normal) < SHORTEST_NORMAL:
            yield "normal", "the normal has length zero"


@dataclass(frozen=True, kw_only=True)
class Ground(HalfPlane):
    """The ground, on which links stand: distances to it are those of their hulls, not of the capsules around them."""


@dataclass(frozen=True, kw_only=True)
class Bar(Obstacle):
    """A capsule: all points within ``radius`` of the segment from ``start`` to ``end``, m."""

    kind: ClassVar[str] = "capsule"
    start: tuple[float, float]
    end: tuple[float, float]
    radius: float
    checks: ClassVar[Mapping[str, Check]] = {
        **Obstacle.checks,
        "start": PLACE,
        "end": PLACE,
        "radius": number("radius"),
    }
    bounded = True

    @classmethod
    def example(cls, place: complex, size: float) -> Self:
        """A level bar."""
        ends = (place.real - 0.2 * size, place.imag), (place.real + 0.2 * size, place.imag)
        return cls(start=ends[0], end=ends[1], radius=0.04 * size)

    @property
    def thickness(self) -> float:
        """Across."""
        return 2 * self.radius

    @property
    def where(self) -> str:
        """Ends and radius."""
        return f"from {_pair(self.start)} to {_pair(self.end)} m, radius {self.radius:g} m"


OBSTACLE_KINDS: dict[str, type[Obstacle]] = {kind.kind: kind for kind in (Circle, HalfPlane, Bar)}


def _pair(values: tuple[float, float]) -> str:
    return f"({values[0]:g}, {values[1]:g})"


@dataclass(frozen=True)
class SelfClearance(Checked):
    """Two links whose shapes must stay ``margin`` apart, m."""

    links: tuple[str, str]
    margin: float = 0.0
    checks: ClassVar[Mapping[str, Check]] = {"links": pair(text, "names of links"), "margin": number("margin")}

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """A link cannot keep away from itself."""
        if self.links[0] == self.links[1]:
            yield "links", "the two links are the same"
