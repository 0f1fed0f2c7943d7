"""Stances that satisfy the dynamics between the program's nodes too, and meet the flight where it begins and ends.

The program's joints, interpolated by quintics, are taken as they are. On one point the orientation follows from the
balance of moments, a differential equation that starts at the flight's end. Where more than the anchor stands, legs
follow from where their feet are: their joints solve the closure of the chain. What a phase ends with goes into the next
by a quintic that vanishes at its other end; next to the flight, accelerations are first made those of both sides, with
feet that do not move and the robot in free fall; on one point, joints are changed a little until the robot stands.
All this is done on a fine grid, between which quintics are as good as exact.
"""

import itertools
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import root

from floatplan.arrays import Array
from floatplan.errors import FloatplanError
from floatplan.jumps.contacts import displacement
from floatplan.jumps.model import PlanarModel, anchor_force, casadi, spread
from floatplan.jumps.motion import Grid, Stance, quintic, quintic_spline, refined, values
from floatplan.jumps.phases import Phase, axes_of, instants
from floatplan.jumps.program import JumpProgram
from floatplan.jumps.variables import JumpSolution
from floatplan.plans.plan import Plan
from floatplan.robot.standing import positions_from_com

SUBSTEPS = 4  # [-] of the differential equation in a step of the fine grid


class NoExactStanceError(FloatplanError):
    """A solution whose stances cannot be made exact, as where a leg between two feet is straight."""


@contextmanager
def may_fail() -> Iterator[None]:
    """Let arithmetic that leads nowhere fail a start, and no more: all that makes a solution exact is done in here.

    Singular equations raise NoExactStanceError; what is not finite gives no warning, and is refused by
    :func:`exact_stances`.
    """
    try:
        with np.errstate(all="ignore"):
            yield
    except np.linalg.LinAlgError:
        raise NoExactStanceError(
            "a leg is straight where it stands with another, so that its joints cannot follow; jump.takeoff.from can"
            " bend its knee"
        ) from None


class StanceDynamics:
    """What the stances of a phase need, as compiled functions over many instants.

    Attributes
    ----------
    moment : (y, v, a, forces of the others) -> the moment about the base that is out of balance, N m
    closure : (y, v, a) -> positions of contacts less where they stand, m, of a heel its height; the Jacobian, and the
        second derivative by time without accelerations
    ground_force : (y, v, a) -> horizontal and vertical force of all contacts, N
    fall : (y, v, a) -> what vanishes in free fall with feet that do not accelerate, and its derivatives by a
    size : of the closure
    """

    def __init__(self, model: PlanarModel, phase: Phase, standing: Array) -> None:
        ca = casadi()
        self.model = model
        self.phase = phase
        anchor = phase.anchor.spots[0]
        forces = ca.SX.sym("forces", 2 * len(phase.others))
        own, pairs = anchor_force(model, phase, forces)
        moments = model.moments(anchor, spread(phase.contacts, [own, *pairs]))
        self.moment = model.function("moment", [ca.sum1(moments)], forces)
        gaps: list[Any] = []
        for contact in phase.others:
            spot = contact.spots[0]
            position = model.positions(model.weights([spot], anchor))
            at_end = displacement(model.robot, anchor, spot, standing)
            gaps += [position[k] - at_end[k] for k in axes_of(contact)]
        closure = ca.vertcat(*gaps) if gaps else ca.SX(0, 1)
        jacobian = ca.jacobian(closure, model.y)
        bias = ca.jtimes(ca.jtimes(closure, model.y, model.v), model.y, model.v)
        self.closure = model.function("closure", [closure, jacobian, bias])
        self.size = len(gaps)
        no_forces = np.zeros(2 * len(phase.others))
        ground_force, _ = anchor_force(model, phase, no_forces)
        self.ground_force = model.function("ground_force", ground_force)
        moment = self.moment(model.y, model.v, model.a, no_forces)
        fall = ca.vertcat(*ground_force, moment, ca.mtimes(jacobian, model.a) + bias)
        self.fall = model.function("fall", [fall, ca.jacobian(fall, model.a)])

    @cached_property
    def dependent(self) -> list[int]:
        """Entries of y that follow from the closure: joints nearest to the other contacts, of their own legs first."""
        tree = self.model.robot.tree
        dependent = []
        for contact in self.phase.others:
            dependent += [1 + joint for joint in self.phase.own_joints(tree, contact)]
        return dependent

    def base_acceleration(self, y: Array, v: Array, a: Array) -> Array:
        """Orientation's acceleration (N,) rad/s^2 by the balance of moments, where only the anchor stands."""
        without = a.copy()
        without[0] = 0.0
        with_unit = a.copy()
        with_unit[0] = 1.0
        forces = np.zeros(2 * len(self.phase.others))
        bias = np.asarray(self.moment(y, v, without, forces)).ravel()
        one = np.asarray(self.moment(y, v, with_unit, forces)).ravel()
        return np.asarray(-bias / (one - bias))

    def close(self, y: Array, v: Array, a: Array) -> Array:
        """Return y, v, a (3, n+1, N) with the dependent joints that close the chain.

        Raises
        ------
        LinAlgError
            A leg is straight; callers do this in :func:`may_fail`.
        """
        motion = np.stack((y, v, a))
        columns = self.dependent
        if not self.size:
            return motion
        for _ in range(8):  # Newton's steps
            gaps, jacobian, _ = self._evaluated(motion)
            motion[0, columns] -= np.linalg.solve(jacobian[:, :, columns], gaps)[:, :, 0].T
            if np.abs(gaps).max() < 1e-11:  # m
                break
        for order in (1, 2):
            motion[order, columns] = 0.0
            _, jacobian, bias = self._evaluated(motion)
            of_others = jacobian @ motion[order].T[:, :, None] + (bias if order == 2 else 0.0)
            motion[order, columns] = -np.linalg.solve(jacobian[:, :, columns], of_others)[:, :, 0].T
        return motion

    def released(self, y: Array, v: Array, a: Array) -> Array:
        """Accelerations (n+1,) nearest to ``a`` with which the robot falls freely while its feet do not move yet.

        The centre of mass falls, the angular momentum is constant, and the chain stays closed.
        """
        value, jacobian = (np.asarray(output) for output in self.fall(y, v, a))
        return np.asarray(a - np.linalg.lstsq(jacobian, value[:, 0], rcond=None)[0])

    def shared_ratios(self, grid: Grid, friction: float) -> Array:
        """Horizontal over vertical force (others, G) of the other contact, clipped to the cone of ``friction``.

        Where the ratio of the whole ground's force is larger, to that: anchor and other cannot do with less then. The
        anchor's own force is clipped likewise, and what it does not take the other one does. The ends of a sole take
        the same. The cone is that of the program, with its margin, since ratios are linear between the instants of the
        grid; in space forces are shared anew at each instant, inside the cone itself.
        """
        if len(grid.ratios) != 1:
            return grid.ratios
        motion = grid.motion
        light = 0.01 * self.model.robot.mass  # [N] at 0.01 m/s^2, about a thousandth of the weight: less has no ratio
        horizontal, vertical = (np.asarray(component) for component in self.ground_force(*motion))
        same = horizontal / np.maximum(vertical, light)
        if self.phase.others[0].vertical:
            return np.asarray(same)
        cone = np.maximum(friction, np.abs(same))
        ratio = np.clip(grid.ratios, -cone, cone)
        without, with_unit = (
            np.asarray(self.moment(*motion, np.vstack((vertical_force * ratio, vertical_force + 0 * ratio))))
            for vertical_force in (0.0, 1.0)
        )
        other = -without / (with_unit - without)
        most = cone * np.maximum(vertical - other, 0.0)
        of_anchor = np.clip(horizontal - ratio * other, -most, most)
        return np.where(other < light, ratio, (horizontal - of_anchor) / np.maximum(other, light))

    def _evaluated(self, motion: Array) -> Iterator[Array]:
        """Closure (N, c, 1), its Jacobian (N, c, n+1), and (N, c, 1) its second derivative without accelerations."""
        for output in self.closure(*motion):
            yield np.asarray(output).reshape(self.size, motion.shape[2], -1).transpose(1, 0, 2)


class OnePoint:
    """A stance on its anchor: joints are prescribed, the orientation follows.

    Parameters
    ----------
    dynamics : StanceDynamics
    times : (G,) s, from the flight's end outwards: increasing or decreasing
    """

    def __init__(self, dynamics: StanceDynamics, times: Array) -> None:
        ca = casadi()
        self.dynamics = dynamics
        self.times = times
        n = len(dynamics.model.robot.joints)
        state = ca.SX.sym("state", 2)
        step = ca.SX.sym("step")
        joints = ca.SX.sym("joints", 9 * n)
        no_forces = np.zeros(2 * len(dynamics.phase.others))

        def rate(base: Any, stage: int) -> Any:
            """Rate of the orientation and of its rate, at the step's begin, middle or end."""
            q, qd, qdd = (joints[(3 * stage + order) * n : (3 * stage + order + 1) * n] for order in range(3))
            y = ca.vertcat(base[0], q)
            v = ca.vertcat(base[1], qd)
            without = dynamics.moment(y, v, ca.vertcat(0.0, qdd), no_forces)
            with_unit = dynamics.moment(y, v, ca.vertcat(1.0, qdd), no_forces)
            return ca.vertcat(base[1], -without / (with_unit - without))

        k1 = rate(state, 0)
        k2 = rate(state + step / 2 * k1, 1)
        k3 = rate(state + step / 2 * k2, 1)
        k4 = rate(state + step * k3, 2)
        after = state + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        runge_kutta = ca.Function("step", [state, joints, step], [after], {"cse": True})
        self._steps = runge_kutta.mapaccum(SUBSTEPS * (len(times) - 1))

    @property
    def _fine(self) -> Array:
        """Times of the steps, s."""
        return refined(self.times, SUBSTEPS)

    @property
    def sampled(self) -> tuple[Array, ...]:
        """Times, s, at which joints are sampled: of the steps' begins, middles and ends, and ``times``."""
        fine = self._fine
        return fine[:-1], fine[:-1] + np.diff(fine) / 2, fine[1:], self.times

    def follow(self, joints: Sequence[Array], start: tuple[float, float]) -> Array:
        """Return y, v, a (3, n+1, G) at the times.

        Parameters
        ----------
        joints : q, q', q'' (3, n, N) at each of the times in ``sampled``
        start : orientation and its rate at the first time
        """
        *stages, at_times = joints
        steps = np.diff(self._fine)
        stacked = np.concatenate(stages).reshape(-1, len(steps))
        states = np.asarray(self._steps(np.array(start), stacked, steps[None]))
        motion = np.insert(at_times, 0, 0.0, axis=1)
        motion[:2, 0] = np.insert(states[:, SUBSTEPS - 1 :: SUBSTEPS], 0, start, axis=1)
        motion[2, 0] = self.dynamics.base_acceleration(*motion)
        return motion


def released_solution(program: JumpProgram, solution: JumpSolution) -> JumpSolution:
    """Return a solution in which accelerations are exactly those of stance and of flight, where one meets the other.

    The program's contacts drift a little there, and its forces vanish but for its tolerance.

    Raises
    ------
    NoExactStanceError
        There are none.
    """
    a = solution.a.copy()
    for flight, side in itertools.product(program.flights, (-1, 1)):
        node = program.first_nodes[flight + max(side, 0)]
        phase = program.phases[flight + side]
        with may_fail():
            dynamics = StanceDynamics(program.model, phase, program.node_rows.standing(phase))
            a[:, node] = dynamics.released(solution.y[:, node], solution.v[:, node], a[:, node])
    if not np.isfinite(a).all():
        raise NoExactStanceError("no finite accelerations join stance and flight")
    return replace(solution, a=a)


def exact_stances(
    program: JumpProgram,
    solution: JumpSolution,
    side: str,
    plan: Plan,
    rate: float | None = None,
    flight_number: int = 0,
) -> tuple[Stance, ...]:
    """Return the stances of one side of a flight, in order of time and in its world, exact from the flight's end on.

    Parameters
    ----------
    side : "takeoff" or "landing"
    plan : of the flight
    flight_number : of the flight among the jump's
    rate : of the orientation where it begins or ends, rad/s; the plan's if left out

    Raises
    ------
    NoExactStanceError
        There is none near the solution.
    """
    with may_fail():
        stances = tuple(_exact_stances(program, solution, (side, flight_number), plan, rate))
    for stance in stances:
        if not (np.isfinite(stance.grid.motion).all() and np.isfinite(stance.grid.ratios).all()):
            raise NoExactStanceError("the stances have no finite motion near the program's solution")
    return stances


def _exact_stances(
    program: JumpProgram, solution: JumpSolution, side_of_flight: tuple[str, int], plan: Plan, rate: float | None
) -> list[Stance]:
    """Stances of one side of a flight, by its number, in order of time, see :func:`exact_stances`."""
    takes_off = side_of_flight[0] == "takeoff"
    flight_end = -1 if takes_off else 0  # index of the end of a phase that is next to the flight
    other_end = 0 if takes_off else -1
    outwards = -1 if takes_off else 1  # order from the flight to where the robot stands
    sides = [(phase.side, phase.flight_number) for phase in program.phases]
    indices = [index for index, side in enumerate(sides) if side == side_of_flight][::outwards]
    state = plan.at(0.0 if takes_off else plan.duration)
    y = np.append(state.orientation, state.positions)
    rate = float(state.orientation_rate) if rate is None else rate
    robot = program.model.robot
    spot = program.phases[indices[0]].anchor.spots[0]
    rolled = robot.tree.turn * spot.radius * robot.tree.absolute_angles(y[0], y[1:])[spot.body]
    anchor_position = complex(*state.com_position) + complex(positions_from_com(robot, [spot], y)[0]) + rolled
    standing = program.node_rows.standing(program.phases[indices[0]])
    end = _outer_end(program, solution, indices[-1])
    of_phases = [StanceDynamics(program.model, program.phases[index], standing) for index in indices]
    stances: list[Stance] = []
    junction = None  # y, v, a (3, n+1) with which the phase before ends
    for position, (index, dynamics) in enumerate(zip(indices, of_phases, strict=True)):
        nodes = _fine_grid(program, solution, index)
        if junction is None and not dynamics.phase.others:
            beyond = of_phases[position + 1] if position + 1 < len(of_phases) else None
            point = OnePoint(dynamics, nodes.times[::outwards])
            motion = _one_point(point, nodes, (float(y[0]), rate), end, beyond)[:, :, ::outwards]
        else:
            motion = nodes.motion
            free = np.delete(np.arange(program.size), dynamics.dependent)
            change = np.zeros((3, len(free)))
            at_end = np.zeros((3, len(free)))
            if junction is not None:
                change = (junction - motion[:, :, flight_end])[:, free]
            if position == len(indices) - 1:
                at_end = (end - motion[:, :, other_end])[:, free]
            if change.any() or at_end.any():
                changes = (change, at_end)[::outwards]
                motion[:, free] += quintic(nodes.times, nodes.times[[0, -1]], *changes)
            motion = dynamics.close(*motion)
        junction = motion[:, :, other_end]
        grid = Grid(nodes.times, motion[0], motion[1], motion[2], nodes.ratios)
        grid = replace(grid, ratios=dynamics.shared_ratios(grid, program.node_rows.limits.friction))
        stances.append(Stance(robot, program.model.gravity, dynamics.phase.contacts, anchor_position, grid))
    return stances[::outwards]


def _outer_end(program: JumpProgram, solution: JumpSolution, index: int) -> Array:
    """y, v, a (3, n+1) in which the outermost stance of a flight's side begins or ends: standing, or in the middle.

    Where the next flight's stances begin, or a periodic jump's own, the motion is the solution's with its chain closed
    in one way: from the anchor of what has landed.
    """
    phase = program.phases[index]
    takes_off = phase.side == "takeoff"
    standing = program.node_rows.standing(phase)
    is_first = index == 0
    is_last = index == len(program.phases) - 1
    if is_first and program.begin_rates is not None:
        dynamics = StanceDynamics(program.model, phase, standing)
        state = np.stack((standing, program.begin_rates, solution.a[:, 0]))
        return np.asarray(dynamics.close(*state[:, :, None])[:, :, 0])
    if (is_first or is_last) and not program.periodic:
        return np.stack((standing, 0 * standing, 0 * standing))
    landed = index - 1 if takes_off else index  # of a periodic jump's beginning the last one
    node = int(program.first_nodes[landed % len(program.phases) + 1])
    motion = np.stack((solution.y, solution.v, solution.a))[:, :, node]
    last = program.phases[landed]
    dynamics = StanceDynamics(program.model, last, program.node_rows.standing(last))
    closed = dynamics.close(*motion[:, :, None])[:, :, 0]
    if program.periodic and is_first:
        closed[0] -= program.ends[-1] - program.ends[0]
    return np.asarray(closed)


def _fine_grid(program: JumpProgram, solution: JumpSolution, index: int) -> Grid:
    """A phase of the program's solution on a grid of four steps in each interval."""
    nodes = program.nodes_of(index)
    coarse = instants(program.phases, solution.durations)[nodes]
    fine = refined(coarse, 4)
    horizontal = solution.forces[index][0::2]
    vertical = solution.forces[index][1::2]
    ratios = np.zeros((len(vertical), len(fine)))
    for row, (along, load) in enumerate(zip(horizontal, vertical, strict=True)):
        light = load < 1e-3 * program.node_rows.weight  # [N] there the ratio is that of the nodes around
        if not light.all():
            at = np.flatnonzero(~light)
            of_nodes = np.interp(np.arange(len(load)), at, along[at] / load[at])
            ratios[row] = np.interp(fine, coarse, of_nodes)
    motion = np.stack((solution.y, solution.v, solution.a))[:, :, nodes]
    y, v, a = values(quintic_spline(coarse, motion), fine)
    return Grid(fine, y, v, a, ratios)


def _one_point(
    stance: OnePoint, nodes: Grid, start: tuple[float, float], end: Array, beyond: StanceDynamics | None
) -> Array:
    """Motion (3, n+1, G) on one point from the flight's end to the next phase, whose feet stand there; or to its end.

    Of the ``end``, y, v, a (3, n+1), orientation and its rate count.

    Unknowns are changes of joints: at the junction, of those that follow from the next closure; or in between.
    """
    if beyond is None:
        return _to_end(stance, nodes, start, end[:2, 0])
    ends = nodes.times[[0, -1]]
    is_landing = stance.times[0] < stance.times[-1]
    order = -1 if is_landing else 1  # of (junction, flight) in time
    span = ends[1] - ends[0]
    scale = np.array([[1.0], [1 / span], [1 / span**2]])
    rows = [index - 1 for index in beyond.dependent]
    sampled = stance.sampled
    of_nodes = _joints_at(nodes, sampled)
    # Quintics (3, 3, N) of which value, first or second derivative is 1 at the junction; all are 0 at the other end.
    units = (np.eye(3), np.zeros((3, 3)))[::order]
    shapes = [quintic(times, ends, *units) for times in sampled]

    def follow(unknown: Array) -> Array:
        change = scale * unknown.reshape(3, -1)
        changed = []
        for joints, shape in zip(of_nodes, shapes, strict=True):
            other = joints.copy()
            other[:, rows] += change.T @ shape
            changed.append(other)
        return stance.follow(changed, start)

    def residual(unknown: Array) -> Array:
        last = follow(unknown)[:, :, -1:]
        return np.asarray(((beyond.close(*last) - last)[:, beyond.dependent, 0] / scale).ravel())

    zero = np.zeros(3 * len(beyond.dependent))
    unknown, is_solved = _least_norm_root(residual, zero)
    if not is_solved:  # too far for whole steps
        unknown = root(residual, zero, method="hybr", options={"xtol": 1e-13}).x
    return follow(unknown)


def _to_end(stance: OnePoint, nodes: Grid, start: tuple[float, float], end: Array) -> Array:
    """Motion (3, n+1, G) on one point from the flight's end to an orientation and its rate ``end`` (2,).

    Its joints are changed in between.
    """
    n = len(nodes.y) - 1
    ends = nodes.times[[0, -1]]
    sampled = stance.sampled
    of_nodes = _joints_at(nodes, sampled)
    shapes = [_bumps(times, ends) for times in sampled]

    def follow(unknown: Array) -> Array:
        sizes = unknown.reshape(n, 2)
        changed = [joints + np.asarray(sizes @ shape) for joints, shape in zip(of_nodes, shapes, strict=True)]
        return stance.follow(changed, start)

    def residual(unknown: Array) -> Array:
        last = follow(unknown)[:, 0, -1]
        return np.array([last[0] - end[0], (last[1] - end[1]) * (ends[1] - ends[0])])

    unknown, _ = _least_norm_root(residual, np.zeros(2 * n))
    return follow(unknown)


def _joints_at(grid: Grid, sampled: Sequence[Array]) -> list[Array]:
    """Joints with two derivatives (3, n, N) at each of some times (N,), s."""
    return [grid.at(times)[:, 1:] for times in sampled]


def _bumps(times: Array, span: Array) -> Array:
    """An even and an odd polynomial with two derivatives (3, 2, N), all of which vanish at two times (2,)."""
    duration = span[1] - span[0]
    even = np.polynomial.Polynomial([0, 0, 0, 64, -192, 192, -64])
    odd = even * np.polynomial.Polynomial([-1, 2])
    s = (times - span[0]) / duration
    orders = []
    for order in range(3):
        of_order = [(shape.deriv(order) if order else shape)(s) / duration**order for shape in (even, odd)]
        orders.append(np.array(of_order))
    return np.array(orders)


def _least_norm_root(residual: Callable[[Array], Array], start: Array) -> tuple[Array, bool]:
    """Newton's steps of least norm to a root of no more equations than unknowns; and whether they end there."""
    unknown = start
    step = 1e-6  # of the differences
    for _ in range(12):
        value = residual(unknown)
        if np.abs(value).max() < 1e-9:
            return unknown, True
        if not np.isfinite(value).all():
            break
        columns = [(residual(unknown + step * direction) - value) / step for direction in np.eye(len(start))]
        unknown = unknown - np.linalg.pinv(np.stack(columns, axis=1)) @ value
    return unknown, False
