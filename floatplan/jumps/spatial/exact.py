"""Stances in space that satisfy the dynamics between the program's nodes too, and meet the flight at its ends.

The program's base and joints are taken as they are, but next to the flight, where the base's rates and accelerations
are made those of free fall with feet that do not move; legs that stand follow from where their feet are. The feet of
the phase with most of them bear any motion of the base. On two points the moment about the line through them takes no
force: the whole robot is turned about that line by an angle that follows from this moment, an inverted pendulum, from
the flight's end on. On one sole, or on three feet where another phase has more, the program's forces push the base.
What a phase ends with goes into the next by a quintic that vanishes at its other end, from both ends of a stance to the
phase in which most feet stand.

Feet that roll are where their legs have brought them: on all feet from where the robot stands
still towards the flight, on two from the flight's end on. Where both meet, the feet have to be at the same points: a
fixed point of where they are when the flight begins, or ends, and of the legs whose feet leave or come.

All motions here have the base's origin in their first rows, but for the ``com_motion`` of a solution.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.jumps.exact import NoExactStanceError
from floatplan.jumps.motion import quintic, quintic_spline, refined, values
from floatplan.jumps.phases import Side
from floatplan.jumps.spatial.coordinates import Mechanics
from floatplan.jumps.spatial.impact import after_impact
from floatplan.jumps.spatial.model import BASE
from floatplan.jumps.spatial.nodes import SpatialSolution
from floatplan.jumps.spatial.pendulum import Line, balanced_about, pushed_from, rolled_from
from floatplan.jumps.spatial.phases import SpatialPhase
from floatplan.jumps.spatial.program import SpatialProgram
from floatplan.jumps.spatial.stance import SpatialGrid, SpatialStance

Curve = Callable[[Array], Array]  # a motion (3, 6+n, N) at N times, s from the stance's begin


@dataclass(frozen=True, eq=False)
class FlightEnds:
    """What stances and flight have in common.

    Attributes
    ----------
    motion : (3, 6+n, 2) of base and joints at takeoff and landing
    landed : (3, 6+n, 1) with which the landing's stance begins: where feet come to the ground with speed, after that
    momentum : (3,) kg m^2/s, about the centre of mass
    com_velocity : (3,) m/s at takeoff
    duration : s
    """

    motion: Array
    landed: Array
    momentum: Array
    com_velocity: Array
    duration: float


def feet_places(program: SpatialProgram, solution: SpatialSolution, side: str) -> dict[str, Array]:
    """Where the feet of a side stand, by their names, (3,) m."""
    shift = solution.origin.copy()
    if side == "landing" and program.flight >= 0:
        shift[:2] = solution.y[:2, -1]
    return {name: position + shift for name, position in program.ends.places[side].items()}


def flight_ends(program: SpatialProgram, solution: SpatialSolution, mechanics: Mechanics) -> FlightEnds:
    """Return takeoff and landing of a flight that both stances can meet, on feet that do not roll."""
    flight = program.flight
    takeoff = _takeoff_on(program, solution, mechanics, _standing_places(program, solution, program.phases[flight - 1]))
    after = _standing_places(program, solution, program.phases[flight + 1])
    return _landed_on(program, solution, mechanics, takeoff, after)


def _takeoff_on(
    program: SpatialProgram, solution: SpatialSolution, mechanics: Mechanics, places: dict[str, Array]
) -> Array:
    """The motion (3, 6+n, 1) with which feet at places leave: pose and rates of the program, feet that do not slip."""
    columns = [program.borders[program.flight]]
    motion = mechanics.from_centre(solution.com_motion[:, :, columns])
    return _falling(mechanics, mechanics.close(motion, places), places)


def _landed_on(
    program: SpatialProgram,
    solution: SpatialSolution,
    mechanics: Mechanics,
    takeoff: Array,
    places: dict[str, Array],
) -> FlightEnds:
    """The ends of a flight from its takeoff (3, 6+n, 1), which lands with feet at places.

    Its attitude is the program's; its height, its rates and the legs that land follow from the parabola, the momentum
    and the feet, which do not slip. Where these come with speed, their joints have the rates of the program's arrival.
    """
    flight = program.flight
    duration = float(solution.durations[flight])
    columns = [program.borders[flight + 1]]
    motion = mechanics.from_centre(solution.com_motion[:, :, columns])
    centres, momenta = mechanics.centre(takeoff)
    momentum = momenta[:, 0]
    position = centres[0, :, 0]
    velocity = centres[1, :, 0]
    fallen = np.array([0.0, 0.0, mechanics.gravity * duration])
    landing_centre = position + velocity * duration - fallen * duration / 2
    landing = _with_centre_at(mechanics, motion, places, landing_centre)
    if solution.arrival is None:
        landing = _moving(mechanics, landing, places, velocity - fallen, momentum)
        landing = _falling(mechanics, landing, places)
        landed = landing
    else:
        landed = landing.copy()  # with accelerations of the program's after the impact
        landing[1:, BASE:, 0] = solution.arrival[:, BASE:]  # those of the base follow
        landing = _moving(mechanics, landing, {}, velocity - fallen, momentum)
        landing = _falling(mechanics, landing, {})
        landed[1] = after_impact(mechanics, landing, list(places))[1]
        landed = _falling(mechanics, landed, places)
    return FlightEnds(np.concatenate((takeoff, landing), axis=2), landed, momentum, velocity, duration)


def _standing_places(program: SpatialProgram, solution: SpatialSolution, phase: SpatialPhase) -> dict[str, Array]:
    """Where the feet of a phase stand, by their names, (3,) m."""
    places = feet_places(program, solution, phase.side)
    return {name: places[name] for name in phase.names}


def _with_centre_at(mechanics: Mechanics, motion: Array, places: dict[str, Array], centre: Array) -> Array:
    """The motion (3, 6+n, 1) with its centre of mass at a point (3,), its attitude as it is, its feet at places."""

    def missing(base: Array) -> tuple[Array, Array]:
        moved = motion.copy()
        moved[0, :3, 0] = base
        moved = mechanics.close(moved, places)
        return centre - mechanics.centre(moved)[0][0, :, 0], moved

    base = motion[0, :3, 0].copy()
    step = 1e-6  # [m] of the differences
    for _ in range(12):
        gap, moved = missing(base)
        if np.abs(gap).max() < 1e-13:
            return moved
        if not np.isfinite(gap).all():
            break
        jacobian = np.stack([(missing(base + step * axis)[0] - gap) / step for axis in np.eye(3)], axis=1)
        base = base - np.linalg.solve(jacobian, gap)
    raise NoExactStanceError("the legs do not reach the ground where the flight lands")


def _moving(
    mechanics: Mechanics, motion: Array, places: dict[str, Array], com_velocity: Array, momentum: Array
) -> Array:
    """The motion (3, 6+n, 1) with base rates of a centre's velocity and a momentum, the feet standing still."""

    def missing(rates: Array) -> tuple[Array, Array]:
        moving = motion.copy()
        moving[1, :BASE, 0] = rates
        moving = mechanics.close(moving, places)
        centres, momenta = mechanics.centre(moving)
        return np.concatenate((centres[1, :, 0] - com_velocity, momenta[:, 0] - momentum)), moving

    return _affine_root(missing, motion[1, :BASE, 0])


def _falling(mechanics: Mechanics, motion: Array, places: dict[str, Array]) -> Array:
    """The motion (3, 6+n, 1) with base accelerations for which nothing bears it, the feet not accelerating."""

    def missing(accelerations: Array) -> tuple[Array, Array]:
        falling = motion.copy()
        falling[2, :BASE, 0] = accelerations
        falling = mechanics.close(falling, places)
        return mechanics.base_wrench(falling)[0], falling

    return _affine_root(missing, motion[2, :BASE, 0])


def _affine_root(function: Callable[[Array], tuple[Array, Array]], start: Array) -> Array:
    """The motion where an affine function (6,) of six numbers vanishes; a second step takes rounding away."""
    point = start.copy()
    value, motion = function(point)
    columns = [function(point + direction)[0] - value for direction in np.eye(len(start))]
    jacobian = np.stack(columns, axis=1)
    for _ in range(2):
        point = point - np.linalg.solve(jacobian, value)
        value, motion = function(point)
    return motion


def stance_ends(program: SpatialProgram, solution: SpatialSolution, mechanics: Mechanics) -> Array:
    """Return the motion (3, 6+n, 2) at a solution's first and last node, with feet that stand there still.

    Where the robot stands still, it does so to more than the program's tolerance.
    """
    ends = []
    for end, phase in ((0, program.phases[0]), (-1, program.phases[-1])):
        com_motion = solution.com_motion[:, :, [end]]
        fixed = program.ends.fixed(end)
        for order, derivatives in ((1, program.ends.v), (2, program.ends.a)):
            if order < fixed:
                com_motion[order, :, 0] = derivatives[end]
        places = _standing_places(program, solution, phase)
        ends.append(mechanics.close(mechanics.from_centre(com_motion), places))
    return np.concatenate(ends, axis=2)


def met_by_flight(
    mechanics: Mechanics, motion: Array, places: dict[str, Array], com_velocity: Array, momentum: Array
) -> Array:
    """Return the motion (3, 6+n) next to one at hand with which feet that are still leave for a flight, or end one.

    Base and joints are as they are, but for legs whose feet stand at ``places``, (3,) m; the centre of mass has a
    velocity (3,), m/s, and the robot an angular momentum about it (3,), kg m^2/s. Nothing bears it; of accelerations
    that do this the motors have those with the least squared shares of their limits, next to the ones at hand.

    Raises
    ------
    NoExactStanceError
        The joints cannot hold the feet still there.
    """
    still = 1e-6  # [m, m/s; m/s^2 over g] of the feet
    standing = mechanics.close(motion[:, :, None], places)
    try:
        moving = _moving(mechanics, standing, places, com_velocity, momentum)
        moving[2, :, 0] = _gentle_fall(mechanics, moving, list(places))
    except np.linalg.LinAlgError:
        raise NoExactStanceError("its joints do not hold the feet still where the flight is met") from None
    feet = mechanics.feet(moving, list(places))
    feet[0] -= np.array(list(places.values()))
    feet[2] /= mechanics.gravity
    if not np.abs(feet).max() < still:
        raise NoExactStanceError("its joints do not hold the feet still where the flight is met")
    return moving[:, :, 0]


def _gentle_fall(mechanics: Mechanics, motion: Array, names: list[str]) -> Array:
    """Accelerations (6+n,) of a motion (3, 6+n, 1) in which nothing bears the robot, and feet do not accelerate."""
    robot = mechanics.robot
    nearness = 1e-3  # [s^2] share of a motor's limit that an acceleration of 1 rad/s^2 off the one at hand is worth
    limits = np.where(np.isfinite(robot.motor_torque_limits), robot.motor_torque_limits, robot.mass * mechanics.gravity)

    def effects(accelerations: Array) -> tuple[Array, Array]:
        """What has to vanish, and the motors' shares of their limits, of accelerations (6+n, N)."""
        varied = np.repeat(motion, accelerations.shape[1], axis=2)
        varied[2] = accelerations
        wrench = mechanics.wrench(varied)
        feet = mechanics.feet(varied, names)
        vanishing = np.hstack((wrench[:, :BASE] / robot.mass, feet[2].reshape(len(wrench), -1)))
        return vanishing.T, (wrench @ robot.transmission / limits).T

    at_hand = motion[2, :, 0]
    steps = np.eye(len(at_hand))
    vanishing, shares = effects(np.column_stack((at_hand, at_hand[:, None] + steps)))
    equations = vanishing[:, 1:] - vanishing[:, [0]]
    costs = shares[:, 1:] - shares[:, [0]]
    u, sizes, v = np.linalg.svd(equations)
    rank = int((sizes > 1e-9 * sizes[0]).sum())  # three points of a sole are nine rows of a pose's six
    change = -v[:rank].T @ ((u[:, :rank].T @ vanishing[:, 0]) / sizes[:rank])
    free = v[rank:].T
    if free.shape[1]:
        rows = np.vstack((costs @ free, nearness * free))
        target = -np.concatenate((shares[:, 0] + costs @ change, nearness * change))
        change = change + free @ np.linalg.lstsq(rows, target, rcond=None)[0]
    return np.asarray(at_hand + change)


def exact_stances(
    program: SpatialProgram,
    solution: SpatialSolution,
    mechanics: Mechanics,
    side: str,
    ends: Array,
    begin: float = 0.0,
) -> list[SpatialStance]:
    """Return the stances of a side of the flight, or those of a single stance, in order of time.

    The phase with most feet, which bear any motion, takes up what is left when the phases before and after it have
    taken over what they begin and end with.

    Parameters
    ----------
    side : "takeoff", "landing" or "step"
    ends : (3, 6+n, 2) motion with which they begin and end
    begin : s, of the first node

    Raises
    ------
    NoExactStanceError
        Nothing but two feet ever stands, or legs do not reach the ground.
    """
    indices = [index for index, phase in enumerate(program.phases) if phase.side == side]
    middle = max(indices, key=lambda index: len(program.phases[index].feet))
    motions: dict[int, SpatialGrid] = {}
    seams = [ends[:, :, 0], ends[:, :, 1]]  # between what is done, and the middle
    inwards = [*range(indices[0], middle), *range(indices[-1], middle, -1), middle]
    for index in inwards:
        fixed_end = 0 if index < middle else -1
        phase = program.phases[index]
        times, motion, planned_forces = _fine_motion(program, solution, mechanics, index)
        for end in (0, -1) if index == middle else (fixed_end,):
            motion = motion + _vanishing(times, seams[end] - motion[:, :, end], end)
        places = _standing_places(program, solution, phase)
        motion = mechanics.close(motion, places)
        if len(places) == 2 and index == middle:
            raise NoExactStanceError("on no more than two feet it cannot begin and end as it has to")
        if index != middle:
            beyond = _standing_places(program, solution, program.phases[index + (1 if fixed_end == 0 else -1)])
            others = {name: position for name, position in beyond.items() if name not in places}
            motion = _borne(mechanics, times, motion, planned_forces, places, others, fixed_end)
        seams[fixed_end] = motion[:, :, -1 - fixed_end]
        motions[index] = SpatialGrid(times + begin, motion[0], motion[1], motion[2], planned_forces)
    model = program.model
    return [
        SpatialStance(
            model.robot, model.gravity, mechanics.axes, program.phases[index].feet, program.friction, motions[index]
        )
        for index in indices
    ]


def _borne(
    mechanics: Mechanics,
    times: Array,
    motion: Array,
    planned_forces: Array,
    places: dict[str, Array],
    others: dict[str, Array],
    fixed_end: int,
) -> Array:
    """The motion (3, 6+n, G) that feet at ``places`` can bear, as it is at its fixed end, 0 or -1.

    At the other end ``others`` stand too. On two feet it is balanced about the line through them; else the planned
    forces (3 F, G), N, push the base. So the base moves the other legs, and these move it: a fixed point.

    Raises
    ------
    NoExactStanceError
        The other legs do not reach the ground.
    """
    free_end = -1 - fixed_end
    scale = ((times[-1] - times[0]) ** np.arange(3))[:, None]
    bent = np.zeros(motion.shape[:2])  # by how much joints differ from the motion at the free end
    tried: list[tuple[Array, Array]] = []
    for _ in range(30):
        changed = motion + _vanishing(times, bent, free_end)
        if len(places) == 2:
            result = balanced_about(mechanics, Line.through(places), times, changed, fixed_end)
        else:
            result = pushed_from(mechanics, times, changed, planned_forces, places, fixed_end)
        change = _to_the_ground(mechanics, result, others, free_end)
        if not np.isfinite(change).all():
            break
        if np.abs(change * scale).max() < 1e-8:
            return result
        tried.append((bent * scale, change * scale))
        bent = _mixed(tried) / scale
    raise NoExactStanceError("on the feet next to the flight the other legs do not reach the ground where they stand")


def _mixed(tried: list[tuple[Array, Array]]) -> Array:
    """The next point of a fixed-point iteration, from points and their changes so far: Anderson's mixing (1965).

    Of all sums of points with weights that add up to 1 it is the one whose change would be least, were it linear.
    """
    points = np.array([point.ravel() for point, _ in tried])
    changes = np.array([change.ravel() for _, change in tried])
    weights, *_ = np.linalg.lstsq(np.diff(changes, axis=0).T, changes[-1], rcond=1e-12)
    following = points[-1] + changes[-1] - weights @ np.diff(points + changes, axis=0)
    return np.asarray(following.reshape(tried[-1][0].shape))


def _to_the_ground(mechanics: Mechanics, motion: Array, places: dict[str, Array], end: int) -> Array:
    """What (3, 6+n) of a motion (3, 6+n, G) has to change at an end, 0 or -1, for feet to stand at places there."""
    at_end = motion[:, :, [end]]
    return np.asarray((mechanics.close(at_end, places) - at_end)[:, :, 0])


def _vanishing(times: Array, change: Array, end: int) -> Array:
    """Quintics (3, rows, G) that are a change (3, rows) at one end of some times, 0 or -1, and vanish at the other."""
    span = times[[0, -1]]
    zero = np.zeros_like(change)
    first, last = (change, zero) if end == 0 else (zero, change)
    return quintic(times, span, first, last)


def motion_of_side(program: SpatialProgram, solution: SpatialSolution, mechanics: Mechanics, side: str) -> Curve:
    """Return the program's motion on a side of the flight, whose legs may miss their feet between nodes.

    It takes times (N,), s from the side's begin.
    """
    indices = [index for index, phase in enumerate(program.phases) if phase.side == side]
    pieces = [_fine_motion(program, solution, mechanics, index)[:2] for index in indices]
    times = np.concatenate([pieces[0][0][:1], *(of_phase[1:] for of_phase, _ in pieces)])
    motion = np.concatenate([pieces[0][1][:, :, :1], *(of_phase[:, :, 1:] for _, of_phase in pieces)], axis=2)
    curve = quintic_spline(times - times[0], motion)
    return lambda at: values(curve, np.clip(at, 0.0, times[-1] - times[0]))


def _fine_motion(
    program: SpatialProgram, solution: SpatialSolution, mechanics: Mechanics, index: int
) -> tuple[Array, Array, Array]:
    """Times (G,), the motion (3, 6+n, G) with accelerations that are linear between nodes, and forces (3 F, G), N."""
    begin, end = program.borders[index], program.borders[index + 1]
    coarse = program.times(solution.durations)[begin : end + 1]
    # On two feet nothing bears the moment about the line between instants: there they are denser.
    times = refined(coarse, 12 if len(program.phases[index].feet) == 2 else 6)
    interval = np.minimum(np.searchsorted(coarse, times, "right") - 1, len(coarse) - 2)
    step = np.diff(coarse)[interval]
    since = times - coarse[interval]
    y, v, a = (rows[:, begin + interval] for rows in (solution.y, solution.v, solution.a))
    jerk = (solution.a[:, begin + interval + 1] - a) / step
    com_motion = np.stack(
        (
            y + since * v + since**2 / 2 * a + since**3 / 6 * jerk,
            v + since * a + since**2 / 2 * jerk,
            a + since * jerk,
        )
    )
    planned_forces = []
    for foot in program.phases[index].feet:
        nodes = [solution.forces[node].get(foot.name, np.zeros(3)) for node in range(begin, end + 1)]
        planned_forces += [np.interp(times, coarse, component) for component in np.transpose(nodes)]
    return times, mechanics.from_centre(com_motion), np.array(planned_forces)


@dataclass(frozen=True, eq=False)
class RollingStances:
    """The stances of a jump whose feet roll, in order of time, and the flight's ends that they meet."""

    ends: FlightEnds
    before: tuple[SpatialStance, ...]
    after: tuple[SpatialStance, ...]


def rolling_stances(program: SpatialProgram, solution: SpatialSolution, mechanics: Mechanics) -> RollingStances:
    """Return the stances of a solution, exact between its nodes, and the flight between them.

    Raises
    ------
    NoExactStanceError
        There are none.
    """
    first, last = stance_ends(program, solution, mechanics).transpose(2, 0, 1)

    def leaving(places: dict[str, Array]) -> Array:
        return _takeoff_on(program, solution, mechanics, places)

    left, before = _RollingSide(program, solution, mechanics, "takeoff", first).between(leaving)
    takeoff = leaving(left)

    def landing(places: dict[str, Array]) -> Array:
        return _landed_on(program, solution, mechanics, takeoff, places).landed

    met, after = _RollingSide(program, solution, mechanics, "landing", last).between(landing)
    return RollingStances(_landed_on(program, solution, mechanics, takeoff, met), before, after)


class _RollingSide:
    """The phases between where the robot stands still and a flight.

    Attributes
    ----------
    standing : (3, 6+n) the motion where it stands still
    flight_end : index of the end of the phases that is next to the flight, 0 or -1
    outer : index of the phase that is next to where it stands
    inner : of the one that is next to the flight; None where one phase is both
    fine : of each phase, by its index: times, the program's motion and forces between its nodes
    """

    def __init__(
        self, program: SpatialProgram, solution: SpatialSolution, mechanics: Mechanics, side: Side, standing: Array
    ) -> None:
        self.program = program
        self.solution = solution
        self.mechanics = mechanics
        self.standing = standing
        self.flight_end = -1 if side == "takeoff" else 0
        indices = [index for index, phase in enumerate(program.phases) if phase.side == side]
        self.outer, *inner = indices if side == "takeoff" else indices[::-1]
        self.inner = inner[0] if inner else None
        self.fine = {index: _fine_motion(program, solution, mechanics, index) for index in indices}

    def between(
        self, end_on: Callable[[dict[str, Array]], Array]
    ) -> tuple[dict[str, Array], tuple[SpatialStance, ...]]:
        """Where the feet are, (3,) m, that leave for the flight, or land from it; and the stances that meet it so.

        Parameters
        ----------
        end_on : the motion (3, 6+n, 1) with which feet at such places meet the flight

        Raises
        ------
        NoExactStanceError
            There are none.
        """
        program = self.program
        meeting = program.phases[self.outer if self.inner is None else self.inner]
        names = list(meeting.names)
        places = self._places_in_program(meeting)
        others = self._other_joints(meeting)
        times, _, _ = self.fine[self.outer if self.inner is None else self.inner]
        scale = ((times[-1] - times[0]) ** np.arange(3))[:, None]
        bent = np.zeros(self.standing.shape)  # by how much the other legs differ from the program's where feet join
        tried: list[tuple[Array, Array]] = []
        for _ in range(30):
            seam, outer_seam, motions = self._rolled(names, end_on(dict(zip(names, places, strict=True))), bent)
            moved = self._centres(outer_seam, names) - self._centres(seam, names)
            missing = np.zeros(self.standing.shape)
            missing[:, others] = (outer_seam - seam)[:, others]
            change = np.concatenate((moved.ravel(), (missing * scale).ravel()))
            if not np.isfinite(change).all():
                break
            if np.abs(change).max() < 1e-9:  # m, rad, rad of rates and accelerations over the phase's duration
                return dict(zip(names, places, strict=True)), self._stances(motions)
            point = np.concatenate((places.ravel(), (bent * scale).ravel()))
            tried.append((point, change))
            point = _mixed(tried)
            places = point[: places.size].reshape(places.shape)
            bent = point[places.size :].reshape(bent.shape) / scale
        raise NoExactStanceError("feet that roll are not where they would have to be when the flight begins or ends")

    def _rolled(self, names: list[str], end: Array, bent: Array) -> tuple[Array, Array, dict[int, Array]]:
        """Motions (3, 6+n, G) of the phases between the flight's end (3, 6+n, 1) and where the robot stands still.

        Before them the motion (3, 6+n) that the phase next to the flight has where both meet, and that which the
        outer phase has there.
        """
        flight_end = self.flight_end
        standing_end = -1 - flight_end
        motions: dict[int, Array] = {}
        seam = end[:, :, 0]
        if self.inner is not None:
            times, motion, _ = self.fine[self.inner]
            motion = motion + _vanishing(times, seam - motion[:, :, flight_end], flight_end)
            motion = motion + _vanishing(times, bent, standing_end)
            direction = self._rotation_of_base(names, motion[:, :, motion.shape[2] // 2]) if len(names) == 2 else None
            motion = rolled_from(self.mechanics, names, times, motion, flight_end, direction)
            motions[self.inner] = motion
            seam = motion[:, :, standing_end]
        times, motion, _ = self.fine[self.outer]
        motion = motion + _vanishing(times, self.standing - motion[:, :, standing_end], standing_end)
        motion = motion + _vanishing(times, seam - motion[:, :, flight_end], flight_end)
        motion = rolled_from(self.mechanics, self.program.phases[self.outer].names, times, motion, standing_end, None)
        motions[self.outer] = motion
        return seam, motion[:, :, flight_end], motions

    def _rotation_of_base(self, names: list[str], motion: Array) -> Array:
        """By which the base's coordinates (6,) change where the robot rotates about the line through two feet."""
        still = motion[:, :, None].copy()
        still[1:] = 0.0
        line = Line.through(dict(zip(names, self._centres(motion, names), strict=True)))
        rotating = line.rotated_robot(self.mechanics.axes, still, np.array([[0.0], [1.0], [0.0]]))
        return np.asarray(rotating[1, :BASE, 0])

    def _places_in_program(self, phase: SpatialPhase) -> Array:
        """Centres (F, 3) of a phase's feet at the program's node next to the flight, m, as high as they stand."""
        flight = self.program.flight
        node = self.program.borders[flight + 1 if self.flight_end == 0 else flight]
        motion = self.mechanics.from_centre(self.solution.com_motion[:, :, [node]])[:, :, 0]
        centres = self._centres(motion, list(phase.names))
        standing = _standing_places(self.program, self.solution, phase)
        centres[:, 2] = [standing[name][2] for name in phase.names]
        return centres

    def _other_joints(self, meeting: SpatialPhase) -> IntArray:
        """Rows of the joints of legs that stand in the outer phase only."""
        legs = self.mechanics.legs
        rows: list[int] = []
        for name in self.program.phases[self.outer].names:
            if name not in meeting.names:
                rows += legs[name]
        return BASE + np.unique(np.array(rows, int))

    def _centres(self, motion: Array, names: list[str]) -> Array:
        """Centres (F, 3) of the balls of feet that roll in a motion (3, 6+n), m."""
        places = self.mechanics.feet(motion[:, :, None], names)
        return np.asarray(places[0, 0])

    def _stances(self, motions: dict[int, Array]) -> tuple[SpatialStance, ...]:
        """Stances of the phases' motions."""
        stances = []
        for index in sorted(motions):
            times, _, planned_forces = self.fine[index]
            y, v, a = motions[index]
            model = self.program.model
            feet = self.program.phases[index].feet
            grid = SpatialGrid(times, y, v, a, planned_forces)
            axes = self.mechanics.axes
            stances.append(SpatialStance(model.robot, model.gravity, axes, feet, self.program.friction, grid))
        return tuple(stances)
