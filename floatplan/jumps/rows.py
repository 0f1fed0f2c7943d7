"""Rows of a jump's program at one node: what a stance requires, and what a flight requires, as functions of the node.

A row is an expression with bounds and a label. :class:`NodeRows` writes the functions of single nodes,
:class:`NodeFunctions` evaluates them at many, and :class:`Rows` collects what a program consists of.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from floatplan.arrays import Array, BoolArray, ComplexArray
from floatplan.jumps.contacts import (
    ClearancePoints,
    GroundContact,
    contact_depths,
    contact_positions,
    displacement,
    ground_below,
)
from floatplan.jumps.locked_joints import LockedJoints
from floatplan.jumps.model import Pair, PlanarModel, anchor_force, casadi, spread
from floatplan.jumps.phases import Phase, axes_of, closing_count, indices_of_flights
from floatplan.robot.standing import Spot, positions_from_com
from floatplan.tables import POINT_FEET

# Kinds of rows that the program treats in ways of their own, at some nodes or in its objective. A share of a limit is
# between -1 and 1, or at most the factor where one is minimised. Points and feet are above the ground. What stands does
# not accelerate, and meets the ground where it stands; its force balances moments, is inside the cone, presses, and is
# released at the seam.
Kind: TypeAlias = Literal["share", "point", "foot", "stands", "meets", "balance", "friction", "least_force", "release"]


class Bound(NamedTuple):
    """Bounds of a row, what it is about, in words that messages repeat, and its kind if it has one."""

    low: float
    high: float
    label: str
    kind: Kind | None = None


Row: TypeAlias = tuple[Any, Bound]  # a value, and its bounds


class Label:
    """What several kinds of rows are about, in words that messages repeat."""

    BALANCE = "balance of moments"
    CLEAR = "clear of the ground"


@dataclass(frozen=True, eq=False)
class NodeLimits:
    """What the program requires, margins taken off.

    Attributes
    ----------
    torque, stall, slope : (motors,) N m, N m, N m s/rad, of each motor; infinite where there is none
    joint_torque : (n,) N m, of the generalised torques; infinite where those of motors say all
    velocity : (n,) rad/s
    position : (n, 2) rad
    friction : coefficient
    torque_margin : share of torque limits that the program takes of what the request allows; of the efforts of locked
        joints too, which it allows all of
    least_force : vertical, over the weight, on each contact that stands, where several do
    pitch_error : rad, by which the robot may be rotated about its feet where it lands, either way
    """

    torque: Array
    joint_torque: Array
    stall: Array
    slope: Array
    velocity: Array
    position: Array
    friction: float
    torque_margin: float
    least_force: float
    pitch_error: float


@dataclass(frozen=True)
class ExtraRows:
    """Rows that programs have only where a solution has violated them.

    Attributes
    ----------
    locked_joints : whose torques have rows
    all_points : whether all points have rows in stances too, and not only those that are low where the robot stands
    """

    locked_joints: tuple[str, ...] = ()
    all_points: bool = False

    def __or__(self, other: ExtraRows) -> ExtraRows:
        """Those of both."""
        return ExtraRows((*self.locked_joints, *other.locked_joints), self.all_points or other.all_points)


@dataclass
class Rows:
    """Constraints as they are collected: expressions with bounds and labels; and functions of nodes.

    Where there is a ``factor``, shares of limits are at most that. Functions of single nodes are evaluated by
    ``at_nodes``.
    """

    factor: Any = None
    values: list[Any] = field(default_factory=list)
    low: list[Array] = field(default_factory=list)
    high: list[Array] = field(default_factory=list)
    labels: list[str] = field(default_factory=list)
    at_nodes: NodeFunctions = field(default_factory=lambda: NodeFunctions())

    def add(self, value: Any, low: float, high: float, label: str) -> None:
        """Values of any shape with the same bounds."""
        size = value.numel()
        no_share = np.zeros(size, bool)
        self._append(casadi().vec(value), np.full(size, low), np.full(size, high), [label] * size, no_share)

    def add_nodes(self, values: Any, bounds: Sequence[Bound], low: Array, high: Array, side: str) -> None:
        """Rows (rows, nodes) of nodes, with bounds of that shape; those without bounds are left out."""
        nodes, index = np.nonzero((np.isfinite(low) | np.isfinite(high)).T)
        at = index + nodes * len(bounds)
        labels = [f"{bounds[row].label} ({side})" for row in index.tolist()]
        is_share = np.array([bound.kind == "share" for bound in bounds], bool)[index]
        self._append(casadi().vec(values)[at.tolist()], low[index, nodes], high[index, nodes], labels, is_share)

    def _append(self, values: Any, low: Array, high: Array, labels: list[str], is_share: BoolArray) -> None:
        shares = [] if self.factor is None else np.flatnonzero(is_share).tolist()
        if shares:  # -factor <= share <= factor, as two rows
            limited = values[shares]
            values[shares] = self.factor - limited
            low[shares] = 0.0
            high[shares] = np.inf
            of_shares = [labels[row] for row in shares]
            self._append(self.factor + limited, low[shares], high[shares], of_shares, np.zeros(len(shares), bool))
        self.values.append(values)
        self.low.append(low)
        self.high.append(high)
        self.labels += labels


class CompiledProgram(NamedTuple):
    """IPOPT's solver, a function of the variables for all rows, and the rows; the callback, which CasADi does not own.

    Attributes
    ----------
    solver, evaluate : CasADi's
    rows : Rows
    callback : as of :func:`floatplan.jumps.locked_joints.stop_when_overloaded`
    """

    solver: Any
    evaluate: Any
    rows: Rows
    callback: Any


@dataclass(frozen=True)
class _Call:
    """A function of one vector, its arguments (size, nodes), and symbols (outputs, nodes) of what it returns."""

    function: Any
    points: Any
    symbols: Any


class NodeFunctions:
    """Functions of single nodes, evaluated at many: their derivatives are taken node by node, each in one expression.

    What they return are symbols, in which the rest of a program is written; arguments are affine in its variables.
    """

    def __init__(self) -> None:
        self._calls: list[_Call] = []

    def __call__(self, function: Any, *arguments: Any) -> list[Any]:
        """Outputs (size, nodes) for arguments (size, nodes)."""
        ca = casadi()
        sizes = [function.size1_in(k) for k in range(function.n_in())]
        point = ca.SX.sym("point", sum(sizes))
        outputs = function.call(ca.vertsplit(point, np.cumsum([0, *sizes]).tolist()))
        of_point = ca.Function("of_point", [point], [ca.vertcat(*outputs)], {"cse": True})
        points = ca.vertcat(*arguments)
        symbols = ca.MX.sym("called", of_point.size1_out(0), points.shape[1])
        self._calls.append(_Call(of_point, points, symbols))
        output_sizes = [output.shape[0] for output in outputs]
        return list(ca.vertsplit(symbols, np.cumsum([0, *output_sizes]).tolist()))

    def solver(self, raw: Any, cost: Any, values: Any, settings: dict[str, Any], callback: Any) -> tuple[Any, Any]:
        """IPOPT's solver of a program, whose iterates a ``callback`` may stop, and a function raw -> values.

        The program is written in its variables and in the symbols of the calls. Its derivatives are those by both,
        times those of the symbols by the variables.
        """
        ca = casadi()
        symbols = [raw]
        outputs = [raw]
        for call in self._calls:
            symbols.append(call.symbols)
            outputs.append(call.function.map(call.points.shape[1])(call.points))
        all_symbols = ca.vertcat(*[ca.vec(symbol) for symbol in symbols])
        lam_f = ca.MX.sym("lam_f")
        lam_g = ca.MX.sym("lam_g", values.shape[0])
        of_symbols = ca.hessian(lam_f * cost + ca.dot(lam_g, values), all_symbols)
        full_cost, full_values = ca.Function("program", symbols, [cost, values])(*outputs)
        jacobian = ca.Function("jacobian", symbols, [ca.jacobian(values, all_symbols)])(*outputs)
        hessian, gradient = ca.Function("hessian", [*symbols, lam_f, lam_g], of_symbols)(*outputs, lam_f, lam_g)
        sizes = np.cumsum([0, *[symbol.numel() for symbol in symbols]]).tolist()
        curvature = 0.0  # of the functions of nodes, weighted by the program's gradient by their symbols
        chain = [ca.MX.eye(raw.shape[0])]
        for call, weight in zip(self._calls, ca.vertsplit(gradient, sizes)[1:], strict=True):
            first, second = self._derivatives(raw, call, weight)
            curvature += second
            chain.append(first)
        by_variables = ca.vertcat(*chain)
        none = ca.MX.sym("p", 0)
        full_hessian = ca.mtimes(by_variables.T, ca.mtimes(hessian, by_variables)) + curvature
        options = {
            "jac_g": ca.Function("jac_g", [raw, none], [full_values, ca.mtimes(jacobian, by_variables)]),
            "hess_lag": ca.Function("hess_lag", [raw, none, lam_f, lam_g], [ca.triu(full_hessian)]),
            "print_time": False,
            "ipopt": settings,
            "iteration_callback": callback,
        }
        solver = ca.nlpsol("jump", "ipopt", {"x": raw, "f": full_cost, "g": full_values}, options)
        return solver, ca.Function("values", [raw], [full_values])

    def _derivatives(self, raw: Any, call: _Call, weights: Any) -> tuple[Any, Any]:
        """First derivatives of a function's outputs at all nodes by the variables, and the second, weighted, summed."""
        ca = casadi()
        size, count = call.points.shape
        point = ca.SX.sym("point", call.function.size1_in(0))
        weight = ca.SX.sym("weight", call.function.size1_out(0))
        output = call.function(point)
        jacobian = ca.Function("jacobian", [point], [ca.jacobian(output, point)])
        hessian = ca.Function("hessian", [point, weight], [ca.hessian(ca.dot(weight, output), point)[0]])
        linear = ca.MX(ca.sparsify(ca.evalf(ca.jacobian(ca.vec(call.points), raw))))
        jacobians = jacobian.map(count)(call.points)
        hessians = hessian.map(count)(call.points, ca.reshape(weights, -1, count))
        first = ca.mtimes(ca.diagcat(*ca.horzsplit(jacobians, size)), linear)
        second = ca.mtimes(ca.diagcat(*ca.horzsplit(hessians, size)), linear)
        return first, ca.mtimes(linear.T, second)


class NodeRows:
    """Rows of single nodes, in units of the robot: its weight, its standing height, and the time of a fall by it.

    Parameters
    ----------
    model : PlanarModel
    phases : of the jump
    points : that stay above the ground
    limits : NodeLimits
    ends : (flights + 1, n+1) rad, y where the robot stands before each flight and after the last
    low_postures : contacts that stand, and y (n+1,), of postures in which points may be nearer to the ground
        Feet that have left, or are to come, may then be as far in the ground as other corners of feet.

    Attributes
    ----------
    model, phases, points, limits, ends : as passed
    first_nodes : (phases + 1,) number of each phase's first node, and of the last node
    flights : indices of the flights among the phases
    weight, height : N, and of the centre of mass over the ground, where the robot stands, m
    time_unit, momentum_unit : sqrt(height / g), s, and weight times height times that, kg m^2/s
    least_heights : (points + feet,) m, of points over the ground, then of feet in the air
    extra : rows in addition to those that all programs have; ``JumpProgram.extended`` sets it in a copy
    """

    extra = ExtraRows()

    def __init__(
        self,
        model: PlanarModel,
        phases: Sequence[Phase],
        points: ClearancePoints,
        limits: NodeLimits,
        ends: Array,
        low_postures: Sequence[tuple[GroundContact, Array]] = (),
    ) -> None:
        self.model = model
        self.phases = tuple(phases)
        self.points = points
        self.limits = limits
        self.ends = ends
        self.first_nodes = np.concatenate(([0], np.cumsum([phase.intervals for phase in self.phases])))
        self.flights = indices_of_flights(self.phases)
        self._locked = LockedJoints(model)
        self._functions: dict[tuple[GroundContact, ...], Any] = {}
        self.weight = model.robot.mass * model.gravity  # [N]
        end = 0 if self.phases[0].contacts else -1
        self.height = -ground_below(model.robot, self.phases[end].anchor, ends[end])  # [m] of the centre of mass
        self.time_unit = float(np.sqrt(self.height / model.gravity))  # [s]
        self.momentum_unit = self.weight * self.height * self.time_unit  # [kg m^2/s]
        dip = POINT_FEET / 2 if low_postures else 0.0
        self.least_heights = np.append(points.least, contact_depths(self.feet) - dip)  # [m] of the points, then of feet
        rounding = 1e-9  # [m]
        for contact, y in low_postures:
            heights = positions_from_com(model.robot, [contact.spots[0], *self._spots], y).imag
            over_ground = heights[1:] - heights[0] + contact.depth
            self.least_heights = np.minimum(self.least_heights, over_ground - rounding)

    @cached_property
    def feet(self) -> list[GroundContact]:
        """All contacts, each once."""
        feet: dict[str, GroundContact] = {}
        for phase in self.phases:
            for contact in phase.contacts:
                feet[contact.name] = contact
        return list(feet.values())

    def standing(self, phase: Phase) -> Array:
        """Posture y (n+1,) rad in which the robot stands with the feet where a stance has them."""
        posture: Array = self.ends[phase.flight_number + (phase.side == "landing")]
        return posture

    @property
    def _spots(self) -> list[Spot]:
        """The points that stay above the ground, then the feet."""
        return [*self.points.spots, *(contact.spots[0] for contact in self.feet)]

    def stance(self, phase: Phase) -> tuple[Any, list[Bound]]:
        """Function of a stance's node, and its rows' bounds.

        It is (y, v, a, forces over weight, closing accelerations) -> (rows, torques, load), the torques of
        :meth:`_motor_torques`. The load is the ground's vertical force on all contacts over the weight. The closing
        accelerations, (c,) over g, are those of feet that stand, so that their chain is closed at both ends.
        """
        ca = casadi()
        model = self.model
        forces = ca.SX.sym("forces", 2 * len(phase.others))
        closing_accelerations = ca.SX.sym("closing_accelerations", closing_count(phase))
        anchor = phase.anchor.spots[0]
        own, pairs = anchor_force(model, phase, forces * self.weight)
        moments = model.moments(anchor, spread(phase.contacts, [own, *pairs]))
        rows: list[Row] = [(ca.sum1(moments) / (self.weight * self.height), Bound(0.0, 0.0, Label.BALANCE, "balance"))]
        rows += self._closures(phase, closing_accelerations)
        rows += self._friction_rows(phase, own, pairs)
        for component in own:
            rows.append((component / self.weight, Bound(0.0, 0.0, "release", "release")))
        if phase.others:  # on one point the friction cone already forbids pulling
            least = Bound(self.limits.least_force, np.inf, "pressed on the ground", "least_force")
            rows.append((own[1] / self.weight, least))
        rows += [*self._torque_rows(moments), *self._locked_rows(phase.contacts, [own, *pairs])]
        rows += self._height_rows(phase)
        output, bounds = _stacked(rows)
        load = model.com_from(anchor, 2)[1] / model.gravity + 1.0
        function = model.function("stance", [output, self._motor_torques(moments), load], forces, closing_accelerations)
        return function, bounds

    def _friction_rows(self, phase: Phase, own: Pair, pairs: Sequence[Pair]) -> list[Row]:
        """Both sides of the friction cone of each contact; a toe takes the load of its heel."""
        heels = sum(pair[1] for contact, pair in zip(phase.others, pairs, strict=True) if contact.vertical)
        rows: list[Row] = []
        for contact, (horizontal, vertical) in zip(phase.contacts, [(own[0], own[1] + heels), *pairs], strict=True):
            if contact.vertical:
                continue
            for sign in (1.0, -1.0):
                margin = (self.limits.friction * vertical + sign * horizontal) / self.weight
                rows.append((margin, Bound(0.0, np.inf, f"friction of {contact.name}", "friction")))
        return rows

    def _height_rows(self, phase: Phase) -> list[Row]:
        """Heights over the ground of a stance's points that may come near it, and of feet that do not stand."""
        model = self.model
        anchor = phase.anchor.spots[0]
        ground = -phase.anchor.depth
        rows: list[Row] = []
        near = np.flatnonzero(self.points.low | self.extra.all_points).tolist()
        if near:
            heights = model.positions(model.weights([self.points.spots[at] for at in near], anchor))[1]
            for height, least in zip(casadi().vertsplit(heights), self.least_heights[near].tolist(), strict=True):
                rows.append((height - ground, Bound(least, np.inf, Label.CLEAR, "point")))
        standing = [contact.name for contact in phase.contacts]
        for contact, least in zip(self.feet, self.least_heights[len(self.points.spots) :].tolist(), strict=True):
            if contact.name not in standing:
                height = model.positions(model.weights(contact.spots[:1], anchor))[1]
                rows.append((height - ground, Bound(least, np.inf, f"{contact.name} above the ground", "foot")))
        return rows

    def rotated_heights(self, phase: Phase) -> tuple[Any, Array]:
        """Heights of points where the robot is rotated about a foot, a function of (y, v, a); and the least, m.

        The robot is rotated by the pitch error either way, as a rigid body, until a foot is on the ground. No foot is
        lower than that, so that it is enough to look at one: points of a leg are measured from its own foot, others
        from what stands. Of several, as heel and toe, it is the last one on the side to which it rotates. A point at
        (x, z) from a foot's spot is at ``z cos e + x sin e`` above it then, for errors e of both signs.
        """
        model = self.model
        error = self.limits.pitch_error
        end = self.standing(phase)
        least: list[float] = []
        heights = []
        for spot, least_height in zip(self.points.spots, self.points.touchdown.tolist(), strict=True):
            if not np.isfinite(least_height):
                continue
            feet = self._feet_of_leg(spot.body) or phase.contacts
            along = contact_positions(model.robot, feet, end).real
            for pivot, sign in ((int(along.argmin()), 1.0), (int(along.argmax()), -1.0)):
                contact = feet[pivot]
                x, z = model.positions(model.weights([spot], contact.spots[0]._replace(radius=0.0)))
                heights.append(z * np.cos(error) + sign * x * np.sin(error) + contact.depth)
                least.append(least_height)
        return model.function("rotated_heights", [casadi().vertcat(*heights)]), np.array(least)

    def _feet_of_leg(self, body: int) -> list[GroundContact]:
        """Contacts of the legs to which a body belongs; none for the base, which belongs to no leg."""
        parent = self.model.robot.tree.parent
        feet = []
        for contact in self.feet:
            for spot in contact.spots:
                above = spot.body
                while above > 0 and above != body:
                    above = int(parent[above])
                if above == body > 0 and contact not in feet:
                    feet.append(contact)
        return feet

    def _closures(self, phase: Phase, closing_accelerations: Any) -> list[Row]:
        """Accelerations of the contacts but the anchor, and their positions and rates; of a heel the vertical ones."""
        anchor = phase.anchor.spots[0]
        model = self.model
        unit = self.time_unit
        end = self.standing(phase)
        stand: list[Row] = []
        meet: list[Row] = []
        for contact in phase.others:
            spot = contact.spots[0]
            weights = model.weights([spot], anchor)
            position, rate, acceleration = (model.positions(weights, order) for order in range(3))
            at_end = displacement(model.robot, anchor, spot, end)
            for k in axes_of(contact):
                closing = 0.0 if contact.vertical else closing_accelerations[len(meet) // 2]
                stands = Bound(0.0, 0.0, f"{contact.name} stands", "stands")
                stand.append((acceleration[k] * unit**2 - closing, stands))
                if contact.vertical:  # its row says that the sole's angle, linear in y, does not accelerate
                    continue
                meets = Bound(0.0, 0.0, f"{contact.name} meets the ground", "meets")
                meet.append((position[k] - at_end[k], meets))
                meet.append((rate[k] * unit, meets))
        return [*stand, *meet]

    @cached_property
    def _distinct_motors(self) -> list[int]:
        """Motors whose torques are not always those of one before: their bodies have other inertias."""
        tree = self.model.robot.tree
        distinct: list[int] = []
        seen: list[ComplexArray] = []
        for motor in range(tree.motor_turns.shape[1]):
            bodies = np.flatnonzero(tree.motor_turns[:, motor])
            own = (tree.mass, tree.center, tree.inertia, tree.armature)
            key: ComplexArray = np.column_stack([values[bodies] for values in (*own, tree.turns)])
            if not any(other.shape == key.shape and np.allclose(other, key, rtol=1e-6, atol=1e-6) for other in seen):
                distinct.append(motor)
                seen.append(key)
        return distinct

    def _torque_rows(self, moments: Any) -> list[Row]:
        """Torques over their limits; with the torque that is lost with the rate over the stall torque."""
        limits = self.limits
        robot = self.model.robot
        torques = self.model.motor_torques(moments)
        rates = casadi().mtimes(self.model.constant(robot.motor_ratios), self.model.v[1:])
        generalised = casadi().mtimes(self.model.constant(robot.tree.turns.T), moments)
        shares = generalised / limits.joint_torque
        limited = np.flatnonzero(np.isfinite(limits.joint_torque))
        rows = [share_row(shares[joint], f"torque of {robot.joints[joint]}") for joint in limited.tolist()]
        for motor in self._distinct_motors:
            name = robot.motors[motor]
            torque = torques[motor]
            if np.isfinite(limits.torque[motor]):
                rows.append(share_row(torque / limits.torque[motor], f"torque of {name}"))
            if np.isfinite(limits.stall[motor]):
                for sign in (1.0, -1.0):
                    value = (torque + sign * limits.slope[motor] * rates[motor]) / limits.stall[motor]
                    rows.append(share_row(value, f"torque-speed curve of {name}"))
        return rows

    def _locked_rows(self, contacts: Sequence[GroundContact], forces: Sequence[Pair]) -> list[Row]:
        """Torques of locked joints over their efforts."""
        names = self.extra.locked_joints
        shares = self._locked.shares(names, contacts, forces) / self.limits.torque_margin
        return [share_row(shares[row], f"effort of {name}, held") for row, name in enumerate(names)]

    def missing_rows(self, motion: Sequence[Array], forces: Sequence[Array], factor: float) -> ExtraRows:
        """What is beyond its bounds at nodes, but has no row yet: locked joints, of left and right one; points.

        Parameters
        ----------
        motion : y, v, a (n+1, K+1)
        forces : of each phase (2 others, nodes) N
        factor : on the bounds of torques
        """
        tolerance = 1e-4  # [-, m] beyond a bound: not the right joint where the left one has a row
        names = list(self._locked.efforts)
        spots = self.points.spots
        least = self.least_heights[: len(spots)] - tolerance
        are_low = False
        missing = dict[tuple[float, ...], str]()  # by shares at all nodes: those of left and right are the same
        shares = [np.zeros((len(names), 0))]
        for phase, start, of_others in zip(self.phases, self.first_nodes, forces, strict=False):
            y, v, a = (values[:, start : start + phase.intervals + 1] for values in motion)
            if phase.contacts and not self.extra.all_points:
                heights = positions_from_com(self.model.robot, [*spots, phase.anchor.spots[0]], y).imag
                are_low |= bool((heights[:, :-1] - heights[:, -1:] + phase.anchor.depth < least).any())
            if names:
                shares.append(np.abs(np.asarray(self._locked_shares(phase)(y, v, a, of_others))))
        for name, row in zip(names, np.concatenate(shares, axis=1), strict=True):
            if name not in self.extra.locked_joints and row.max() > factor * self.limits.torque_margin + tolerance:
                missing.setdefault(tuple(row.round(3).tolist()), name)
        return ExtraRows(tuple(missing.values()), are_low)

    def _locked_shares(self, phase: Phase) -> Any:
        """Function (y, v, a, forces) -> torques over efforts of all locked joints; built once for its contacts."""
        if phase.contacts not in self._functions:
            forces = casadi().SX.sym("forces", 2 * len(phase.others))
            of_contacts: list[Pair] = []
            if phase.contacts:
                own, pairs = anchor_force(self.model, phase, forces)
                of_contacts = [own, *pairs]
            shares = self._locked.shares(list(self._locked.efforts), phase.contacts, of_contacts)
            self._functions[phase.contacts] = self.model.function("locked_shares", [shares], forces)
        return self._functions[phase.contacts]

    def _motor_torques(self, moments: Any) -> Any:
        """Torques (motors,) over the weight and the height, of which the sum of squares is the cost.

        Squared outside of the node's function, in which second derivatives are then those of torques alone.
        """
        return self.model.motor_torques(moments) / (self.weight * self.height)

    def of_flight(self) -> tuple[Any, list[Bound]]:
        """Function (y, v, a) -> (rows, torques) of the flight's nodes: h first, and heights over the centre of mass."""
        ca = casadi()
        model = self.model
        moments = model.moments(None, [])
        constant = Bound(0.0, 0.0, "angular momentum in flight")
        rows: list[Row] = [
            (model.momentum() / self.momentum_unit, constant),
            (ca.sum1(moments) / (self.weight * self.height), constant),
            *self._torque_rows(moments),
            *self._locked_rows((), []),
        ]
        _, z = model.positions(model.weights(self._spots))
        kinds: list[tuple[str, Kind]] = [(Label.CLEAR, "point")] * len(self.points.spots)
        kinds += [(f"{contact.name} above the ground", "foot") for contact in self.feet]
        for index, (label, kind) in enumerate(kinds):
            rows.append((z[index], Bound(float(self.least_heights[index]), np.inf, label, kind)))
        output, bounds = _stacked(rows)
        return model.function("flight", [output, self._motor_torques(moments)]), bounds


def share_row(value: Any, label: str) -> Row:
    """Return the row of a share of a limit."""
    return value, Bound(-1.0, 1.0, label, "share")


def _stacked(rows: Sequence[Row]) -> tuple[Any, list[Bound]]:
    """Values of rows as one vector, and their bounds."""
    values, bounds = zip(*rows, strict=True)
    return casadi().vertcat(*values), list(bounds)


def quadrature_step(values: Any, rates: Any, accelerations: Any, step: Any) -> Any:
    """Values (1, N) a step later, of a row (1, N+1) with its first and second derivatives, by Hermite's rule."""
    mean = step / 2 * (rates[:, :-1] + rates[:, 1:])
    return values[:, :-1] + mean + step**2 / 12 * (accelerations[:, :-1] - accelerations[:, 1:])
