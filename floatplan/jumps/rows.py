"""Rows of a jump's program at one node: what a stance holds, and what a flight holds, as functions of the node."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from floatplan.arrays import Array
from floatplan.jumps.contacts import Contact, Watched, ground_below, way_between
from floatplan.jumps.held import HeldJoints
from floatplan.jumps.model import Pair, PlanarModel, casadi
from floatplan.jumps.phases import Phase
from floatplan.robot.standing import Spot, heights_over_com
from floatplan.tables import POINT_FEET

Bound: TypeAlias = tuple[float, float, str]  # low, high, and what it is about
Row: TypeAlias = tuple[Any, float, float, str]  # a value, then the same
BALANCE = "balance of moments"
STANDS = "stands"
MEETS = "meets the ground"
RELEASE = "release"
PRESSED = "pressed on the ground"
LEAST_FORCE = 0.05  # [-] of the weight, vertical, at nodes where more than one contact stands
CLEAR = "clear of the ground"
EFFORT = "effort of"
ROUNDING = 1e-9  # [m]
BEYOND = 1e-4  # [-, m] its bound is what has to become a row: not the right joint where the left one is


@dataclass(frozen=True, eq=False)
class Bounds:
    """What the program holds, margins taken off.

    Attributes
    ----------
    torque, stall, slope : (motors,) N m, N m, N m s/rad, of each motor; infinite where there is none
    joint_torque : (n,) N m, of the generalised torques; infinite where those of motors say all
    velocity : (n,) rad/s
    position : (n, 2) rad
    friction : coefficient
    held : share of the efforts of joints that are held
    pressed : least vertical force over the weight, where more than one contact stands
    pitch_error : rad, by which the robot may be turned about its feet where it lands, either way
    """

    torque: Array
    joint_torque: Array
    stall: Array
    slope: Array
    velocity: Array
    position: Array
    friction: float
    held: float = 1.0
    pressed: float = LEAST_FORCE
    pitch_error: float = 0.0


@dataclass
class Rows:
    """Constraints as they are gathered: expressions with bounds, and what each is about; and functions of nodes.

    Values within -1 and 1 are shares of limits; where there is a ``factor``, they are at most that.
    """

    factor: Any = None
    values: list[Any] = field(default_factory=list)
    low: list[Array] = field(default_factory=list)
    high: list[Array] = field(default_factory=list)
    labels: list[str] = field(default_factory=list)
    calls: Calls = field(default_factory=lambda: Calls())

    def add(self, value: Any, low: float, high: float, label: str) -> None:
        """Values of any shape with the same bounds."""
        size = value.numel()
        self._append(casadi().vec(value), np.full(size, low), np.full(size, high), [label] * size)

    def add_nodes(self, values: Any, bounds: Sequence[Bound], low: Array, high: Array, side: str) -> None:
        """Rows (rows, nodes) of nodes, with bounds of that shape; those without bounds are left out."""
        nodes, index = np.nonzero((np.isfinite(low) | np.isfinite(high)).T)
        at = index + nodes * len(bounds)
        labels = [f"{bounds[row][2]} ({side})" for row in index.tolist()]
        self._append(casadi().vec(values)[at.tolist()], low[index, nodes], high[index, nodes], labels)

    def _append(self, values: Any, low: Array, high: Array, labels: list[str]) -> None:
        shares = [] if self.factor is None else np.flatnonzero((low == -1.0) & (high == 1.0)).tolist()
        if shares:
            own = values[shares]
            values[shares] = self.factor - own
            low[shares] = 0.0
            high[shares] = np.inf
            self._append(self.factor + own, low[shares], high[shares], [labels[row] for row in shares])
        self.values.append(values)
        self.low.append(low)
        self.high.append(high)
        self.labels += labels


class Calls:
    """Functions of single nodes, evaluated at many: their derivatives are taken node by node, each in one expression.

    What they return are symbols, in which the rest of a program is written; arguments are affine in its variables.
    """

    def __init__(self) -> None:
        self._found: list[tuple[Any, Any, Any]] = []  # function of one vector, its arguments (size, nodes), symbols

    def __call__(self, function: Any, *arguments: Any) -> list[Any]:
        """Outputs (size, nodes) for arguments (size, nodes)."""
        ca = casadi()
        ways = [function.size1_in(k) for k in range(function.n_in())]
        point = ca.SX.sym("point", sum(ways))
        outputs = function.call(ca.vertsplit(point, np.cumsum([0, *ways]).tolist()))
        one = ca.Function("one", [point], [ca.vertcat(*outputs)], {"cse": True})
        points = ca.vertcat(*arguments)
        symbols = ca.MX.sym("called", one.size1_out(0), points.shape[1])
        self._found.append((one, points, symbols))
        return list(ca.vertsplit(symbols, np.cumsum([0, *[each.shape[0] for each in outputs]]).tolist()))

    def solver(self, raw: Any, goal: Any, values: Any, settings: dict[str, Any], look: Any) -> tuple[Any, Any]:
        """IPOPT's solver of a program, which a ``look`` at its iterates may stop, and a function raw -> values."""
        ca = casadi()
        given = [raw, *[symbols for _, _, symbols in self._found]]
        both = ca.vertcat(*[ca.vec(each) for each in given])
        lam_f = ca.MX.sym("lam_f")
        lam_g = ca.MX.sym("lam_g", values.shape[0])
        bends = ca.hessian(lam_f * goal + ca.dot(lam_g, values), both)
        now = [raw, *[one.map(points.shape[1])(points) for one, points, _ in self._found]]
        found = ca.Function("found", given, [goal, values])(*now)
        slope = ca.Function("slope", given, [ca.jacobian(values, both)])(*now)
        bend, weights = ca.Function("bend", [*given, lam_f, lam_g], bends)(*now, lam_f, lam_g)
        sizes = np.cumsum([0, *[each.numel() for each in given]]).tolist()
        curved = 0.0
        chain = [ca.MX.eye(raw.shape[0])]
        for called, weight in zip(self._found, ca.vertsplit(weights, sizes)[1:], strict=True):
            first, second = self._derivatives(raw, *called[:2], weight)
            curved += second
            chain.append(first)
        through = ca.vertcat(*chain)
        none = ca.MX.sym("p", 0)
        full = ca.mtimes(through.T, ca.mtimes(bend, through)) + curved
        options = {
            "jac_g": ca.Function("jac_g", [raw, none], [found[1], ca.mtimes(slope, through)]),
            "hess_lag": ca.Function("hess_lag", [raw, none, lam_f, lam_g], [ca.triu(full)]),
            "print_time": False,
            "ipopt": settings,
            "iteration_callback": look,
        }
        solver = ca.nlpsol("jump", "ipopt", {"x": raw, "f": found[0], "g": found[1]}, options)
        return solver, ca.Function("values", [raw], [found[1]])

    def _derivatives(self, raw: Any, one: Any, points: Any, weights: Any) -> tuple[Any, Any]:
        """First derivatives of a function's outputs at all nodes by the variables, and the second, weighted, summed."""
        ca = casadi()
        count = points.shape[1]
        point = ca.SX.sym("point", one.size1_in(0))
        weight = ca.SX.sym("weight", one.size1_out(0))
        slope = ca.Function("slope", [point], [ca.jacobian(one(point), point)])
        bend = ca.Function("bend", [point, weight], [ca.hessian(ca.dot(weight, one(point)), point)[0]])
        linear = ca.MX(ca.sparsify(ca.evalf(ca.jacobian(ca.vec(points), raw))))
        wides = slope.map(count)(points), bend.map(count)(points, ca.reshape(weights, -1, count))
        first, second = (ca.mtimes(ca.diagcat(*ca.horzsplit(wide, points.shape[0])), linear) for wide in wides)
        return first, ca.mtimes(linear.T, second)


class NodeRows:
    """Rows of single nodes, in units of the robot: its weight, its standing height, and the time of a fall by it.

    Parameters
    ----------
    model : PlanarModel
    phases : of the jump
    watched : what stays above the ground
    bounds : Bounds
    ends : (2, n+1) y where the robot stands before and after
    known : contacts that stand, and y (n+1,), of postures in which what is watched may be nearer to the ground
        Feet that have left, or are to come, may then be as far in the ground as other parts of feet.
    held : joints that are held, whose torques are rows; CLEAR, where all that is watched is in stances too
    """

    held: tuple[str, ...] = ()

    def __init__(
        self,
        model: PlanarModel,
        phases: Sequence[Phase],
        watched: Watched,
        bounds: Bounds,
        ends: Array,
        known: Sequence[tuple[Contact, Array]] = (),
    ) -> None:
        self.model = model
        self.phases = tuple(phases)
        self.watched = watched
        self.bounds = bounds
        self.ends = ends
        self.starts = np.concatenate(([0], np.cumsum([phase.intervals for phase in self.phases])))  # first nodes
        self.flies = next(index for index, phase in enumerate(self.phases) if phase.side == "flight")
        self._holding = HeldJoints(model)
        self._functions: dict[tuple[Contact, ...], Any] = {}
        self.weight = model.robot.mass * model.gravity  # [N]
        end = 0 if self.phases[0].contacts else -1
        self.height = -ground_below(model.robot, self.phases[end].anchor, ends[end])  # [m] of the centre of mass
        self.unit = float(np.sqrt(self.height / model.gravity))  # [s]
        self.momentum = self.weight * self.height * self.unit  # [kg m^2/s]
        spots = [*watched.spots, *(contact.spots[0] for contact in self.feet)]
        dips = POINT_FEET / 2 if known else 0.0
        self.least = np.append(watched.least, [contact.depth - dips for contact in self.feet])  # [m] heights of those
        for contact, y in known:
            heights = heights_over_com(model.robot, [contact.spots[0], *spots], y).imag
            self.least = np.minimum(self.least, heights[1:] - heights[0] + contact.depth - ROUNDING)

    def stance(self, phase: Phase) -> tuple[Any, list[Bound]]:
        """Function of a stance's node, and its rows' bounds.

        It is (y, v, a, forces over weight, drifts) -> (rows, torques, load), the torques of :meth:`_motor_torques`. The
        load is the ground's vertical force on all contacts over the weight.
        The drifts are accelerations, (c,), that a chain's closures keep, so that it is closed at both ends.
        """
        ca = casadi()
        model = self.model
        friction = self.bounds.friction
        forces = ca.SX.sym("forces", 2 * len(phase.others))
        drifts = ca.SX.sym("drifts", drifting(phase))
        anchor = phase.anchor.spots[0]
        own, pairs = balanced(model, phase, forces * self.weight)
        moments = model.moments(anchor, spread(phase.contacts, [own, *pairs]))
        rows: list[Row] = [(ca.sum1(moments) / (self.weight * self.height), 0.0, 0.0, BALANCE)]
        rows += self._closures(phase, drifts)
        heels = sum(pair[1] for contact, pair in zip(phase.others, pairs, strict=True) if contact.vertical)
        for contact, pair in zip(phase.contacts, [(own[0], own[1] + heels), *pairs], strict=True):
            for sign in (1.0, -1.0) if not contact.vertical else ():
                held = (friction * pair[1] + sign * pair[0]) / self.weight
                rows.append((held, 0.0, np.inf, f"friction of {contact.name}"))
        rows += [(own[k] / self.weight, 0.0, 0.0, RELEASE) for k in (0, 1)]
        if phase.others:  # else it may pull a little between nodes
            rows.append((own[1] / self.weight, self.bounds.pressed, np.inf, PRESSED))
        rows += [*self._torque_rows(moments), *self._held_rows(phase.contacts, [own, *pairs])]
        ground = -phase.anchor.depth
        near = np.flatnonzero(self.watched.low | (CLEAR in self.held)).tolist()
        if near:
            heights = model.places(model.weights([self.watched.spots[at] for at in near], anchor))[1]
            low = zip(casadi().vertsplit(heights), self.least[near].tolist(), strict=True)
            rows += [(height - ground, least, np.inf, CLEAR) for height, least in low]
        standing = [contact.name for contact in phase.contacts]
        for contact, least in zip(self.feet, self.least[len(self.watched.spots) :].tolist(), strict=True):
            if contact.name not in standing:
                height = model.places(model.weights(contact.spots[:1], anchor))[1]
                rows.append((height - ground, least, np.inf, f"{contact.name} above the ground"))
        output = ca.vertcat(*[row[0] for row in rows])
        load = model.com_from(anchor, 2)[1] / model.gravity + 1.0
        function = model.function("stance", [output, self._motor_torques(moments), load], forces, drifts)
        return function, [row[1:] for row in rows]

    def turned(self, phase: Phase) -> tuple[Any, Array]:
        """Heights of what is watched where the robot is turned about a foot, a function of (y, v, a); the least, m.

        The robot is turned by the pitch error either way, as a rigid body, until a foot is on the ground. No foot is
        lower than that, so that it is enough to look at one: parts of a leg are measured from its own foot, others from
        what stands. Of several, as heel and toe, it is the last one on the side to which it turns. A point at (x, z)
        from a foot's spot is at ``z cos e + x sin e`` above it then, for errors e of both signs.
        """
        model = self.model
        error = self.bounds.pitch_error
        end = self.ends[0 if phase.side == "takeoff" else 1]
        spots: list[Spot] = []
        least: list[float] = []
        for spot, height in zip(self.watched.spots, self.watched.touchdown.tolist(), strict=True):
            if np.isfinite(height):
                spots.append(spot)
                least.append(height)
        heights = []
        for spot in spots:
            feet = self._feet_of_leg(spot.body) or phase.contacts
            along = heights_over_com(model.robot, [contact.spots[0] for contact in feet], end).real
            for pivot, sign in ((int(along.argmin()), 1.0), (int(along.argmax()), -1.0)):
                contact = feet[pivot]
                x, z = model.places(model.weights([spot], contact.spots[0]._replace(radius=0.0)))
                heights.append(z * np.cos(error) + sign * x * np.sin(error) + contact.depth)
        return model.function("turned", [casadi().vertcat(*heights)]), np.repeat(least, 2)

    def _feet_of_leg(self, body: int) -> list[Contact]:
        """Contacts of the legs of which a body is a part; none of the base, which no leg has for its own."""
        parent = self.model.robot.tree.parent
        found = []
        for contact in self.feet:
            for spot in contact.spots:
                above = spot.body
                while above > 0 and above != body:
                    above = int(parent[above])
                if above == body > 0 and contact not in found:
                    found.append(contact)
        return found

    def _closures(self, phase: Phase, drifts: Any) -> list[Row]:
        """Accelerations of the contacts beside the anchor, and their places and rates; of a heel the vertical ones."""
        anchor = phase.anchor.spots[0]
        model = self.model
        unit = self.unit
        stand: list[Row] = []
        meet: list[Row] = []
        for contact in phase.others:
            weights = model.weights(contact.spots[:1], anchor)
            place, rate, acceleration = (model.places(weights, order) for order in range(3))
            home = way_between(model.robot, anchor, contact.spots[0], self.ends[0 if phase.side == "takeoff" else 1])
            for k in axes_of(contact):
                drift = 0.0 if contact.vertical else drifts[len(meet) // 2]
                stand.append((acceleration[k] * unit**2 - drift, 0.0, 0.0, f"{contact.name} {STANDS}"))
                if contact.vertical:  # a level sole stays so where it does not accelerate
                    continue
                meet += [(each, 0.0, 0.0, f"{contact.name} {MEETS}") for each in (place[k] - home[k], rate[k] * unit)]
        return [*stand, *meet]

    @cached_property
    def feet(self) -> list[Contact]:
        """All contacts, each once."""
        return list({each.name: each for phase in self.phases for each in phase.contacts}.values())

    @cached_property
    def _distinct(self) -> list[int]:
        """Motors whose torques are not always those of one before."""
        turns = self.model.robot.tree.motor_turns
        tree = self.model.robot.tree
        seen: list[tuple[int, Any]] = []
        for motor in range(turns.shape[1]):
            bodies = np.flatnonzero(turns[:, motor])
            own = (tree.mass, tree.center, tree.inertia, tree.armature)
            key = np.array([[*(each[b] for each in own), *tree.turns[b]] for b in bodies])
            if not any(k.shape == key.shape and np.allclose(k, key, rtol=1e-6, atol=1e-6) for _, k in seen):
                seen.append((motor, key))
        return [motor for motor, _ in seen]

    def _torque_rows(self, moments: Any) -> list[Row]:
        """Torques over their limits; with the torque that is lost with the rate over the stall torque."""
        bounds = self.bounds
        robot = self.model.robot
        torques = self.model.motor_torques(moments)
        rates = casadi().mtimes(self.model._constant(robot.motor_ratios), self.model.v[1:])
        generalised = casadi().mtimes(self.model._constant(robot.tree.turns.T), moments)
        shares = generalised / bounds.joint_torque
        limited = np.flatnonzero(np.isfinite(bounds.joint_torque))
        rows = [(shares[joint], -1.0, 1.0, f"torque of {robot.joints[joint]}") for joint in limited.tolist()]
        for motor in self._distinct:
            name = robot.motors[motor]
            torque = torques[motor]
            if np.isfinite(bounds.torque[motor]):
                rows.append((torque / bounds.torque[motor], -1.0, 1.0, f"torque of {name}"))
            if np.isfinite(bounds.stall[motor]):
                for sign in (1.0, -1.0):
                    value = (torque + sign * bounds.slope[motor] * rates[motor]) / bounds.stall[motor]
                    rows.append((value, -1.0, 1.0, f"torque-speed curve of {name}"))
        return rows

    def _held_rows(self, contacts: Sequence[Contact], forces: Sequence[Pair]) -> list[Row]:
        """Torques of joints that are held over their efforts."""
        names = [name for name in self.held if name != CLEAR]
        shares = self._holding.shares(names, contacts, forces) / self.bounds.held
        return [(shares[row], -1.0, 1.0, f"{EFFORT} {name}, held") for row, name in enumerate(names)]

    def strained(self, motion: Sequence[Array], forces: Sequence[Array], factor: float) -> tuple[str, ...]:
        """What is beyond its bounds at nodes, but no row yet: torques of held joints, of left and right the one; CLEAR.

        Parameters
        ----------
        motion : y, v, a (n+1, K+1)
        forces : of each phase (2 others, nodes) N
        factor : on the bounds of torques
        """
        names = list(self._holding.efforts)
        spots = self.watched.spots
        least = self.least[: len(spots)] - BEYOND
        found = dict[tuple[float, ...], str]()
        shares = [np.zeros((len(names), 0))]
        for phase, start, given in zip(self.phases, self.starts, forces, strict=False):
            nodes = [part[:, start : start + phase.intervals + 1] for part in motion]
            if phase.contacts and CLEAR not in self.held:
                heights = heights_over_com(self.model.robot, [*spots, phase.anchor.spots[0]], nodes[0]).imag
                if (heights[:, :-1] - heights[:, -1:] + phase.anchor.depth < least).any():
                    found[()] = CLEAR
            if names:
                shares.append(np.abs(np.asarray(self._bearing(phase)(*nodes, given))))
        for name, row in zip(names, np.concatenate(shares, axis=1), strict=True):
            if name not in self.held and row.max() > factor * self.bounds.held + BEYOND:
                found.setdefault(tuple(row.round(3).tolist()), name)
        return tuple(found.values())

    def _bearing(self, phase: Phase) -> Any:
        """Function (y, v, a, forces) -> torques over efforts of all held joints; built once for its contacts."""
        if phase.contacts not in self._functions:
            forces = casadi().SX.sym("forces", 2 * len(phase.others))
            acting: list[Pair] = []
            if phase.contacts:
                own, pairs = balanced(self.model, phase, forces)
                acting = [own, *pairs]
            shares = self._holding.shares(list(self._holding.efforts), phase.contacts, acting)
            self._functions[phase.contacts] = self.model.function("held", [shares], forces)
        return self._functions[phase.contacts]

    def _motor_torques(self, moments: Any) -> Any:
        """Torques (motors,) over the weight and the height, of which the sum of squares is the cost.

        Squared outside of the node's function, in which second derivatives are then those of torques alone.
        """
        return self.model.motor_torques(moments) / (self.weight * self.height)

    def flight(self) -> tuple[Any, list[Bound]]:
        """Function (y, v, a) -> (rows, torques) of the flight's nodes: h first, and heights over the centre of mass."""
        ca = casadi()
        model = self.model
        moments = model.moments(None, [])
        rows: list[Row] = [
            (model.momentum() / self.momentum, 0.0, 0.0, "angular momentum in flight"),
            (ca.sum1(moments) / (self.weight * self.height), 0.0, 0.0, "angular momentum in flight"),
            *self._torque_rows(moments),
            *self._held_rows((), []),
        ]
        spots = [*self.watched.spots, *(contact.spots[0] for contact in self.feet)]
        _, z = model.places(model.weights(spots))
        labels = [CLEAR] * len(self.watched.spots) + [f"{contact.name} above the ground" for contact in self.feet]
        rows += [(z[at], float(self.least[at]), np.inf, label) for at, label in enumerate(labels)]
        output = ca.vertcat(*[row[0] for row in rows])
        function = model.function("flight", [output, self._motor_torques(moments)])
        return function, [row[1:] for row in rows]


def hermite_step(values: Any, rates: Any, changes: Any, step: Any) -> Any:
    """Values (1, N) a step later, of a row (1, N+1) with its first and second derivatives."""
    mean = step / 2 * (rates[:, :-1] + rates[:, 1:])
    return values[:, :-1] + mean + step**2 / 12 * (changes[:, :-1] - changes[:, 1:])


def axes_of(contact: Contact) -> tuple[int, ...]:
    """Which directions a contact beside the anchor holds: both, or of a heel the vertical one."""
    return (1,) if contact.vertical else (0, 1)


def drifting(phase: Phase) -> int:
    """How many conditions of contacts beside the anchor drift: not those of heels, which are linear in y."""
    return sum(len(axes_of(contact)) for contact in phase.others if not contact.vertical)


def balanced(model: PlanarModel, phase: Phase, forces: Any) -> tuple[Pair, list[Pair]]:
    """The anchor's force, by the balance of forces, and those of the others (2 others,), as pairs, N."""
    pairs = [(forces[2 * k], forces[2 * k + 1]) for k in range(len(phase.others))]
    x, z = model.com_from(phase.anchor.spots[0], 2)
    mass = model.robot.mass
    horizontal = mass * x
    vertical = mass * (z + model.gravity)
    for pair in pairs:
        horizontal = horizontal - pair[0]
        vertical = vertical - pair[1]
    return (horizontal, vertical), pairs


def spread(contacts: Sequence[Contact], forces: Sequence[Pair]) -> list[tuple[Spot, Pair]]:
    """Forces of contacts shared among the feet that are coupled: points, and a part of each."""
    return [
        (spot, (force[0] / len(contact.spots), force[1] / len(contact.spots)))
        for contact, force in zip(contacts, forces, strict=True)
        for spot in contact.spots
    ]
