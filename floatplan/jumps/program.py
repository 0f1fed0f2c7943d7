"""One nonlinear program over all phases of a jump, from standing to standing, for IPOPT.

Variables at the nodes are y = (theta_0, q), y', y'' and the forces of all contacts but the anchor's; beside them drifts
of closed chains, the phases' durations and the angular momentum h of the flight. Between nodes y'' is linear:

``y'_1 = y'_0 + T (y''_0 + y''_1) / 2``,  ``y_1 = y_0 + T y'_0 + T^2 (2 y''_0 + y''_1) / 6``.

In stance the base hangs on the anchor, whose force is ``m (c'' + g)`` less the others'; the balance of moments holds
at every node. On one point the momentum about it and the orientation follow by Hermite's rule instead. Where more
stand, the others do not accelerate, but for a drift, linear in time, that closes the chain at both ends. In flight h is
constant, ``D y' = h``, the centre of mass is on its parabola, and the orientation follows by Hermite's rule. Both seams
are exact: there forces vanish, and h and the parabola are those of either side. Least are the squared torques; or a
factor, one more variable, that is no less than any share of a limit on torques, torque-speed curves and rates. One side
alone is a jump whose flight, of no intervals, is known.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np

from floatplan.arrays import Array
from floatplan.jumps.check import TOUCHDOWN
from floatplan.jumps.held import first_look
from floatplan.jumps.model import casadi
from floatplan.jumps.motion import hermite, values
from floatplan.jumps.phases import Meeting, Phase, instants, unsteady
from floatplan.jumps.rows import (
    BALANCE,
    CLEAR,
    MEETS,
    PRESSED,
    RELEASE,
    STANDS,
    NodeRows,
    Rows,
    drifting,
    hermite_step,
)
from floatplan.jumps.separation import SLIGHT, Separation
from floatplan.tables import POINT_FEET

LIFT = 0.02  # [m] of feet in the middle of the flight
LOW_LIFT = 2 * POINT_FEET  # [m] of hops that do not reach that: the legs of slow motors extend by 0.5 m/s at most
CONE_ROOM = 0.02  # [-] of the weight, that forces keep inside the cone, but at nodes where contacts change
TURN_ROOM = 1.5  # [rad] of the base beyond its start and goal
FASTEST_TURN = 40.0  # [rad/s] of the base
ROUGHNESS = 3e-4  # [-] of steps of accelerations, beside the squared torques
SMOOTH = 0.03  # [-] weight of squared torques, beside the factor
STEADY = 1e-3  # [-] weight of steps of torques, beside their squares
ONSET = 0.012  # [s] in which the ground's force may grow by the weight: feet land by so much late and early
ABRUPT = 10.0  # [-] cost of the square of force over the weight beyond that, in which 3 to 100 make little difference
ROUNDED = 0.02  # [-] of the weight, by which the corner of that cost is rounded
MOST = 20.0  # [-] the largest factor that is looked for
HELD = 1e-8  # [-] what constraints may be off
IPOPT = {"print_level": 0, "sb": "yes", "tol": 1e-6, "constr_viol_tol": HELD, "mu_strategy": "adaptive"}
IPOPT["max_hessian_perturbation"] = 1e6  # more takes seconds an iteration
ONE_SIDE = {"adaptive_mu_globalization": "never-monotone-mode"}  # where the flight is known: guesses that nearly hold
IPOPT["mumps_mem_percent"] = 20  # [%] beyond what it expects: of ten times that, most time went to the system
IPOPT["mumps_pivot_order"] = 0  # by approximate minimum degree, with which MUMPS is faster than with what it chooses
CONVERGED = 1e-6  # [-] what they may be off where IPOPT ends
ITERATIONS = 250  # 40 to 125 find a first solution where there is one, more those near what stands in the way
WARM = {
    "mu_strategy": "monotone",
    "mu_init": 1e-4,
    "mu_target": 1e-4,
    "bound_push": 1e-5,
    "bound_frac": 1e-5,
    "max_iter": 80,
}
AROUND = 250  # [-] of IPOPT where distances are kept: what is missing of them lets it begin near an answer


@dataclass(frozen=True, eq=False)
class Solution:
    """Values at the K+1 nodes of a jump.

    Attributes
    ----------
    y, v, a : (n+1, K+1)
    forces : for each phase (2 (contacts - 1), nodes of the phase) N, of its contacts but the anchor
    durations : (phases,) s
    momentum : h, kg m^2/s
    factor : largest share of a limit, where that was least; else 1
    worst : largest violation of a constraint, scaled; and which it is
    missing : of distances that are kept, where all else holds, though the cost may not be least; else infinite, m
    iterations : int
    strained : joints that are held and bear too much in the first motion that holds, at which the search stopped
    """

    y: Array
    v: Array
    a: Array
    forces: tuple[Array, ...]
    durations: Array
    momentum: float
    factor: float
    worst: tuple[float, str]
    missing: float
    iterations: int
    strained: tuple[str, ...] = ()

    @property
    def converged(self) -> bool:
        """Whether every constraint holds."""
        return self.missing <= SLIGHT and not self.strained


class JumpProgram:
    """The program of a jump; built once, solved from any guess.

    Parameters
    ----------
    node : NodeRows of the jump's phases
    separation : what it keeps apart
    fixed : what is known of the flight's ends
    momentum : kg m^2/s, where it is given
    limits : whether the factor on limits is least, instead of squared torques
    iterations : of IPOPT at most
    lift : of feet in the middle of the flight, m
    """

    def __init__(
        self,
        node: NodeRows,
        separation: Separation,
        fixed: Sequence[Meeting] = (),
        momentum: float | None = None,
        limits: bool = False,
        iterations: int = ITERATIONS,
        lift: float = LIFT,
    ) -> None:
        self.node = node
        self.model = node.model
        self.phases = node.phases
        self.ends = node.ends
        self.size = 1 + len(self.model.robot.joints)
        self.starts = node.starts
        self.flight = node.flies
        self.nodes = int(self.starts[-1]) + 1
        self.separation = separation
        self._fixed = tuple(fixed)
        self._momentum = momentum
        self._limits = limits
        self._iterations = iterations
        self._warm = False
        self.lift = lift

    @cached_property
    def _shapes(self) -> list[tuple[int, int]]:
        """Sizes of y, v, a; then of each phase's forces and drifts; of durations, h, and the factor."""
        forces = [(2 * len(phase.others), phase.intervals + 1) for phase in self.phases]
        drifts = [(drifting(phase), 2) for phase in self.phases]
        return [*[(self.size, self.nodes)] * 3, *forces, *drifts, (len(self.phases), 1), (1, 1), (int(self._limits), 1)]

    @cached_property
    def _scales(self) -> list[float]:
        node = self.node
        count = len(self.phases)
        return [1.0, 1 / node.unit, 1 / node.unit**2, *[node.weight] * count, *[1.0] * (count + 1), node.momentum, 1.0]

    def split(self, raw: Any) -> list[Any]:
        """Variables (size,), scaled, as matrices of their own units: an expression, or numbers."""
        parts = []
        at = 0
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
        bounds = self.node.bounds
        ends = self.ends
        known = np.vstack([ends, *(each.y for each in self._fixed)])
        least = known.min(axis=0)
        most = known.max(axis=0)
        low = np.append(least[0] - TURN_ROOM, np.minimum(bounds.position[:, 0], least[1:]))
        high = np.append(most[0] + TURN_ROOM, np.maximum(bounds.position[:, 1], most[1:]))
        fastest = np.append(FASTEST_TURN, (MOST if self._limits else 1.0) * bounds.velocity)
        parts = [np.stack((np.full(shape, -np.inf), np.full(shape, np.inf))) for shape in self._shapes]
        y, v, a = parts[:3]
        y[:] = np.stack((low, high))[:, :, None]
        v[:] = np.stack((-fastest, fastest))[:, :, None]
        for node in (0, -1):
            if self.phases[node].contacts:
                y[:, :, node] = ends[node]
                v[:, :, node] = 0.0
                a[:, :, node] = 0.0
        for each in self._fixed:
            node = self.starts[self.flight + (1 if each.node else 0)]
            for part, held in ((y, each.y), (v, each.v), (a, each.a)):
                part[:, :, node] = part[:, :, node] if held is None else held
        for index, phase in enumerate(self.phases):
            if phase.others:
                self._bound_forces(parts[3 + index], phase, self.phases[index + (1 if phase.side == "takeoff" else -1)])
        parts[-3][:] = np.array([phase.bounds for phase in self.phases]).T[:, :, None]
        if self._momentum is not None:
            parts[-2][:] = self._momentum
        parts[-1][0] = 0.0
        parts[-1][1] = MOST
        return self.join([part[0] for part in parts]), self.join([part[1] for part in parts])

    def _bound_forces(self, box: Array, phase: Phase, inner: Phase) -> None:
        """Bounds (2, 2 others, nodes) of forces: unilateral; nothing where a contact leaves or comes."""
        box[0, 1::2] = self.node.bounds.pressed * self.node.weight * phase.firm
        seam = -1 if phase.side == "takeoff" else 0
        stays = [contact.name for contact in inner.contacts]
        for row, contact in enumerate(phase.others):
            if contact.vertical:
                box[:, 2 * row] = 0.0
            if contact.name not in stays:
                box[:, 2 * row : 2 * row + 2, seam] = 0.0

    @cached_property
    def stated(self) -> tuple[Any, Any, Rows]:
        """IPOPT's solver, a function of the variables for all rows, and the rows."""
        solver, evaluate, rows, _ = self._stated
        return solver, evaluate, rows

    @cached_property
    def _stated(self) -> tuple[Any, Any, Rows, Any]:
        """As :attr:`stated`, and the look at iterates, which CasADi does not keep alive."""
        ca = casadi()
        unit = self.node.unit
        size = sum(rows * columns for rows, columns in self._shapes)
        raw = ca.MX.sym("w", size + len(self.separation.start))
        y, v, a, *rest = self.split(raw)
        count = len(self.phases)
        forces = rest[:count]
        drifts = rest[count:-3]
        durations, momentum, factor = rest[-3:]
        rows = Rows(factor if self._limits else None)
        total = 0.0
        rough = 0.0
        for index, phase in enumerate(self.phases):
            nodes = slice(int(self.starts[index]), int(self.starts[index + 1]) + 1)
            parts = [each[:, nodes] for each in (y, v, a)]
            if not phase.intervals:
                self._add_seam(rows, parts, momentum)
                continue
            step = durations[index] * ca.DM(np.diff(phase.shares)).T
            joints = [each[1:, :] for each in parts]
            self._add_links(rows, parts if phase.others else joints, step, phase.side)
            if not phase.others:
                self._add_turn(rows, phase, parts, step)
            if phase.side == "flight":
                cost = self._add_flight(rows, parts, durations[index], momentum)
            else:
                cost = self._add_stance(rows, phase, parts, forces[index], drifts[index], durations[index])
            self._add_rates(rows, joints, step, phase.name)
            total += ca.dot(step, (cost[:, :-1] + cost[:, 1:]) / 2)
            rough += ca.sumsqr(unit**2 * ca.diff(parts[2][1:, :], 1, 1))
        apart = self.separation.add(self.node, rows, (y, v, a, durations), raw[size:])
        total += 0.0 if self._limits else ca.dot(ca.DM(unsteady(self.phases)), durations)
        cost = total / unit + (STEADY if self._limits else ROUGHNESS) * rough
        cost = factor + SMOOTH * cost if self._limits else cost
        settings = IPOPT | {"max_iter": self._iterations} | ({} if self.phases[self.flight].intervals else ONE_SIDE)
        settings |= WARM if self._warm else {}
        look = first_look(raw.shape[0], np.concatenate(rows.low), np.concatenate(rows.high))
        return *rows.calls.solver(raw, apart + cost, ca.vertcat(*rows.values), settings, look), rows, look

    def _add_links(self, rows: Rows, parts: Sequence[Any], step: Any, label: str) -> None:
        """Between nodes accelerations are linear."""
        y, v, a = parts
        step = casadi().repmat(step, y.shape[0], 1)
        rates = v[:, 1:] - v[:, :-1] - step / 2 * (a[:, :-1] + a[:, 1:])
        rows.add(rates * self.node.unit, 0.0, 0.0, f"motion ({label})")
        ahead = y[:, :-1] + step * v[:, :-1] + step**2 / 6 * (2 * a[:, :-1] + a[:, 1:])
        rows.add(y[:, 1:] - ahead, 0.0, 0.0, f"motion ({label})")

    def _add_rates(self, rows: Rows, joints: Sequence[Any], step: Any, label: str) -> None:
        """Rates in the middle between nodes; at nodes they are bounds, unless a factor is least."""
        ca = casadi()
        fastest = self.node.bounds.velocity
        names = self.model.robot.joints
        limited = np.flatnonzero(np.isfinite(fastest)).tolist()
        if limited:
            _, v, a = (each[limited, :] for each in joints)
            middle = (v[:, 1:] + v[:, :-1]) / 2 + ca.repmat(step, len(limited), 1) / 8 * (a[:, :-1] - a[:, 1:])
            bounds = [(-1.0, 1.0, f"rate of {names[joint]}") for joint in limited]
            for rates in (middle, v) if self._limits else (middle,):
                most = np.ones(rates.shape)
                rows.add_nodes(ca.mtimes(ca.DM(np.diag(1 / fastest[limited])), rates), bounds, -most, most, label)

    def _add_turn(self, rows: Rows, phase: Phase, parts: Sequence[Any], step: Any) -> None:
        """Orientation by Hermite's rule, on one point after the momentum about it, as of ``model``."""
        model = self.model
        y, v, a = parts
        if phase.contacts:
            about = model.function("about", model.momentum_about(phase.anchor.spots[0]))
            momenta, pulls, changes = rows.calls(about, y, v, a)
            ahead = hermite_step(momenta, pulls, changes, step)
            rows.add((momenta[:, 1:] - ahead) / self.node.momentum, 0.0, 0.0, f"{BALANCE} ({phase.side})")
        rows.add(y[0, 1:] - hermite_step(y[0, :], v[0, :], a[0, :], step), 0.0, 0.0, f"turn ({phase.side})")

    def _add_stance(
        self, rows: Rows, phase: Phase, parts: Sequence[Any], forces: Any, drifts: Any, duration: Any
    ) -> Any:
        """Rows of a stance's nodes; a node between two phases of a side is that of the one with more contacts."""
        ca = casadi()
        index = self.phases.index(phase)
        count = phase.intervals + 1
        function, bounds = self.node.stance(phase)
        linear = ca.mtimes(drifts, ca.DM(np.stack((1 - phase.shares, phase.shares))))
        values, torques, load = rows.calls(function, *parts, forces / self.node.weight, linear)
        cost = ca.sum1(torques**2)
        low, high = (np.tile([[row[side]] for row in bounds], (1, count)).astype(float) for side in (0, 1))
        takeoff = phase.side == "takeoff"
        seam, inner = (-1, self.phases[index + 1]) if takeoff else (0, self.phases[index - 1])
        flies = inner.side == "flight"
        kept = {f"friction of {contact.name}" for contact in inner.contacts}
        settled = self._settled if flies else set()
        for row, (_, _, label) in enumerate(bounds):
            kind = MEETS if label.endswith(MEETS) else label
            if kind in (RELEASE, MEETS):
                low[row] = -np.inf
                high[row] = np.inf
                if flies or kind == MEETS:
                    low[row, seam] = high[row, seam] = 0.0
            low[row] *= phase.firm if kind == PRESSED else 1.0
            if label.endswith(STANDS) and phase.others[0].vertical:
                low[row, -1 - seam] = -np.inf if phase in (self.phases[0], self.phases[-1]) else 0.0
                high[row, -1 - seam] = -low[row, -1 - seam]
            if label.startswith("friction"):
                low[row, 1:-1] = CONE_ROOM * phase.firm[1:-1]
                if label not in kept:  # where there is no force, nothing is inside the cone
                    low[row, seam] = -np.inf
            if kind in settled or (flies and kind == PRESSED):
                low[row, seam] = -np.inf
                high[row, seam] = np.inf
        if 0 <= (index - 1 if takeoff else index + 1) < len(self.phases):
            low[:, -1 - seam] = -np.inf
            high[:, -1 - seam] = np.inf
        rows.add_nodes(values, bounds, low, high, phase.name)
        touches_down = phase.side == "landing" and flies and not phase.gentle
        return cost + self._add_touchdown(rows, phase, parts, load, duration) if touches_down else cost

    def _add_touchdown(self, rows: Rows, phase: Phase, parts: Sequence[Any], load: Any, duration: Any) -> Any:
        """Rows of a landing that is not as planned, and what it costs that the ground's force grows at once.

        What is watched keeps its height also where the robot is turned by the pitch error; of that less and less is
        asked, nothing after ``TOUCHDOWN``. A foot that lands late is pressed down without a ground below it, and hits
        it the faster the more force it was to bear by then: what is beyond one weight in ``ONSET`` costs.
        """
        ca = casadi()
        times = duration * ca.DM(phase.shares).T
        if self.node.bounds.pitch_error:
            function, least = self.node.turned(phase)
            (heights,) = rows.calls(function, *parts)
            heights += ca.mtimes(ca.DM(least), times / TOUCHDOWN)
            low = np.repeat(least[:, None], len(phase.shares), axis=1)
            bounds = [(0.0, np.inf, CLEAR)] * len(least)
            turned = f"landing, turned by {np.degrees(self.node.bounds.pitch_error):.1f} degrees"
            rows.add_nodes(heights, bounds, low, np.full(low.shape, np.inf), turned)
        beyond = load - times / ONSET
        return ABRUPT * ((beyond + ca.sqrt(beyond**2 + ROUNDED**2)) / 2) ** 2

    @property
    def _settled(self) -> set[str]:
        """What holds by itself where the stances meet a flight that is known."""
        kinds = [[MEETS] if each.a is None else [MEETS, BALANCE, RELEASE] for each in self._fixed if each.v is not None]
        return {kind for each in kinds for kind in each}

    def _add_flight(self, rows: Rows, parts: Sequence[Any], duration: Any, momentum: Any) -> Any:
        """Rows of the flight: momentum, parabola, limits and heights."""
        ca = casadi()
        phase = self.phases[self.flight]
        gravity = self.model.gravity
        unit = self.node.unit
        y, v, a = parts
        count = phase.intervals + 1
        z0, vx0, vz0 = self._com(rows, self.flight - 1, [each[:, 0] for each in parts])
        z1, vx1, vz1 = self._com(rows, self.flight + 1, [each[:, -1] for each in parts])
        rows.add((z1 - z0 - vz0 * duration + gravity * duration**2 / 2) / self.node.height, 0.0, 0.0, "parabola")
        rows.add((vx1 - vx0) / (gravity * unit), 0.0, 0.0, "parabola")
        rows.add((vz1 - vz0 + gravity * duration) / (gravity * unit), 0.0, 0.0, "parabola")
        times = duration * ca.DM(phase.shares).T
        heights = z0 + vz0 * times - gravity * times**2 / 2
        lifts = self.lift * np.minimum(1.0, 16 * (phase.shares * (1 - phase.shares)) ** 2)
        function, bounds = self.node.flight()
        values, torques = rows.calls(function, y, v, a)
        feet = np.array([float(label.endswith("above the ground")) for _, _, label in bounds])
        over = feet + [float(label == CLEAR) for _, _, label in bounds]
        values += ca.mtimes(ca.sparsify(ca.DM(over)), heights) - ca.sparsify(ca.DM(np.outer(feet, lifts)))
        values[0, :] -= ca.repmat(momentum / self.node.momentum, 1, count)
        low, high = (np.tile([[row[side]] for row in bounds], (1, count)).astype(float) for side in (0, 1))
        for end in (0, -1):  # the stances hold all but the momentum there
            low[1:, end] = -np.inf
            high[1:, end] = np.inf
        rows.add_nodes(values, bounds, low, high, "flight")
        return ca.sum1(torques**2)

    def _add_seam(self, rows: Rows, state: Sequence[Any], momentum: Any) -> None:
        """Where a flight is known, its momentum and the velocity of its centre of mass, if the rates do not say so."""
        model = self.model
        unit = self.node.unit
        for each in self._fixed:
            if each.com is not None:
                spot = self.phases[self.flight + (1 if each.node else -1)].anchor.spots[0]
                found = rows.calls(model.function("seam", [model.momentum(), *model.com_from(spot, 1)]), *state)
                scales = (self.node.momentum, model.gravity * unit, model.gravity * unit)
                for value, given, scale in zip(found, (momentum, *each.com), scales, strict=True):
                    rows.add((value - given) / scale, 0.0, 0.0, "velocity and momentum of the flight")

    def _com(self, rows: Rows, index: int, state: Sequence[Any]) -> tuple[Any, Any, Any]:
        """Height of the centre of mass over the ground, and its velocity, where a stance's anchor stands."""
        model = self.model
        anchor = self.phases[index].anchor
        places = model.com_from(anchor.spots[0])
        rates = model.com_from(anchor.spots[0], 1)
        z, vx, vz = rows.calls(model.function("com", [places[1], *rates]), *state)
        return z + anchor.depth, vx, vz

    def solve(self, guess: Array) -> Solution:
        """Follow IPOPT from a guess (size,), scaled as :meth:`join` does, and directions that separate."""
        solver, evaluate, rows, look = self._stated
        look.overloaded = self.overloaded
        look.strained = None
        low = np.concatenate(rows.low)
        high = np.concatenate(rows.high)
        box = self.box

        def excess(raw: Array) -> Array:
            values = np.asarray(evaluate(raw)).ravel()
            return np.asarray(np.maximum(np.maximum(low - values, values - high), 0.0))

        answer = solver(x0=np.append(guess, self.separation.start), lbx=box[0], ubx=box[1], lbg=low, ubg=high)
        look.overloaded = None
        stats = solver.stats()
        raw = np.asarray(answer["x"]).ravel()
        if not np.isfinite(raw).all():  # IPOPT met numbers that are none
            raw = np.append(guess, self.separation.start)
        holds = excess(raw).max() < (CONVERGED if stats["success"] else HELD)
        left = raw[len(guess) :][-1:]  # of distances, a view: nothing without lines
        missing = float(left.sum()) if holds else np.inf
        left[:] = 0.0
        found = excess(raw)
        at = int(found.argmax())
        y, v, a, *rest = self.split(raw)
        return Solution(
            y=y,
            v=v,
            a=a,
            forces=tuple(rest[: len(self.phases)]),
            durations=rest[-3].ravel(),
            momentum=float(rest[-2].item()),
            factor=float(rest[-1].sum()) if self._limits else 1.0,
            worst=(float(found[at]), rows.labels[at]),
            missing=missing,
            iterations=int(stats["iter_count"]),
            strained=look.strained or (),
        )

    def overloaded(self, raw: Array) -> tuple[str, ...]:
        """Joints that are held, bear too much, and have no rows, where variables and directions are ``raw`` (size,)."""
        y, v, a, *rest = self.split(raw)
        factor = float(rest[-1].sum()) if self._limits else 1.0
        strained = self.node.strained((y, v, a), rest[: len(self.phases)], factor)
        return tuple(name for name in strained if name != CLEAR)

    @property
    def box(self) -> Array:
        """Bounds (2, size) of the variables, scaled, and of directions."""
        return np.concatenate((np.stack(self._box), self.separation.box), axis=1)

    @property
    def labels(self) -> list[str]:
        """What the bounds of the variables and directions are about; "" where that is no limit."""
        parts = [np.full(shape, "", object) for shape in self._shapes]
        names = self.model.robot.joints
        at = np.searchsorted(self.starts[1:-1], np.arange(self.nodes), "right")
        for part, words in zip(parts, ("range of", "rate of"), strict=False):
            part[1:] = [[f"{words} {name} ({self.phases[phase].name})" for phase in at] for name in names]
        parts[-3][:, 0] = [f"duration of ({phase.name})" for phase in self.phases]
        return [*np.concatenate([np.ravel(part, order="F") for part in parts]), *[""] * len(self.separation.start)]

    def warm(self) -> Self:
        """The same program, solved near a guess in which all but little holds, in few iterations or not at all."""
        other = self.kept(self.separation, self.node.held)
        other._warm = True
        return other

    def kept(self, separation: Separation, held: tuple[str, ...] = ()) -> Self:
        """The same program, with what it keeps apart, and what is among its rows of what is left out at first."""
        other = copy(self)
        for name in ("stated", "_stated"):
            vars(other).pop(name, None)
        other.node = copy(self.node)
        other.separation = separation
        other._iterations = AROUND if separation.lines else self._iterations
        other.node.held = held
        return other

    def motion(self, guess: Array) -> list[Array]:
        """Values of y, v, a (n+1, K+1) and durations (phases, 1) of a guess (size,)."""
        y, v, a, *_, durations, _, _ = self.split(guess)
        return [y, v, a, durations]

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
        times = instants(self.phases, durations)
        begin, end = (times[self.starts[np.clip(self.flight + at, 0, len(self.phases))]] for at in (-1, 2))
        share = np.clip((times - begin) / (end - begin), 0.0, 1.0)
        turn = self.ends[1, 0] - self.ends[0, 0]
        y = np.vstack((self.ends[0, 0] + turn * share**2 * (3 - 2 * share), joints))
        v = np.zeros_like(y)
        v[0] = turn * 6 * share * (1 - share) / (end - begin)
        rest = [np.zeros(shape) for shape in self._shapes[3:-3]]
        own = durations[:, None], np.zeros((1, 1)), np.ones((int(self._limits), 1))
        return self.join([y, v, np.zeros_like(y), *rest, *own])

    def resampled(self, solution: Solution, phases: Sequence[Phase]) -> Array:
        """Return the solution of a program with other numbers of nodes in its ``phases``, as a guess."""
        curve = hermite(instants(phases, solution.durations), np.stack((solution.y, solution.v, solution.a)))
        joined = values(curve, instants(self.phases, solution.durations))
        forces = [
            np.array([np.interp(own.shares, other.shares, row) for row in rows]).reshape(-1, len(own.shares))
            for own, other, rows in zip(self.phases, phases, solution.forces, strict=True)
        ]
        drifts = [np.zeros(shape) for shape in self._shapes[3 + len(phases) : -3]]
        rest = solution.durations[:, None], np.array([[solution.momentum]])
        return self.join([*joined, *forces, *drifts, *rest, np.full((int(self._limits), 1), solution.factor)])
