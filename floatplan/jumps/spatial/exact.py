"""Stances in space that satisfy the dynamics between the program's nodes too, and meet the flight at its ends.

The program's base and joints are taken as they are, but next to the flight, where the base's rates and accelerations
are made those of free fall with feet that do not move; legs that stand follow from where their feet are. The feet of
the phase with most of them bear any motion of the base. On two points the moment about the line through them takes no
force: the whole robot is turned about that line by an angle that follows from this moment, an inverted pendulum, from
the flight's end on. On one sole, or on three feet where another phase has more, the program's forces push the base.
What a phase ends with goes into the next by a quintic that vanishes at its other end, from both ends of a stance to the
phase in which most feet stand.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array
from floatplan.jumps.exact import NoExactStanceError
from floatplan.jumps.motion import quintic, quintic_spline, refined, values
from floatplan.jumps.spatial.coordinates import Mechanics
from floatplan.jumps.spatial.model import BASE
from floatplan.jumps.spatial.nodes import SpatialSolution
from floatplan.jumps.spatial.pendulum import Line, balanced_about, pushed_from
from floatplan.jumps.spatial.phases import SpatialPhase
from floatplan.jumps.spatial.program import SpatialProgram
from floatplan.jumps.spatial.stance import SpatialGrid, SpatialStance

Curve = Callable[[Array], Array]  # a motion (3, 6+n, N) at N times, s from the stance's begin


@dataclass(frozen=True, eq=False)
class FlightEnds:
    """What stances and flight have in common.

    Attributes
    ----------
    motion : (3, 6+n, 2) at takeoff and landing
    momentum : (3,) kg m^2/s, about the centre of mass
    com_velocity : (3,) m/s at takeoff
    duration : s
    """

    motion: Array
    momentum: Array
    com_velocity: Array
    duration: float


def feet_places(program: SpatialProgram, solution: SpatialSolution, side: str) -> dict[str, Array]:
    """Where the feet of a side stand, (3,) m."""
    shift = solution.origin.copy()
    if side == "landing" and program.flight >= 0:
        shift[:2] = solution.y[:2, -1]
    return {frame: position + shift for frame, position in program.ends.places[side].items()}


def flight_ends(program: SpatialProgram, solution: SpatialSolution, mechanics: Mechanics) -> FlightEnds:
    """Return takeoff and landing of a flight that both stances can meet.

    The takeoff's pose and rates are the program's; the landing's attitude too, while its height, its rates and the legs
    that land follow from the parabola, the momentum and the feet, which stand still.
    """
    flight = program.flight
    duration = float(solution.durations[flight])
    columns = [program.borders[flight], program.borders[flight + 1]]
    from_program = np.stack((solution.y, solution.v, solution.a))[:, :, columns]
    motion = mechanics.from_centre(from_program)
    before = _standing_places(program, solution, program.phases[flight - 1])
    after = _standing_places(program, solution, program.phases[flight + 1])
    takeoff = mechanics.close(motion[:, :, :1], before)
    takeoff = _falling(mechanics, takeoff, before)
    centres, momenta = mechanics.centre(takeoff)
    momentum = momenta[:, 0]
    position = centres[0, :, 0]
    velocity = centres[1, :, 0]
    fallen = np.array([0.0, 0.0, mechanics.gravity * duration])
    landing_centre = position + velocity * duration - fallen * duration / 2
    landing = _placed(mechanics, motion[:, :, 1:], after, landing_centre)
    landing = _moving(mechanics, landing, after, velocity - fallen, momentum)
    landing = _falling(mechanics, landing, after)
    return FlightEnds(np.concatenate((takeoff, landing), axis=2), momentum, velocity, duration)


def _standing_places(program: SpatialProgram, solution: SpatialSolution, phase: SpatialPhase) -> dict[str, Array]:
    places = feet_places(program, solution, phase.side)
    return {frame: places[frame] for frame in phase.names}


def _placed(mechanics: Mechanics, motion: Array, places: dict[str, Array], centre: Array) -> Array:
    """The motion (3, 6+n, 1) with its centre of mass at a point (3,), its attitude as it is, its feet at places."""

    def missing(base: Array) -> tuple[Array, Array]:
        placed = motion.copy()
        placed[0, :3, 0] = base
        placed = mechanics.close(placed, places)
        return centre - mechanics.centre(placed)[0][0, :, 0], placed

    base = motion[0, :3, 0].copy()
    step = 1e-6  # [m] of the differences
    for _ in range(12):
        gap, placed = missing(base)
        if np.abs(gap).max() < 1e-13:
            return placed
        if not np.isfinite(gap).all():
            break
        jacobian = np.stack([(missing(base + step * axis)[0] - gap) / step for axis in np.eye(3)], axis=1)
        base = base - np.linalg.solve(jacobian, gap)
    raise NoExactStanceError("the legs do not reach the ground where the flight lands")


def _moving(mechanics: Mechanics, motion: Array, places: dict[str, Array], velocity: Array, momentum: Array) -> Array:
    """The motion (3, 6+n, 1) with base rates of a centre's velocity and a momentum, the feet standing still."""

    def missing(rates: Array) -> tuple[Array, Array]:
        moving = motion.copy()
        moving[1, :BASE, 0] = rates
        moving = mechanics.close(moving, places)
        centres, momenta = mechanics.centre(moving)
        return np.concatenate((centres[1, :, 0] - velocity, momenta[:, 0] - momentum)), moving

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
        motion = np.stack((solution.y, solution.v, solution.a))[:, :, [end]]
        fixed = program.ends.fixed(end)
        for order, derivatives in ((1, program.ends.v), (2, program.ends.a)):
            if order < fixed:
                motion[order, :, 0] = derivatives[end]
        places = _standing_places(program, solution, phase)
        ends.append(mechanics.close(mechanics.from_centre(motion), places))
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
    feet, _ = mechanics.feet(moving, list(places))
    feet[0] -= np.array(list(places.values()))
    feet[2] /= mechanics.gravity
    if not np.abs(feet).max() < still:
        raise NoExactStanceError("its joints do not hold the feet still where the flight is met")
    return moving[:, :, 0]


def _gentle_fall(mechanics: Mechanics, motion: Array, frames: list[str]) -> Array:
    """Accelerations (6+n,) of a motion (3, 6+n, 1) in which nothing bears the robot, and feet do not accelerate."""
    robot = mechanics.robot
    nearness = 1e-3  # [s^2] share of a motor's limit that an acceleration of 1 rad/s^2 off the one at hand is worth
    limits = np.where(np.isfinite(robot.motor_torque_limits), robot.motor_torque_limits, robot.mass * mechanics.gravity)

    def effects(accelerations: Array) -> tuple[Array, Array]:
        """What has to vanish, and the motors' shares, of accelerations (6+n, N)."""
        varied = np.repeat(motion, accelerations.shape[1], axis=2)
        varied[2] = accelerations
        wrench = mechanics.wrench(varied)
        feet, _ = mechanics.feet(varied, frames)
        vanishing = np.hstack((wrench[:, :BASE] / robot.mass, feet[2].reshape(len(wrench), -1)))
        return vanishing.T, (wrench @ robot.transmission / limits).T

    near = motion[2, :, 0]
    steps = np.eye(len(near))
    vanishing, shares = effects(np.column_stack((near, near[:, None] + steps)))
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
    return np.asarray(near + change)


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
        near = 0 if index < middle else -1
        phase = program.phases[index]
        times, motion, shares = _fine_motion(program, solution, mechanics, index)
        for end in (0, -1) if index == middle else (near,):
            motion = motion + _vanishing(times, seams[end] - motion[:, :, end], end)
        places = _standing_places(program, solution, phase)
        motion = mechanics.close(motion, places)
        if len(places) == 2 and index == middle:
            raise NoExactStanceError("on no more than two feet it cannot begin and end as it has to")
        if index != middle:
            beyond = _standing_places(program, solution, program.phases[index + (1 if near == 0 else -1)])
            others = {frame: position for frame, position in beyond.items() if frame not in places}
            motion = _borne(mechanics, times, motion, shares, places, others, near)
        seams[near] = motion[:, :, -1 - near]
        motions[index] = SpatialGrid(times + begin, motion[0], motion[1], motion[2], shares)
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
    shares: Array,
    places: dict[str, Array],
    others: dict[str, Array],
    near: int,
) -> Array:
    """The motion (3, 6+n, G) that feet at ``places`` can bear, with ``others`` that stand at the far end.

    On two feet it is balanced about the line through them; else their forces, ``shares`` (3 F, G), push the base. So
    the base moves the other legs, and these move it: a fixed point.

    Raises
    ------
    NoExactStanceError
        The other legs do not reach the ground.
    """
    far = -1 - near
    scale = ((times[-1] - times[0]) ** np.arange(3))[:, None]
    bent = np.zeros(motion.shape[:2])  # by how much joints differ from the motion at the far end
    tried: list[tuple[Array, Array]] = []
    for _ in range(30):
        changed = motion + _vanishing(times, bent, far)
        if len(places) == 2:
            result = balanced_about(mechanics, Line.through(places), times, changed, near)
        else:
            result = pushed_from(mechanics, times, changed, shares, places, near)
        change = _to_the_ground(mechanics, result, others, far)
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


def _vanishing(times: Array, change: Array, near: int) -> Array:
    """Quintics (3, rows, G) that are a change (3, rows) at one end of some times, and vanish at the other."""
    span = times[[0, -1]]
    zero = np.zeros_like(change)
    first, last = (change, zero) if near == 0 else (zero, change)
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
    """Times (G,), the motion (3, 6+n, G) with accelerations that are linear between nodes, and forces (3 F, G)."""
    begin, end = program.borders[index], program.borders[index + 1]
    coarse = program.times(solution.durations)[begin : end + 1]
    # On two feet nothing bears the moment about the line between instants: there they are denser.
    times = refined(coarse, 12 if len(program.phases[index].feet) == 2 else 6)
    interval = np.minimum(np.searchsorted(coarse, times, "right") - 1, len(coarse) - 2)
    step = np.diff(coarse)[interval]
    since = times - coarse[interval]
    y, v, a = (rows[:, begin + interval] for rows in (solution.y, solution.v, solution.a))
    jerk = (solution.a[:, begin + interval + 1] - a) / step
    of_program = np.stack(
        (
            y + since * v + since**2 / 2 * a + since**3 / 6 * jerk,
            v + since * a + since**2 / 2 * jerk,
            a + since * jerk,
        )
    )
    shares = []
    for foot in program.phases[index].feet:
        nodes = [solution.forces[node].get(foot.name, np.zeros(3)) for node in range(begin, end + 1)]
        shares += [np.interp(times, coarse, component) for component in np.transpose(nodes)]
    return times, mechanics.from_centre(of_program), np.array(shares)
