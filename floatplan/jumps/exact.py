"""Stances that satisfy the dynamics between the program's nodes too, and meet the flight where it begins and ends.

The program's joints, interpolated by quintics, are taken as they are. On one point the orientation follows from the
balance of moments, a differential equation that starts at the flight's end. Where more than the anchor stands, legs
follow from where their feet are: their joints solve the closure of the chain. What a phase ends with goes into the next
by a quintic that dies out at its other end; where the flight is, accelerations are first made those of both sides,
with feet at rest and the robot in free fall; on one point alone, joints are changed a little until the robot stands.
All this is done on a fine grid, between which quintics are as good as exact.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import root

from floatplan.arrays import Array
from floatplan.errors import FloatplanError
from floatplan.jumps.contacts import way_between
from floatplan.jumps.model import PlanarModel, casadi
from floatplan.jumps.motion import Grid, Stance, hermite, quintic, refined, values
from floatplan.jumps.phases import Phase, instants
from floatplan.jumps.program import JumpProgram, Solution
from floatplan.jumps.rows import axes_of, balanced, spread
from floatplan.plans.plan import Plan
from floatplan.robot.standing import heights_over_com

REFINED = 4  # [-] steps of the grid in an interval of the program
SUBSTEPS = 4  # [-] of the differential equation in a step of the grid
NEWTON = 8  # [-] steps for the closure of a chain
CLOSED = 1e-11  # [m]
FALLING = 0.01  # [m/s^2] times the mass: a force that is less has no ratio
MET = 1e-9  # [-] what a residual of a junction may be


class NoExactStanceError(FloatplanError):
    """A start of a search whose stances cannot be made exact, as where a leg between two feet is straight."""


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
    """What the stances of a phase need, as compiled functions over many instants."""

    def __init__(self, model: PlanarModel, phase: Phase, home: Array) -> None:
        ca = casadi()
        self.model = model
        self.phase = phase
        forces = ca.SX.sym("forces", 2 * len(phase.others))
        own, pairs = balanced(model, phase, forces)
        moments = model.moments(phase.anchor.spots[0], spread(phase.contacts, [own, *pairs]))
        self.moment = model.function("moment", [ca.sum1(moments)], forces)
        parts: list[Any] = []
        anchor = phase.anchor.spots[0]
        for spot, axes in ((contact.spots[0], axes_of(contact)) for contact in phase.others):
            places = model.places(model.weights([spot], anchor))
            at_home = way_between(model.robot, anchor, spot, home)
            parts += [places[k] - at_home[k] for k in axes]
        closure = ca.vertcat(*parts) if parts else ca.SX(0, 1)
        drift = ca.jtimes(ca.jtimes(closure, model.y, model.v), model.y, model.v)
        self.closure = model.function("closure", [closure, ca.jacobian(closure, model.y), drift])
        self.size = len(parts)  # of the closure: places of contacts less where they stand, m, of a heel its height
        none = np.zeros(2 * len(phase.others))
        total, _ = balanced(model, phase, none)
        self.total = model.function("total", total)
        alone = self.moment(model.y, model.v, model.a, none)
        falls = ca.vertcat(*total, alone, ca.mtimes(ca.jacobian(closure, model.y), model.a) + drift)
        self.falls = model.function("falls", [falls, ca.jacobian(falls, model.a)])

    @cached_property
    def dependent(self) -> list[int]:
        """Entries of y that follow from the closure: joints nearest to the other contacts, of their own legs first."""
        own = [self.phase.own_joints(self.model.robot.tree, contact) for contact in self.phase.others]
        return [1 + joint for joints in own for joint in joints]

    def turned(self, y: Array, v: Array, a: Array) -> Array:
        """Orientation's acceleration (N,) rad/s^2 by the balance of moments, on the anchor alone."""
        still = a.copy()
        unit = a.copy()
        still[0] = 0.0
        unit[0] = 1.0
        forces = np.zeros(2 * len(self.phase.others))
        rest, one = (np.asarray(self.moment(y, v, each, forces)).ravel() for each in (still, unit))
        return np.asarray(-rest / (one - rest))

    def close(self, y: Array, v: Array, a: Array) -> Array:
        """Return y, v, a (3, n+1, N) with the dependent joints as the closure demands.

        Raises
        ------
        LinAlgError
            A leg is straight; callers do this in :func:`may_fail`.
        """
        motion = np.stack((y, v, a))
        columns = self.dependent
        if not self.size:
            return motion
        for _ in range(NEWTON):
            value, ways, _ = self._closed(motion)
            motion[0, columns] -= np.linalg.solve(ways[:, :, columns], value)[:, :, 0].T
            if np.abs(value).max() < CLOSED:
                break
        for order in (1, 2):
            motion[order, columns] = 0.0
            _, ways, drift = self._closed(motion)
            rest = ways @ motion[order].T[:, :, None] + (drift if order == 2 else 0.0)
            motion[order, columns] = -np.linalg.solve(ways[:, :, columns], rest)[:, :, 0].T
        return motion

    def released(self, y: Array, v: Array, a: Array) -> Array:
        """Accelerations (n+1,) nearest to ``a`` with which the robot falls freely while its feet are still at rest.

        The centre of mass falls, the angular momentum is constant, and the closure of the chain lasts.
        """
        value, ways = (np.asarray(each) for each in self.falls(y, v, a))
        return np.asarray(a - np.linalg.lstsq(ways, value[:, 0], rcond=None)[0])

    def shared(self, grid: Grid, friction: float) -> Array:
        """Ratios (others, G) with which forces of both are in the cone of ``friction``, or in the least that they need.

        The ends of a sole take the same.
        """
        if len(grid.ratios) != 1:
            return grid.ratios
        motion = grid.motion
        light = FALLING * self.model.robot.mass
        horizontal, vertical = (np.asarray(each) for each in self.total(*motion))
        same = horizontal / np.maximum(vertical, light)
        if self.phase.others[0].vertical:
            return np.asarray(same)
        cone = np.maximum(friction, np.abs(same))
        ratio = np.clip(grid.ratios, -cone, cone)
        none, one = (self.moment(*motion, np.vstack((part * ratio, part + 0 * ratio))) for part in (0.0, 1.0))
        other = -np.asarray(none) / np.asarray(one - none)
        most = cone * np.maximum(vertical - other, 0.0)
        taken = np.clip(horizontal - ratio * other, -most, most)
        return np.where(other < light, ratio, (horizontal - taken) / np.maximum(other, light))

    def _closed(self, motion: Array) -> Iterator[Array]:
        """Closure (N, c, 1), its derivative (N, c, n+1), and (N, c, 1) its second one by time without accelerations."""
        for each in self.closure(*motion):
            yield np.asarray(each).reshape(self.size, motion.shape[2], -1).transpose(1, 0, 2)


class OnePoint:
    """A stance on its anchor alone: joints are given, the orientation follows.

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

        def rate(now: Any, stage: int) -> Any:
            q, qd, qdd = (joints[(3 * stage + order) * n : (3 * stage + order + 1) * n] for order in range(3))
            moments = [
                dynamics.moment(ca.vertcat(now[0], q), ca.vertcat(now[1], qd), ca.vertcat(each, qdd), zero)
                for each in (0.0, 1.0)
            ]
            return ca.vertcat(now[1], -moments[0] / (moments[1] - moments[0]))

        zero = np.zeros(2 * len(dynamics.phase.others))
        k1 = rate(state, 0)
        k2 = rate(state + step / 2 * k1, 1)
        k3 = rate(state + step / 2 * k2, 1)
        k4 = rate(state + step * k3, 2)
        forward = ca.Function(
            "step", [state, joints, step], [state + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)], {"cse": True}
        )
        self._steps = forward.mapaccum(SUBSTEPS * (len(times) - 1))

    @property
    def _fine(self) -> Array:
        """Times of the steps, s."""
        return refined(self.times, SUBSTEPS)

    @property
    def sampled(self) -> tuple[Array, ...]:
        """Times, s, at which joints have to be known: of the steps' begins, middles and ends, and ``times``."""
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
        found = np.asarray(self._steps(np.array(start), np.concatenate(stages).reshape(-1, len(steps)), steps[None]))
        motion = np.insert(at_times, 0, 0.0, axis=1)
        motion[:2, 0] = np.insert(found[:, SUBSTEPS - 1 :: SUBSTEPS], 0, start, axis=1)
        motion[2, 0] = self.dynamics.turned(*motion)
        return motion


def released(program: JumpProgram, solution: Solution) -> Solution:
    """Return a solution in which accelerations are exactly those of stance and of flight, where one meets the other.

    The program's contacts drift a little there, and its forces vanish but for its tolerance.

    Raises
    ------
    NoExactStanceError
        There are none.
    """
    a = solution.a.copy()
    for side, home in ((-1, program.ends[0]), (1, program.ends[1])):
        node = program.starts[program.flight + max(side, 0)]
        with may_fail():
            dynamics = StanceDynamics(program.model, program.phases[program.flight + side], home)
            a[:, node] = dynamics.released(solution.y[:, node], solution.v[:, node], a[:, node])
    if not np.isfinite(a).all():
        raise NoExactStanceError("no finite accelerations join stance and flight")
    return replace(solution, a=a)


def exact_stances(
    program: JumpProgram, solution: Solution, side: str, plan: Plan, rate: float | None = None
) -> tuple[Stance, ...]:
    """Return the stances of one side, in order of time, exact from the flight's end on.

    Parameters
    ----------
    side : "takeoff" or "landing"
    plan : of the flight
    rate : of the orientation where it begins or ends, rad/s; the plan's if left out

    Raises
    ------
    NoExactStanceError
        There is none near the solution.
    """
    with may_fail():
        stances = tuple(_exact_stances(program, solution, side, plan, rate))
    if not all(np.isfinite(stance.grid.motion).all() and np.isfinite(stance.grid.ratios).all() for stance in stances):
        raise NoExactStanceError("the stances have no finite motion near the program's solution")
    return stances


def _exact_stances(program: JumpProgram, solution: Solution, side: str, plan: Plan, rate: float | None) -> list[Stance]:
    """Stances of one side in order of time, see :func:`exact_stances`."""
    near, far, way = (-1, 0, -1) if side == "takeoff" else (0, -1, 1)  # ends of phases, and from where to where
    outwards = [index for index, phase in enumerate(program.phases) if phase.side == side][::way]
    state = plan.at(0.0 if side == "takeoff" else plan.duration)
    y = np.append(state.orientation, state.positions)
    rate = float(state.orientation_rate) if rate is None else rate
    robot = program.model.robot
    spot = program.phases[outwards[0]].anchor.spots[0]
    gravity = program.model.gravity
    rolled = robot.tree.turn * spot.radius * robot.tree.absolute_angles(y[0], y[1:])[spot.body]
    place = complex(*state.com_position) + complex(heights_over_com(robot, [spot], y)[0]) + rolled
    home = program.ends[far]
    stances: list[Stance] = []
    junction = None
    each = [StanceDynamics(program.model, program.phases[index], home) for index in outwards]
    for index, dynamics, beyond in zip(outwards, each, [*each[1:], None], strict=True):
        nodes = _nodes(program, solution, index)
        if junction is None and not dynamics.phase.others:
            point = OnePoint(dynamics, nodes.times[::way])
            motion = _one_point(point, nodes, (float(y[0]), rate), home, beyond)[:, :, ::way]
        else:
            motion = nodes.motion
            if junction is not None:
                free = np.delete(np.arange(program.size), dynamics.dependent)
                change = (junction - motion[:, :, near])[:, free]
                motion[:, free] += quintic(nodes.times, nodes.times[[0, -1]], *(change, 0 * change)[::way])
            motion = dynamics.close(*motion)
        junction = motion[:, :, far]
        grid = Grid(nodes.times, motion[0], motion[1], motion[2], nodes.ratios)
        grid = replace(grid, ratios=dynamics.shared(grid, program.node.bounds.friction))
        stances.append(Stance(robot, gravity, dynamics.phase.contacts, place, grid))
    return stances[::way]


def _nodes(program: JumpProgram, solution: Solution, index: int) -> Grid:
    """A phase of the program's solution on the fine grid."""
    nodes = slice(program.starts[index], program.starts[index + 1] + 1)
    coarse = instants(program.phases, solution.durations)[nodes]
    fine = refined(coarse, REFINED)
    horizontal = solution.forces[index][0::2]
    vertical = solution.forces[index][1::2]
    small = vertical < 1e-3 * program.node.weight
    ratios = np.where(small, 0.0, horizontal / np.where(small, 1.0, vertical))
    for row, lost in zip(ratios, small, strict=True):
        row[lost] = np.interp(np.flatnonzero(lost), np.flatnonzero(~lost), row[~lost]) if (~lost).any() else 0.0
    between = np.array([np.interp(fine, coarse, row) for row in ratios]).reshape(len(ratios), len(fine))
    y, v, a = values(hermite(coarse, np.stack((solution.y, solution.v, solution.a))[:, :, nodes]), fine)
    return Grid(fine, y, v, a, between)


def _one_point(
    stance: OnePoint, nodes: Grid, meeting: tuple[float, float], home: Array, beyond: StanceDynamics | None
) -> Array:
    """Motion (3, n+1, G) on one point from the flight's end to the next phase, whose feet stand there; or to rest.

    Unknowns are changes of joints: at the junction, of those that the next closure leaves no choice; or in between.
    """
    n = len(nodes.y) - 1
    ends = nodes.times[[0, -1]]
    way = 1 if stance.times[0] > stance.times[-1] else -1
    span = ends[1] - ends[0]
    scale = np.array([[1.0], [1 / span], [1 / span**2]])
    rows = [] if beyond is None else [each - 1 for each in beyond.dependent]

    sampled = stance.sampled
    planned = [nodes.at(times)[:, 1:] for times in sampled]
    # Quintics (3, 3, N) of value, first and second derivative 1 at the junction, alone, and 0 at the other end.
    shapes = [quintic(times, ends, *(np.eye(3), np.zeros((3, 3)))[::way]) for times in sampled]

    def follow(unknown: Array) -> Array:
        changed = []
        for times, joints, shape in zip(sampled, planned, shapes, strict=True):
            if beyond is None:
                changed.append(joints + _bumps(times, ends, unknown.reshape(n, 2)))
                continue
            change = scale * unknown.reshape(3, -1)
            found = joints.copy()
            found[:, rows] += change.T @ shape
            changed.append(found)
        return stance.follow(changed, meeting)

    def residual(unknown: Array) -> Array:
        last = follow(unknown)[:, :, -1:]
        if beyond is None:
            return np.array([last[0, 0, 0] - home[0], last[1, 0, 0] * span])
        return np.asarray(((beyond.close(*last) - last)[:, beyond.dependent, 0] / scale).ravel())

    start = np.zeros(2 * n if beyond is None else 3 * len(beyond.dependent))
    unknown, is_met = _least_change(residual, start)
    if beyond is not None and not is_met:  # too far for whole steps
        unknown = root(residual, start, method="hybr", options={"xtol": 1e-13}).x
    return follow(unknown)


def _bumps(times: Array, span: Array, sizes: Array) -> Array:
    """Changes (3, n, N) with two derivatives, all of which vanish at two times (2,); sizes (n, 2)."""
    lasts = span[1] - span[0]
    base = np.polynomial.Polynomial([0, 0, 0, 64, -192, 192, -64])
    s = (times - span[0]) / lasts
    shapes = [base, base * np.polynomial.Polynomial([-1, 2])]
    found = [[(each.deriv(k) if k else each)(s) / lasts**k for each in shapes] for k in range(3)]
    return np.asarray(sizes @ np.array(found))


def _least_change(residual: Any, start: Array) -> tuple[Array, bool]:
    """Newton's steps of least norm to a root of no more equations than unknowns; and whether they came there."""
    unknown = start
    step = 1e-6
    for _ in range(12):
        value = residual(unknown)
        if np.abs(value).max() < MET:
            return unknown, True
        if not np.isfinite(value).all():
            break
        jacobian = np.stack([(residual(unknown + step * way) - value) / step for way in np.eye(len(start))], axis=1)
        unknown = unknown - np.linalg.pinv(jacobian) @ value
    return unknown, False
