"""The program of a jump in space over all phases: variables, rows, and IPOPT: one loose solve, then tight ones.

A border of two phases is one node, at which feet that leave or arrive bear no force. Between nodes accelerations are
linear: ``y1 = y0 + h v0 + h^2 (a0 / 3 + a1 / 6)``, ``v1 = v0 + h (a0 + a1) / 2``; but in flight the rates of the base's
angles are those with which the angular momentum is the same at all nodes. Feet that stand satisfy ``acc + 50 vel + 625
(pos - start) = 0`` at nodes, which brings back what the steps let drift; after landing with the other sign of the
velocity, since there the motion's end is fixed. Of feet that roll, vel and acc are what they slip by, and pos is their
height only. Where feet may land with speed, the flight arrives with rates and accelerations of its own, which impulses
change into the rates of the landing's first node. The squares of the motors' shares of their torque limits are
minimised, summed over nodes without the times between. Tight solves go on until all rows hold, four at most.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.jumps.model import casadi
from floatplan.jumps.phases import grounds_below, instants
from floatplan.jumps.spatial.impact import Arrival
from floatplan.jumps.spatial.model import BASE, SpatialModel
from floatplan.jumps.spatial.nodes import (
    NodeKind,
    NodeParameters,
    Row,
    SpatialBounds,
    SpatialEnds,
    SpatialSolution,
    force_rows,
    leverage_rows,
    lifted_share,
    standing_rows,
    torque_rows,
)
from floatplan.jumps.spatial.phases import SpatialPhase, with_more_feet
from floatplan.jumps.spatial.pieces import Assembly, Expression, Piece
from floatplan.jumps.spatial.standing import ClearancePoint, Foot
from floatplan.problem.ground_step import GroundStep

MIDDLE_ANGLE = 1.3  # [rad] 75 degrees, beyond which the base's angles are no coordinates
PROXIMAL = {"y": 1.0, "v": 1e-2, "a": 1e-5, "force": 0.1, "duration": 10.0}  # weights; forces over the weight


@dataclass(eq=False)
class SpatialProgram:
    """A jump's program.

    Attributes
    ----------
    model : SpatialModel
    phases : in order of time, a flight among them, or those of a single stance
    ends : SpatialEnds
    points : that stay above the ground
    corners : of the feet's shapes, which nearly do
    shank_points : of the links to which feet are fixed, which do
    bounds : SpatialBounds
    friction : that is allowed; the bounds' has a margin
    reference : (6+n, K+1) coordinates y to which those of the nodes are to be near; None for none
    step : of the ground, in the program's world; None where it is level
    expressions : of nodes and intervals; programs that differ only in limits and numbers of nodes share them
    """

    model: SpatialModel
    phases: tuple[SpatialPhase, ...]
    ends: SpatialEnds
    points: Sequence[ClearancePoint]
    corners: Sequence[ClearancePoint]
    shank_points: Sequence[ClearancePoint]
    bounds: SpatialBounds
    friction: float
    reference: Array | None = None
    step: GroundStep | None = None
    expressions: dict[Any, Expression] = field(default_factory=dict)
    kinds: list[NodeKind] = field(init=False)
    phase_of: IntArray = field(init=False)

    def __post_init__(self) -> None:
        """Lay out nodes and variables."""
        model = self.model
        flights = [index for index, phase in enumerate(self.phases) if phase.side == "flight"]
        self.flight = flights[0] if flights else -1
        self.borders = np.cumsum([0, *(phase.intervals for phase in self.phases)])
        self.nodes = int(self.borders[-1]) + 1
        self.phase_of = np.minimum(
            np.searchsorted(self.borders[1:], np.arange(self.nodes), "right"), len(self.phases) - 1
        )
        self.kinds = [self._kind(node) for node in range(self.nodes)]
        self.height = float(self.ends.y[0, 2])
        self.weight = model.mass * model.gravity
        self.unit = math.sqrt(self.height / model.gravity)
        widths = [3 * model.size + 3 * len(kind.bearing) for kind in self.kinds]
        self.begins = np.cumsum([0, *widths])
        self.arrival = Arrival(model, self.bounds, self._landing_feet, int(self.begins[-1]))
        self.size = int(self.begins[-1]) + len(self.arrival.variables) + len(self.phases)

    @property
    def _landing_feet(self) -> tuple[Foot, ...]:
        """Feet that may come to the ground with speed; none where all land without."""
        return self.phases[self.flight + 1].feet if self.flight >= 0 and self.bounds.impact else ()

    def _kind(self, node: int) -> NodeKind:
        """What holds at a node."""
        if node in (0, self.nodes - 1):
            end = 0 if node == 0 else -1
            phase = self.phases[end]
            fixed = self.ends.fixed(end)
            bearing = () if self.ends.flies[end] else phase.feet
            tracking = phase.feet if fixed < 3 else ()
            return NodeKind(phase.side, tracking, bearing, self._damping_signs(node, tracking), fixed)
        phase = self._standing_phase(node)
        bearing = phase.feet
        if node in self.borders:
            after = self.phases[self.phase_of[node]]
            bearing = tuple(foot for foot in self.phases[self.phase_of[node] - 1].feet if foot in after.feet)
        return NodeKind(phase.side, phase.feet, bearing, self._damping_signs(node, phase.feet))

    def _standing_phase(self, node: int) -> SpatialPhase:
        """The phase whose feet stand at a node: on the border of two that which has more of them."""
        index = int(self.phase_of[node])
        if node in self.borders[1:-1]:
            return with_more_feet(self.phases[index - 1], self.phases[index])
        return self.phases[index]

    def _damping_signs(self, node: int, feet: Sequence[Foot]) -> tuple[int, ...]:
        """What brings back the drift of each foot at a node; see :class:`NodeKind`.

        Where a foot stands from the first node on, its motion is fixed there, and drift decays with time; where it
        stands until the last one, backwards in time. From the first until the last, half of the nodes do the one, half
        the other, and two in the middle, which have no such rows, join them.
        """
        middle = self.nodes // 2
        towards_end = node > middle
        signs = []
        for foot in feet:
            stands = [foot in phase.feet for phase in self.phases]
            if all(stands):
                signs.append(0 if node in (middle, middle - 1) else (-1 if towards_end else 1))
            else:
                signs.append(-1 if stands[-1] and all(stands[self.phase_of[node] :]) else 1)
        return tuple(signs)

    @cached_property
    def assembly(self) -> Assembly:
        """Rows, cost and derivatives."""
        nodes_of: dict[NodeKind, list[int]] = {}
        for node, kind in enumerate(self.kinds):
            # Which sign the damping has is a parameter; whether there is any, is not.
            is_damped = tuple(abs(sign) for sign in kind.damping_signs)
            nodes_of.setdefault(replace(kind, damping_signs=is_damped), []).append(node)
        pieces = []
        for kind, nodes in nodes_of.items():
            if kind.bearing or kind.fixed < 3:  # where all of the motion is fixed, and flies, nothing is open
                pieces.append(self._node_piece(kind, nodes))
        pieces += [self._interval_piece(index) for index in range(len(self.phases))]
        if self.arrival.feet:
            after = self.begins[self.borders[self.flight + 1]] + np.arange(2 * self.model.size)
            pieces.append(self.arrival.piece(after, self.height, self.expressions))
        return Assembly(pieces, self._weights())

    def _weights(self) -> Array:
        """Weights (size,) of the proximal term."""
        n = self.model.size
        weights = np.full(self.size, PROXIMAL["duration"])
        for node, kind in enumerate(self.kinds):
            begin = self.begins[node]
            weights[begin : begin + n] = PROXIMAL["y"]
            weights[begin + n : begin + 2 * n] = PROXIMAL["v"]
            weights[begin + 2 * n : begin + 3 * n] = PROXIMAL["a"]
            weights[begin + 3 * n : begin + 3 * n + 3 * len(kind.bearing)] = PROXIMAL["force"]
        weights[self.arrival.rates] = PROXIMAL["v"]
        weights[self.arrival.accelerations] = PROXIMAL["a"]
        weights[self.arrival.impulses] = PROXIMAL["force"]
        return weights

    def _node_piece(self, kind: NodeKind, nodes: Sequence[int]) -> Piece:
        """Rows of all nodes of a kind, but for the signs of their damping."""
        ca = casadi()
        model = self.model
        weight = self.weight
        scaled_forces = {foot.name: ca.SX.sym(f"F_{foot.name}", 3) for foot in kind.bearing}
        forces = {name: weight * scaled for name, scaled in scaled_forces.items()}
        # Those of a single stance are where they are; those after a flight are where it brings the robot.
        uses_displacement = kind.side == "landing" and bool(kind.tracking) and self.flight >= 0
        displacement = ca.SX.sym("d", 2) if uses_displacement else ca.SX(2, 1)
        width = 0 if self.reference is None else model.size
        parameters = NodeParameters.of_sizes(len(self.bounds.scales), len(kind.damping_signs), width)
        com_motion = ca.vertcat(model.y, model.v, model.a)
        rows: list[Row] = []
        balance = model.balance(forces)
        for index in range(6):
            scale = weight if index < 3 else weight * self.height
            rows.append((balance[index] / scale, 0.0, 0.0, "balance of forces and moments"))
        if kind.tracking:
            rows += standing_rows(model, kind, self.ends.places[kind.side], displacement, parameters.signs)
        rows += force_rows(kind.bearing, scaled_forces, parameters.friction, parameters.inside)
        motor_rows, cost = torque_rows(model, self.bounds, forces, parameters.scales)
        height_rows: list[Row] = []
        if kind.fixed < 3:
            rows += motor_rows
        if not kind.fixed:
            rows += leverage_rows(model, kind.tracking, self.ends.standing, self.flight >= 0)
            rows += self._distance_rows(kind)
            height_rows = self._height_rows(kind)
        smoothness = 1e-5  # [s^4/rad^2] 100 rad/s^2 cost as much as a motor with a third of its torque;
        evenness = 1e-2  # [-] and so does a force of three weights
        cost += smoothness * ca.sumsqr(model.a) + evenness * sum(map(ca.sumsqr, scaled_forces.values()), ca.SX(0))
        if self.reference is not None:
            nearness = 10.0  # [1/rad^2] a joint that is 0.1 rad off costs as much as a motor with a third of its torque
            cost += nearness * ca.sumsqr((model.y - parameters.reference)[3:])
        low = np.array([row[1] for row in rows])[:, None] * np.ones(len(nodes))
        high = np.array([row[2] for row in rows])[:, None] * np.ones(len(nodes))
        if height_rows:
            least = np.stack([self._least_heights(kind, node) for node in nodes], axis=1)
            low = np.vstack((low, least))
            high = np.vstack((high, np.full(least.shape, np.inf)))
        indices = np.array([np.arange(self.begins[node], self.begins[node + 1]) for node in nodes]).T
        variables = [com_motion, *scaled_forces.values()]
        numbers = parameters.vector
        if kind.fixed == 3:  # only the forces are open
            variables = variables[1:]
            numbers = ca.vertcat(numbers, com_motion)
            indices = indices[com_motion.shape[0] :]
        if uses_displacement:
            variables.append(displacement)
            last = self.begins[self.nodes - 1]
            indices = np.vstack((indices, np.tile([[last], [last + 1]], len(nodes))))
        everything = [*rows, *height_rows]
        where = self._standing_phase(nodes[0]).name
        expression = Expression(
            variables=ca.vertcat(*variables),
            parameters=numbers,
            rows=ca.vertcat(*(row[0] for row in everything)),
            cost=cost,
        )
        key = (kind, self.reference is None, tuple(self.shank_points))
        return Piece(
            expression=self.expressions.setdefault(key, expression),
            indices=indices,
            parameter_values=np.stack([self._parameter_values(node) for node in nodes], axis=1),
            low=low,
            high=high,
            labels=tuple(f"{row[3]} ({where})" for row in everything),
        )

    def _parameter_values(self, node: int) -> Array:
        """Values (p,) of the parameters of a node's expression."""
        kind = self.kinds[node]
        reference = np.empty(0) if self.reference is None else self.reference[:, node]
        signs = np.array(kind.damping_signs, np.float64)
        margins = np.array([self.bounds.friction, self.bounds.inside])
        values: list[Array] = [reference, margins, self.bounds.scales, signs]
        if kind.fixed == 3:
            end = 0 if node == 0 else 1
            # One zero stands for all rates of an end that is still.
            values += np.broadcast_arrays(self.ends.y[end], self.ends.v[end], self.ends.a[end])
        return np.concatenate(values)

    def _distance_rows(self, kind: NodeKind) -> list[Row]:
        """Rows that keep feet apart, as balls as large as they are high; but for two that stand, and soles.

        Where the ground has a step, these are of the links' distances from it too.
        """
        ca = casadi()
        apart = 0.01  # [m] between their surfaces
        of_points = {foot for phase in self.phases for foot in phase.feet if not foot.suffix}
        feet = sorted(of_points, key=lambda foot: (foot.body, foot.name))
        rows = []
        for first, second in itertools.combinations(feet, 2):
            if first in kind.tracking and second in kind.tracking:
                continue
            between = self.model.foot(first.name)[1][0] - self.model.foot(second.name)[1][0]
            least = first.depth + second.depth + apart
            label = f"distance of {first.name} from {second.name}"
            rows.append(((ca.sumsqr(between) - least**2) / self.height**2, 0.0, np.inf, label))
        if self.step is not None:
            rows += self.model.step_rows(self.step, self.height, self.ends.standing, bool(kind.tracking))
        return rows

    def _heights(self, kind: NodeKind) -> list[tuple[ClearancePoint, str]]:
        """What stays above the ground at nodes of a kind, and as what: "link", foot's "corner", "shank" or "foot"."""
        standing = {foot.name for foot in kind.tracking}
        heights = [(point, "link") for point in self.points]
        heights += [(point, "corner") for point in self.corners]
        heights += [(point, "shank") for point in self.shank_points]
        in_the_air = {foot for phase in self.phases for foot in phase.feet if foot.name not in standing}
        for foot in sorted(in_the_air, key=lambda foot: (foot.body, foot.name)):  # a sole's points are of one body
            heights.append((ClearancePoint(foot.name, foot.body, foot.local, foot.depth), "foot"))
        return heights

    def _height_rows(self, kind: NodeKind) -> list[Row]:
        rows = []
        standing = {foot.body: foot for foot in kind.tracking if not foot.suffix}
        for point, use in self._heights(kind):
            position, _, _ = self.model.in_world(self.model.bodies[point.body - 1].point(np.array(point.local)))
            height = position[2] - point.radius
            foot = standing.get(point.body)
            if use == "shank" and foot is not None:
                # From the foot's point, not from the ground: at nodes feet are up to millimetres off their places, to
                # which the exact stance brings them back.
                height += self._ground_of(kind) + foot.depth - self.model.foot(foot.name)[1][0][2]
            rows.append((height / self.height, 0.0, np.inf, f"height of {point.link}"))
        return rows

    def _ground_of(self, kind: NodeKind) -> float:
        """Height of the ground of a kind's side, m, over that which the robot leaves."""
        return self.ends.rise if kind.side == "landing" else 0.0

    def _least_heights(self, kind: NodeKind, node: int) -> Array:
        """Least heights of what :meth:`_heights` names at a node, over the standing height of the centre of mass.

        They are over the ground on which it stands then, in flight over that which :func:`grounds_below` says.
        """
        lift = 0.003  # [m] of feet in the air in stance
        ground = self._ground_of(kind)
        in_flight = self.flight >= 0 and self.borders[self.flight] < node < self.borders[self.flight + 1]
        if in_flight:
            progress = (node - self.borders[self.flight]) / self.phases[self.flight].intervals
            lift = self.bounds.lift * lifted_share(progress)
            ground = float(grounds_below(np.array(progress), 0.0, self.ends.rise))
        bounds = self.bounds
        least_of = {"link": bounds.clearance, "foot": lift, "corner": -bounds.dip, "shank": bounds.shank_height}
        return np.array([ground + least_of[use] for _, use in self._heights(kind)]) / self.height

    def _interval_piece(self, index: int) -> Piece:
        """Rows of the intervals of a phase: y and v follow from accelerations that are linear.

        In flight the rates of the base's angles follow from the angular momentum, which is the same at all nodes: as
        integrals of accelerations they would be wrong by the square of the step, and the attitude where it lands too.
        """
        ca = casadi()
        model = self.model
        n = model.size
        phase = self.phases[index]
        first = [ca.SX.sym(f"{name}0", n) for name in "yva"]
        second = [ca.SX.sym(f"{name}1", n) for name in "yva"]
        duration = ca.SX.sym("T")
        fraction = ca.SX.sym("fraction")
        step = fraction * duration
        places = second[0] - first[0] - step * first[1] - step**2 * (first[2] / 3 + second[2] / 6)
        rates = (second[1] - first[1] - step / 2 * (first[2] + second[2])) * self.unit
        in_flight = index == self.flight
        if in_flight:
            momentum = ca.Function("momentum", [model.y, model.v], [model.angular_momentum])
            change = momentum(second[0], second[1]) - momentum(first[0], first[1])
            rates[3:BASE] = change * self.unit / (model.mass * self.height**2)
        nodes = np.arange(self.borders[index], self.borders[index + 1])
        offsets = np.arange(3 * n)[:, None]
        indices = np.vstack(
            (
                self.begins[nodes] + offsets,
                self.begins[nodes + 1] + offsets,
                np.full((1, len(nodes)), self.size - len(self.phases) + index),
            )
        )
        if in_flight and self.arrival.feet:
            indices[4 * n : 6 * n, -1] = self.arrival.derivatives
        zero = np.zeros((2 * n, len(nodes)))
        expression = Expression(
            variables=ca.vertcat(*first, *second, duration),
            parameters=fraction,
            rows=ca.vertcat(places, rates),
            cost=ca.SX(0),
        )
        labels = [f"motion between nodes ({phase.name})"] * (2 * n)
        if in_flight:
            labels[n + 3 : n + BASE] = [f"angular momentum ({phase.name})"] * 3
        return Piece(
            expression=self.expressions.setdefault("flight" if in_flight else "interval", expression),
            indices=indices,
            parameter_values=np.diff(phase.progress)[None],
            low=zero,
            high=zero,
            labels=tuple(labels),
        )

    @cached_property
    def box(self) -> tuple[Array, Array]:
        """Bounds (size,) of the variables."""
        n = self.model.size
        bounds = self.bounds
        low = np.full(self.size, -np.inf)
        high = np.full(self.size, np.inf)
        least_angles, largest_angles = np.sort(self.ends.y[:, 3:BASE], axis=0)
        for node, kind in enumerate(self.kinds):
            begin = self.begins[node]
            if kind.fixed:
                end = 0 if node == 0 else 1
                for order, values in enumerate((self.ends.y, self.ends.v, self.ends.a)[: kind.fixed]):
                    at = begin + order * n
                    low[at : at + n] = high[at : at + n] = values[end]
                if node and self.ends.displacement is not None:
                    low[begin : begin + 2] = high[begin : begin + 2] = self.ends.displacement
                elif node:
                    low[begin : begin + 2] = -np.inf
                    high[begin : begin + 2] = np.inf
            else:
                low[begin + 3 : begin + BASE] = least_angles - bounds.leeway
                high[begin + 3 : begin + BASE] = largest_angles + bounds.leeway
                low[begin + 4] = -bounds.tilt
                high[begin + 4] = bounds.tilt
                low[begin + BASE : begin + n], high[begin + BASE : begin + n] = bounds.position.T
                low[begin + n + BASE : begin + 2 * n] = -bounds.velocity
                high[begin + n + BASE : begin + 2 * n] = bounds.velocity
                if node in (0, self.nodes - 1):  # an end where the robot settles
                    low[begin + n : begin + 3 * n] = high[begin + n : begin + 3 * n] = 0.0
            forces = np.arange(begin + 3 * n, self.begins[node + 1])
            low[forces[2::3]] = bounds.least_force
        if self.arrival.feet:
            low[self.arrival.rates[BASE:]] = -bounds.velocity
            high[self.arrival.rates[BASE:]] = bounds.velocity
        durations = self.size - len(self.phases)
        low[durations:], high[durations:] = np.transpose([phase.bounds for phase in self.phases])
        return low, high

    @property
    def flight_nodes(self) -> slice:
        """The flight's nodes, both borders among them."""
        return slice(int(self.borders[self.flight]), int(self.borders[self.flight + 1]) + 1)

    def times(self, durations: Array) -> Array:
        """Instants (K+1,) of the nodes, s."""
        return instants(self.phases, durations)

    def resampled(self, solution: SpatialSolution, other: "SpatialProgram") -> Array:
        """Return the solution of another program of these phases, with other numbers of nodes, as a guess (size,)."""
        progress = self.progress
        other_progress = other.progress
        com_motion = solution.com_motion
        com_motion[0, :3] -= solution.origin[:, None]
        resampled = [[np.interp(progress, other_progress, row) for row in rows] for rows in com_motion]
        names = {foot.name for kind in self.kinds for foot in kind.bearing}
        forces = {}
        for name in names:
            at_nodes = np.array([of_node.get(name, np.zeros(3)) for of_node in solution.forces])
            forces[name] = np.stack([np.interp(progress, other_progress, row) for row in at_nodes.T], axis=1)
        raw = self.joined(np.array(resampled), forces, solution.durations)
        raw[self.arrival.variables] = solution.raw[other.arrival.variables]
        return raw

    def joined(self, com_motion: Array, forces: Mapping[str, Array], durations: Array) -> Array:
        """Variables (size,) of a motion, as :meth:`solution` has it; forces are of those that bear some at a node.

        Those of an :class:`Arrival` are 0.

        Parameters
        ----------
        com_motion : (3, 6+n, K+1) y, v and a at the nodes, with the centre of mass from the program's origin
        forces : name of a foot's point -> (K+1, 3) N
        durations : (phases,) s
        """
        raw = np.zeros(self.size)
        raw[self.size - len(self.phases) :] = durations
        for node, kind in enumerate(self.kinds):
            scaled_forces = [forces[foot.name][node] / self.weight for foot in kind.bearing]
            own = slice(self.begins[node], self.begins[node + 1])
            raw[own] = np.concatenate((com_motion[:, :, node].ravel(), *scaled_forces))
        return raw

    @property
    def progress(self) -> Array:
        """Progress (K+1,) of the nodes through the phases: 1.5 is the middle of the second one."""
        progress = [0.0]
        for index, phase in enumerate(self.phases):
            progress += (index + phase.progress[1:]).tolist()
        return np.array(progress)

    def solve(self, guess: Array, is_near: bool = False, tight_solves: int = 4) -> SpatialSolution:
        """Run IPOPT from a guess (size,): loosely with an adaptive barrier, then tightly from its result.

        A guess that ``is_near`` a solution needs no loose stage; of tight ones there are so many at most.
        """
        ca = casadi()
        assembly = self.assembly
        low, high = self.box
        limits = {"lbx": low, "ubx": high, "lbg": assembly.low, "ubg": assembly.high}
        raw = np.clip(guess, low, high)
        iterations = 0
        violation = np.inf
        for stage in range(1 if is_near else 0, 1 + tight_solves):
            solver = ca.nlpsol("jump", "ipopt", assembly.problem, self._options(loose=stage == 0))
            weight = 0.1 if stage == 0 else 1.0
            result = solver(x0=raw, p=np.append(raw, weight), **limits)
            values = np.asarray(result["x"]).ravel()
            iterations += int(solver.stats()["iter_count"])
            if not np.isfinite(values).all():
                break
            raw = values
            violation, _ = self._worst(raw)
            if stage and solver.stats()["success"] and violation < 1e-6:
                break
        return self.solution(raw, iterations, violation < 1e-6)

    def _options(self, loose: bool) -> dict[str, Any]:
        """Options of IPOPT for the first stage, or the following ones."""
        common = {"print_level": 0, "sb": "yes", "mumps_pivot_order": 0, "mumps_mem_percent": 20}
        common |= {"max_hessian_perturbation": 1e8, "constr_viol_tol": 1e-7}
        if loose:
            common |= {"tol": 1e-3, "max_iter": 70, "mu_strategy": "adaptive", "constr_viol_tol": 1e-4}
            # It is enough that all rows nearly hold.
            common |= {"acceptable_iter": 1, "acceptable_constr_viol_tol": 1e-3}
            common |= {f"acceptable_{name}": 1e20 for name in ("tol", "dual_inf_tol", "compl_inf_tol")}
        else:
            common |= {"tol": 1e-5, "max_iter": 60, "mu_strategy": "monotone", "mu_init": 1e-3, "mu_target": 1e-4}
            common |= {"bound_push": 1e-4, "bound_frac": 1e-4, "dual_inf_tol": 1e-1}
            # It is enough that the cost does not change any more: internal forces and durations hardly count.
            common |= {"acceptable_iter": 5, "acceptable_obj_change_tol": 1e-3, "acceptable_constr_viol_tol": 1e-6}
            common |= {f"acceptable_{name}": 1e20 for name in ("tol", "dual_inf_tol", "compl_inf_tol")}
        return {"ipopt": common, "print_time": False, "error_on_fail": False, **self.assembly.functions}

    def _worst(self, raw: Array) -> tuple[float, str]:
        """Largest violation of a row, and its label."""
        assembly = self.assembly
        values = np.asarray(assembly.evaluate(raw, np.zeros(self.size + 1))).ravel()
        violations = np.maximum(np.maximum(assembly.low - values, values - assembly.high), 0.0)
        index = int(violations.argmax())
        return float(violations[index]), assembly.labels[index]

    def solution(self, raw: Array, iterations: int, converged: bool) -> SpatialSolution:
        """Variables (size,) as matrices."""
        n = self.model.size
        com_motion = np.stack([raw[begin : begin + 3 * n] for begin in self.begins[:-1]], axis=1)
        forces = []
        for node, kind in enumerate(self.kinds):
            scaled_forces = raw[self.begins[node] + 3 * n : self.begins[node + 1]].reshape(-1, 3)
            of_node = {}
            for foot, scaled in zip(kind.bearing, scaled_forces, strict=True):
                of_node[foot.name] = self.weight * scaled
            forces.append(of_node)
        return SpatialSolution(
            raw=raw,
            y=com_motion[:n],
            v=com_motion[n : 2 * n],
            a=com_motion[2 * n :],
            forces=forces,
            durations=raw[self.size - len(self.phases) :],
            worst=self._worst(raw),
            iterations=iterations,
            converged=converged,
            arrival=raw[self.arrival.derivatives].reshape(2, n) if self.arrival.feet else None,
        )


def solved_again(
    finer: SpatialProgram, program: SpatialProgram, solution: SpatialSolution
) -> tuple[SpatialProgram, SpatialSolution] | None:
    """Return a finer program and its solution from that of another one; None where it has none."""
    refined = finer.solve(finer.resampled(solution, program), is_near=True)
    return (finer, refined) if refined.converged else None
