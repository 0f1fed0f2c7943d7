"""What a problem is made of: states, flight, motion, limits and obstacles, as the user gives them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Real
from typing import Annotated, ClassVar, Literal, Self, TypeAlias, cast, get_args

import numpy as np

from floatplan.arguments import (
    FINITE,
    Check,
    by_joint,
    made,
    many,
    number,
    one_of,
    optional,
    pair,
    shortened,
    text,
    whole,
)
from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.keys import Keyed
from floatplan.problem.attitude import Attitude, Triple
from floatplan.tables import (
    ACCELERATION,
    ANGLE,
    FLIGHT_EVENTS,
    GRAVITY,
    KEY_TABLE,
    RANGES,
    RATE,
    Key,
    MomentumWord,
    MomentumWordInPlane,
    Objective,
)

JointValues: TypeAlias = Mapping[str, float] | Sequence[float] | Array | float
JointRates: TypeAlias = JointValues | Literal["takeoff", "landing"]
JointAccelerations: TypeAlias = JointValues | Literal["free"]
Pair: TypeAlias = tuple[float, float]


def in_plane_or_space(key: str, spatial: Check, *words: str) -> Check:
    """A number in the range of a key or one of some words, or what a check of flights in space lets through."""
    planar = one_of(*words, or_number=number(key)) if words else number(key)

    def check(value: object, element: str) -> object:
        is_number = isinstance(value, str | Real) or getattr(value, "ndim", 1) == 0
        return (planar if is_number else spatial)(value, element)

    return check


def attitude(value: object, element: str) -> object:
    """An attitude in space."""
    if isinstance(value, Attitude):
        return made(Attitude)(value, element)
    reason = "is neither an angle nor an Attitude: quaternion_xyzw, or angles and axes"
    raise InputError(f"{value!r} {reason}", element=element)


def pair_or_three(key: str) -> Check:
    """Two numbers in the range of a key, or three."""
    two, three = (pair(number(key), "numbers, nor three" if count == 2 else "numbers", count) for count in (2, 3))

    def check(value: object, element: str) -> object:
        is_three = isinstance(value, list | tuple | np.ndarray) and len(np.atleast_1d(np.asarray(value, object))) == 3
        return (three if is_three else two)(value, element)

    return check


@dataclass(frozen=True, eq=False)
class Posture(Keyed):
    """Base orientation and joints at one end of the flight, as the user gives them.

    Parameters
    ----------
    orientation : float, rad, or Attitude
        Absolute angle of the base link, unbounded; a full rotation more is one somersault more. In space an attitude.
    positions : mapping, (n,) sequence, or one number for all joints, rad
        Of the joints: by name, a list in joint order, or one number for all.
    velocities : as positions, rad/s
        Of these, the ones with the least largest share of the joints' limits; they follow from the angular momentum.
    accelerations : as positions, rad/s^2
    settled : pair of (n,) sequences, optional
        Velocities and accelerations that a plan has come to, where these are words; the planner fills it in.
    """

    orientation: Annotated[float | Attitude, Key(unit=ANGLE, check=in_plane_or_space("orientation", attitude))]
    positions: Annotated[JointValues, Key(unit=ANGLE)]
    velocities: Annotated[JointRates, KEY_TABLE["start.velocities"]] = KEY_TABLE["start.velocities"].default
    accelerations: Annotated[JointAccelerations, KEY_TABLE["start.accelerations"]] = KEY_TABLE[
        "start.accelerations"
    ].default
    settled: Annotated[
        tuple[JointValues | None, JointValues | None] | None, optional(pair(optional(by_joint(FINITE)), "sequences"))
    ] = None

    @property
    def angle(self) -> float:
        """The orientation in a plane, rad."""
        return cast("float", self.orientation)

    @classmethod
    def degrees(
        cls,
        orientation: float,
        positions: JointValues,
        velocities: JointRates = 0.0,
        accelerations: JointAccelerations = 0.0,
    ) -> Posture:
        """Return the posture whose angles and rates are in degrees: deg, deg/s, deg/s^2.

        Raises
        ------
        InputError
            A number is none, or out of its range.
        """
        converted = by_joint(_radians, *FLIGHT_EVENTS.values(), "free")
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

    In space it has an ``attitude``, and the orientation is NaN.
    ``frame_rests`` where the velocities are those with which the frame does not move, ``free_accelerations`` where the
    search chooses them: NaN until a plan has settled them.
    """

    orientation: float
    positions: Array
    velocities: Array
    accelerations: Array
    attitude: Attitude | None = None
    frame_rests: bool = False
    free_accelerations: bool = False


@dataclass(frozen=True)
class Takeoff(Keyed):
    """The frame that leaves the ground last, and where it is at t = 0, m (horizontal, vertical); x, y, z in space."""

    frame: Annotated[str, KEY_TABLE["flight.takeoff.frame"]]
    position: Annotated[
        Pair | Triple,
        Key("Where the frame is at takeoff: horizontal, vertical; x, y, z in space", "m", check=pair_or_three("place")),
    ] = (0.0, 0.0)

    @property
    def planar_position(self) -> Pair:
        """Where the frame is in a plane, m."""
        return cast("Pair", self.position)


@dataclass(frozen=True)
class Landing(Keyed):
    """The frame that lands first, and its height at t = T, m.

    Left out, its link's shapes stand on the ground where the problem has one; else the height is 0.
    """

    frame: Annotated[str, KEY_TABLE["flight.landing.frame"]]
    height: Annotated[
        float | None, Key("Of the frame at landing; that of the ground, or of its takeoff, where left out", "m")
    ] = None


@dataclass(frozen=True)
class Flight(Keyed):
    """The flight as a whole.

    Parameters
    ----------
    duration : float, s
    angular_momentum : float, kg m^2/s, "midpoint" or "free"
        In a plane it is about its normal, "midpoint" is (10), the middle of (9), which motions that do not reverse
        need, and "free" is in (9) or outside. In space the numbers are along the world's axes, or 0 for all three;
        "suggested" is that with which the joints' nominal motion reaches the goal, "midpoint" means the same there,
        and "free" is about that.
    takeoff : Takeoff, optional
        The frame that leaves the ground last; the base link at the origin where left out.
    landing : Landing, optional
        The frame that lands first; the takeoff frame where left out: at the height it left, or resting on the ground
        where the problem has one.
    horizontal_velocity : float, m/s
        In space two numbers, along x and y.
    gravity : float, m/s^2
        Downwards.
    """

    duration: Annotated[float, KEY_TABLE["flight.duration"]]
    angular_momentum: Annotated[
        float | Triple | MomentumWord,
        KEY_TABLE["flight.angular_momentum"].with_check(
            in_plane_or_space("angular_momentum", pair(number("angular_momentum"), count=3), *get_args(MomentumWord))
        ),
    ] = KEY_TABLE["flight.angular_momentum"].default
    takeoff: Annotated[Takeoff | None, Key()] = None
    landing: Annotated[Landing | None, Key()] = None
    horizontal_velocity: Annotated[
        float | Pair,
        KEY_TABLE["flight.horizontal_velocity"].with_check(
            in_plane_or_space("horizontal_velocity", pair(number("horizontal_velocity")))
        ),
    ] = KEY_TABLE["flight.horizontal_velocity"].default
    gravity: Annotated[float, Key(unit="m/s^2", check=number("gravity", advice="downwards is positive"))] = GRAVITY

    @property
    def momentum_in_plane(self) -> float | MomentumWordInPlane:
        """The angular momentum of a flight in a plane."""
        return cast("float | MomentumWordInPlane", self.angular_momentum)

    @property
    def speed_in_plane(self) -> float:
        """The horizontal velocity of a flight in a plane, m/s."""
        return cast("float", self.horizontal_velocity)


MOST_SAMPLES = 2000  # [-] instants of a recorded motion: more than a flight's polynomials could tell apart


@dataclass(frozen=True, eq=False)
class ClipReference(Keyed):
    """A recorded motion of the joints, to which a flight is to be near: columns of a file, or positions themselves.

    Parameters
    ----------
    file : str, optional
        Path of a table (CSV) with a column `time` and one `<joint>_position` for each planned joint, such as the
        trajectory.csv of a plan.
    from_ : float, s, optional
        Time in the file that is takeoff; its first if left out.
    to : float, s, optional
        Time in the file that is landing; its last if left out.
    positions : (K, n) sequences, optional
        Positions of the joints at K instants evenly apart, of which takeoff is the first and landing the last.
    """

    about: ClassVar[str] = "The recorded motion of the objective `clip`"
    file: Annotated[str | None, Key()] = None
    from_: Annotated[float | None, Key(unit="s", numbers="duration", check=optional(FINITE))] = None
    to: Annotated[float | None, Key(unit="s", numbers="duration", check=optional(FINITE))] = None
    positions: Annotated[
        Sequence[Sequence[float]] | None, Key(unit="rad", check=optional(many(many(FINITE, "numbers"), "lists")))
    ] = None

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """It is one of both, and has at least two instants."""
        if self.file is None and self.positions is None:
            yield "file", "is missing: give it, or positions"
        if self.positions is not None and not 2 <= len(self.positions) <= MOST_SAMPLES:
            yield "positions", f"has {len(self.positions)} instants, not 2 to {MOST_SAMPLES}"


@dataclass(frozen=True, eq=False)
class Motion(Keyed):
    """The class of motions searched, (12), and the objective.

    Parameters
    ----------
    degree : int, (n,) ints, or "auto"
        It is k_i of (12); "auto" starts at 7 and raises it where nothing else helps.
    objective : str
        Of these, "coefficients" is (17).
    clip : ClipReference, optional
        The recorded motion that the objective ``clip`` is about.
    """

    degree: Annotated[
        int | Sequence[int] | Literal["auto"],
        KEY_TABLE["motion.degree"].with_check(
            by_joint(
                whole(
                    RANGES["degree"],
                    "six boundary conditions per joint need degree 5; one more at least is needed to steer, (16)",
                ),
                "auto",
                mapping=False,
            )
        ),
    ] = KEY_TABLE["motion.degree"].default
    objective: Annotated[Objective, KEY_TABLE["motion.objective"]] = KEY_TABLE["motion.objective"].default
    clip: Annotated[ClipReference | None, Key()] = None

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """The objective "clip" needs a recorded motion, and no other has one."""
        if self.objective == "clip" and self.clip is None:
            yield "clip", 'is missing: the objective "clip" needs a recorded motion'
        if self.objective != "clip" and self.clip is not None:
            yield "clip", f'is of the objective "clip", not of "{self.objective}"'


@dataclass(frozen=True, eq=False)
class Motor(Keyed):
    """Speed-dependent torque limit ``|torque| + slope |velocity| <= stall``, N m and N m s/rad."""

    about: ClassVar[str] = "A motor's torque falls with its rate: at most `stall - slope |rate|`"
    stall: Annotated[float, Key("Torque at rest", "N m", "limit")]
    slope: Annotated[float, Key("Torque that is lost with the rate", "N m s/rad")]


@dataclass(frozen=True, eq=False)
class Limits(Keyed):
    """What the robot can do.

    Parameters
    ----------
    position : "urdf", "full", mapping joint -> (low, high), or (n, 2) sequence, rad
        Joint ranges; "full" is the paper's, 360 deg. A joint that is left out keeps the URDF's range, and one without
        a range there has the full one.
    velocity : "none", "urdf", one number, mapping or (n,) sequence, rad/s
        Largest rate: one number for each motor, by motor, or by planned joint. A leader's holds for followers that are
        not named; motors left out have no limit.
    torque : "none", "urdf", one number, mapping or (n,) sequence, N m
        Largest torque: one number for each motor, by motor as the largest rates, or a list in joint order of the
        generalised ones, of a leader with its followers.
    motor : mapping motor -> Motor
        Motors' curves, by joint; a leader's holds for followers that are not named.
    orientation_rate : float, rad/s, optional
        Largest rate of the base; in space the length of its angular velocity.
    acceleration : "none", one number, mapping or (n,) sequence, rad/s^2
        Largest acceleration, written as the largest rates are; a URDF knows none.
    """

    position: Annotated[
        Literal["urdf", "full"] | Mapping[str, Sequence[float]] | Sequence[Sequence[float]],
        Key(unit=ANGLE, numbers="positions"),
    ] = "urdf"
    velocity: Annotated[Literal["urdf", "none"] | JointValues, Key(unit=RATE, numbers="limit")] = "none"
    torque: Annotated[Literal["urdf", "none"] | JointValues, Key(unit="N m", numbers="limit")] = "none"
    motor: Annotated[Mapping[str, Motor], Key()] = field(default_factory=dict)
    orientation_rate: Annotated[float | None, Key(unit=RATE, numbers="limit")] = None
    acceleration: Annotated[Literal["none"] | JointValues, Key(unit=ACCELERATION, numbers="limit")] = "none"


@dataclass(frozen=True, kw_only=True)
class Obstacle(Keyed):
    """What all obstacles share.

    Parameters
    ----------
    margin : float, m
        Distance to keep from it, the paper's epsilon.
    velocity : (float, float), m/s
        Of one that moves: horizontal, vertical; it is where it is written at takeoff.
    window : (float, float), s, optional
        When it exists: from, to, since takeoff; for the whole flight, where left out.
    """

    margin: Annotated[float, Key(unit="m")] = 0.0
    velocity: Annotated[Pair, Key(unit="m/s")] = (0.0, 0.0)
    window: Annotated[Pair | None, Key(unit="s")] = None

    @classmethod
    def example(cls, position: complex, size: float) -> Self:
        """Return one at a position near a robot of some size, m."""
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
        """Least width, m: a point that moves less between two instants cannot have passed through unseen.

        Nothing passes through what has no radius, a half-plane.
        """
        return min(2 * getattr(piece, "radius", math.inf) for piece in self.pieces)

    @property
    def where(self) -> str:
        """Where it stands and how large it is, for a person."""
        return " and ".join(piece.where for piece in self.pieces)

    @property
    def description(self) -> str:
        """What it is, where, how it moves and when it is there, for a person."""
        text = f"{self.kind} {self.where}, margin {self.margin:g} m"
        if any(self.velocity):
            text += f", moving at ({shortened(self.velocity, 6)}) m/s"
        return text if self.window is None else f"{text}, from {self.window[0]:g} to {self.window[1]:g} s"

    @classmethod
    def places(cls) -> tuple[str, ...]:
        """Names of the fields that are places, m."""
        return tuple(name for name, key in cls.keys.items() if cls.hints[name] in (Pair, Triple) and key.unit == "m")

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """Those of every obstacle."""
        if self.window is not None and not self.window[0] < self.window[1]:
            start, end = self.window
            yield "window", f"the window ends ({end} s) before it begins ({start} s)"


class RoundObstacle(Obstacle):
    """A disc, or a ball in space."""

    center: Sequence[float]
    radius: float
    bounded = True

    @property
    def where(self) -> str:
        """Centre and radius."""
        return f"at ({shortened(self.center, 6)}) m, radius {self.radius:g} m"


class RoundBar(Obstacle):
    """A bar with round ends, in a plane or in space."""

    start: Sequence[float]
    end: Sequence[float]
    radius: float
    bounded = True

    @property
    def where(self) -> str:
        """Ends and radius."""
        return f"from ({shortened(self.start, 6)}) to ({shortened(self.end, 6)}) m, radius {self.radius:g} m"


class Wall(Obstacle):
    """Ground or a wall, in a plane or in space: solid where ``normal . (x - point) < 0``."""

    point: Sequence[float]
    normal: Sequence[float]
    bounded = False

    @property
    def where(self) -> str:
        """Point and normal."""
        return f"at ({shortened(self.point, 6)}) m, normal ({shortened(self.normal, 6)})"

    @property
    def is_level(self) -> bool:
        """Whether it is solid below a level line or plane, as ground is."""
        *across, up = self.normal
        return math.hypot(*across) <= 1e-9 * up  # but for rounding

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """Those of every obstacle, and a normal that has no direction."""
        yield from super().contradictions()
        if math.hypot(*self.normal) < 1e-9:  # as written, of any length
            yield "normal", "the normal has length zero"


@dataclass(frozen=True, kw_only=True)
class Circle(RoundObstacle):
    """A disc: centre (horizontal, vertical) and radius, m."""

    kind: ClassVar[str] = "circle"
    about: ClassVar[str] = "A disc"
    center: Annotated[Pair, Key("Horizontal, vertical", "m")]
    radius: Annotated[float, Key("Of the disc", "m")]

    @classmethod
    def example(cls, position: complex, size: float) -> Self:
        """A disc of a tenth of the size."""
        return cls(center=(position.real, position.imag), radius=0.1 * size)


@dataclass(frozen=True, kw_only=True)
class HalfPlane(Wall):
    """Ground or a wall: solid where ``normal . (x - point) < 0``; the normal is made a unit vector."""

    kind: ClassVar[str] = "half-plane"
    about: ClassVar[str] = "Ground or a wall, solid on one side of a line"
    point: Annotated[Pair, Key("A point on the line: horizontal, vertical", "m")] = (0.0, 0.0)
    normal: Annotated[Pair, Key("Direction away from what is solid: horizontal, vertical; of any length")] = (0.0, 1.0)

    @classmethod
    def example(cls, position: complex, size: float) -> Self:
        """A ceiling."""
        return cls(point=(position.real, position.imag), normal=(0.0, -1.0))


@dataclass(frozen=True, kw_only=True)
class Ground(HalfPlane):
    """The ground, on which links stand: distances to it are those of their hulls, not of the capsules around them."""


@dataclass(frozen=True, kw_only=True)
class Bar(RoundBar):
    """A capsule: all points within ``radius`` of the segment from ``start`` to ``end``, m."""

    kind: ClassVar[str] = "capsule"
    about: ClassVar[str] = "A bar with round ends"
    start: Annotated[Pair, Key("One end of its middle line: horizontal, vertical", "m")]
    end: Annotated[Pair, Key("The other end", "m")]
    radius: Annotated[float, Key("Of the bar", "m")]

    @classmethod
    def example(cls, position: complex, size: float) -> Self:
        """A level bar."""
        ends = (position.real - 0.2 * size, position.imag), (position.real + 0.2 * size, position.imag)
        return cls(start=ends[0], end=ends[1], radius=0.04 * size)


OBSTACLE_KINDS: dict[str, type[Obstacle]] = {kind.kind: kind for kind in (Circle, HalfPlane, Bar)}
Obstacle.kinds = OBSTACLE_KINDS


@dataclass(frozen=True)
class SelfClearance(Keyed):
    """Two links whose shapes must stay ``margin`` apart, m."""

    links: Annotated[tuple[str, str], Key("The two links", check=pair(text, "names of links"))]
    margin: Annotated[float, Key("Distance to keep between them", "m")] = 0.0

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """A link cannot keep away from itself."""
        if self.links[0] == self.links[1]:
            yield "links", "the two links are the same"
