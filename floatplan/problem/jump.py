"""The request of a whole jump around its flight: contacts, margins, friction, and what is fixed of the flight."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Annotated, Any, ClassVar, Literal, Self, TypeAlias

from floatplan.arguments import by_name, number, optional, pair, positive
from floatplan.errors import InputError
from floatplan.keys import Keyed
from floatplan.robot.robot import Robot
from floatplan.tables import ANGLE, KEY_TABLE, LEAST, RATE, Key, Range

Standing: TypeAlias = Literal["standing"] | Mapping[str, float]
Ending: TypeAlias = Literal["standing", "periodic"] | Mapping[str, float]
Groups: TypeAlias = Sequence[tuple[str, ...]]
Durations: TypeAlias = Sequence[Sequence[float]]

MARGIN = {"torque": 0.85, "velocity": 0.88}  # [-] of the limits
MOST_PHASES = 2  # [-] on each side of the flight
MOST_FLIGHTS = 20  # [-] of a sequence: its program grows with each
ONLY_THE_FLIGHT = "Planned is the flight alone, not the jump around it."


def _margin(value: Any, element: str) -> dict[str, float]:
    margins: dict[str, float] = by_name(positive(1.0))(value, element)
    unknown = [name for name in margins if name not in MARGIN]
    if unknown:
        raise InputError(f"{unknown[0]!r} is not a margin", element=element, advice=f"margins: {', '.join(MARGIN)}")
    return MARGIN | margins


def _stands_again(stands: Sequence[bool]) -> bool:
    """Whether a foot that stands in these phases leaves the ground and returns."""
    landings = 0
    stood = False
    for phase in stands:
        if phase and not stood:
            landings += 1
        stood = phase
    return landings > 1


@dataclass(frozen=True)
class JumpSide(Keyed):
    """What is on the ground on one side of the flight.

    ``outer`` is the index of the phase in which it stands still; ``wrong`` says in messages what a foot that is missing
    there would do.

    Parameters
    ----------
    contacts : sequence of sequences of str, optional
        A sole's frame is its heel and toe, ``FRAME.toe`` in a plane its toe only. A foot that has left does not return.
        Left out before takeoff: all feet, and those on the side to which it turns; after landing: in a plane those of
        takeoff in reverse, in space first those that are lower when it lands.
    durations : sequence of pairs, s, optional
        Of each phase: least and largest.
    height : float, m, optional
        Of the ground there, from any level; 0 if left out. Where both sides differ, ``jump.edge`` says where one ends.
    """

    contacts: Annotated[Groups | None, KEY_TABLE["jump.takeoff.contacts"]] = None
    durations: Annotated[Durations | None, Key(unit="s", numbers="duration")] = None
    height: Annotated[float | None, Key(unit="m", numbers="edge")] = None
    outer: ClassVar[int] = 0
    wrong: ClassVar[str] = "come to the ground before takeoff"  # of a frame that does not stand then

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """Phases that contradict each other."""
        if self.contacts is not None:
            fault = self._fault(self.contacts)
            if fault:
                yield "contacts", fault
        for index, (low, high) in enumerate(self.durations or ()):
            if low > high:
                yield f"durations[{index}]", f"low {low} s is above high {high} s"
        if self.contacts is not None and self.durations and len(self.durations) != len(self.contacts):
            yield "durations", f"{len(self.durations)} given for {len(self.contacts)} phases of contacts"

    def _fault(self, groups: Groups) -> str:
        for name in dict.fromkeys(chain.from_iterable(groups)):
            stands = [name in group or name.partition(".")[0] in group for group in groups]
            if _stands_again(stands):
                return f"{name!r} would leave the ground and return; let it stand without a break"
            if 1 <= len(groups) <= MOST_PHASES and not stands[self.outer]:
                return f"{name!r} would {self.wrong}; name it in the {'last' if self.outer else 'first'} phase too"
        if not 1 <= len(groups) <= MOST_PHASES or not all(groups):
            return "must be one or two phases, each with a frame at least"
        return ""


@dataclass(frozen=True)
class JumpTakeoff(JumpSide):
    """Where a jump begins, and what stands until it takes off.

    Parameters
    ----------
    contacts, durations, height : as of :class:`JumpSide`
    from_ : "standing", or mapping of joints to rad; in files it is ``from``
        By joint, those left out being where the reference posture has them, or "standing", the nearest to that which
        is static; knees that would be straight, where feet that are points stand as one, are bent for it.
    com_velocity : (float, float), m/s, optional
        In a plane: velocity of the centre of mass, horizontal and vertical, with which the jump begins. With this or
        any other rate it begins in motion: its first feet stand, its posture need not be static, and rates that are
        left out are the least ones with which these feet do not move.
    velocities : mapping of joints to rad/s, optional
        In a plane: rates of joints with which the jump begins in motion.
    orientation : float, rad, optional
        In a plane: of the base where the jump begins in motion; level if left out.
    orientation_rate : float, rad/s, optional
        In a plane: of the base where the jump begins in motion.
    """

    from_: Annotated[Standing, KEY_TABLE["jump.takeoff.from"]] = KEY_TABLE["jump.takeoff.from"].default
    com_velocity: Annotated[tuple[float, float] | None, Key(unit="m/s", check=optional(pair(number("velocity"))))] = (
        None
    )
    velocities: Annotated[Mapping[str, float] | None, Key(unit=RATE)] = None
    orientation: Annotated[float | None, Key(unit=ANGLE)] = None
    orientation_rate: Annotated[float | None, Key(unit=RATE, numbers="velocities")] = None

    @property
    def in_motion(self) -> bool:
        """Whether the jump begins in motion, instead of standing still."""
        return bool(self.velocities) or self.com_velocity is not None or self.orientation_rate is not None

    @property
    def from_standing(self) -> Self:
        """The same takeoff from standing: of one that begins in motion without its posture."""
        if not self.in_motion:
            return self
        return replace(
            self, from_="standing", com_velocity=None, velocities=None, orientation=None, orientation_rate=None
        )

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """An orientation of what stands still, which is level, or without its posture."""
        yield from super().contradictions()
        if self.orientation is not None and not (self.in_motion and isinstance(self.from_, Mapping)):
            yield "orientation", "is of a posture in motion; give from by joint and com_velocity too, or leave it out"


@dataclass(frozen=True)
class JumpLanding(JumpSide):
    """What stands after a jump's landing, and where it ends.

    Parameters
    ----------
    contacts, durations, height : as of :class:`JumpSide`
    to : "standing", "periodic", or mapping of joints to rad
        Posture it comes to, by joint, or "standing": the one that it stood in before. "periodic": it never stands, and
        comes to the motion in which it begins, further on and with whole turns more, so that it may go on for ever.
    displacement : (float, float), m, optional
        In space: how far its centre of mass has come, along x and y of the world, from standing to standing; where it
        lands is free if left out.
    impact : float, m/s
        In space: speed with which the feet that land first may come to the ground, at most. Their impact takes it from
        them at once, without bouncing or slipping, and changes all rates. 0: they land without speed.
    """

    to: Annotated[Ending, Key(unit=ANGLE, numbers="positions")] = "standing"
    displacement: Annotated[
        tuple[float, float] | None,
        Key(
            unit="m",
            check=optional(pair(number("edge"))),
        ),
    ] = None
    impact: Annotated[float, Key(unit="m/s", numbers=Range(0.0, 10.0, "m/s"))] = 0.0
    outer: ClassVar[int] = -1
    wrong: ClassVar[str] = "leave the ground after it has landed"


@dataclass(frozen=True)
class JumpFlight(Keyed):
    """A flight of a sequence: what it lands on takes off again, without standing still between.

    Parameters
    ----------
    turns : int, optional
        Whole turns of the base; those from the problem's start to its goal if left out.
    repeat : int
        So many equal flights.
    duration : (float, float), s, optional
        Least and largest.
    """

    turns: Annotated[int | None, Key(numbers=Range(-10.0, 10.0, ""))] = None
    repeat: Annotated[int, Key(numbers=Range(1.0, MOST_FLIGHTS, ""))] = 1
    duration: Annotated[tuple[float, float] | None, Key(unit="s", numbers="duration")] = None

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """Durations of which none is allowed."""
        if self.duration is not None and self.duration[0] > self.duration[1]:
            yield "duration", f"low {self.duration[0]} s is above high {self.duration[1]} s"


@dataclass(frozen=True)
class JumpRequest(Keyed):
    """A jump around a flight: from standing, or in motion, through phases of contact, to standing again.

    Parameters
    ----------
    friction : float
    margin : mapping
        Shares of the limits that stances may use: of ``torque``, curves of torque and speed too, and ``velocity``.
    fixed : sequence of str
        What the problem fixes of the flight, of duration, angular_momentum, start, goal; all else is a guess.
    takeoff : JumpTakeoff
        What stands before the flight.
    landing : JumpLanding
        What stands after it.
    feet : str
        "auto": in a plane feet whose outlines are circles about their frames roll on the ground without slipping,
        others rotate about their frames' origins, where the ground's forces act, and so do all in space; "rolling": all
        have to be such circles, in space balls; "points", or "point": none rolls.
    objective : "torque" or "limits"
        What is least: "torque" is the integral of squared torques, in space the sum over nodes, without the times
        between, of squared shares of the motors' limits; "limits", in a plane, the largest share of what the margins
        leave of any limit on torque, torque-speed curve or rate, over the whole jump.
    clearance : float, m
        Of what does not stand from the ground, or half of its height where the robot stands if that is less: margin
        for a landing that is not as planned. The check asks for none.
    pitch_error : float, rad
        By how much the robot may be turned about its feet, either way, where it touches down, and for 60 ms after, with
        nothing but its feet on the ground; 0.07 rad, 4 degrees, if left out.
    flights : sequence of JumpFlight, optional
        In a plane: all flights, in order of time, where there are several; the first is the problem's own.
    least_force : float
        Over the weight: vertical force on each contact that stands, at least, at the program's nodes; nothing checks it
        between them. More of it keeps the centre of pressure inside the feet, and a robot that lands from tipping over
        some of them. In a plane it holds where several contacts stand, and is 0.05 at least.
    leeway : float, rad, optional
        In space: by how much, at the program's nodes, the first and the last of the angles of the goal's orientation
        may leave what lies between those of start and goal. Legs that have little torque to spare twist the base where
        nothing keeps them from it. The flight is planned anew between its ends, and may leave it by more.
    edge : float, m, optional
        Where the higher ground ends, horizontally from where the frame that takes off is at takeoff; for grounds of
        different heights. In space that is along x or y of the world, along which ``landing.displacement`` is longer,
        and the edge is a straight line at right angles to it.

    Raises
    ------
    InputError
        A value is wrong, or a foot would leave the ground and return, or come and leave again.
    """

    friction: Annotated[float, KEY_TABLE["jump.friction"]] = KEY_TABLE["jump.friction"].default
    margin: Annotated[Mapping[str, float], Key(numbers=Range(LEAST, 1.0, ""), check=_margin)] = field(
        default_factory=lambda: dict(MARGIN)
    )
    fixed: Annotated[Sequence[Literal["duration", "angular_momentum", "start", "goal"]], Key()] = ()
    takeoff: Annotated[JumpTakeoff, Key()] = field(default_factory=JumpTakeoff)
    landing: Annotated[JumpLanding, Key()] = field(default_factory=JumpLanding)
    feet: Annotated[Literal["auto", "rolling", "points", "point"], Key()] = "auto"
    objective: Annotated[Literal["torque", "limits"], Key()] = "torque"
    clearance: Annotated[float, Key(unit="m", numbers="margin")] = 0.04
    pitch_error: Annotated[float, Key(unit=ANGLE, numbers=Range(0.0, 0.5, "rad"))] = 0.07
    flights: Annotated[Sequence[JumpFlight] | None, Key()] = None
    # At most so that what stands on many points, two soles on six, may bear less on some than on others.
    least_force: Annotated[float, Key(numbers=Range(0.0, 0.1, ""))] = 0.0
    leeway: Annotated[float | None, Key(unit=ANGLE, numbers=Range(1e-3, math.pi, "rad"))] = None
    edge: Annotated[float | None, Key(unit="m")] = None

    @property
    def rise(self) -> float:
        """Height of the ground on which it lands over that which it leaves, m."""
        return (self.landing.height or 0.0) - (self.takeoff.height or 0.0)

    @property
    def edge_axis(self) -> int:
        """In space the axis along which ``edge`` is: 0, x, or 1, y, where it lands farther along that."""
        x, y = self.landing.displacement or (0.0, 0.0)
        return int(abs(y) > abs(x))

    @property
    def is_periodic(self) -> bool:
        """Whether it ends as it begins, moving."""
        return self.landing.to == "periodic"

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """What sequences and steps of the ground exclude."""
        count = sum(flight.repeat for flight in self.flights or ())
        if count > MOST_FLIGHTS:
            yield "flights", f"{count} flights are too many; {MOST_FLIGHTS} at most"
        several = count > 1 or self.is_periodic
        of_one = sorted(set(self.fixed) - {"duration"})
        if several and of_one:
            yield "fixed", f"{of_one[0]!r} is of one flight; leave it out where several follow one another"
        if several and self.takeoff.in_motion:
            yield "takeoff", "several flights begin standing, periodic ones as they end; leave velocities out"
        if several and self.rise:
            yield "landing.height", "several flights are on one ground; leave it out"
        if self.rise and self.edge is None:
            yield "edge", "the grounds differ in height; say where the higher one ends"
        if self.edge is not None and not self.rise:
            yield "edge", "the grounds are equally high; leave it out"


def _edge_errors(jump: JumpRequest) -> Iterator[InputError]:
    """What contradicts an edge in space: that it is not between where the robot stands and where it lands."""
    if jump.landing.displacement is None:
        advice = "give [x, y], m: the edge is at right angles to the longer of both"
        reason = "the grounds differ in height; say where it lands"
        yield InputError(reason, element="jump.landing.displacement", advice=advice)
        return
    axis = jump.edge_axis
    way = jump.landing.displacement[axis]
    edge = jump.edge or 0.0
    if way * edge <= 0:
        reason = f"{edge:.3g} m along {'xy'[axis]} is not on its way, which is {way:.3g} m there"
        advice = "give both the same sign: the edge is between where it stands and where it lands"
        yield InputError(reason, element="jump.edge", advice=advice)


def jump_errors(robot: Robot, jump: JumpRequest) -> Iterator[InputError]:
    """What a robot lacks of what a jump names: frames, joints."""
    is_planar = robot.base == "planar"
    frames = robot.frames if is_planar else dict.fromkeys(robot.frame_names)
    if is_planar and jump.landing.displacement is not None:
        advice = "leave it out: where a jump in a plane lands is free"
        yield InputError("is for jumps in space", element="jump.landing.displacement", advice=advice)
    if is_planar and jump.landing.impact:
        advice = "leave it out: in a plane feet land without speed"
        yield InputError("is for jumps in space", element="jump.landing.impact", advice=advice)
    if is_planar and jump.leeway is not None:
        advice = "leave it out: in a plane the base has one angle"
        yield InputError("is for jumps in space", element="jump.leeway", advice=advice)
    in_a_plane = {
        "takeoff.com_velocity": jump.takeoff.com_velocity,
        "takeoff.velocities": jump.takeoff.velocities,
        "takeoff.orientation": jump.takeoff.orientation,
        "takeoff.orientation_rate": jump.takeoff.orientation_rate,
        "landing.to": "periodic" if jump.is_periodic else None,
        "flights": jump.flights or None,
    }
    for key, value in {} if is_planar else in_a_plane.items():
        if value is not None:
            yield InputError("is for jumps in a plane", element=f"jump.{key}", advice="leave it out")
    if not is_planar and jump.edge is not None:
        yield from _edge_errors(jump)
    for name, side in (("takeoff", jump.takeoff), ("landing", jump.landing)):
        for index, group in enumerate(side.contacts or ()):
            for frame in group:
                frame_name = frame if frame in frames else frame.rpartition(".")[0]
                element = f"jump.{name}.contacts[{index}]"
                if frame_name not in frames:
                    yield InputError(
                        f"the robot has no frame {frame!r}", element=element, advice="name a link or a joint"
                    )
                elif not is_planar and frame not in frames:
                    reason = f"{frame!r} is one end of a sole, and in space soles stand as a whole"
                    yield InputError(reason, element=element, advice=f"name {frame_name!r}")
    by_joint = {
        "takeoff.from": jump.takeoff.from_,
        "takeoff.velocities": jump.takeoff.velocities,
        "landing.to": jump.landing.to,
    }
    for key, values in by_joint.items():
        for joint in values if isinstance(values, Mapping) else ():
            if joint not in robot.joints:
                advice = f"joints: {', '.join(robot.joints)}"
                yield InputError(f"{joint!r} is not a planned joint", element=f"jump.{key}", advice=advice)
