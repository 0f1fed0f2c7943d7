"""Stances that satisfy the dynamics between the program's nodes too, and meet the flight where it begins and ends.

The program's joints, interpolated by quintics, are taken as they are. On one point the orientation follows from the
balance of moments, a differential equation that starts at the flight's end. Where more than the anchor stands, legs
follow from where their feet are: their joints solve the closure of the chain. What a phase ends with goes into the next
by a quintic that dies out at its other end; where the flight is, accelerations are first made those of both sides,
with feet at rest and the robot in free fall; on one point alone, joints are changed a little until the robot stands.
All this is done on a fine grid, between which quintics are as good as exact.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.interpolate import BPoly
from scipy.optimize import root

from floatplan.arrays import Array
from floatplan.stance.contacts import Contact, heights_over_com
from floatplan.stance.model import PlanarModel, casadi
from floatplan.stance.motion import Grid, Stance, hermite, refined, values
from floatplan.stance.phases import Phase
from floatplan.stance.program import JumpProgram, Solution
from floatplan.stance.rows import axes_of, balanced, closures, spread

REFINED = 4  # [-] steps of the grid in an interval of the program
SUBSTEPS = 4  # [-] of the differential equation in a step of the grid
NEWTON = 8  # [-] steps for the closure of a chain
CLOSED = 1e-11  # [m]
FALLING = 0.01  # [m/s^2] times the mass: a force that is less has no ratio
MET = 1e-9  # [-] what a residual of a junction may be


class StanceDynamics:
    """What the stances of a phase need, as compiled functions over many instants."""

    def __init__(self, model: PlanarModel, phase: Phase, home: Array) -> None:
        ca = casadi()
        self.model, self.phase = model, phase
        forces = ca.SX.sym("forces", 2 * len(phase.others))
        own, pairs = balanced(model, phase, forces)
        moments = model.moments(phase.anchor.spots[0], spread(phase.contacts, [own, *pairs]))
        self.moment = model.function("moment", [ca.sum1(moments)], forces)
        parts = [self._closure(contact, home) for contact in phase.others]
        closure = ca.vertcat(*parts) if parts else ca.SX(0, 1)
        rate = ca.jtimes(closure, model.y, model.v)
        self.closure = model.function("closure", [closure, ca.jacobian(closure, model.y)])
        drift = ca.jtimes(rate, model.y, model.v)
        self.drift = model.function("drift", [drift])
        self.size = closures(phase)
        none = np.zeros(2 * len(phase.others))
        total, _ = balanced(model, phase, none)
        self.total = model.function("total", total)
        alone = self.moment(model.y, model.v, model.a, none)
        falls = ca.vertcat(*total, alone, ca.mtimes(ca.jacobian(closure, model.y), model.a) + drift)
        self.falls = model.function("falls", [falls, ca.jacobian(falls, model.a)])

    def _closure(self, contact: Contact, home: Array) -> Any:
        """Place of a contact less where it stands, m; of a heel its height."""
        model, anchor = self.model, self.phase.anchor.spots[0]
        places = model.places(model.weights(contact.spots[:1], anchor))
        at_home = model.function("place", places)(home, 0 * home, 0 * home)
        return casadi().vertcat(*[places[k] - at_home[k] for k in axes_of(contact)])

    @cached_property
    def dependent(self) -> list[int]:
        """Entries of y that follow from the closure: joints nearest to the other contacts, of their own legs first."""
        tree, found = self.model.robot.tree, []
        for contact in self.phase.others:
            body, own = contact.spots[0][0], []
            held = tree.turns[self.phase.anchor.spots[0][0]] if not contact.vertical else np.zeros(tree.turns.shape[1])
            while body > 0:
                joint = np.flatnonzero(tree.turns[body] - tree.turns[tree.parent[body]])
                own += [1 + int(each) for each in joint if not held[each] and 1 + int(each) not in own]
                body = int(tree.parent[body])
            found += own[: 1 if contact.vertical else 2]
        return found

    def turned(self, y: Array, v: Array, a: Array) -> Array:
        """Orientation's acceleration (N,) rad/s^2 by the balance of moments, on the anchor alone."""
        still, unit = a.copy(), a.copy()
        still[0], unit[0] = 0.0, 1.0
        forces = np.zeros(2 * len(self.phase.others))
        rest, one = (np.asarray(self.moment(y, v, each, forces)).ravel() for each in (still, unit))
        return np.asarray(-rest / (one - rest))

    def close(self, y: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
        """Return y, v, a (n+1, N) with the dependent joints as the closure demands."""
        y, v, a = y.copy(), v.copy(), a.copy()
        if not self.size:
            return y, v, a
        columns, count = self.dependent, y.shape[1]
        for _ in range(NEWTON):
            value, jacobian = self._closed(y, v, a)
            y[columns] -= np.linalg.solve(jacobian[:, :, columns], value[:, :, None])[:, :, 0].T
            if np.abs(value).max() < CLOSED:
                break
        _, jacobian = self._closed(y, v, a)
        own = jacobian[:, :, columns]
        v[columns] = 0.0
        v[columns] = -np.linalg.solve(own, np.einsum("nij,jn->ni", jacobian, v)[:, :, None])[:, :, 0].T
        drift = np.asarray(self.drift(y, v, a)).reshape(self.size, count, order="F").T
        a[columns] = 0.0
        rest = np.einsum("nij,jn->ni", jacobian, a) + drift
        a[columns] = -np.linalg.solve(own, rest[:, :, None])[:, :, 0].T
        return y, v, a

    def released(self, y: Array, v: Array, a: Array) -> Array:
        """Accelerations (n+1,) nearest to ``a`` with which the robot falls freely while its feet are still at rest.

        The centre of mass falls, the angular momentum is constant, and the closure of the chain lasts.
        """
        value, ways = (np.asarray(each) for each in self.falls(y, v, a))
        return np.asarray(a - np.linalg.lstsq(ways, value[:, 0], rcond=None)[0])

    def shared(self, grid: Grid, friction: float) -> Array:
        """Ratios (others, G) with which the anchor's force is in the cone too: the other takes the rest.

        The ends of a sole take the same.
        """
        if len(grid.ratios) != 1:
            return grid.ratios
        ratio, motion = grid.ratios, (grid.y, grid.v, grid.a)
        horizontal, vertical = (np.asarray(each) for each in self.total(*motion))
        if self.phase.others[0].vertical:
            return np.asarray(horizontal / np.maximum(vertical, FALLING * self.model.robot.mass))
        none, one = (self.moment(*motion, np.vstack((part * ratio, part + 0 * ratio))) for part in (0.0, 1.0))
        other = -np.asarray(none) / np.asarray(one - none)
        own = vertical - other
        most = friction * np.maximum(own, 0.0)
        taken = np.clip(horizontal - ratio * other, -most, most)
        light = other < FALLING * self.model.robot.mass
        return np.where(light, ratio, (horizontal - taken) / np.where(light, 1.0, other))

    def _closed(self, y: Array, v: Array, a: Array) -> tuple[Array, Array]:
        """Closure (N, c) and its derivative (N, c, n+1)."""
        count, size = y.shape[1], len(y)
        value, jacobian = self.closure(y, v, a)
        values = np.asarray(value).reshape(self.size, count, order="F").T
        blocks = np.asarray(jacobian).reshape(self.size, count, size) if count == 1 else np.asarray(jacobian)
        return values, blocks.reshape(self.size, count, size).transpose(1, 0, 2)


class OnePoint:
    """A stance on its anchor alone: joints are given, the orientation follows.

    Parameters
    ----------
    dynamics : StanceDynamics
    times : (G,) s, from the flight's end outwards: increasing or decreasing
    """

    def __init__(self, dynamics: StanceDynamics, times: Array) -> None:
        ca = casadi()
        self.dynamics, self.times = dynamics, times
        n = len(dynamics.model.robot.joints)
        state, step = ca.SX.sym("state", 2), ca.SX.sym("step")
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
        forward = ca.Function("step", [state, joints, step], [state + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)])
        self._steps = forward.mapaccum(SUBSTEPS * (len(times) - 1))

    def follow(self, joints: Any, start: tuple[float, float]) -> tuple[Array, Array, Array]:
        """Return y, v, a (n+1, G) at the times.

        Parameters
        ----------
        joints : function of times (N,) that returns q, q', q'' (n, N)
        start : orientation and its rate at the first time
        """
        times = self.times
        fine = refined(times, SUBSTEPS)
        steps = np.diff(fine)
        stages = [np.concatenate(joints(each)) for each in (fine[:-1], fine[:-1] + steps / 2, fine[1:])]
        found = np.asarray(self._steps(np.array(start), np.concatenate(stages), steps[None]))
        path = np.concatenate((np.array(start)[:, None], found[:, SUBSTEPS - 1 :: SUBSTEPS]), axis=1)
        q, qd, qdd = joints(times)
        y, v = np.vstack((path[0], q)), np.vstack((path[1], qd))
        a = np.vstack((np.zeros(len(times)), qdd))
        a[0] = self.dynamics.turned(y, v, a)
        return y, v, a


def blend(times: Array, near: float, far: float, changes: Array) -> tuple[Array, Array, Array]:
    """Return a quintic and two derivatives (rows, N): ``changes`` (rows, 3) at ``near``, all zero at ``far``."""
    order = np.argsort([near, far])
    ends = np.zeros((2, 3, len(changes)))
    ends[0] = changes.T
    return values(BPoly.from_derivatives(np.array([near, far])[order], ends[order]), times)


def released(program: JumpProgram, solution: Solution) -> Solution:
    """Return a solution in which accelerations are exactly those of stance and of flight, where one meets the other.

    The program's contacts drift a little there, and its forces vanish but for its tolerance.
    """
    a = solution.a.copy()
    for side, home in ((-1, program.ends[0]), (1, program.ends[1])):
        node = program.starts[program.flight + max(side, 0)]
        dynamics = StanceDynamics(program.model, program.phases[program.flight + side], home)
        a[:, node] = dynamics.released(solution.y[:, node], solution.v[:, node], a[:, node])
    return replace(solution, a=a)


def exact_stances(
    program: JumpProgram, solution: Solution, side: str, y: Array, rate: float, com: complex
) -> tuple[Stance, ...]:
    """Return the stances of one side, in order of time, exact from the flight's end on.

    Parameters
    ----------
    side : "takeoff" or "landing"
    y : (n+1,) rad, where the flight begins or ends
    rate : of the orientation there, rad/s
    com : place of the centre of mass there, m, horizontal + i vertical
    """
    phases = [phase for phase in program.phases if phase.side == side]
    robot, anchor = program.model.robot, phases[-1 if side == "takeoff" else 0].anchor
    spot, angles = anchor.spots[0], robot.tree.absolute_angles(y[0], y[1:])
    place = com + complex(heights_over_com(robot, [spot], y)[0]) + robot.tree.turn * spot.radius * angles[spot.body]
    pairs = zip(phases, exact_side(program, solution, side, (float(y[0]), rate)), strict=True)
    return tuple(Stance(robot, program.model.gravity, phase.contacts, place, grid) for phase, grid in pairs)


def exact_side(program: JumpProgram, solution: Solution, side: str, meeting: tuple[float, float]) -> list[Grid]:
    """Motion of the stances of one side; ``meeting``: orientation and its rate where the flight is, rad and rad/s."""
    indices = [index for index, phase in enumerate(program.phases) if phase.side == side]
    outwards = indices[::-1] if side == "takeoff" else indices
    home = program.ends[0 if side == "takeoff" else 1]
    grids: dict[int, Grid] = {}
    first = _nodes(program, solution, outwards[0])
    dynamics = StanceDynamics(program.model, program.phases[outwards[0]], home)
    junction: tuple[Array, Array, Array] | None = None
    if not dynamics.phase.others:
        times = first.times[::-1] if side == "takeoff" else first.times
        outer = program.phases[outwards[1]] if len(outwards) > 1 else None
        beyond = None if outer is None else StanceDynamics(program.model, outer, home)
        y, v, a = _one_point(OnePoint(dynamics, times), first, meeting, home, beyond)
        junction = y[:, -1:], v[:, -1:], a[:, -1:]
        order = np.argsort(times)
        grids[outwards[0]] = Grid(times[order], y[:, order], v[:, order], a[:, order], first.ratios)
        outwards = outwards[1:]
    for index in outwards:
        nodes = _nodes(program, solution, index)
        dynamics = StanceDynamics(program.model, program.phases[index], home)
        y, v, a = nodes.y, nodes.v, nodes.a
        if junction is not None:
            near, far = (nodes.times[-1], nodes.times[0]) if side == "takeoff" else (nodes.times[0], nodes.times[-1])
            at = -1 if side == "takeoff" else 0
            change = np.stack([part[:, 0] - own[:, at] for part, own in zip(junction, (y, v, a), strict=True)], axis=1)
            free = [row for row in range(program.size) if row not in dynamics.dependent]
            parts = blend(nodes.times, float(near), float(far), change[free])
            y, v, a = y.copy(), v.copy(), a.copy()
            for own, part in zip((y, v, a), parts, strict=True):
                own[free] += part
        y, v, a = dynamics.close(y, v, a)
        grid = Grid(nodes.times, y, v, a, nodes.ratios)
        grids[index] = replace(grid, ratios=dynamics.shared(grid, program.node.bounds.friction))
        inner = 0 if side == "takeoff" else -1
        junction = y[:, [inner]], v[:, [inner]], a[:, [inner]]
    return [grids[index] for index in indices]


def _nodes(program: JumpProgram, solution: Solution, index: int) -> Grid:
    """A phase of the program's solution on the fine grid."""
    phase = program.phases[index]
    begins = np.concatenate(([0.0], np.cumsum(solution.durations)))
    coarse = begins[index] + solution.durations[index] * phase.shares
    columns = slice(program.starts[index], program.starts[index + 1] + 1)
    curve = hermite(coarse, solution.y[:, columns], solution.v[:, columns], solution.a[:, columns])
    fine = refined(coarse, REFINED)
    forces = solution.forces[index]
    horizontal, vertical = forces[0::2], forces[1::2]
    small = vertical < 1e-3 * program.node.weight
    ratios = np.where(small, 0.0, horizontal / np.where(small, 1.0, vertical))
    for row, lost in zip(ratios, small, strict=True):
        row[lost] = np.interp(np.flatnonzero(lost), np.flatnonzero(~lost), row[~lost]) if (~lost).any() else 0.0
    spread_out = np.array([np.interp(fine, coarse, row) for row in ratios]).reshape(len(ratios), len(fine))
    return Grid(fine, *values(curve, fine), spread_out)


def _one_point(
    stance: OnePoint, nodes: Grid, meeting: tuple[float, float], home: Array, beyond: StanceDynamics | None
) -> tuple[Array, Array, Array]:
    """Motion on one point from the flight's end to the next phase, whose feet stand there; or to rest.

    Unknowns are changes of joints: at the junction, of those that the next closure leaves no choice; or in between.
    """
    near, far = float(stance.times[-1]), float(stance.times[0])
    n, span = len(nodes.y) - 1, abs(far - near)
    scale = np.array([1.0, 1 / span, 1 / span**2])
    rows = [] if beyond is None else [each - 1 for each in beyond.dependent]

    def joints(unknown: Array, times: Array) -> tuple[Array, ...]:
        parts = [part[1:].copy() for part in nodes.at(times)]
        changes = (
            blend(times, near, far, unknown.reshape(len(rows), 3) * scale)
            if rows
            else _bumps(times, near, far, unknown.reshape(n, 2))
        )
        for part, change in zip(parts, changes, strict=True):
            part[rows if rows else slice(None)] += change
        return tuple(parts)

    def follow(unknown: Array) -> tuple[Array, Array, Array]:
        return stance.follow(lambda times: joints(unknown, times), meeting)

    def residual(unknown: Array) -> Array:
        y, v, a = (part[:, -1:] for part in follow(unknown))
        if beyond is None:
            return np.array([y[0, 0] - home[0], v[0, 0] * span])
        wanted = beyond.close(y, v, a)
        own = np.stack([(new - old)[1:][rows, 0] for new, old in zip(wanted, (y, v, a), strict=True)], axis=1)
        return np.asarray((own / scale).ravel())

    if rows:
        found = root(residual, np.zeros(3 * len(rows)), method="hybr", options={"xtol": 1e-13}).x
    else:
        found = _least_change(residual, np.zeros(2 * n))
    return follow(found)


def _bumps(times: Array, near: float, far: float, sizes: Array) -> tuple[Array, Array, Array]:
    """Changes (n, N) that vanish with two derivatives at both ends, and their derivatives; sizes (n, 2)."""
    span = far - near
    s = (times - near) / span
    base = np.polynomial.Polynomial([0, 0, 0, 64, -192, 192, -64])
    shapes = [base, base * np.polynomial.Polynomial([-1, 2])]
    found = []
    for order in range(3):
        values = np.array([(shape.deriv(order) if order else shape)(s) for shape in shapes]) / span**order
        found.append(sizes @ values)
    return found[0], found[1], found[2]


def _least_change(residual: Any, start: Array) -> Array:
    """Newton's steps of least norm to a root of fewer equations than unknowns."""
    unknown, step = start, 1e-6
    for _ in range(12):
        value = residual(unknown)
        if np.abs(value).max() < MET:
            break
        jacobian = np.stack([(residual(unknown + step * way) - value) / step for way in np.eye(len(start))], axis=1)
        unknown = unknown - np.linalg.pinv(jacobian) @ value
    return unknown
