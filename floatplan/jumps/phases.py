"""Phases of a jump: which contacts stand when, for how long; and where it begins and ends, standing or in motion."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from scipy.linalg import null_space
from scipy.optimize import Bounds, NonlinearConstraint, least_squares, minimize

from floatplan.arrays import Array, ComplexArray
from floatplan.errors import InputError
from floatplan.jumps.contacts import LEVEL, GroundContact, contact_depths, contact_positions, names_of
from floatplan.problem.jump import JumpRequest, JumpTakeoff
from floatplan.problem.problem import Problem
from floatplan.robot import PlanarTree, Robot
from floatplan.robot.standing import spot_weights

SUPPORT_MARGIN = 0.2  # [-] of the support's length, by which the centre of mass stays inside it where the robot stands
STILL = 1e-6  # [m, rad] what counts as level, and as within limits

# A step is a stance between two flights of a recorded motion in space; in a jump that is a landing and a takeoff.
Side = Literal["takeoff", "flight", "landing", "step"]


class Usual(NamedTuple):
    """Usual durations of a phase: a guess over sqrt(height / g), shares of it that bound them; and its intervals."""

    guess: float
    shortest: float
    longest: float
    intervals: int

    def duration(self, unit: float, requested: tuple[float, float] | None) -> tuple[float, tuple[float, float]]:
        """Guess of the duration, and its bounds, s, where sqrt(height / g) is ``unit``; within requested bounds."""
        low, high = requested or (self.shortest * self.guess * unit, self.longest * self.guess * unit)
        return min(max(self.guess * unit, low), high), (low, high)


def _usual_durations(side: Side, phases: int, turns: int) -> list[Usual]:
    """Durations of a side's one or two phases, those of jumps of many robots; of a flight, with turns or without."""
    if side == "flight":
        return [Usual(2.57, 0.8, 1.5, 16) if turns else Usual(1.2, 0.3, 1.5, 16)]
    if phases == 1:
        return [Usual(2.73 if side == "takeoff" else 3.16, 0.5, 1.6, 28)]
    guesses = (1.7, 1.03) if side == "takeoff" else (0.86, 2.3)
    return [Usual(guess, 0.5, 1.6, 18) for guess in guesses]


@dataclass(frozen=True)
class TimedPhase:
    """A time in which the contacts do not change, in a plane or in space.

    Attributes
    ----------
    side : "takeoff", "flight", "landing", or "step", between two flights
    contacts : those that stand
    duration : guessed, s
    bounds : of the duration, s
    intervals : between the nodes of the program
    """

    side: Side
    contacts: tuple[Any, ...]
    duration: float
    bounds: tuple[float, float]
    intervals: int
    first_step: ClassVar[float]  # [-] of an even step is the step next to the flight; steps grow linearly from there

    @property
    def name(self) -> str:
        """Side and contacts, for a person."""
        names = [contact.name for contact in self.contacts]
        return f"{self.side} on {' and '.join(names)}" if names else self.side

    @property
    def points(self) -> tuple[str, ...]:
        """Names of all points that stand, by contact."""
        return names_of(self.contacts)

    @cached_property
    def progress(self) -> Array:
        """Times (intervals + 1,) of its nodes over its duration: denser near the one flight that it meets."""
        even = np.linspace(0.0, 1.0, self.intervals + 1)
        if self.side in ("flight", "step"):
            return even
        from_flight = 1 - even if self.side == "takeoff" else even
        spaced = from_flight * (self.first_step + (1 - self.first_step) * from_flight)
        return 1 - spaced if self.side == "takeoff" else spaced


@dataclass(frozen=True)
class Phase(TimedPhase):
    """A phase in a plane; its first contact is the anchor, which stands in all phases of its side.

    Attributes
    ----------
    gentle : whether forces may vanish towards the flight as gently as they like; how fast they grow after landing costs
        nothing then either, and no rows are of a robot that lands rotated
    flight_number : number of the flight that it is, that it leads to, or that it follows
    rise : height of the ground on which it stands over that of the first stance, m
    """

    contacts: tuple[GroundContact, ...]
    gentle: bool = False
    flight_number: int = 0
    rise: float = 0.0
    first_step: ClassVar[float] = 0.1

    @property
    def name(self) -> str:
        """Side and contacts, for a person; of which flight, but of the first."""
        return f"{super().name}, flight {self.flight_number + 1}" if self.flight_number else super().name

    @property
    def anchor(self) -> GroundContact:
        """The contact from which positions are measured."""
        return self.contacts[0]

    @cached_property
    def force_shares(self) -> Array:
        """Shares (intervals + 1,) of the least forces that are required at its nodes."""
        from_flight = 1 - self.progress if self.side == "takeoff" else self.progress
        if not self.gentle:
            return np.ones_like(from_flight)
        vanishing = 0.1  # [-] of the duration, at the end next to the flight, in which forces may vanish gently
        return np.minimum(from_flight / vanishing, 1.0)

    @property
    def others(self) -> tuple[GroundContact, ...]:
        """The contacts but the anchor."""
        return self.contacts[1:]

    def stacked(self, forces: Mapping[str, Array]) -> Array:
        """Forces (2 others, N) of the contacts but the anchor, from those (N, 2) of points by their names."""
        sums = [np.sum(contact.values(forces), axis=0).T for contact in self.others]
        return np.concatenate([np.empty((0, self.intervals + 1)), *sums])

    def own_joints(self, tree: PlanarTree, contact: GroundContact) -> list[int]:
        """Indices of the joints that hold a contact but the anchor where it stands: its leg's, from the foot up.

        Raises
        ------
        InputError
            The leg has too few of its own.
        """
        count = 1 if contact.vertical else 2
        anchor_joints = np.zeros(tree.turns.shape[1])  # a heel may share its joints with the toe
        if not contact.vertical:
            anchor_joints = tree.turns[self.anchor.spots[0].body]
        own: list[int] = []
        body = contact.spots[0].body
        while body > 0:
            parent = int(tree.parent[body])
            for joint in np.flatnonzero(tree.turns[body] - tree.turns[parent]).tolist():
                if not anchor_joints[joint] and joint not in own:
                    own.append(joint)
            body = parent
        if len(own) < count:
            reason = f"the leg of {contact.name!r} has too few joints to stand beside {self.anchor.name!r}"
            raise InputError(reason, element=f"jump.{self.side}.contacts", advice="name one foot alone")
        return own[:count]


@dataclass(frozen=True, eq=False)
class FixedEnd:
    """What is fixed at one end of the flight.

    Attributes
    ----------
    node : 0, its first, or -1, its last
    y : (n+1,) rad
    v, a : (n+1,) rad/s, rad/s^2; None where they are free
    com_velocity : horizontal and vertical, of the centre of mass, m/s; None where it follows from the rates
    """

    node: int
    y: Array
    v: Array | None = None
    a: Array | None = None
    com_velocity: tuple[float, float] | None = None


def side_phases(
    side: Side,
    groups: Sequence[tuple[GroundContact, ...]],
    unit: float,
    bounds: Sequence[tuple[float, float] | None],
    turns: int = 0,
) -> list[Phase]:
    """Return the phases of a side of the flight, or the flight, with generic durations.

    Parameters
    ----------
    side : "takeoff", "flight" or "landing"
    groups : contacts of its one or two phases, in order of time
    unit : sqrt(height / g) of the centre of mass where the robot stands, s
    bounds : of their durations, s; None for generic ones
    turns : of the base in flight
    """
    anchor = groups[-1 if side == "takeoff" else 0][:1]
    phases: list[Phase] = []
    for contacts, usual, fixed in zip(groups, _usual_durations(side, len(groups), turns), bounds, strict=True):
        anchor_first = tuple(sorted(contacts, key=lambda contact: (contact,) != anchor))
        phases.append(Phase(side, anchor_first, *usual.duration(unit, fixed), usual.intervals))
    return phases


def instants(phases: Sequence[TimedPhase], durations: Array) -> Array:
    """Times (K+1,) of the nodes of phases with these durations, s."""
    times = np.zeros(1)
    for phase, duration in zip(phases, durations, strict=True):
        times = np.append(times, times[-1] + duration * phase.progress[1:])
    return times


def duration_costs(phases: Sequence[Phase]) -> list[float]:
    """Costs of the phases' durations over sqrt(height / g).

    They are 1 for phases on one point, where more points stand on the same side of the flight: on one point errors grow
    by a factor e in as much time.
    """
    steadier_sides = {(phase.side, phase.flight_number) for phase in phases if phase.others}
    return [float(not phase.others and (phase.side, phase.flight_number) in steadier_sides) for phase in phases]


def standing_posture(robot: Robot, contacts: Sequence[GroundContact], target: Array, limits: Array) -> Array | None:
    """Return orientation and joints (n+1,) rad, nearest to a target, in which the robot stands still.

    All contacts are on level ground, and the centre of mass is over them: inside their span, or above the one point.
    None where no such posture is found.

    Parameters
    ----------
    contacts : all on which it stands
    target : (n+1,) rad
    limits : (n+1, 2) rad
    """
    on_one_point = np.ptp(contact_positions(robot, contacts, target).real) < STILL

    def levels(y: Array) -> Array:
        """Heights of the contacts relative to the first; of one point its horizontal distance from the centre."""
        over_point = contact_positions(robot, contacts[:1], y).real
        return np.append(ground_steps(robot, contacts, y), over_point if on_one_point else [])

    def support(y: Array) -> Array:
        """Horizontal distances of the centre of mass from both ends of the support, less its margin."""
        along = contact_positions(robot, contacts, y).real
        margin = SUPPORT_MARGIN * np.ptp(along)
        return np.array([-(along.min() + margin), along.max() - margin])

    def stands(y: Array) -> bool:
        inside = on_one_point or bool(support(y).min() >= -STILL)
        return inside and bool(np.abs(levels(y)).max(initial=0.0) < STILL)

    if stands(target) and (limits[:, 0] <= target).all() and (target <= limits[:, 1]).all():
        return _exactly_level(levels, target) if on_one_point else target
    constraints = [NonlinearConstraint(levels, 0.0, 0.0)]
    if not on_one_point:
        constraints.append(NonlinearConstraint(support, 0.0, np.inf))
    low, high = limits.T
    random = np.random.default_rng(0).uniform(low[1:], high[1:], (10, len(low) - 1))  # starts after the target
    for start in (np.clip(target, low, high), *np.insert(random, 0, target[0], axis=1)):
        nearest = minimize(  # type: ignore[call-overload]
            lambda y: float(((y - target) ** 2).sum()),
            start,
            jac=lambda y: 2 * (y - target),
            bounds=Bounds(low, high),
            constraints=constraints,
            method="SLSQP",
            options={"ftol": 1e-12, "maxiter": 200},
        )
        if stands(nearest.x):
            return _exactly_level(levels, nearest.x) if on_one_point else np.asarray(nearest.x)
    return None


def level_posture(robot: Robot, contacts: Sequence[GroundContact], target: Array) -> Array:
    """Return the posture (n+1,) rad next to a target in which all contacts are on level ground; the base stays."""
    if len(contacts) == 1:
        return target
    return _exactly_level(lambda y: ground_steps(robot, contacts, y), target)


def ground_steps(robot: Robot, contacts: Sequence[GroundContact], y: Array) -> Array:
    """Heights (contacts - 1,) m of the ground below contacts over that below the first, in a posture y (n+1,)."""
    ground = contact_positions(robot, contacts, y).imag - contact_depths(contacts)
    return np.asarray(ground[1:] - ground[0])


def _exactly_level(levels: Callable[[Array], Array], y: Array) -> Array:
    """Return the posture (n+1,) next to one whose ``levels`` nearly vanish, in which they do; the base stays.

    Standing still on one point, nothing but the posture puts the centre of mass over it: what it is off by is a moment
    that no force takes up.
    """

    def of_joints(joints: Array) -> Array:
        return levels(np.append(y[0], joints))

    rounding = 1e-14  # as level as numbers are
    solution = least_squares(of_joints, y[1:], ftol=rounding, xtol=rounding, gtol=rounding)
    return np.append(y[0], solution.x)


def not_static(robot: Robot, contacts: Sequence[GroundContact], y: Array) -> str:
    """Why a robot does not stand still on contacts in a posture y (n+1,), for a person."""
    positions = contact_positions(robot, contacts, y)
    ground = positions.imag - contact_depths(contacts)
    step = float(np.ptp(ground))
    if step > LEVEL:
        highest = contacts[int(ground.argmax())].name
        return f"its feet are {1e3 * step:.0f} mm apart in height, {highest!r} is the highest"
    inside = min(-positions.real.min(), positions.real.max())
    front = contacts[int(positions.real.argmax())].name
    rear = contacts[int(positions.real.argmin())].name
    com_is_ahead = positions.real.max() < -positions.real.min()  # of the middle of the feet
    end = f"ahead of {front!r}" if com_is_ahead else f"behind {rear!r}"
    if inside < -STILL:
        return f"its centre of mass is {-1e3 * inside:.0f} mm outside its feet, {end}"
    margin = SUPPORT_MARGIN * np.ptp(positions.real)
    if inside < margin:
        nearest = front if com_is_ahead else rear
        return (
            f"its centre of mass is {1e3 * inside:.0f} mm from the end of its feet, {nearest!r},"
            f" {1e3 * margin:.0f} mm at least"
        )
    return "a joint is too near the end of its range"


def static_beyond_ranges(robot: Robot, contacts: Sequence[GroundContact], target: Array, limits: Array) -> str:
    """Say which joints leave their ranges where a robot would stand still on contacts; empty where it never does.

    Parameters
    ----------
    contacts, target, limits : as of :func:`standing_posture`, which finds no posture
    """
    wide = np.column_stack((np.minimum(limits[:, 0], target - np.pi), np.maximum(limits[:, 1], target + np.pi)))
    wide[0] = limits[0]
    static = standing_posture(robot, contacts, target, wide)
    if static is None:
        return ""
    beyond = []
    for joint, angle, (low, high) in zip(robot.joints, static[1:], limits[1:], strict=True):
        if not low - STILL <= angle <= high + STILL:
            beyond.append(f"{joint} at {angle:.3g} rad, where {low:.3g} to {high:.3g} rad are left of its range")
    return f"static would be {' and '.join(beyond)}" if beyond else ""


def running_start(
    problem: Problem, request: JumpRequest, contacts: Sequence[GroundContact], posture: Array
) -> JumpTakeoff:
    """Return the request of a takeoff in motion with its whole state: every joint, and all rates.

    Parameters
    ----------
    contacts : that stand first
    posture : (n+1,) rad, in which they are on the ground

    Raises
    ------
    InputError
        With no rates like those requested the contacts stand; or a rate is beyond its limit.
    """
    takeoff = request.takeoff
    robot = problem.robot
    still, com = velocities_of_rates(robot, contacts, posture)
    free = null_space(still) if len(still) else np.eye(len(posture))  # rates with which the contacts stand
    selected: list[Array] = []
    values: list[float] = []
    for row, value in requested_rates(robot, takeoff, com):
        selected.append(row)
        values.append(value)
    of_free = np.stack(selected) @ free
    rates = free @ np.linalg.lstsq(of_free, np.array(values), rcond=None)[0]
    tolerated = 0.01  # [rad/s, m/s] by which rates are moved so that feet stand: files have as many digits
    off = float(np.abs(np.stack(selected) @ rates - values).max())
    if off > tolerated:
        names = ", ".join(contact.name for contact in contacts)
        nearest = [f"{name} {rate:.4g}" for name, rate in zip(robot.joints, rates[1:], strict=True)]
        reason = f"{names} would not stand: these rates and velocities are {off:.2g} off any with which they do"
        advice = f"leave some out, which follow then; nearest is base {rates[0]:.4g}, {', '.join(nearest)} rad/s"
        raise InputError(reason, element="jump.takeoff", advice=advice)
    refuse_fast_rates(problem, request, rates)
    velocity = com @ rates
    return replace(
        takeoff,
        from_=dict(zip(robot.joints, posture[1:].tolist(), strict=True)),
        com_velocity=(float(velocity[0]), float(velocity[1])),
        velocities=dict(zip(robot.joints, rates[1:].tolist(), strict=True)),
        orientation=float(posture[0]),
        orientation_rate=float(rates[0]),
    )


def begin_state(robot: Robot, takeoff: JumpTakeoff) -> Array:
    """Orientation and joints with their rates (2, n+1), rad and rad/s, of a takeoff with its whole state.

    NaN of what it does not say.
    """
    posture = takeoff.from_ if not isinstance(takeoff.from_, str) else {}
    rates = takeoff.velocities or {}
    positions = [takeoff.orientation, *(posture.get(name) for name in robot.joints)]
    velocities = [takeoff.orientation_rate, *(rates.get(name) for name in robot.joints)]
    return np.array([positions, velocities], dtype=np.float64)


def velocities_of_rates(robot: Robot, contacts: Sequence[GroundContact], posture: Array) -> tuple[Array, Array]:
    """Velocities by rates (n+1,) of orientation and joints: of contacts from the first one, and of the centre of mass.

    They are matrices (conditions, n+1), of a heel its vertical velocity, and (2, n+1), horizontal and vertical.
    The first contact does not move, or rolls on the ground.
    """
    spots = [contact.spots[0] for contact in contacts]
    from_com = position_derivatives(robot, spot_weights(robot, spots), posture)
    still = []
    for contact, derivative in zip(contacts[1:], from_com[1:] - from_com[0], strict=True):
        still.append(derivative.imag)
        if not contact.vertical:
            still.append(derivative.real)
    of_com = -from_com[0]
    return np.reshape(still, (-1, len(posture))), np.stack((of_com.real, of_com.imag))


def position_derivatives(robot: Robot, weights: ComplexArray, posture: Array) -> ComplexArray:
    """Derivatives (points, n+1) by a posture (n+1,) of positions, horizontal + i vertical, that have such weights."""
    tree = robot.tree
    by_posture = np.column_stack((np.ones(len(tree.turns)), tree.turns))  # angles of bodies
    rotations = tree.rotations(tree.absolute_angles(posture[0], posture[1:]))
    of_rotations = 1j * tree.turn * rotations[:, None] * by_posture
    return np.asarray(weights @ np.vstack((of_rotations, by_posture)))


def requested_rates(robot: Robot, takeoff: JumpTakeoff, com: Array) -> Iterator[tuple[Array, float]]:
    """Rows (n+1,) of rates, and the value that each is to have."""
    units = np.eye(1 + len(robot.joints))
    if takeoff.orientation_rate is not None:
        yield units[0], takeoff.orientation_rate
    for name, rate in (takeoff.velocities or {}).items():
        yield units[1 + robot.joints.index(name)], rate
    if takeoff.com_velocity is not None:
        yield from zip(com, takeoff.com_velocity, strict=True)


def refuse_fast_rates(problem: Problem, request: JumpRequest, rates: Array) -> None:
    """Refuse rates (n+1,) of joints beyond what the margin leaves of their limits."""
    most = request.margin["velocity"] * problem.velocity_limits
    for name, rate, limit in zip(problem.robot.joints, rates[1:], most, strict=True):
        if abs(rate) > limit:
            reason = f"{name} would begin with {rate:.4g} rad/s, where {limit:.4g} rad/s are left of its limit"
            advice = "begin more slowly, or in a posture in which legs are less bent or stretched"
            raise InputError(reason, element="jump.takeoff", advice=advice)


def indices_of_flights(phases: Sequence[Phase]) -> list[int]:
    """Return where the flights are among the phases of a jump."""
    return [index for index, phase in enumerate(phases) if phase.side == "flight"]


def outer_phase(phases: Sequence[Phase], index: int) -> Phase | None:
    """The phase of the same side of its flight that is farther from it than a stance; None where there is none."""
    phase = phases[index]
    outer = index - 1 if phase.side == "takeoff" else index + 1
    if not 0 <= outer < len(phases) or phases[outer].side != phase.side:
        return None
    return phases[outer]


def meets_next(phases: Sequence[Phase], index: int, periodic: bool) -> bool:
    """Whether a stance ends, moving, where the stances before another flight begin, or the jump's own again."""
    if phases[index].side != "landing" or outer_phase(phases, index) is not None:
        return False
    return index + 1 < len(phases) or periodic


def grounds_below(progress: Array, before: float, after: float) -> Array:
    """Heights (N,) m of the ground over which a flight is required to be, at times (N,) over its duration.

    In its first half that is the ground that it leaves, in the second that on which it lands: the edge between them is
    an obstacle.
    """
    return np.where(progress <= 0.5, before, after)


def refuse_other_feet(phases: Sequence[Phase], periodic: bool) -> None:
    """Refuse a stance between flights whose feet come or leave in its middle, or which stands on soles."""
    meetings = list(pairwise(phases))
    if periodic:
        meetings.append((phases[-1], phases[0]))
    for one, two in meetings:
        if one.side != "landing" or two.side != "takeoff":
            continue
        landed = sorted(one.points)
        if landed != sorted(two.points):
            reason = f"{', '.join(landed)} stand where {', '.join(sorted(two.points))} are to take off"
            advice = "let the last phase of the landing be the first of the takeoff"
            raise InputError(reason, element="jump.landing.contacts", advice=advice)
        if one.anchor.of_sole:
            reason = "between two flights robots stand on points, not on soles"
            raise InputError(reason, element="jump.flights", advice='name toes, as "FRAME.toe", or plan one flight')


def axes_of(contact: GroundContact) -> tuple[int, ...]:
    """In which directions a contact but the anchor is fixed: both, or of a heel the vertical one."""
    return (1,) if contact.vertical else (0, 1)


def closing_count(phase: Phase) -> int:
    """How many conditions have closing accelerations: not those of heels, which are linear in y."""
    return sum(len(axes_of(contact)) for contact in phase.others if not contact.vertical)


def in_sequence(phase: Phase, flight_number: int, problem: Problem, request: JumpRequest) -> Phase:
    """Return a phase with the number of its flight, and with what a step of the ground makes of it."""
    phase = replace(phase, flight_number=flight_number)
    if phase.side == "landing":
        return replace(phase, rise=request.rise)
    if phase.side == "takeoff":
        return phase
    return replace(phase, **over_step(phase, request.rise, float(problem.flight.gravity)))


def over_step(flight: TimedPhase, rise: float, gravity: float) -> dict[str, Any]:
    """Duration and bounds of a flight, s, that lands on ground which is so much higher or lower, m."""
    low, high = flight.bounds
    if low == high:
        return {}
    fall = math.sqrt(2 * abs(rise) / gravity)  # [s] through the step
    return {"duration": flight.duration + fall / 2, "bounds": (low, high + fall)}
