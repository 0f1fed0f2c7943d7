"""From a problem and a request to the program of a jump: contacts, standing postures, phases, bounds."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any, TypeAlias

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.jumps.contacts import (
    GroundContact,
    bent_ranges,
    clearance_points,
    contact_at,
    ground_below,
    in_the_air,
    least_distance,
    names_of,
    not_round,
    rolling,
    standing_feet,
    with_bent_knees,
)
from floatplan.jumps.model import PlanarModel
from floatplan.jumps.phases import (
    FixedEnd,
    Phase,
    Side,
    begin_state,
    in_sequence,
    indices_of_flights,
    level_posture,
    not_static,
    refuse_other_feet,
    running_start,
    side_phases,
    standing_posture,
    static_beyond_ranges,
)
from floatplan.jumps.program import JumpProgram
from floatplan.jumps.rounds import NodeMargins
from floatplan.jumps.rows import NodeLimits, NodeRows
from floatplan.jumps.separation import Separation
from floatplan.problem.ground_step import GroundStep, edge_obstacles
from floatplan.problem.jump import Ending, JumpFlight, JumpRequest
from floatplan.problem.parts import JointState, Obstacle
from floatplan.problem.problem import Problem
from floatplan.robot import Robot
from floatplan.robot.standing import Spot, positions_from_com

SideContacts: TypeAlias = tuple[list[tuple[GroundContact, ...]], Array]  # contacts of a side's phases, and its posture


@dataclass(frozen=True, eq=False)
class Setup:
    """A jump as it is requested: all but the margins of the program by which it is planned.

    Attributes
    ----------
    problem : Problem
    request : JumpRequest
    phases : of the jump
    ends : (flights + 1, n+1) rad, orientation and joints where it stands before each flight and after the last; of one
        side alone where it meets the flight
    ground_from_com : height of the ground over the centre of mass, standing, m
    fixed_ends : what is fixed at the flight's ends
    fixed_momentum : of the flight, kg m^2/s, where it is fixed
    begin_rates : (n+1,) rad/s, with which the jump begins; None where it stands still
    """

    problem: Problem
    request: JumpRequest
    phases: tuple[Phase, ...]
    ends: Array
    ground_from_com: float
    fixed_ends: tuple[FixedEnd, ...] = ()
    fixed_momentum: float | None = None
    begin_rates: Array | None = None

    def __post_init__(self) -> None:
        """Refuse feet that cannot stay where they stand."""
        for phase in self.phases:
            for contact in phase.others:
                phase.own_joints(self.problem.robot.tree, contact)  # raises where they are too few

    @property
    def base_rotation(self) -> float:
        """The rotation of the base from where it stands to where it stands again, whole turns of it, rad."""
        return math.tau * round(float(self.ends[-1, 0] - self.ends[0, 0]) / math.tau)

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """The problem's obstacles, and the edge between grounds of different heights."""
        position = self.problem.takeoff.position
        step = GroundStep.of(self.request, position, position[1] - self._height_of_origin)
        return (*self.problem.obstacles, *edge_obstacles(step))

    @property
    def _flight(self) -> int:
        """Index of the first flight among the phases."""
        return indices_of_flights(self.phases)[0]

    @property
    def _stance_posture(self) -> Array:
        """The posture (n+1,) before the first stance; after the last one, where the jump is a landing alone."""
        posture: Array = self.ends[0 if self.phases[0].contacts else -1]
        return posture

    def node_rows(self, margins: NodeMargins) -> NodeRows:
        """Rows of nodes, with margins between them and what the request lets the stances use."""
        problem = self.problem
        request = self.request
        feet = list(chain.from_iterable(phase.contacts for phase in self.phases))
        postures = np.stack([*self.ends, *(end.y for end in self.fixed_ends)])
        ranges = bent_ranges(problem.robot, feet, postures, np.asarray(problem.position_limits))
        torque_share = request.margin["torque"] * margins.torque
        no_motor_limits = np.isinf(problem.motor_torque_limits).all()
        limits = NodeLimits(
            torque=torque_share * problem.motor_torque_limits,
            joint_torque=torque_share * np.where(no_motor_limits, problem.torque_limits, np.inf),
            stall=torque_share * problem.motor_stall,
            slope=problem.motor_slope,
            velocity=request.margin["velocity"] * margins.velocity * problem.velocity_limits,
            position=narrowed(ranges, margins.range),
            friction=margins.friction * request.friction,
            torque_margin=margins.torque,
            least_force=max(margins.least_force, request.least_force),
            pitch_error=request.pitch_error if margins.rotated_landing else 0.0,
        )
        clearance = request.clearance + margins.clearance
        points = clearance_points(problem.robot, feet, self.ground_from_com, self._stance_posture, clearance)
        phases = [replace(phase, intervals=round(margins.refinement * phase.intervals)) for phase in self.phases]
        low_postures = []
        for end in self.fixed_ends:
            stance = phases[self._flight + (1 if end.node else -1)]
            low_postures.append((stance.anchor, end.y))
        model = PlanarModel(problem.robot, float(problem.flight.gravity))
        return NodeRows(model, phases, points, limits, self.ends, low_postures)

    def program(self, margins: NodeMargins) -> JumpProgram:
        """Return the program with some margins."""
        problem = self.problem
        origin = problem.takeoff.planar_position
        separation = Separation(
            problem.robot,
            obstacles=self.obstacles,
            pairs=problem.self_clearances,
            origin=origin,
            ground=origin[1] - self._height_of_origin,
            reserve=margins.reserve,
        )
        return JumpProgram(
            self.node_rows(margins),
            separation,
            self.fixed_ends,
            self.fixed_momentum,
            beyond=least_distance(problem.robot, self.request, self.phases[-1].contacts, self.ends[-1]),
            periodic=self.request.is_periodic,
            limits=self.request.objective == "limits",
            lift=margins.lift,
            begin_rates=self.begin_rates,
        )

    @property
    def _height_of_origin(self) -> float:
        """Height over the ground, standing, of the frame whose position at takeoff obstacles are measured from, m."""
        takes_off = self.phases[self._flight - 1] if self._flight else self.phases[-1]
        home = self.problem.robot.frames[takes_off.anchor.frame]
        origin = positions_from_com(self.problem.robot, [Spot(home.body, home.local)], self._stance_posture)
        return float(origin[0].imag - self.ground_from_com)


def narrowed(ranges: Array, margin: float) -> Array:
    """Joint ranges (n, 2) rad, less a margin at both ends, a quarter of the range at most."""
    margins = np.minimum(margin, np.ptp(ranges, axis=1) / 4)
    return np.asarray(ranges + np.stack((margins, -margins), axis=1))


def jump_setup(problem: Problem, request: JumpRequest) -> Setup:
    """Resolve what a problem and a request ask for.

    Raises
    ------
    InputError
        No frame takes off, a contact cannot be one, there is no gravity, or no standing posture is found.
    """
    check_robot_stands(problem)
    robot = problem.robot
    turns = round(problem.final.orientation / math.tau) - round(problem.initial.orientation / math.tau)
    _refuse_impossible_ends(problem, turns)
    refuse_other_ground(problem, request)
    before = _target_posture(problem, problem.initial, request.takeoff.from_)
    if request.takeoff.orientation is not None:
        before[0] = request.takeoff.orientation
    flights = _flights(problem, request, turns)
    phases: list[Phase] = []
    ends: list[Array] = []
    sides: dict[tuple[Any, Any], tuple[SideContacts, SideContacts]] = {}  # by names of contacts
    for number, (own_turns, flight_bounds) in enumerate(flights):
        takeoff, landing = _groups(problem, request, own_turns, before)
        groups = (tuple(takeoff), tuple(landing))
        if groups not in sides:  # flights with the same contacts stand in the same postures
            takeoff_side = _side(problem, request, "takeoff", takeoff, before)
            stood = None if request.takeoff.in_motion else takeoff_side[1]
            after = _target_posture(problem, problem.final, request.landing.to, stood)
            sides[groups] = (takeoff_side, _side(problem, request, "landing", landing, after))
        (takeoff_contacts, start), (landing_contacts, end) = sides[groups]
        if not number:
            ends.append(start)
            if request.takeoff.in_motion:
                request = replace(request, takeoff=running_start(problem, request, takeoff_contacts[0], start))
                problem = replace(problem, jump=request)
            ground_from_com = ground_below(robot, takeoff_contacts[0][0], start)
            unit = math.sqrt(-ground_from_com / float(problem.flight.gravity))
            before_flight = chain.from_iterable(takeoff_contacts)
            check_frames(problem, _frames_of(before_flight), _frames_of(landing_contacts[0]))
        is_last = number == len(flights) - 1
        of_takeoff = duration_bounds(request, "takeoff", len(takeoff))
        of_landing = duration_bounds(request, "landing", len(landing))
        of_flight = [
            *side_phases("takeoff", takeoff_contacts, unit, of_takeoff),
            *side_phases("flight", [()], unit, [flight_bounds], own_turns),
            *side_phases("landing", landing_contacts, unit, of_landing),
        ]
        phases += [in_sequence(phase, number, problem, request) for phase in of_flight]
        ends.append(_rotated(end if is_last else start, ends[-1][0] - start[0] + math.tau * own_turns))
    refuse_other_feet(phases, request.is_periodic)
    fixed_ends = []
    for key, node, state in (("start", 0, problem.initial), ("goal", -1, problem.final)):
        if key in request.fixed:
            fixed_ends.append(FixedEnd(node, np.append(state.orientation, state.positions)))
    begin_rates = begin_state(robot, request.takeoff)[1] if request.takeoff.in_motion else None
    return Setup(
        problem,
        request,
        tuple(phases),
        ends=np.stack(ends),
        ground_from_com=ground_from_com,
        fixed_ends=tuple(fixed_ends),
        fixed_momentum=_fixed_momentum(problem, request),
        begin_rates=begin_rates,
    )


def _flights(problem: Problem, request: JumpRequest, turns: int) -> list[tuple[int, tuple[float, float] | None]]:
    """Whole turns of each flight, and bounds of its duration, s, if it has any; ``turns`` are those of the problem."""
    time = problem.flight.duration
    fixed = (time, time) if "duration" in request.fixed else None
    flights: list[tuple[int, tuple[float, float] | None]] = []
    for flight in request.flights or (JumpFlight(),):
        own_turns = turns if flight.turns is None else flight.turns
        flights += [(own_turns, flight.duration or fixed)] * flight.repeat
    if flights[0][0] != turns:
        reason = f"the first flight makes {flights[0][0]} turns, and the problem's goal is {turns} from its start"
        raise InputError(reason, element="jump.flights[0].turns", advice="let both say the same, or leave it out")
    if len(flights) > 1 and problem.obstacles:
        reason = "only jumps of one flight keep clear of obstacles"
        raise InputError(reason, element="obstacles", advice="leave them out, or plan one flight")
    return flights


def _groups(
    problem: Problem, request: JumpRequest, turns: int, posture: Array
) -> tuple[Sequence[Sequence[str]], Sequence[Sequence[str]]]:
    """Names of what stands in the phases before and after a flight: as requested, else as usual for so many turns."""
    takeoff = request.takeoff.contacts
    landing = request.landing.contacts
    if takeoff and landing:
        return takeoff, landing
    feet, single = usual_groups(problem.robot, problem.takeoff.frame, "takeoff", posture)
    if turns * problem.robot.tree.turn < 0:  # forwards from the front feet to the rear ones
        single = single[::-1]
    return takeoff or [feet, *single[:1]], landing or [*single[-1:], feet]


def _refuse_impossible_ends(problem: Problem, turns: int) -> None:
    """Refuse ends of a flight that a jump around it does not reach, since it stands level at both ends."""
    tilts = [abs(math.remainder(state.orientation, math.tau)) for state in (problem.initial, problem.final)]
    stands_level = problem.takeoff_frame.body != 0  # else its orientation is the goal's, less whole turns
    # An orientation is a guess: on rear or front feet robots lean far.
    if stands_level and max(tilts) > math.tau / 3:
        angle = f"it would turn by {math.tau * turns:.4g} rad, {max(tilts):.2g} rad off"
        reason = f"a jump ends as level as it begins: {angle}"
        advice = "ask for whole turns, or plan the flight alone with floatplan plan"
        raise InputError(reason, element="goal.orientation", advice=advice)


def refuse_other_ground(problem: Problem, request: JumpRequest) -> None:
    """Refuse a flight, in a plane or in space, that lands on another ground than the jump around it."""
    landing = problem.flight.landing
    rise = 0.0 if landing is None or landing.height is None else landing.height - problem.takeoff.position[-1]
    rise_of_ground = request.rise
    if min(abs(rise), abs(rise - rise_of_ground)) > 0.2:  # m: ankles rise by so much where soles tip; 0 if left out
        ground = f"ground that is {rise_of_ground:.3g} m up" if rise_of_ground else "the ground that it leaves"
        reason = f"a jump lands on {ground}, not {rise:.3g} m up"
        advice = "leave it out, or plan the flight alone with floatplan plan"
        raise InputError(reason, element="flight.landing.height", advice=advice)


def check_frames(problem: Problem, takeoff: Iterable[str], landing: Iterable[str]) -> None:
    """Refuse a frame with which the flight is to take off, and which never stands; or to land, and not stand then.

    Parameters
    ----------
    takeoff, landing : frames that stand before the flight, and where it lands
    """
    flight = problem.flight
    for side, requested, names in (("takeoff", flight.takeoff, takeoff), ("landing", flight.landing, landing)):
        frames = list(dict.fromkeys(names))
        if requested is not None and requested.frame not in frames:
            reason = f"{requested.frame!r} is not among what stands there in the jump: {', '.join(frames)}"
            advice = f"name one of these, or leave it out; jump.{side}.contacts says what stands"
            raise InputError(reason, element=f"flight.{side}.frame", advice=advice)


def _frames_of(contacts: Iterable[GroundContact]) -> list[str]:
    return list(chain.from_iterable(contact.frames for contact in contacts))


def _fixed_momentum(problem: Problem, request: JumpRequest) -> float | None:
    """The flight's angular momentum, kg m^2/s, where the request fixes it."""
    momentum = problem.flight.momentum_in_plane
    if "angular_momentum" not in request.fixed:
        return None
    if isinstance(momentum, str):
        raise InputError(f"{momentum!r} is no number to keep", element="flight.angular_momentum", advice="give one")
    return float(momentum)


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
    check_robot_stands(problem)
    frame = problem.takeoff.frame if takes_off else problem.landing.frame
    _check_frame_stands(robot, frame, side)
    target = _target_posture(problem, problem.initial, request.takeoff.from_)
    if not takes_off:
        target = _target_posture(problem, problem.final, request.landing.to, target)
    if problem.takeoff_frame.body == 0:
        target = _over_frame(robot, frame, target)
    groups: Sequence[Sequence[str]] = getattr(request, side).contacts or ()
    if not groups:
        feet, single = usual_groups(robot, frame, side, target)
        groups = [feet, *([(frame,)] if len(feet) > 1 else single)]
        if not takes_off:
            groups = groups[::-1]
    contacts, posture = _side(problem, request, side, groups, target)
    ground_from_com = ground_below(robot, contacts[0 if takes_off else -1][0], posture)
    time = problem.flight.duration
    unit = math.sqrt(-ground_from_com / float(problem.flight.gravity))
    phases = []
    for phase in side_phases(side, contacts, unit, [None] * len(contacts)):
        shortest = 0.15 * phase.duration  # since the flight is fixed, stances may have to be brief
        phases.append(replace(phase, bounds=(shortest, phase.bounds[1]), gentle=True))
    phases.insert(len(phases) if takes_off else 0, Phase("flight", (), time, (time, time), 0))
    standing = _rotated(posture, math.tau * round((meeting[0] - posture[0]) / math.tau))
    ends = np.stack((standing, meeting) if takes_off else (meeting, standing))
    return Setup(problem, request, tuple(phases), ends, ground_from_com)


def _over_frame(robot: Robot, frame: str, posture: Array) -> Array:
    """A posture (n+1,) rotated so that the centre of mass is above a frame on the base, where the flight's may not be.

    The angle is at most half a turn; whole turns stay.
    """
    home = robot.frames[frame]
    from_com = positions_from_com(robot, [Spot(home.body, home.local)], posture)[0]
    angle = math.remainder(-math.pi / 2 - float(np.angle(from_com)), math.tau)
    return _rotated(posture, robot.tree.turn * angle)


def _rotated(posture: Array, angle: float) -> Array:
    """The posture (n+1,) with its base rotated by an angle, rad."""
    return np.append(posture[0] + angle, posture[1:])


def _check_frame_stands(robot: Robot, frame: str, side: Side) -> None:
    if frame == robot.tree.names[0]:
        reason = "the frame there is the base's own, so that nothing stands"
        raise InputError(reason, element=f"flight.{side}", advice="name a foot there")


def check_robot_stands(problem: Problem) -> None:
    """Refuse a robot without shapes, and a world without gravity."""
    problem.robot.check_shapes()
    if not problem.flight.gravity > 0:
        raise InputError("nothing stands without gravity", element="flight.gravity", advice="give it, as 9.81")


def _side(
    problem: Problem, request: JumpRequest, side: Side, groups: Sequence[Sequence[str]], target: Array
) -> SideContacts:
    """Contacts of a side's phases, and the posture (n+1,) in which the robot stands still at its outer end, rad."""
    robot = problem.robot
    takes_off = side == "takeoff"
    contacts_key = f"jump.{side}.contacts"
    posture_key = contacts_key
    is_requested = isinstance(request.takeoff.from_ if takes_off else request.landing.to, Mapping)
    if is_requested:
        posture_key = "jump.takeoff.from" if takes_off else "jump.landing.to"
        refuse_beyond_ranges(problem, target[1:], posture_key)
    contacts = [_contacts(robot, names, target, contacts_key, request.feet) for names in groups]
    most = 2  # contacts of a phase, of which forces and closures of a planar robot can be told apart
    if any(len(of_phase) > most for of_phase in contacts):
        raise InputError(f"more than {most} points would stand at once", element=contacts_key, advice="name fewer")
    outer = contacts[0 if takes_off else -1]
    if takes_off and is_requested and request.takeoff.in_motion:
        return contacts, posture_in_motion(robot, outer, target, posture_key)
    tilt = math.pi if problem.takeoff_frame.body == 0 else 0.0  # what stands on its base is not level
    ranges = narrowed(np.asarray(problem.position_limits), NodeMargins.range)
    limits = np.vstack((target[0] + [-tilt, tilt], ranges))
    if not is_requested:
        floating = in_the_air(robot, outer, target, most=0.1)  # m: farther up in the reference posture is no foot
        if floating:
            raise InputError(floating, element=contacts_key, advice="name what is on the ground where it stands")
        target = with_bent_knees(robot, outer, target, limits[1:])
    posture = standing_posture(robot, outer, target, limits)
    advice = ""
    if posture is None:
        beyond = static_beyond_ranges(robot, outer, target, limits)
        advice = "none was found on these contacts: give other ones, or plan more joints"
        if beyond:
            advice = f"{beyond}: give another posture, or other contacts"
    elif is_requested and is_moved(posture, target):
        static = [f"{name} {angle:.4g}" for name, angle in zip(robot.joints, posture[1:], strict=True)]
        advice = f"static is {', '.join(static)} rad"
    if posture is None or advice:
        reason = f"the posture is not static: {not_static(robot, outer, target)}"
        raise InputError(reason, element=posture_key, advice=advice)
    floating = in_the_air(robot, outer, posture)
    if floating:
        raise InputError(floating, element=contacts_key, advice="name what is on the ground where it stands")
    return contacts, posture


def is_moved(posture: Array, target: Array) -> bool:
    """Whether a posture (n+1,) rad that is static, or level, is another one than the requested target."""
    most = 0.1  # [rad] of a joint; the base is level whatever is requested
    return bool(np.abs(posture - target)[1:].max() > most)


def posture_in_motion(robot: Robot, contacts: Sequence[GroundContact], target: Array, key: str) -> Array:
    """The posture (n+1,) rad in which a jump begins in motion: the target, moved a little so that feet are level."""
    posture = level_posture(robot, contacts, target)
    floating = in_the_air(robot, contacts, posture)
    if is_moved(posture, target):
        floating = not_static(robot, contacts, target)
    if floating:
        advice = "bend the legs so that all are on the ground, or give the base's orientation there"
        raise InputError(floating, element=key, advice=advice)
    return posture


def refuse_beyond_ranges(problem: Problem, joints: Array, key: str) -> None:
    """Refuse positions (n,) rad of planned joints, requested by a key, that are outside of their ranges."""
    for name, angle, (low, high) in zip(problem.robot.joints, joints, problem.position_limits, strict=True):
        if not low <= angle <= high:
            reason = f"{angle:.4g} rad is outside the joint's range, {low:.4g} to {high:.4g} rad"
            raise InputError(reason, element=f"{key}.{name}")


def duration_bounds(request: JumpRequest, side: Side, phases: int) -> list[tuple[float, float] | None]:
    """Bounds of the durations of a side's phases, s."""
    durations = getattr(request, side).durations
    if durations is None:
        return [None] * phases
    if len(durations) != phases:
        reason = f"{len(durations)} given for {phases} phases of contacts"
        raise InputError(reason, element=f"jump.{side}.durations", advice="give one for each phase")
    return [(low, high) for low, high in durations]


def _target_posture(problem: Problem, state: JointState, requested: Ending, standing: Array | None = None) -> Array:
    """Posture (n+1,) rad that is requested: that of ``standing``, or by joint, others being in the reference.

    The base is level; or, where the robot stands on it, as in the flight's ``state`` there, less whole turns.
    """
    if standing is not None and not isinstance(requested, Mapping):
        return standing
    robot = problem.robot
    by_joint = requested if isinstance(requested, Mapping) else {}
    orientation = math.remainder(state.orientation, math.tau) if problem.takeoff_frame.body == 0 else 0.0
    joints = [by_joint.get(name, angle) for name, angle in zip(robot.joints, robot.resting.tolist(), strict=True)]
    return np.array([orientation, *joints])


def usual_groups(robot: Robot, frame: str, side: Side, posture: Array) -> tuple[tuple[str, ...], list[tuple[str]]]:
    """Return the frames on which it usually stands, the rearmost first; and what may stand next to the flight.

    Those are each single foot; or of the only one its toe, nothing where that is a point. A frame of the base itself
    is refused.
    """
    _check_frame_stands(robot, frame, side)
    feet = standing_feet(robot, frame, posture)
    if len(feet) > 1:
        return tuple(feet), [(foot,) for foot in feet]
    toe = contact_at(robot, frame, posture)[0]
    return (frame,), [(toe.name,)] if toe.of_sole else []


def _contacts(robot: Robot, names: Sequence[str], posture: Array, key: str, feet: str) -> tuple[GroundContact, ...]:
    """Contacts of a phase's names, points or circles as ``feet`` says; of a sole toe and heel, or the one named."""
    contacts: list[GroundContact] = []
    for name in names:
        frame, dot, _ = name.partition(".") if name not in robot.frames else (name, "", "")
        try:
            points = contact_at(robot, frame, posture)
            named = [point for point in points if not dot or point.name == name]
            for index, point in enumerate(named):
                if feet == "rolling" or (feet == "auto" and not not_round(robot, point, posture)):
                    named[index] = rolling(robot, point, posture)
        except InputError as error:
            raise error.within(element=key) from None
        if not named:
            raise InputError(f"{name!r} is no point of a sole", element=key, advice=f"name {points[0].name!r}")
        own_names = set(names_of(named))
        for other in contacts:
            if own_names & set(other.names):
                reason = f"{name!r} stands twice: with {', '.join(map(repr, other.names))}"
                raise InputError(reason, element=key, advice="name a foot, or those that are coupled to it, once")
        contacts += named
    return tuple(contacts)
