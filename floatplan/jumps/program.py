"""One nonlinear program over all phases of a jump, from standing to standing, for IPOPT.

Variables at the nodes are y = (theta_0, q), y', y'' and the forces of all contacts but the anchor's; in addition the
accelerations that close chains, the phases' durations and the angular momentum h of the flight. Between nodes y'' is
linear:

``y'_1 = y'_0 + T (y''_0 + y''_1) / 2``,  ``y_1 = y_0 + T y'_0 + T^2 (2 y''_0 + y''_1) / 6``.

In stance the base hangs on the anchor, whose force is ``m (c'' + g)`` less the others'; the balance of moments holds
at every node. On one point the momentum about it and the orientation follow by Hermite's rule instead. Where more
stand, the others do not accelerate, but for what closes the chain at both ends, linear in time. In flight h is
constant, ``D y' = h``, the centre of mass is on its parabola, and the orientation follows by Hermite's rule. Both seams
are exact: there forces vanish, and h and the parabola are those of either side. The objective is the integral of
squared torques; or, where shares of limits count, a factor, one more variable, that is no less than any share of a
limit on torques, torque-speed curves and rates. One side alone is a jump whose flight, of no intervals, is fixed.

A sequence has more flights: what follows a landing leads to the next takeoff. In between is one more node, at which all
feet of both stand as far apart as where the robot stands, and everything moves as it likes; forces of both are equal.
A periodic jump begins and ends in such a node: its motion there is the same at both ends, but for whole turns. Where
one begins in motion, its posture and rates at the first node are fixed, and its accelerations are free.
"""

from collections.abc import Sequence
from copy import copy
from functools import cached_property
from typing import Any, Self

import numpy as np

from floatplan.arrays import Array
from floatplan.jumps.check import TOUCHDOWN
from floatplan.jumps.locked_joints import stop_when_overloaded
from floatplan.jumps.model import casadi
from floatplan.jumps.motion import quintic_spline, values
from floatplan.jumps.phases import (
    FixedEnd,
    Phase,
    closing_count,
    duration_costs,
    grounds_below,
    instants,
    meets_next,
    outer_phase,
)
from floatplan.jumps.rows import (
    Bound,
    CompiledProgram,
    ExtraRows,
    Kind,
    Label,
    NodeRows,
    Rows,
    quadrature_step,
)
from floatplan.jumps.separation import Separation, add_distance
from floatplan.jumps.variables import (
    FOOT_LIFT,
    ITERATIONS,
    PROGRAM,
    JumpSolution,
    Variables,
    add_meeting,
    bound_ends,
    bound_forces,
    ipopt_options,
    onset_cost,
)


class JumpProgram:
    """The program of a jump; built once, solved from any guess.

    Parameters
    ----------
    node_rows : NodeRows of the jump's phases
    separation : distances that it requires
    fixed_ends : what is fixed at the flight's ends
    fixed_momentum : h of the flight, kg m^2/s, where it is fixed
    beyond : least horizontal position of the foot that lands from the one that takes off, m, its sign the direction
    periodic : whether it ends as it begins, in the middle of a stance, instead of standing
    limits : whether the factor on limits is minimised, instead of squared torques
    lift : of feet in the middle of the flight, m
    begin_rates : (n+1,) rad/s, with which the jump begins; None where it stands still
    """

    def __init__(
        self,
        node_rows: NodeRows,
        separation: Separation,
        fixed_ends: Sequence[FixedEnd] = (),
        fixed_momentum: float | None = None,
        beyond: float | None = None,
        periodic: bool = False,
        limits: bool = False,
        lift: float = FOOT_LIFT,
        begin_rates: Array | None = None,
    ) -> None:
        self.node_rows = node_rows
        self.model = node_rows.model
        self.phases = node_rows.phases
        self.ends = node_rows.ends
        self.size = 1 + len(self.model.robot.joints)
        self.first_nodes = node_rows.first_nodes
        self.flights = node_rows.flights
        self.nodes = int(self.first_nodes[-1]) + 1
        self.separation = separation
        self._fixed_ends = tuple(fixed_ends)
        self._fixed_momentum = fixed_momentum
        self._beyond = beyond
        self.periodic = periodic
        self._limits = limits
        self._warm = False
        self.lift = lift
        self.begin_rates = begin_rates

    @cached_property
    def _shapes(self) -> Variables:
        """Shapes of all variables."""
        motion = (self.size, self.nodes)
        forces = [(2 * len(phase.others), phase.intervals + 1) for phase in self.phases]
        closing = [(closing_count(phase), 2) for phase in self.phases]
        durations = (len(self.phases), 1)
        momenta = (len(self.flights), 1)
        return Variables(motion, motion, motion, forces, closing, durations, momenta, (int(self._limits), 1))

    @cached_property
    def _scales(self) -> Variables:
        """Units of all variables."""
        unit = self.node_rows.time_unit
        forces = [self.node_rows.weight] * len(self.phases)
        momentum_unit = self.node_rows.momentum_unit
        return Variables(1.0, 1 / unit, 1 / unit**2, forces, [1.0] * len(forces), 1.0, momentum_unit, 1.0)

    def split(self, raw: Any) -> Variables:
        """Variables (size,), scaled, as matrices of their own units: an expression, or numbers."""
        matrices = []
        at = 0
        for (rows, columns), scale in zip(self._shapes.matrices(), self._scales.matrices(), strict=True):
            piece = raw[at : at + rows * columns]
            at += rows * columns
            if isinstance(raw, np.ndarray):
                matrices.append(scale * piece.reshape(rows, columns, order="F"))
            else:
                matrices.append(scale * casadi().reshape(piece, rows, columns))
        return Variables.of(matrices)

    def join(self, variables: Variables) -> Array:
        """The reverse of :meth:`split`."""
        pieces = []
        for matrix, scale in zip(variables.matrices(), self._scales.matrices(), strict=True):
            pieces.append(np.ravel(np.asarray(matrix) / scale, order="F"))
        return np.concatenate(pieces)

    def nodes_of(self, index: int) -> slice:
        """The nodes of a phase."""
        return slice(int(self.first_nodes[index]), int(self.first_nodes[index + 1]) + 1)

    @property
    def _duration_bounds(self) -> Array:
        """Least and largest durations (2, phases) of the phases, s."""
        return np.array([phase.bounds for phase in self.phases]).T

    @cached_property
    def _box(self) -> tuple[Array, Array]:
        """Bounds of the variables, scaled."""
        limits = self.node_rows.limits
        ends = self.ends
        postures = np.vstack([ends, *(end.y for end in self._fixed_ends)])
        least = postures.min(axis=0)
        most = postures.max(axis=0)
        low = np.append(least[0] - PROGRAM.base_range, np.minimum(limits.position[:, 0], least[1:]))
        high = np.append(most[0] + PROGRAM.base_range, np.maximum(limits.position[:, 1], most[1:]))
        largest_factor = PROGRAM.largest_factor if self._limits else 1.0
        fastest = np.append(PROGRAM.base_rate, largest_factor * limits.velocity)
        box = self._shapes.map(lambda shape: np.stack((np.full(shape, -np.inf), np.full(shape, np.inf))))
        box.y[:] = np.stack((low, high))[:, :, None]
        box.v[:] = np.stack((-fastest, fastest))[:, :, None]
        if not self.periodic:
            bound_ends(box, self.phases, ends, self.begin_rates)
        for end in self._fixed_ends:
            node = self.first_nodes[self.flights[0] + (1 if end.node else 0)]
            for bound, fixed in ((box.y, end.y), (box.v, end.v), (box.a, end.a)):
                if fixed is not None:
                    bound[:, :, node] = fixed
        for index, phase in enumerate(self.phases):
            if phase.others:
                towards_flight = self.phases[index + (1 if phase.side == "takeoff" else -1)]
                bound_forces(box.forces[index], phase, towards_flight, limits.least_force * self.node_rows.weight)
        box.durations[:] = self._duration_bounds[:, :, None]
        if self._fixed_momentum is not None:
            box.momenta[:] = self._fixed_momentum
        box.factor[0] = 0.0
        box.factor[1] = PROGRAM.largest_factor
        return self.join(box.map(lambda bound: bound[0])), self.join(box.map(lambda bound: bound[1]))

    @cached_property
    def compiled(self) -> CompiledProgram:
        """The program as functions."""
        ca = casadi()
        unit = self.node_rows.time_unit
        size = sum(rows * columns for rows, columns in self._shapes.matrices())
        raw = ca.MX.sym("w", size + len(self.separation.start))
        variables = self.split(raw)
        motion = (variables.y, variables.v, variables.a)
        rows = Rows(variables.factor if self._limits else None)
        total = 0.0
        rough = 0.0
        for index, phase in enumerate(self.phases):
            y, v, a = (values[:, self.nodes_of(index)] for values in motion)
            if not phase.intervals:
                self._add_seam(rows, (y, v, a), variables.momenta)  # of its only flight, which is fixed
                continue
            duration = variables.durations[index]
            step = duration * ca.DM(np.diff(phase.progress)).T
            joints = (y[1:, :], v[1:, :], a[1:, :])
            self._add_links(rows, (y, v, a) if phase.others else joints, step, phase.side)
            if not phase.others:
                self._add_base(rows, phase, (y, v, a), step)
            if phase.side == "flight":
                cost = self._add_flight(rows, index, (y, v, a), duration, variables.momenta[phase.flight_number])
            else:
                cost = self._add_stance(rows, index, (y, v, a), variables)
                if meets_next(self.phases, index, self.periodic):
                    add_meeting(rows, self.node_rows, index, variables, self.periodic)
            self._add_rates(rows, joints, step, phase.name)
            total += ca.dot(step, (cost[:, :-1] + cost[:, 1:]) / 2)
            rough += ca.sumsqr(unit**2 * ca.diff(joints[2], 1, 1))
        shortfall_cost = self.separation.add(self.node_rows, rows, (*motion, variables.durations), raw[size:])
        if self._limits:
            cost = variables.factor + PROGRAM.smoothness * (total / unit + PROGRAM.steadiness * rough)
        else:
            total += ca.dot(ca.DM(duration_costs(self.phases)), variables.durations)
            cost = total / unit + PROGRAM.roughness * rough
        options = ipopt_options(ITERATIONS, not self.phases[self.flights[0]].intervals, self._warm)
        callback = stop_when_overloaded(raw.shape[0], np.concatenate(rows.low), np.concatenate(rows.high))
        all_rows = ca.vertcat(*rows.values)
        solver, evaluate = rows.at_nodes.solver(raw, shortfall_cost + cost, all_rows, options, callback)
        return CompiledProgram(solver, evaluate, rows, callback)

    def _add_links(self, rows: Rows, motion: Sequence[Any], step: Any, label: str) -> None:
        """Between nodes accelerations are linear."""
        y, v, a = motion
        step = casadi().repmat(step, y.shape[0], 1)
        rates = v[:, 1:] - v[:, :-1] - step / 2 * (a[:, :-1] + a[:, 1:])
        rows.add(rates * self.node_rows.time_unit, 0.0, 0.0, f"motion ({label})")
        ahead = y[:, :-1] + step * v[:, :-1] + step**2 / 6 * (2 * a[:, :-1] + a[:, 1:])
        rows.add(y[:, 1:] - ahead, 0.0, 0.0, f"motion ({label})")

    def _add_rates(self, rows: Rows, joints: Sequence[Any], step: Any, label: str) -> None:
        """Rates in the middle between nodes; at nodes they are bounds, unless a factor is minimised."""
        ca = casadi()
        fastest = self.node_rows.limits.velocity
        names = self.model.robot.joints
        limited = np.flatnonzero(np.isfinite(fastest)).tolist()
        if not limited:
            return
        _, v, a = (values[limited, :] for values in joints)
        middle = (v[:, 1:] + v[:, :-1]) / 2 + ca.repmat(step, len(limited), 1) / 8 * (a[:, :-1] - a[:, 1:])
        bounds = [Bound(-1.0, 1.0, f"rate of {names[joint]}", "share") for joint in limited]
        for rates in (middle, v) if self._limits else (middle,):
            most = np.ones(rates.shape)
            rows.add_nodes(ca.mtimes(ca.DM(np.diag(1 / fastest[limited])), rates), bounds, -most, most, label)

    def _add_base(self, rows: Rows, phase: Phase, motion: Sequence[Any], step: Any) -> None:
        """Orientation by Hermite's rule, on one point after the momentum about it, as of ``model``."""
        model = self.model
        y, v, a = motion
        if phase.contacts:
            about = model.function("about", model.momentum_about(phase.anchor.spots[0]))
            momenta, first, second = rows.at_nodes(about, y, v, a)
            ahead = quadrature_step(momenta, first, second, step)
            rows.add(
                (momenta[:, 1:] - ahead) / self.node_rows.momentum_unit, 0.0, 0.0, f"{Label.BALANCE} ({phase.side})"
            )
        rows.add(y[0, 1:] - quadrature_step(y[0, :], v[0, :], a[0, :], step), 0.0, 0.0, f"turn ({phase.side})")

    def _add_stance(self, rows: Rows, index: int, motion: Sequence[Any], variables: Variables) -> Any:
        """Rows of a stance's nodes, and its cost (1, nodes)."""
        ca = casadi()
        phase = self.phases[index]
        function, bounds = self.node_rows.stance(phase)
        forces = variables.forces[index] / self.node_rows.weight
        ends = ca.DM(np.stack((1 - phase.progress, phase.progress)))
        closing = ca.mtimes(variables.closing_accelerations[index], ends)
        values, torques, load = rows.at_nodes(function, *motion, forces, closing)
        low, high = self._stance_bounds(index, bounds)
        rows.add_nodes(values, bounds, low, high, phase.name)
        cost = ca.sum1(torques**2)
        if phase.side == "landing" and self.phases[index - 1].side == "flight" and not phase.gentle:
            times = variables.durations[index] * ca.DM(phase.progress).T
            if self.node_rows.limits.pitch_error:
                self._add_rotated_landing(rows, phase, motion, times)
            abruptness = PROGRAM.abruptness_of_shares if self._limits else PROGRAM.abruptness
            cost = cost + onset_cost(load, times, abruptness)
        return cost

    def _stance_bounds(self, index: int, bounds: Sequence[Bound]) -> tuple[Array, Array]:
        """Bounds (rows, nodes) of a stance's rows; a node between two phases is that of the one with more contacts."""
        phase = self.phases[index]
        takeoff = phase.side == "takeoff"
        seam = -1 if takeoff else 0  # the node towards the flight
        outer = -1 - seam
        towards_flight = self.phases[index + 1 if takeoff else index - 1]
        at_flight = towards_flight.side == "flight"
        in_middle = meets_next(self.phases, index, self.periodic)
        stays = {f"friction of {contact.name}" for contact in towards_flight.contacts}
        implied = self._implied if at_flight else set()
        low, high = _repeated(bounds, phase.intervals + 1)
        for row, bound in enumerate(bounds):
            kind = bound.kind
            if kind in ("release", "meets"):  # rows of the seam only
                low[row] = -np.inf
                high[row] = np.inf
                if at_flight or kind == "meets":
                    low[row, seam] = 0.0
                    high[row, seam] = 0.0
                if kind == "meets" and in_middle:
                    low[row, outer] = 0.0
                    high[row, outer] = 0.0
            if kind == "least_force":
                low[row] *= phase.force_shares
            if kind == "stands" and phase.others[0].vertical:
                # At rest accelerations are fixed, so that the row would be there twice.
                begins_still = index == 0 and self.begin_rates is None
                low[row, outer] = -np.inf if begins_still or index == len(self.phases) - 1 else 0.0
                high[row, outer] = -low[row, outer]
            if kind == "friction":
                low[row, 1:-1] = PROGRAM.cone_margin * phase.force_shares[1:-1]
                if bound.label not in stays:  # where there is no force, nothing is inside the cone
                    low[row, seam] = -np.inf
            if kind in implied or (at_flight and kind == "least_force"):
                low[row, seam] = -np.inf
                high[row, seam] = np.inf
        if outer_phase(self.phases, index) is not None:
            low[:, outer] = -np.inf
            high[:, outer] = np.inf
        return low, high

    def _add_rotated_landing(self, rows: Rows, phase: Phase, motion: Sequence[Any], times: Any) -> None:
        """Points stay above the ground also where the robot lands rotated by the pitch error.

        The height that is required falls with the times (1, nodes) s from the landing on, to nothing after
        ``TOUCHDOWN``.
        """
        ca = casadi()
        function, least = self.node_rows.rotated_heights(phase)
        (heights,) = rows.at_nodes(function, *motion)
        heights += ca.mtimes(ca.DM(least), times / TOUCHDOWN)
        low = np.repeat(least[:, None], len(phase.progress), axis=1)
        bounds = [Bound(0.0, np.inf, Label.CLEAR, "point")] * len(least)
        label = f"landing, turned by {np.degrees(self.node_rows.limits.pitch_error):.1f} degrees"
        rows.add_nodes(heights, bounds, low, np.full(low.shape, np.inf), label)

    @property
    def _implied(self) -> set[Kind]:
        """What holds by itself where the stances meet a flight whose rates are fixed."""
        implied: set[Kind] = set()
        for end in self._fixed_ends:
            if end.v is not None:
                implied.add("meets")
                if end.a is not None:
                    implied |= {"balance", "release"}
        return implied

    def _add_flight(self, rows: Rows, index: int, motion: Sequence[Any], duration: Any, momentum: Any) -> Any:
        """Rows of a flight: momentum, parabola, limits and heights; and its cost (1, nodes)."""
        ca = casadi()
        phase = self.phases[index]
        gravity = self.model.gravity
        unit = self.node_rows.time_unit
        y, v, a = motion
        count = phase.intervals + 1
        z0, vx0, vz0 = self._com(rows, index - 1, (y[:, 0], v[:, 0], a[:, 0]))
        z1, vx1, vz1 = self._com(rows, index + 1, (y[:, -1], v[:, -1], a[:, -1]))
        rows.add((z1 - z0 - vz0 * duration + gravity * duration**2 / 2) / self.node_rows.height, 0.0, 0.0, "parabola")
        rows.add((vx1 - vx0) / (gravity * unit), 0.0, 0.0, "parabola")
        rows.add((vz1 - vz0 + gravity * duration) / (gravity * unit), 0.0, 0.0, "parabola")
        times = duration * ca.DM(phase.progress).T
        ground = grounds_below(phase.progress, self.phases[index - 1].rise, self.phases[index + 1].rise)
        com_heights = z0 + vz0 * times - gravity * times**2 / 2 - ca.DM(ground).T
        lifts = self.lift * np.minimum(1.0, 16 * (phase.progress * (1 - phase.progress)) ** 2)
        function, bounds = self.node_rows.of_flight()
        values, torques = rows.at_nodes(function, y, v, a)
        is_foot = np.array([float(bound.kind == "foot") for bound in bounds])
        is_point = np.array([float(bound.kind == "point") for bound in bounds])
        over_ground = ca.mtimes(ca.sparsify(ca.DM(is_foot + is_point)), com_heights)
        values += over_ground - ca.sparsify(ca.DM(np.outer(is_foot, lifts)))
        values[0, :] -= ca.repmat(momentum / self.node_rows.momentum_unit, 1, count)
        low, high = _repeated(bounds, count)
        for end in (0, -1):  # the stances require all but the momentum there
            low[1:, end] = -np.inf
            high[1:, end] = np.inf
        rows.add_nodes(values, bounds, low, high, "flight")
        if self._beyond is not None:
            add_distance(rows, self.node_rows, index, (y, v, a), vx0 * duration, self._beyond)
        return ca.sum1(torques**2)

    def _add_seam(self, rows: Rows, state: Sequence[Any], momentum: Any) -> None:
        """Where a flight is fixed, its momentum and the velocity of its centre of mass, if the rates do not say so."""
        model = self.model
        speed_unit = model.gravity * self.node_rows.time_unit
        scales = (self.node_rows.momentum_unit, speed_unit, speed_unit)
        for end in self._fixed_ends:
            if end.com_velocity is None:
                continue
            stance = self.phases[self.flights[0] + (1 if end.node else -1)]
            spot = stance.anchor.spots[0]
            function = model.function("seam", [model.momentum(), *model.com_from(spot, 1)])
            values = rows.at_nodes(function, *state)
            for value, fixed, scale in zip(values, (momentum, *end.com_velocity), scales, strict=True):
                rows.add((value - fixed) / scale, 0.0, 0.0, "velocity and momentum of the flight")

    def _com(self, rows: Rows, index: int, state: Sequence[Any]) -> tuple[Any, Any, Any]:
        """Height of the centre of mass over the first ground, and its velocity, where a stance's anchor stands."""
        model = self.model
        anchor = self.phases[index].anchor
        _, height = model.com_from(anchor.spots[0])
        rates = model.com_from(anchor.spots[0], 1)
        z, vx, vz = rows.at_nodes(model.function("com", [height, *rates]), *state)
        return z + anchor.depth + self.phases[index].rise, vx, vz

    def solve(self, guess: Array) -> JumpSolution:
        """Run IPOPT from a guess (size,), scaled as :meth:`join` does, and directions that separate."""
        solver, evaluate, rows, callback = self.compiled
        low = np.concatenate(rows.low)
        high = np.concatenate(rows.high)
        box = self.box

        def violations(raw: Array) -> Array:
            values = np.asarray(evaluate(raw)).ravel()
            return np.asarray(np.maximum(np.maximum(low - values, values - high), 0.0))

        start = np.append(guess, self.separation.start)
        callback.overloaded = None
        callback.overloaded_joints = self.overloaded_joints
        result = solver(x0=start, lbx=box[0], ubx=box[1], lbg=low, ubg=high)
        callback.overloaded_joints = None
        stats = solver.stats()
        raw = np.asarray(result["x"]).ravel()
        if not np.isfinite(raw).all():  # IPOPT met numbers that are none
            raw = start
        violation = PROGRAM.converged_violation if stats["success"] else PROGRAM.violation
        holds = violations(raw).max() < violation
        shortfall = 0.0
        if len(raw) > len(guess):  # the last of the separation's variables
            shortfall = float(raw[-1])
            raw[-1] = 0.0
        off = violations(raw)
        worst = int(off.argmax())
        variables = self.split(raw)
        return JumpSolution(
            y=variables.y,
            v=variables.v,
            a=variables.a,
            forces=tuple(variables.forces),
            durations=variables.durations.ravel(),
            momenta=variables.momenta.ravel(),
            factor=float(variables.factor.sum()) if self._limits else 1.0,
            worst=(float(off[worst]), rows.labels[worst]),
            shortfall=shortfall if holds else np.inf,
            iterations=int(stats["iter_count"]),
            overloaded=callback.overloaded or (),
        )

    def overloaded_joints(self, raw: Array) -> tuple[str, ...]:
        """Locked joints that bear too much, and have no rows, where variables and directions are ``raw`` (size,)."""
        variables = self.split(raw)
        factor = float(variables.factor.sum()) if self._limits else 1.0
        motion = (variables.y, variables.v, variables.a)
        return self.node_rows.missing_rows(motion, variables.forces, factor).locked_joints

    @property
    def box(self) -> Array:
        """Bounds (2, size) of the variables, scaled, and of directions."""
        return np.concatenate((np.stack(self._box), self.separation.box), axis=1)

    @property
    def labels(self) -> list[str]:
        """What the bounds of the variables and directions are about; "" where that is no limit."""
        of_nodes = np.searchsorted(self.first_nodes[1:-1], np.arange(self.nodes), "right")
        labels = self._shapes.limit_labels(self.phases, of_nodes, self.model.robot.joints)
        of_variables = np.concatenate([np.ravel(matrix, order="F") for matrix in labels.matrices()])
        return [*of_variables, *[""] * len(self.separation.start)]

    def warm(self) -> Self:
        """The same program, solved near a guess in which all but little holds, in few iterations or not at all."""
        other = self.extended(self.separation, self.node_rows.extra)
        other._warm = True
        return other

    def extended(self, separation: Separation, extra: ExtraRows) -> Self:
        """The same program with distances that it requires, and extra rows of what is left out at first."""
        other = copy(self)
        vars(other).pop("compiled", None)
        other.node_rows = copy(self.node_rows)
        other.node_rows.extra = extra
        other.separation = separation
        return other

    def motion(self, guess: Array) -> list[Array]:
        """Values of y, v, a (n+1, K+1) and durations (phases, 1) of a guess (size,)."""
        variables = self.split(guess)
        return [variables.y, variables.v, variables.a, variables.durations]

    def guess(self, rng: np.random.Generator | None = None) -> Array:
        """Return the generic guess; with random numbers a perturbed one.

        Joints as they stand, the base rotated by smoothsteps from each takeoff's last phase to its landing's first,
        nothing else.
        """
        durations = np.array([phase.duration for phase in self.phases])
        joints = np.linspace(self.ends[0, 1:], self.ends[-1, 1:], self.nodes).T
        if rng is not None:
            durations = np.clip(durations * rng.uniform(0.75, 1.35, len(durations)), *self._duration_bounds)
            bumps = np.sin(np.pi * np.linspace(0, 1, self.nodes)[None] * rng.integers(1, 4, (self.size - 1, 1)))
            joints = joints + rng.uniform(-0.3, 0.3, (self.size - 1, 1)) * bumps
        times = instants(self.phases, durations)
        guess = self._shapes.map(np.zeros)
        guess.y[:] = np.vstack((np.full(self.nodes, self.ends[0, 0]), joints))
        for index, rotation in zip(self.flights, np.diff(self.ends[:, 0]), strict=True):
            begin, end = times[self.first_nodes[np.clip([index - 1, index + 2], 0, len(self.phases))]]
            share = np.clip((times - begin) / (end - begin), 0.0, 1.0)
            guess.y[0] += rotation * share**2 * (3 - 2 * share)
            guess.v[0] += rotation * 6 * share * (1 - share) / (end - begin)
        guess.durations[:, 0] = durations
        guess.factor[:] = 1.0
        return self.join(guess)

    def resampled(self, solution: JumpSolution, phases: Sequence[Phase]) -> Array:
        """Return the solution of a program with other numbers of nodes in its ``phases``, as a guess."""
        curve = quintic_spline(instants(phases, solution.durations), np.stack((solution.y, solution.v, solution.a)))
        guess = self._shapes.map(np.zeros)
        guess.y, guess.v, guess.a = values(curve, instants(self.phases, solution.durations))
        for index, (own, other) in enumerate(zip(self.phases, phases, strict=True)):
            for row, force in enumerate(solution.forces[index]):
                guess.forces[index][row] = np.interp(own.progress, other.progress, force)
        guess.durations[:, 0] = solution.durations
        guess.momenta[:, 0] = solution.momenta
        guess.factor[:] = solution.factor
        return self.join(guess)


def _repeated(bounds: Sequence[Bound], count: int) -> tuple[Array, Array]:
    """Low and high bounds (rows, count) of rows at so many nodes."""
    columns = np.array([(bound.low, bound.high) for bound in bounds], dtype=float)
    return np.tile(columns[:, :1], (1, count)), np.tile(columns[:, 1:], (1, count))
