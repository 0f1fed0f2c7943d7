"""From a problem and a request to the program of a jump: contacts, standing postures, phases, bounds, corrections."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.jumps.check import FIGURES, SLIP
from floatplan.jumps.contacts import (
    Contact,
    bent_ranges,
    contact_at,
    ground_below,
    in_the_air,
    not_round,
    rolling,
    standing_feet,
    watched_points,
    with_bent_knees,
)
from floatplan.jumps.exchange import solved
from floatplan.jumps.model import PlanarModel
from floatplan.jumps.phases import (
    Meeting,
    Phase,
    Side,
    not_static,
    side_phases,
    standing_posture,
    static_beyond_ranges,
)
from floatplan.jumps.program import ITERATIONS, LIFT, JumpProgram, Solution
from floatplan.jumps.rows import LEAST_FORCE, Bounds, NodeRows
from floatplan.jumps.separation import ROOM, Separation
from floatplan.problem.jump import JumpRequest, Standing
from floatplan.problem.parts import JointState
from floatplan.problem.problem import Problem
from floatplan.robot import Robot
from floatplan.robot.standing import Spot, heights_over_com

MOST = 2  # [-] contacts of a phase
FAR = 0.1  # [m] above what is lowest in the reference posture: no foot is there
NEAR = 0.1  # [rad] by which a posture that is given may be moved so that it is static
CORRECTIONS = 2  # [-] programs after the first
FINER = 1.4  # [-] times the nodes in each
LESS_FRICTION = 0.85  # [-] where forces leave the cone
STRICTER = 0.97  # [-] of the share of a limit that would just do
DEEPER = 1.5  # [-] times the depth that a figure shows
BRIEFEST = 0.15  # [-] of a phase's guessed duration, where the flight is known
TURN = 2 * math.pi
NO_STATIC = "none was found on these contacts: give other ones, or plan more joints"
FARTHEST_HEIGHT = 0.2  # [m] between frames at takeoff and at landing: ankles rise by so much where soles tip
FARTHEST_TURN = TURN / 3  # [rad] from whole turns, of an end that is a guess: on rear or front feet robots lean far


@dataclass(frozen=True)
class Room:
    """How much stricter the program is than the check, since it looks at its nodes alone.

    Attributes
    ----------
    torque, velocity, friction : shares of what is allowed
    finer : by which factor nodes are more than usual
    clear : beyond the clearance that is asked for, m
    range : from the ends of joint ranges, rad
    apart : beyond margins of obstacles and links, m
    pressed : least vertical force over the weight, where more than one contact stands
    turned : whether rows keep the robot above the ground where it lands turned by the pitch error
        Most landings do without them, and a program with them is slower and finds fewer jumps.
    lift : of feet in the middle of the flight, m
    """

    torque: float
    velocity: float
    friction: float
    finer: float = 1.0
    clear: float = 0.0
    range: float = 0.1
    apart: float = ROOM
    pressed: float = LEAST_FORCE
    turned: bool = False
    lift: float = LIFT

    def stricter(self, request: JumpRequest, figures: Mapping[str, float]) -> Room:
        """More nodes, and less of what the figures of a check show too much of."""

        def share(name: str, now: float) -> float:
            over = figures.get(name, 0.0) / FIGURES[name].most(request)
            return now if over <= 1 else now * STRICTER / min(over, 1.25)

        torque = min(share(name, self.torque) for name in ("torque", "torque_speed", "held_torque"))
        velocity = share("velocity", self.velocity)
        friction = share("friction", self.friction)
        if figures.get("slip", 0.0) > SLIP:
            friction *= LESS_FRICTION
        touchdown = figures.get("touchdown", 0.0) if self.turned else 0.0  # else the rows come first
        too_low = max(0.0, -figures.get("ground", 0.0), -touchdown)
        clear = self.clear + DEEPER * too_low
        apart = self.apart - min(figures.get("obstacles", 0.0), figures.get("self_distance", 0.0), 0.0)
        more = {"finer": FINER * self.finer, "clear": clear, "apart": apart}
        more["pressed"] = self.pressed + max(0.0, -figures.get("pull", 0.0))
        turned = self.turned or figures.get("touchdown", 0.0) < 0.0
        return replace(self, torque=torque, velocity=velocity, friction=friction, turned=turned, **more)


Answer = TypeVar("Answer")


def corrected(
    room: Room,
    request: JumpRequest,
    found: tuple[JumpProgram, Solution],
    program: Callable[[Room], JumpProgram],
    complete: Callable[[JumpProgram, Solution], tuple[Answer, Mapping[str, float] | None]],
) -> Answer:
    """Return what a solution comes to between its nodes; where that fails, of one with more nodes, and stricter.

    Parameters
    ----------
    room : of the program that is solved
    request : JumpRequest
    found : that program, and its solution
    program : the same with other room
    complete : what a solution comes to, and the figures of its check where they fail
    """
    answer, figures = complete(*found)
    for _ in range(CORRECTIONS):
        if figures is None:
            break
        room = room.stricter(request, figures)
        finer = program(room)
        again = solved(finer, finer.resampled(found[1], found[0].phases), found[0])
        if not again[1].converged:
            break
        found = again
        answer, figures = complete(*found)
    return answer


@dataclass(frozen=True, eq=False)
class Setup:
    """A jump as it is asked: all but the tightening of limits by which it is planned.

    Attributes
    ----------
    problem : Problem
    request : JumpRequest
    phases : of the jump
    standing : (2, n+1) orientation and joints before and after, rad
    ground : height of the ground over the centre of mass, standing, m
    fixed : what is known of the flight's ends
    momentum : of the flight, kg m^2/s, where it is kept
    """

    problem: Problem
    request: JumpRequest
    phases: tuple[Phase, ...]
    standing: Array
    ground: float
    fixed: tuple[Meeting, ...] = ()
    momentum: float | None = None

    def __post_init__(self) -> None:
        """Refuse feet that cannot stay where they stand."""
        for phase in self.phases:
            for contact in phase.others:
                phase.own_joints(self.problem.robot.tree, contact)

    @property
    def turn(self) -> float:
        """Of the base, from where it stands to where it stands again, in whole turns, rad."""
        return TURN * round(float(self.standing[-1, 0] - self.standing[0, 0]) / TURN)

    def node(self, room: Room) -> NodeRows:
        """Rows of nodes, with some room between them and what the request lets the stances use."""
        problem = self.problem
        request = self.request
        share = request.margin["torque"] * room.torque
        feet = [each for phase in self.phases for each in phase.contacts]
        postures = np.stack([*self.standing, *(each.y for each in self.fixed)])
        bent = bent_ranges(problem.robot, feet, postures, np.asarray(problem.position_limits))
        bounds = Bounds(
            torque=share * problem.motor_torque_limits,
            joint_torque=share * np.where(np.isinf(problem.motor_torque_limits).all(), problem.torque_limits, np.inf),
            stall=share * problem.motor_stall,
            slope=problem.motor_slope,
            velocity=request.margin["velocity"] * room.velocity * problem.velocity_limits,
            position=inside(bent, room.range),
            friction=room.friction * request.friction,
            held=room.torque,
            pressed=room.pressed,
            pitch_error=request.pitch_error if room.turned else 0.0,
        )
        model = PlanarModel(problem.robot, float(problem.flight.gravity))
        rest = self.standing[0 if self.phases[0].contacts else -1]
        watched = watched_points(problem.robot, feet, self.ground, rest, request.clearance + room.clear)
        phases = [replace(each, intervals=round(room.finer * each.intervals)) for each in self.phases]
        flight = next(index for index, phase in enumerate(phases) if phase.side == "flight")
        known = [(phases[flight + (1 if each.node else -1)].anchor, each.y) for each in self.fixed]
        return NodeRows(model, phases, watched, bounds, self.standing, known)

    def program(self, room: Room, iterations: int = ITERATIONS) -> JumpProgram:
        """Return the program with some room, that is solved in so many iterations at most."""
        problem = self.problem
        origin = problem.takeoff.place_in_plane
        parts = problem.obstacles, problem.self_clearances, origin, origin[1] - self._height_of_origin, room.apart
        limits = self.request.objective == "limits"
        apart = Separation(problem.robot, *parts)
        return JumpProgram(self.node(room), apart, self.fixed, self.momentum, limits, iterations, room.lift)

    @property
    def _height_of_origin(self) -> float:
        """Height over the ground, standing, of the frame whose place at takeoff obstacles are measured from, m."""
        flight = next(index for index, phase in enumerate(self.phases) if phase.side == "flight")
        takes_off = self.phases[flight - 1] if flight else self.phases[-1]
        rest = self.standing[0 if self.phases[0].contacts else -1]
        home = self.problem.robot.frames[takes_off.anchor.frame]
        place = heights_over_com(self.problem.robot, [Spot(home.body, home.local)], rest)
        return float(place[0].imag - self.ground)


def inside(ranges: Array, room: float) -> Array:
    """Joint ranges (n, 2) rad, less some room at both ends."""
    rooms = np.minimum(room, np.ptp(ranges, axis=1) / 4)
    return np.asarray(ranges + np.stack((rooms, -rooms), axis=1))


def jump_setup(problem: Problem, request: JumpRequest) -> Setup:
    """Resolve what a problem and a request ask for.

    Raises
    ------
    InputError
        No frame takes off, a contact cannot be one, there is no gravity, or no standing posture is found.
    """
    _check_stand(problem)
    turns = round(problem.final.orientation / TURN) - round(problem.initial.orientation / TURN)
    _refuse_what_is_not_kept(problem, turns)
    before = _wanted(problem, problem.initial, request.takeoff.from_)
    given = request.takeoff.contacts, request.landing.contacts
    outer, inner = ((), []) if all(given) else usual_groups(problem.robot, problem.takeoff.frame, "takeoff", before)
    inner = inner[
        :: 1 if turns * problem.robot.tree.turn >= 0 else -1
    ]  # backwards from the rear feet to the front ones
    takeoff = given[0] or [outer, *inner[:1]]
    landing = given[1] or [*inner[-1:], outer]
    takeoff_contacts, posture = _side(problem, request, "takeoff", takeoff, before)
    after = _wanted(problem, problem.final, request.landing.to, posture)
    landing_contacts, rest = _side(problem, request, "landing", landing, after)
    ground = ground_below(problem.robot, takeoff_contacts[0][0], posture)
    unit = math.sqrt(-ground / float(problem.flight.gravity))
    time = problem.flight.duration
    phases = (
        *side_phases("takeoff", takeoff_contacts, unit, _bounds(request, "takeoff", len(takeoff))),
        *side_phases("flight", [()], unit, [(time, time) if "duration" in request.fixed else None], turns),
        *side_phases("landing", landing_contacts, unit, _bounds(request, "landing", len(landing))),
    )
    _check_frames(problem, takeoff_contacts, landing_contacts)
    standing = np.stack((posture, _turned(rest, TURN * turns)))
    met = (("start", 0, problem.initial), ("goal", -1, problem.final))
    fixed = [Meeting(at, np.append(each.orientation, each.positions)) for key, at, each in met if key in request.fixed]
    return Setup(problem, request, phases, standing, ground, tuple(fixed), _momentum(problem, request))


def _refuse_what_is_not_kept(problem: Problem, turns: int) -> None:
    """Refuse what a flight is asked for and a jump around it would not do, since it stands level at both ends."""
    flight = problem.flight
    ends = (problem.initial.orientation, problem.final.orientation)
    missed = max(abs(math.remainder(orientation, TURN)) for orientation in ends)
    stands_level = problem.takeoff_frame.body != 0  # else its orientation is the goal's, less whole turns
    if stands_level and missed > FARTHEST_TURN:
        reason = f"a jump ends as level as it begins: it would turn by {TURN * turns:.4g} rad, {missed:.2g} rad off"
        advice = "ask for whole turns, or plan the flight alone with floatplan plan"
        raise InputError(reason, element="goal.orientation", advice=advice)
    landing = flight.landing
    rise = 0.0 if landing is None or landing.height is None else landing.height - problem.takeoff.position[1]
    if abs(rise) > FARTHEST_HEIGHT:
        reason = f"a jump lands on the ground that it leaves, not {rise:.3g} m up"
        advice = "leave it out, or plan the flight alone with floatplan plan"
        raise InputError(reason, element="flight.landing.height", advice=advice)


def _check_frames(
    problem: Problem, takeoff: Sequence[tuple[Contact, ...]], landing: Sequence[tuple[Contact, ...]]
) -> None:
    """Refuse a frame with which the flight is to take off, and which never stands; or to land, and not stand then."""
    flight = problem.flight
    stood = [contact for phase in takeoff for contact in phase]
    ends = (("takeoff", flight.takeoff, stood), ("landing", flight.landing, landing[0]))
    for side, asked, contacts in ends:
        frames = list(dict.fromkeys(frame for contact in contacts for frame in contact.frames))
        if asked is not None and asked.frame not in frames:
            reason = f"{asked.frame!r} is not among what stands there in the jump: {', '.join(frames)}"
            advice = f"name one of these, or leave it out; jump.{side}.contacts says what stands"
            raise InputError(reason, element=f"flight.{side}.frame", advice=advice)


def _momentum(problem: Problem, request: JumpRequest) -> float | None:
    """The flight's angular momentum, kg m^2/s, where the request keeps it."""
    asked = problem.flight.momentum_in_plane
    if "angular_momentum" not in request.fixed:
        return None
    if isinstance(asked, str):
        raise InputError(f"{asked!r} is no number to keep", element="flight.angular_momentum", advice="give one")
    return float(asked)


def side_setup(problem: Problem, request: JumpRequest, side: Side, meeting: Array) -> Setup:
    """Resolve one side of a jump: from standing to where a flight begins, or from where it ends to standing.

    Parameters
    ----------
    side : "takeoff" or "landing"
    meeting : (n+1,) rad, orientation and joints there

    Raises
    ------
    InputError
        As of :func:`jump_setup`.
    """
    robot = problem.robot
    takes_off = side == "takeoff"
    _check_stand(problem)
    frame = problem.takeoff.frame if takes_off else problem.landing.frame
    _check_stands(robot, frame, side)
    wanted = _wanted(problem, problem.initial, request.takeoff.from_)
    wanted = wanted if takes_off else _wanted(problem, problem.final, request.landing.to, wanted)
    if problem.takeoff_frame.body == 0:
        wanted = _balanced(robot, frame, wanted)
    groups: Sequence[Sequence[str]] = getattr(request, side).contacts or ()
    if not groups:
        feet, inner = usual_groups(robot, frame, side, wanted)
        groups = [feet, *([(frame,)] if len(feet) > 1 else inner)][:: 1 if takes_off else -1]
    contacts, posture = _side(problem, request, side, groups, wanted)
    ground = ground_below(robot, contacts[0 if takes_off else -1][0], posture)
    time = problem.flight.duration
    unit = math.sqrt(-ground / float(problem.flight.gravity))
    generic = side_phases(side, contacts, unit, [None] * len(contacts))
    phases = [replace(each, bounds=(BRIEFEST * each.duration, each.bounds[1]), gentle=True) for each in generic]
    phases.insert(len(phases) if takes_off else 0, Phase("flight", (), time, (time, time), 0))
    rest = _turned(posture, TURN * round((meeting[0] - posture[0]) / TURN))
    return Setup(problem, request, tuple(phases), np.stack((rest, meeting)[:: 1 if takes_off else -1]), ground)


def _balanced(robot: Robot, frame: str, posture: Array) -> Array:
    """A posture (n+1,) turned so that the centre of mass is above a frame on the base, which the flight's need not be.

    The turn is at most half of one; whole turns stay.
    """
    home = robot.frames[frame]
    way = heights_over_com(robot, [Spot(home.body, home.local)], posture)[0]
    turn = math.remainder(-math.pi / 2 - float(np.angle(way)), TURN)
    return np.append(posture[0] + robot.tree.turn * turn, posture[1:])


def _check_stands(robot: Robot, frame: str, side: Side) -> None:
    if frame == robot.tree.names[0]:
        reason = "the frame there is the base's own, so that nothing stands"
        raise InputError(reason, element=f"flight.{side}", advice="name a foot there")


def _turned(posture: Array, angle: float) -> Array:
    """The posture (n+1,) after whole turns of the base, rad."""
    return np.append(posture[0] + angle, posture[1:])


def _check_stand(problem: Problem) -> None:
    problem.robot.check_shapes()
    if not problem.flight.gravity > 0:
        raise InputError("nothing stands without gravity", element="flight.gravity", advice="give it, as 9.81")


def _side(
    problem: Problem, request: JumpRequest, side: Side, groups: Sequence[Sequence[str]], wanted: Array
) -> tuple[list[tuple[Contact, ...]], Array]:
    """Contacts of a side's phases, and the posture (n+1,) in which the robot stands still at its outer end, rad."""
    robot = problem.robot
    takes_off = side == "takeoff"
    place = f"jump.{side}.contacts"
    asked = request.takeoff.from_ if takes_off else request.landing.to
    own = isinstance(asked, Mapping)
    named = ("jump.takeoff.from" if takes_off else "jump.landing.to") if own else place
    for joint, at, (low, high) in zip(robot.joints, wanted[1:], problem.position_limits, strict=True):
        if own and not low <= at <= high:
            reason = f"{at:.4g} rad is outside the joint's range, {low:.4g} to {high:.4g} rad"
            raise InputError(reason, element=f"{named}.{joint}")
    contacts = [_contacts(robot, names, wanted, place, request.feet) for names in groups]
    if any(len(each) > MOST for each in contacts):
        raise InputError(f"more than {MOST} points would stand at once", element=place, advice="name fewer")
    outer = contacts[0 if takes_off else -1]
    tilt = math.pi if problem.takeoff_frame.body == 0 else 0.0  # what stands on its base is not level
    limits = np.vstack((wanted[0] + [-tilt, tilt], inside(np.asarray(problem.position_limits), Room.range)))
    floating = "" if own else in_the_air(robot, outer, wanted, FAR)
    if not own:
        wanted = with_bent_knees(robot, outer, wanted, limits[1:])
    found = None if floating else standing_posture(robot, outer, wanted, limits)
    is_other = own and found is not None and np.abs(found - wanted)[1:].max() > NEAR
    if not floating and found is not None and not is_other:
        floating = in_the_air(robot, outer, found)
    if floating:
        raise InputError(floating, element=place, advice="name what is on the ground where it stands")
    if found is None or is_other:
        if found is None:
            beyond = static_beyond_ranges(robot, outer, wanted, limits)
            advice = f"{beyond}: give another posture, or other contacts" if beyond else NO_STATIC
        else:
            static = (f"{name} {at:.4g}" for name, at in zip(robot.joints, found[1:], strict=True))
            advice = f"static is {', '.join(static)} rad"
        reason = f"the posture is not static: {not_static(robot, outer, wanted)}"
        raise InputError(reason, element=named, advice=advice)
    return contacts, found


def _bounds(request: JumpRequest, side: Side, phases: int) -> list[tuple[float, float] | None]:
    """Bounds of the durations of a side's phases, s."""
    given = getattr(request, side).durations
    if given is not None and len(given) != phases:
        reason = f"{len(given)} given for {phases} phases of contacts"
        raise InputError(reason, element=f"jump.{side}.durations", advice="give one for each phase")
    return [None] * phases if given is None else [(low, high) for low, high in given]


def _wanted(problem: Problem, state: JointState, asked: Standing, standing: Array | None = None) -> Array:
    """Posture (n+1,) rad that is asked for: that of ``standing``, or by joint, others being in the reference.

    The base is level; or, where the robot stands on it, as in the flight's ``state`` there, less whole turns.
    """
    if standing is not None and not isinstance(asked, Mapping):
        return standing
    robot = problem.robot
    given = asked if isinstance(asked, Mapping) else {}
    level = math.remainder(state.orientation, TURN) if problem.takeoff_frame.body == 0 else 0.0
    return np.array([level, *(given.get(*pair) for pair in zip(robot.joints, robot.resting.tolist(), strict=True))])


def usual_groups(robot: Robot, frame: str, side: Side, wanted: Array) -> tuple[tuple[str, ...], list[tuple[str]]]:
    """Return frames on which it stands where none are asked, the rearmost first; and what may stand next to the flight.

    Those are each foot alone; or of the only one its toe, nothing where that is a point. A frame of the base itself
    is refused.
    """
    _check_stands(robot, frame, side)
    feet = standing_feet(robot, frame, wanted)
    if len(feet) > 1:
        return tuple(feet), [(foot,) for foot in feet]
    toe = contact_at(robot, frame, wanted)[0]
    return (frame,), [(toe.name,)] if toe.of_sole else []


def _rolling_or_not(robot: Robot, contact: Contact, wanted: Array, feet: str) -> Contact:
    """A contact as ``feet`` of a request asks for it: on circles that roll, or on points."""
    if feet == "rolling":
        return rolling(robot, contact, wanted)
    if feet == "auto" and not not_round(robot, contact, wanted):
        return rolling(robot, contact, wanted)
    return contact


def _contacts(robot: Robot, names: Sequence[str], wanted: Array, place: str, feet: str) -> tuple[Contact, ...]:
    """Contacts of a phase's names; of a sole toe and heel, or the one named."""
    found: list[Contact] = []
    for name in names:
        frame, dot, _ = name.partition(".") if name not in robot.frames else (name, "", "")
        try:
            points = contact_at(robot, frame, wanted)
            chosen = [each for each in points if not dot or each.name == name]
            chosen = [_rolling_or_not(robot, each, wanted, feet) for each in chosen]
        except InputError as error:
            raise error.within(element=place) from None
        if not chosen:
            raise InputError(f"{name!r} is no point of a sole", element=place, advice=f"name {points[0].name!r}")
        twice = [each for each in found if set(each.names) & {point for one in chosen for point in one.names}]
        if twice:
            reason = f"{name!r} stands twice: with {', '.join(map(repr, twice[0].names))}"
            raise InputError(reason, element=place, advice="name a foot, or those that are coupled to it, once")
        found += chosen
    return tuple(found)
