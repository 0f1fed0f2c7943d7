"""One nonlinear program over all phases of a jump, from standing to standing, for IPOPT.

Variables at the nodes are y = (theta_0, q), y', y'' and the forces of all contacts but the anchor's; beside them the
phases' durations and the angular momentum h of the flight. Between nodes y'' is linear:

``y'_1 = y'_0 + T (y''_0 + y''_1) / 2``,  ``y_1 = y_0 + T y'_0 + T^2 (2 y''_0 + y''_1) / 6``.

In stance the base hangs on the anchor, whose force is ``m (c'' + g)`` less the others'; the balance of moments holds
at every node. In flight h is constant, ``D y' = h``, the centre of mass is on its parabola, and the orientation is
integrated by Hermite's rule. Both seams are exact: there forces vanish, and h and the parabola are those of either side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.stance.contacts import Contact, Watched
from floatplan.stance.model import PlanarModel, casadi
from floatplan.stance.phases import Phase

DAMPING = 8.0  # [1/s] of drift of contacts beside the anchor
LIFT = 0.02  # [m] of feet in the middle of the flight
RANGE_ROOM = 0.1  # [rad] inside joint ranges
LOWEST_FORCE = 0.0
TURN_ROOM = 1.5  # [rad] of the base beyond its start and goal
FASTEST_TURN = 40.0  # [rad/s] of the base
ROUGHNESS = float(__import__("os").environ.get("RO","1e-6"))  # [-] of steps of accelerations, beside the squared torques
TOLERANCE = 1e-6  # IPOPT's, scaled
ITERATIONS = 400


@dataclass(frozen=True, eq=False)
class Bounds:
    """What the program holds, margins taken off.

    Attributes
    ----------
    torque, stall, slope : (motors,) N m, N m, N m s/rad, of each motor; infinite where there is none
    velocity : (n,) rad/s
    position : (n, 2) rad
    friction : coefficient
    """

    torque: Array
    stall: Array
    slope: Array
    velocity: Array
    position: Array
    friction: float


@dataclass(frozen=True, eq=False)
class Solution:
    """Values at the K+1 nodes of a jump.

    Attributes
    ----------
    y, v, a : (n+1, K+1)
    forces : for each phase (2 (contacts - 1), nodes of the phase) N, of its contacts but the anchor
    durations : (phases,) s
    momentum : h, kg m^2/s
    worst : largest violation of a constraint, scaled; and which it is
    converged : bool
    iterations : int
    cost : integral of squared torques, N^2 m^2 s
    raw : the variables, scaled
    """

    y: Array
    v: Array
    a: Array
    forces: tuple[Array, ...]
    durations: Array
    momentum: float
    worst: tuple[float, str]
    converged: bool
    iterations: int
    cost: float
    raw: Array


@dataclass
class _Rows:
    """Constraints as they are gathered: expressions with bounds, and what each is about."""

    values: list[Any] = field(default_factory=list)
    low: list[Array] = field(default_factory=list)
    high: list[Array] = field(default_factory=list)
    labels: list[str] = field(default_factory=list)

    def add(self, value: Any, low: float | Array, high: float | Array, label: str) -> None:
        size = value.numel()
        self.values.append(casadi().vec(value))
        self.low.append(np.broadcast_to(low, size) if np.ndim(low) == 0 else np.asarray(low).ravel(order="F"))
        self.high.append(np.broadcast_to(high, size) if np.ndim(high) == 0 else np.asarray(high).ravel(order="F"))
        self.labels += [label] * size


class JumpProgram:
    """The program of a jump of some phases; built once, solved from any guess.

    Parameters
    ----------
    model : PlanarModel
    phases : of the jump
    watched : what stays above the ground
    bounds : Bounds
    ends : (2, n+1) y where the robot stands before and after
    """

    def __init__(
        self, model: PlanarModel, phases: Sequence[Phase], watched: Watched, bounds: Bounds, ends: Array
    ) -> None:
        self.model, self.phases, self.watched, self.bounds, self.ends = model, tuple(phases), watched, bounds, ends
        self.size = 1 + len(model.robot.joints)
        self.starts = np.concatenate(([0], np.cumsum([phase.intervals for phase in phases])))
        self.nodes = int(self.starts[-1]) + 1
        self.weight = model.robot.mass * model.gravity  # [N]
        com = model.function("com", model.com_from(self.phases[0].anchor.spots[0]))
        place = [float(value) for value in com(ends[0], 0 * ends[0], 0 * ends[0])]
        self.height = place[1] + self.phases[0].anchor.depth  # [m] of the centre of mass, standing
        self.unit = np.sqrt(self.height / model.gravity)  # [s]
        self.flight = next(index for index, phase in enumerate(phases) if phase.side == "flight")

    # -- variables ----------------------------------------------------------------------------------------------

    @cached_property
    def _shapes(self) -> list[tuple[int, int]]:
        """Sizes of y, v, a, then of each stance's forces, durations, and h."""
        forces = [(2 * len(phase.others), phase.intervals + 1) for phase in self.phases]
        return [*[(self.size, self.nodes)] * 3, *forces, (len(self.phases), 1), (1, 1)]

    @cached_property
    def _scales(self) -> list[float]:
        momentum = self.weight * self.height * self.unit
        return [1.0, 1 / self.unit, 1 / self.unit**2, *[self.weight] * len(self.phases), 1.0, momentum]

    def split(self, raw: Any) -> list[Any]:
        """Variables (size,), scaled, as matrices of their own units: an expression, or numbers."""
        parts, at = [], 0
        for (rows, columns), scale in zip(self._shapes, self._scales, strict=True):
            piece = raw[at : at + rows * columns]
            at += rows * columns
            if isinstance(raw, np.ndarray):
                parts.append(scale * piece.reshape(rows, columns, order="F"))
            else:
                parts.append(scale * casadi().reshape(piece, rows, columns))
        return parts

    def join(self, parts: Sequence[Array]) -> Array:
        """The reverse of :meth:`split`."""
        pairs = zip(parts, self._scales, strict=True)
        return np.concatenate([np.ravel(np.asarray(part) / scale, order="F") for part, scale in pairs])

    @cached_property
    def _box(self) -> tuple[Array, Array]:
        """Bounds of the variables, scaled."""
        bounds, ends = self.bounds, self.ends
        y, v, a = (np.empty((2, self.size, self.nodes)) for _ in range(3))
        room = np.minimum(RANGE_ROOM, np.ptp(bounds.position, axis=1) / 4)
        low, high = np.sort(ends[:, 0])
        y[0], y[1] = (
            np.append(turn, edge)[:, None]
            for turn, edge in (
                (low - TURN_ROOM, bounds.position[:, 0] + room),
                (high + TURN_ROOM, bounds.position[:, 1] - room),
            )
        )
        fastest = np.append(FASTEST_TURN, bounds.velocity)[:, None]
        v[0], v[1], a[0], a[1] = -fastest, fastest, -np.inf, np.inf
        for node, end in ((0, ends[0]), (-1, ends[1])):
            y[:, :, node], v[:, :, node], a[:, :, node] = end, 0.0, 0.0
        parts: list[list[Array]] = [[low, high] for low, high in (y, v, a)]
        for phase, _ in zip(self.phases, self._shapes[3:], strict=False):
            parts.append(list(self._force_box(phase)))
        parts.append([np.array([phase.bounds[side] for phase in self.phases])[:, None] for side in (0, 1)])
        parts.append([np.array([[-np.inf]]), np.array([[np.inf]])])
        return self.join([part[0] for part in parts]), self.join([part[1] for part in parts])

    def _force_box(self, phase: Phase) -> tuple[Array, Array]:
        """Bounds (2 others, nodes) of forces: unilateral; nothing where a contact leaves or comes."""
        index = self.phases.index(phase)
        low = np.tile([[-np.inf], [0.0]], (len(phase.others), phase.intervals + 1))
        high = np.full_like(low, np.inf)
        after = {each.name for each in self.phases[index + 1].contacts} if phase.side == "takeoff" else set()
        before = {each.name for each in self.phases[index - 1].contacts} if phase.side == "landing" else set()
        for row, contact in enumerate(phase.others):
            if contact.vertical:
                low[2 * row], high[2 * row] = 0.0, 0.0
            for changes, node in (
                (phase.side == "takeoff" and contact.name not in after, -1),
                (phase.side == "landing" and contact.name not in before, 0),
            ):
                if changes:
                    low[2 * row : 2 * row + 2, node] = high[2 * row : 2 * row + 2, node] = 0.0
        return low, high

    # -- rows of one node ---------------------------------------------------------------------------------------

    def _stance_node(self, phase: Phase) -> tuple[Any, list[tuple[float, float, str]]]:
        """Function (y, v, a, forces) -> (rows, cost) of a stance's node, with the rows' bounds and labels."""
        ca, model, bounds = casadi(), self.model, self.bounds
        forces = ca.SX.sym("forces", 2 * len(phase.others))
        pairs = [(forces[2 * k] * self.weight, forces[2 * k + 1] * self.weight) for k in range(len(phase.others))]
        anchor = phase.anchor.spots[0]
        x, z = model.com_from(anchor, 2)
        mass = model.robot.mass
        own = (mass * x - sum(p[0] for p in pairs), mass * (z + model.gravity) - sum(p[1] for p in pairs))
        moments = model.moments(anchor, spread([phase.anchor, *phase.others], [own, *pairs]))
        rows: list[tuple[Any, float, float, str]] = [
            (ca.sum1(moments) / (self.weight * self.height), 0.0, 0.0, "balance of moments")
        ]
        for contact, pair in zip(phase.others, pairs, strict=True):
            kinds = self._closure(phase, contact)
            rows += [(each, 0.0, 0.0, f"{contact.name} {kind}") for kind, values in kinds.items() for each in values]
            rows += _cone(pair, bounds.friction, self.weight, contact.name, unilateral=False)
        rows += _cone(own, bounds.friction, self.weight, phase.anchor.name, unilateral=True)
        rows += [(own[k] / self.weight, 0.0, 0.0, "release") for k in (0, 1)]
        rows += self._torque_rows(moments)
        ground = -phase.anchor.depth
        places = model.places(model.weights(self.watched.spots, anchor))[1] if self.watched.spots else ca.SX(0, 1)
        for index, least in enumerate(self.watched.least):
            rows.append((places[index] - ground, float(least), np.inf, "clear of the ground"))
        for contact in self._feet:
            if contact.name not in {each.name for each in phase.contacts}:
                height = model.places(model.weights(contact.spots[:1], anchor))[1]
                rows.append((height - ground, contact.depth, np.inf, f"{contact.name} above the ground"))
        output = ca.vertcat(*[row[0] for row in rows])
        cost = self._cost(moments)
        return model.function("stance", [output, cost], forces), [row[1:] for row in rows]

    def _closure(self, phase: Phase, contact: Contact) -> dict[str, list[Any]]:
        """Damped acceleration of a contact beside the anchor, and its place and rate; of a heel the vertical ones."""
        anchor, model, unit = phase.anchor.spots[0], self.model, self.unit
        weights = model.weights(contact.spots[:1], anchor)
        place, rate, acceleration = (model.places(weights, order) for order in range(3))
        home = self._span(phase, contact)
        found: dict[str, list[Any]] = {"stands": [], "meets": []}
        for k in (1,) if contact.vertical else (0, 1):
            away = place[k] - home[k]
            found["stands"].append((acceleration[k] + 2 * DAMPING * rate[k] + DAMPING**2 * away) * unit**2)
            found["meets"] += [away, rate[k] * unit]
        return found

    def _span(self, phase: Phase, contact: Contact) -> tuple[float, float]:
        """Where a contact is from the anchor where the robot stands, m."""
        model, end = self.model, self.ends[0 if phase.side == "takeoff" else 1]
        place = model.function("span", model.places(model.weights(contact.spots[:1], phase.anchor.spots[0])))
        x, z = place(end, 0 * end, 0 * end)
        return float(x), float(z)

    @cached_property
    def _feet(self) -> list[Contact]:
        """All contacts, each once."""
        return list({each.name: each for phase in self.phases for each in phase.contacts}.values())

    @cached_property
    def _distinct(self) -> list[int]:
        """Motors whose torques are not always those of one before."""
        turns, tree = self.model.robot.tree.motor_turns, self.model.robot.tree
        seen: list[tuple[int, Any]] = []
        names = [each for each in range(turns.shape[1])]
        for motor in names:
            bodies = np.flatnonzero(turns[:, motor])
            key = np.array([[tree.mass[b], tree.center[b], tree.inertia[b], *tree.turns[b]] for b in bodies])
            if not any(k.shape == key.shape and np.allclose(k, key, rtol=1e-6, atol=1e-6) for _, k in seen):
                seen.append((motor, key))
        return [motor for motor, _ in seen]

    def _torque_rows(self, moments: Any) -> list[tuple[Any, float, float, str]]:
        """Torques over their limits; with the torque that is lost with the rate over the stall torque."""
        bounds, robot, rows = self.bounds, self.model.robot, []
        torques = self.model.motor_torques(moments)
        rates = casadi().mtimes(self.model._constant(robot.motor_ratios), self.model.v[1:])
        for motor in self._distinct:
            name, torque = robot.motors[motor], torques[motor]
            if np.isfinite(bounds.torque[motor]):
                rows.append((torque / bounds.torque[motor], -1.0, 1.0, f"torque of {name}"))
            if np.isfinite(bounds.stall[motor]):
                for sign in (1.0, -1.0):
                    value = (torque + sign * bounds.slope[motor] * rates[motor]) / bounds.stall[motor]
                    rows.append((value, -1.0, 1.0, f"torque-speed curve of {name}"))
        return rows

    def _cost(self, moments: Any) -> Any:
        torques = self.model.motor_torques(moments)
        return casadi().sumsqr(torques) / (self.weight * self.height) ** 2

    def _flight_node(self) -> tuple[Any, list[tuple[float, float, str]]]:
        """Function (y, v, a, height of the centre of mass, h) -> (rows, cost) of the flight's nodes."""
        ca, model = casadi(), self.model
        height, lift, momentum = ca.SX.sym("height"), ca.SX.sym("lift"), ca.SX.sym("momentum")
        moments = model.moments(None, [])
        rows: list[tuple[Any, float, float, str]] = [
            ((model.momentum() - momentum) / self._scales[-1], 0.0, 0.0, "angular momentum in flight"),
            (ca.sum1(moments) / (self.weight * self.height), 0.0, 0.0, "angular momentum in flight"),
            *self._torque_rows(moments),
        ]
        spots = [*self.watched.spots, *(contact.spots[0] for contact in self._feet)]
        _, z = model.places(model.weights(spots))
        for index, least in enumerate(self.watched.least):
            rows.append((z[index] + height, float(least), np.inf, "clear of the ground"))
        for index, contact in enumerate(self._feet, start=len(self.watched.spots)):
            rows.append((z[index] + height - lift, contact.depth, np.inf, f"{contact.name} above the ground"))
        output = ca.vertcat(*[row[0] for row in rows])
        function = model.function("flight", [output, self._cost(moments)], height, lift, momentum)
        return function, [row[1:] for row in rows]

    # -- the program --------------------------------------------------------------------------------------------

    @cached_property
    def _solver(self) -> tuple[Any, Any, _Rows]:
        """IPOPT's solver, a function of the variables for all rows and the cost, and the rows."""
        ca = casadi()
        raw = ca.MX.sym("w", sum(rows * columns for rows, columns in self._shapes))
        y, v, a, *rest = self.split(raw)
        forces, durations, momentum = rest[:-2], rest[-2], rest[-1]
        rows, costs, rough = _Rows(), [], 0.0
        for index, phase in enumerate(self.phases):
            start, end = self.starts[index], self.starts[index + 1]
            step = durations[index] * ca.DM(np.diff(phase.shares)).T
            if phase.side == "flight":
                cost = self._add_flight(rows, (y, v, a), durations[index], momentum)
            else:
                parts = [each[:, start : end + 1] for each in (y, v, a)]
                if phase.others:
                    self._add_links(rows, parts, step, phase.side)
                else:
                    self._add_links(rows, [each[1:, :] for each in parts], step, phase.side)
                    self._add_turn(rows, phase, parts, step)
                cost = self._add_stance(rows, phase, parts, forces[index])
            costs.append(ca.dot(step, (cost[:, :-1] + cost[:, 1:]) / 2))
            parts = [each[1:, start : end + 1] for each in (v, a)]
            jumps = (parts[1][:, 1:] - parts[1][:, :-1]) * self.unit**2
            rough += self.unit * ROUGHNESS * ca.sumsqr(jumps)
            middle = (parts[0][:, 1:] + parts[0][:, :-1]) / 2 + ca.repmat(step, self.size - 1, 1) / 8 * (
                parts[1][:, :-1] - parts[1][:, 1:]
            )
            fastest = self.bounds.velocity
            limited = np.flatnonzero(np.isfinite(fastest)).tolist()
            if limited:
                rows.add(ca.mtimes(ca.DM(np.diag(1 / fastest[limited])), middle[limited, :]), -1.0, 1.0, f"rate ({phase.side})")
        total, values = ca.sum1(ca.vertcat(*costs)), ca.vertcat(*rows.values)
        options = {
            "print_time": __import__("os").environ.get("PT")=="1",
            "ipopt": {
                "print_level": 0,
                "sb": "yes",
                "tol": TOLERANCE,
                "constr_viol_tol": 1e-8,
                "max_iter": ITERATIONS,
                "mu_strategy": __import__("os").environ.get("MU","adaptive"),
            },
        }
        solver = ca.nlpsol("jump", "ipopt", {"x": raw, "f": (total + rough) / self.unit, "g": values}, options)
        return solver, ca.Function("rows", [raw], [values, total]), rows

    def _add_links(self, rows: _Rows, parts: Sequence[Any], step: Any, label: str) -> None:
        """Between nodes accelerations are linear."""
        y, v, a = parts
        step = casadi().repmat(step, y.shape[0], 1)
        rows.add((v[:, 1:] - v[:, :-1] - step / 2 * (a[:, :-1] + a[:, 1:])) * self.unit, 0.0, 0.0, f"motion in {label}")
        ahead = y[:, :-1] + step * v[:, :-1] + step**2 / 6 * (2 * a[:, :-1] + a[:, 1:])
        rows.add(y[:, 1:] - ahead, 0.0, 0.0, f"motion in {label}")

    def _add_turn(self, rows: _Rows, phase: Phase, parts: Sequence[Any], step: Any) -> None:
        """On one point gravity alone changes the angular momentum about it; the orientation by Hermite's rule."""
        model, (y, v, a) = self.model, parts
        anchor, mass, turn = phase.anchor.spots[0], model.robot.mass, model.robot.tree.turn
        (x, z), (vx, vz) = model.com_from(anchor), model.com_from(anchor, 1)
        momentum = model.momentum() + turn * mass * (x * vz - z * vx)
        outputs = [momentum, -turn * self.weight * x, -turn * self.weight * vx]
        momenta, pulls, changes = model.function("about", outputs).map(phase.intervals + 1)(y, v, a)
        ahead = _hermite(momenta, pulls, changes, step)
        rows.add((momenta[:, 1:] - ahead) / self._scales[-1], 0.0, 0.0, f"balance of moments ({phase.side})")
        rows.add(y[0, 1:] - _hermite(y[0, :], v[0, :], a[0, :], step), 0.0, 0.0, f"turn in {phase.side}")

    def _add_stance(self, rows: _Rows, phase: Phase, parts: Sequence[Any], forces: Any) -> Any:
        """Rows of a stance's nodes; a node between two phases of a side is that of the one with more contacts."""
        function, bounds = self._stance_node(phase)
        index = self.phases.index(phase)
        count = phase.intervals + 1
        values, cost = function.map(count)(*parts, forces / self.weight)
        low, high = (np.tile([[row[side]] for row in bounds], (1, count)).astype(float) for side in (0, 1))
        labels = [row[2] for row in bounds]
        released = -1 if phase.side == "takeoff" else 0
        free = [1, 2] if phase.side == "takeoff" else [-2, -3]
        flies = self.phases[index + (1 if phase.side == "takeoff" else -1)].side == "flight" if phase.side else False
        shared = (phase.side == "takeoff" and index > 0, 0), (
            phase.side == "landing" and index + 1 < len(self.phases),
            -1,
        )
        for row, label in enumerate(labels):
            if label == "release" or label.endswith(" meets"):
                low[row], high[row] = -np.inf, np.inf
                if flies or label != "release":
                    low[row, released] = high[row, released] = 0.0
            if label.endswith(" stands"):  # two nodes are left free for what the joints drift between nodes
                low[row, free], high[row, free] = -np.inf, np.inf
            for belongs, node in shared:
                if belongs:
                    low[row, node], high[row, node] = -np.inf, np.inf
        kept = [
            (row, node)
            for node in range(count)
            for row in range(len(labels))
            if np.isfinite(low[row, node]) or np.isfinite(high[row, node])
        ]
        at = [row + node * len(labels) for row, node in kept]
        picked = casadi().vec(values)[at]
        rows.values.append(picked)
        rows.low.append(np.array([low[each] for each in kept]))
        rows.high.append(np.array([high[each] for each in kept]))
        rows.labels += [f"{labels[row]} ({phase.side})" for row, _ in kept]
        return cost

    def _add_flight(self, rows: _Rows, parts: Sequence[Any], duration: Any, momentum: Any) -> Any:
        """Rows of the flight: joints, orientation, momentum, parabola, limits and heights."""
        ca, model, phase = casadi(), self.model, self.phases[self.flight]
        start, end, count = self.starts[self.flight], self.starts[self.flight + 1], phase.intervals + 1
        step = duration * ca.DM(np.diff(phase.shares)).T
        y, v, a = (each[:, start : end + 1] for each in parts)
        self._add_links(rows, [each[1:, :] for each in (y, v, a)], step, "flight")
        rows.add(y[0, 1:] - _hermite(y[0, :], v[0, :], a[0, :], step), 0.0, 0.0, "turn in flight")
        ends = []
        for index, node in ((self.flight - 1, 0), (self.flight + 1, count - 1)):
            anchor = self.phases[index].anchor
            com = model.function("com", [*model.com_from(anchor.spots[0]), *model.com_from(anchor.spots[0], 1)])
            x, z, vx, vz = com(y[:, node], v[:, node], a[:, node])
            ends.append((z + anchor.depth, vx, vz))
        (z0, vx0, vz0), (z1, vx1, vz1) = ends
        gravity, unit = model.gravity, self.unit
        rows.add((z1 - z0 - vz0 * duration + gravity * duration**2 / 2) / self.height, 0.0, 0.0, "parabola")
        rows.add((vx1 - vx0) / (gravity * unit), 0.0, 0.0, "parabola")
        rows.add((vz1 - vz0 + gravity * duration) / (gravity * unit), 0.0, 0.0, "parabola")
        shares = ca.DM(np.arange(count) / phase.intervals).T
        times = duration * shares
        heights = z0 + vz0 * times - gravity * times**2 / 2
        lifts = LIFT * np.minimum(1.0, 16 * (np.arange(count) / (count - 1) * (1 - np.arange(count) / (count - 1))) ** 2)
        function, bounds = self._flight_node()
        values, cost = function.map(count)(y, v, a, heights, ca.DM(lifts).T, ca.repmat(momentum, 1, count))
        inner = values[1:, 1:-1]
        rows.add(values[0, :], 0.0, 0.0, bounds[0][2])
        low, high = (np.tile([[row[side]] for row in bounds[1:]], (1, count - 2)) for side in (0, 1))
        first = len(rows.labels)
        rows.add(inner, low, high, "")
        rows.labels[first:] = [f"{row[2]} (flight)" for _ in range(count - 2) for row in bounds[1:]]
        return cost

    def solve(self, guess: Array) -> Solution:
        """Follow IPOPT from a guess (size,), scaled as :meth:`join` does."""
        solver, evaluate, rows = self._solver
        low, high = np.concatenate(rows.low), np.concatenate(rows.high)
        box = self._box
        answer = solver(x0=guess, lbx=box[0], ubx=box[1], lbg=low, ubg=high)
        stats = solver.stats()
        raw = np.asarray(answer["x"]).ravel()
        values, cost = evaluate(raw)
        values = np.asarray(values).ravel()
        excess = np.maximum(np.maximum(low - values, values - high), 0.0)
        at = int(excess.argmax())
        y, v, a, *rest = self.split(raw)
        return Solution(
            y=y,
            v=v,
            a=a,
            forces=tuple(rest[:-2]),
            durations=rest[-2].ravel(),
            momentum=float(rest[-1].item()),
            worst=(float(excess[at]), rows.labels[at]),
            converged=bool(stats["success"]) and float(excess[at]) < 1e-6,
            iterations=int(stats["iter_count"]),
            cost=float(cost) * (self.weight * self.height) ** 2,
            raw=raw,
        )

    def guess(self, rng: np.random.Generator | None = None) -> Array:
        """Return the generic guess; with random numbers a perturbed one.

        Joints as they stand, the base turned by a smoothstep from the takeoff's last phase to the landing's first,
        nothing else.
        """
        durations = np.array([phase.duration for phase in self.phases])
        joints = np.linspace(self.ends[0, 1:], self.ends[1, 1:], self.nodes).T
        if rng is not None:
            low, high = (np.array([phase.bounds[side] for phase in self.phases]) for side in (0, 1))
            durations = np.clip(durations * rng.uniform(0.75, 1.35, len(durations)), low, high)
            bumps = np.sin(np.pi * np.linspace(0, 1, self.nodes)[None] * rng.integers(1, 4, (self.size - 1, 1)))
            joints = joints + rng.uniform(-0.3, 0.3, (self.size - 1, 1)) * bumps
        times = np.zeros(self.nodes)
        for index, phase in enumerate(self.phases):
            times[self.starts[index] : self.starts[index + 1] + 1] = (
                times[self.starts[index]] + durations[index] * phase.shares
            )
        begin, end = times[self.starts[self.flight - 1]], times[self.starts[self.flight + 2]]
        share = np.clip((times - begin) / (end - begin), 0.0, 1.0)
        turn = self.ends[1, 0] - self.ends[0, 0]
        y = np.vstack((self.ends[0, 0] + turn * share**2 * (3 - 2 * share), joints))
        v = np.zeros_like(y)
        v[0] = turn * 6 * share * (1 - share) / (end - begin)
        forces = [np.zeros(shape) for shape in self._shapes[3 : 3 + len(self.phases)]]
        momentum = np.zeros((1, 1))
        return self.join([y, v, np.zeros_like(y), *forces, durations[:, None], momentum])


def _hermite(values: Any, rates: Any, changes: Any, step: Any) -> Any:
    """Values (1, N) a step later, of a row (1, N+1) with its first and second derivatives."""
    mean = step / 2 * (rates[:, :-1] + rates[:, 1:])
    return values[:, :-1] + mean + step**2 / 12 * (changes[:, :-1] - changes[:, 1:])


def spread(contacts: Sequence[Contact], forces: Sequence[Any]) -> list[tuple[Any, Any]]:
    """Forces of contacts shared among the feet that are coupled: points, and a part of each."""
    return [
        (spot, (force[0] / len(contact.spots), force[1] / len(contact.spots)))
        for contact, force in zip(contacts, forces, strict=True)
        for spot in contact.spots
    ]


def _cone(
    force: Any, friction: float, weight: float, name: str, *, unilateral: bool
) -> list[tuple[Any, float, float, str]]:
    """Rows of the friction cone; it holds the vertical force above zero too."""
    horizontal, vertical = force
    del unilateral
    return [
        ((friction * vertical + sign * horizontal) / weight, 0.0, np.inf, f"friction of {name}") for sign in (1.0, -1.0)
    ]
