"""An update of a flight's corrections: the state that is expected, the filter, the rest of the flight corrected.

All of it is computed by the kernel, ``flight.hpp``, ``correcting.hpp`` and ``prediction.hpp``; this fills what these
read. The rest of the flight, joint motions (12) from now to the landing, is written anew exactly at each correction.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.polynomial.chebyshev import chebval

from floatplan.arrays import Array, read_only
from floatplan.compiled.bodies import Bodies, filled_robot
from floatplan.compiled.constraints import CompiledConstraints
from floatplan.inflight import estimate as filtering
from floatplan.inflight.estimate import Estimate, Expected, Measurement
from floatplan.inflight.prediction import LimitRows, Views
from floatplan.kernel.layout import ENUMERATIONS, Filled, constants, kernel
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.flight import GaussGrid
from floatplan.motion.quadrature import gauss_legendre
from floatplan.motion.sine_polynomial import Form, WrittenMotion, basis
from floatplan.plans.plan import Plan
from floatplan.robot.planar.tree import PlanarTree

LEAST_FREE = 6  # [-] free polynomials of each joint, also where the plan has fewer
EVALUATIONS_NEAR = 1  # [-] of changed motions at most
EVALUATIONS_FAR = 6  # [-] the same where the landing is far from the goal
FAR = 0.06  # [rad]
WEIGHED = 10.0  # [-] sigmas of the landing at most, against limits: one that is farther is approached from where it is
SETTLED = 0.1  # [-] of sigma, and of the cost: less is not worth a step
SHORTER = 0.3  # [-] of a step that is no better
MOST_ROWS = 24  # [-] of a block that are looked at in a step
KEPT = 1e-3  # [-] a row that is less below zero counts as kept
TAKEN_BACK = 0.1  # [-] of what earlier corrections changed and the landing does not need, by each
SCALES = (0.5, 0.25)  # [-] shares of a correction that are tried where the whole breaks a limit
MEMORY = 64  # [-] motions that are remembered, for measurements that come late
GAP_NODES = 5  # [-] of the quadrature between measurements
ROUNDING = 1e-9  # [s] of instants at the ends of a window
FILTER = ("state", "covariance", "surprises", "wander", "deviations")  # what is of an estimate
STEPS = ENUMERATIONS["Step"].__members__


@dataclass(eq=False)  # not frozen, for its speed: there is one per update
class RemainingMotion:
    """Joints from ``begin`` to ``end``, s since takeoff: ``centre + amplitude sin(p)``, p a polynomial of time.

    Attributes
    ----------
    centre, amplitude : (n,) rad
    begin, end : s
        The landing is at ``end``.
    coefficients : (6+m, n)
        Of p in ``basis``: p and two derivatives by u = (t - begin) / (end - begin) at both ends, then those of the m
        free polynomials.
    table : (3, k+1, 6+m)
        Of their values and two derivatives by u, in Chebyshev polynomials of 2 u - 1.
    """

    centre: Array
    amplitude: Array
    begin: float
    end: float
    coefficients: Array
    table: Array

    @property
    def remaining(self) -> float:
        """Time from ``begin`` to ``end``, s."""
        return self.end - self.begin

    def at(self, times: npt.ArrayLike) -> tuple[Array, Array, Array]:
        """Positions, velocities, accelerations (N, n) at times (N,), s since takeoff; at rest outside of its time."""
        instants = np.atleast_1d(np.asarray(times, dtype=np.float64))
        inside = np.minimum(np.maximum(instants - self.begin, 0.0), self.remaining)
        positions, velocities, accelerations = self._written.at(inside)
        outside = (instants > self.end) | (instants < self.begin)
        if outside.any():
            velocities[outside] = accelerations[outside] = 0.0
        return positions, velocities, accelerations

    @cached_property
    def _written(self) -> WrittenMotion:
        """The same by time since ``begin``."""
        p, rate, curvature = self.table @ self.coefficients
        chebyshev = p, rate / self.remaining, curvature / self.remaining**2
        return WrittenMotion(self.centre, self.amplitude, self.remaining, chebyshev)


class Rewriting:
    """What writes motions on a shorter time: the values at ``points``, Chebyshev's, fix all coefficients.

    Exact while the landing time stays. Where it moves, p keeps p, p', p'' at both ends, by time, and its free part.
    """

    def __init__(self, plan: Plan) -> None:
        size = max(plan.coefficients.shape[1], CONDITIONS + LEAST_FREE)
        self.form = Form(size - CONDITIONS)
        functions = basis(self.form)
        self.points = (1 - np.cos(np.pi * (np.arange(size) + 0.5) / size)) / 2
        self.of_values = np.linalg.inv(functions.values(self.points)[0])
        written = WrittenMotion.from_powers(plan.centre, plan.amplitude, plan.coefficients, plan.duration)
        coefficients = self.of_values @ chebval(2 * self.points - 1, written.chebyshev[0]).T
        boundary = np.stack([chebval([-1.0, 1.0], part).T for part in written.chebyshev])
        self.landing = read_only(boundary[:, 1])
        scale = plan.duration ** np.arange(3.0)[:, None]  # from derivatives by time to those by u
        coefficients[:3], coefficients[3:CONDITIONS] = boundary[:, 0] * scale, self.landing * scale
        self.first = RemainingMotion(
            np.array(plan.centre),
            np.array(plan.amplitude),
            0.0,
            plan.duration,
            read_only(coefficients),
            functions.series,
        )


@dataclass(eq=False)
class Corrected:
    """The motion that was chosen and what it leads to: its miss, rad, the least value of each block of rows.

    ``torque_peak`` (m,) N m is each motor's largest; ``share`` of the correction was taken.
    """

    motion: RemainingMotion
    miss: float
    worst: Array
    torque_peak: Array
    share: float


class Update:
    """Of one flight at a time: ``motions`` are those of the joints so far, the last one holds now.

    A miss of ``sigma`` rad at the landing is worth a correction by ``acceleration`` rad/s^2. ``row_values`` (rows, K)
    are those of the rows at all instants under the motion predicted last; infinite where none applies.
    """

    def __init__(self, tree: PlanarTree, views: Views, rewriting: Rewriting, sigma: float, acceleration: float) -> None:
        self.views, self._first, self._instants = views, rewriting.first, views.instants
        self.motions: deque[RemainingMotion] = deque(maxlen=MEMORY)
        blocks, grid, first = views.rows, views.instants, rewriting.first
        constraints = CompiledConstraints(views.flight, [rows.block for rows in blocks])
        bodies, n, width = constraints.bodies, tree.turns.shape[1], len(views.whitening)
        columns, motors = CONDITIONS + width, tree.motor_turns.shape[1]
        self._constraints, self._path = constraints.filled, constraints.path
        # Of the masses found: the robot's too.
        found = {name: np.zeros(bodies.real.shape) for name in ("real", "imaginary")}
        found |= {name: np.zeros(bodies.links.shape) for name in ("link_real", "link_imaginary")}
        self._robot = filled_robot(bodies, [width] * n)
        self._robot.point_to(**found)
        self._robot.structure.is_real = False
        shapes: dict[str, Any] = dict.fromkeys(("positions", "velocities"), n)
        shapes |= {"measured_positions": n, "measured_velocities": n, "map": n + 1, "asked": (3, n)}
        shapes |= dict.fromkeys(("coefficients", "planned"), (columns, n)) | {"warm_start": (width, n)}
        shapes |= {"torques": n + motors, "worst": len(blocks), "torque_peak": motors}
        shapes |= {"row_values": (constraints.rows, len(grid.s))}
        self._called = {name: np.zeros(shape) for name, shape in shapes.items()}
        self.row_values = self._called["row_values"]
        gap, law = gauss_legendre(GAP_NODES), constants("Law", vars(filtering), globals())
        counts = {"width": width, "instants": len(grid.s), "nodes": grid.nodes, "motors": motors}
        numbers = {"goal": views.flight.final_orientation, "sigma": sigma, "acceleration": acceleration, "law": law}
        made = {"motions": np.zeros((MEMORY, 2 + 3 * columns * n)), "columns": width * np.arange(n + 1)}
        by_time = [part @ first.coefficients / first.end**order for order, part in enumerate(first.table)]
        made["plan"] = np.concatenate(([first.begin, first.end], np.ravel(by_time)))
        made |= {"gap": gap.nodes, "gap_weights": gap.weights, "at_landing": rewriting.landing}
        made["turns"] = np.concatenate((tree.turns, tree.motor_turns), axis=1)
        later = dict.fromkeys((*FILTER, "room"))  # see begin()
        rows, masses = _of_limits(blocks, constraints.block_first), _of_masses(tree, bodies)
        self._block_first = constraints.block_first
        arrays = {**self._of_instants(grid), **masses, **found, **self._called, **made, **later}
        self._filled = Filled("Flight", first, rewriting, views, grid, tree, **counts, **numbers, **rows, **arrays)
        given = self._robot.structure, self._constraints.structure, self._flight
        self._filled.point_to(room=np.zeros(kernel().flight_room(*given)))

    @property
    def _flight(self) -> Any:
        """What the kernel reads and writes."""
        return self._filled.structure

    def begin(self, estimate: Estimate) -> None:
        """Begin another flight, of which so much is known."""
        inertial, flight = estimate.inertial, self._flight
        self._filled.point_to(**{name: getattr(inertial, name) for name in FILTER})
        flight.known, flight.turn_after = 0, 0.0
        self._step(STEPS["adapt_masses"])
        self.estimate = estimate
        self.motions.clear()
        self.remember(self._first)

    def aim_as_planned(self) -> None:
        """Aim no further from limits than the motion predicted last is: it comes to the ground, as feet do."""
        landing, views = int(np.argmax(self._instants.s)), self.views
        values = [self.row_values[begin:end] for begin, end in pairwise(self._block_first)]
        views.rows = [rows.as_planned(own, landing) for rows, own in zip(views.rows, values, strict=True)]
        self._filled.point_to(aim=np.array([rows.aim for rows in self.views.rows]))

    def expected(self, measured: Measurement, now: float) -> Expected:
        """Return what is expected to be measured; the motion may change from ``now`` on, s."""
        flight, called = self._flight, self._called
        flight.began, flight.measured, flight.now = self.estimate.time, measured.time, now
        called["measured_positions"][:] = measured.positions
        called["measured_velocities"][:] = measured.velocities
        self._step(STEPS["expect_state"])
        orientation = self.estimate.inertial.orientation + flight.turn_before
        base = orientation, flight.expected_rate, flight.aside, flight.variance, flight.noise
        return Expected(called["positions"], called["velocities"], *base)

    def learn(self, measured: Measurement) -> None:
        """Take in a measurement that is as it was expected."""
        self._flight.measured_orientation, self._flight.measured_rate = measured.orientation, measured.orientation_rate
        self._step(STEPS["learn_state"])

    def torques(self, positions: Array, velocities: Array, accelerations: Array) -> Array:
        """Generalised torques (n,) of the joints, then those of the motors (m,), N m, by the h and the masses found."""
        self._called["asked"][:] = positions, velocities, accelerations
        self._step(STEPS["find_torques"])
        return self._called["torques"].copy()

    @property
    def turned(self) -> float:
        """By how much the base turns from the measurement that was learnt from last until ``now``, rad."""
        return float(self._flight.turn_after)

    def corrected(self, now: float, landing: float, evaluations: int, warm_start: Array | None = None) -> Corrected:
        """Return the present motion from ``now`` to the landing, s, corrected; it is the one that holds from now on."""
        flight = self._flight
        self._look_at(now, landing)
        flight.evaluations, flight.is_warm = evaluations, warm_start is not None
        if warm_start is not None:
            self._called["warm_start"][:] = warm_start
        self._step(STEPS["correct_motion"])
        motion = self._written(now, landing)
        self.motions.append(motion)
        return self._judged(motion)

    def predicted(self, motion: RemainingMotion) -> Corrected:
        """Return what comes of a motion as it is; the estimate is that when it begins."""
        self._look_at(motion.begin, motion.end)
        self._called["coefficients"][:] = motion.coefficients
        self._step(STEPS["predict_motion"])
        return self._judged(motion)

    @property
    def times(self) -> Array:
        """Times (K,), s since takeoff, at which the rest of the flight was looked at last."""
        begin, end = self._flight.now, self._flight.landing
        return np.asarray(begin + (end - begin) * self._instants.s)

    def _look_at(self, now: float, landing: float) -> None:
        """Look at the rest of a flight, from now to a landing, s."""
        self._flight.now, self._flight.landing = now, landing
        if not self.views.has_distances:
            return
        place, velocity = self.estimate.place(now)
        self._path[:] = (*place, *velocity, self.estimate.gravity)
        instants = self.views.between(now, landing)
        if instants is not self._instants:
            self._instants, arrays = instants, self._of_instants(instants)
            self._filled.point_to(**{name: np.ascontiguousarray(part) for name, part in arrays.items()})

    def _judged(self, motion: RemainingMotion) -> Corrected:
        found, called = self._flight.corrected, self._called
        return Corrected(motion, found.miss, called["worst"].copy(), called["torque_peak"].copy(), found.share)

    def rewritten(self, now: float, landing: float) -> RemainingMotion:
        """Return the present motion from ``now``, s, to a landing: positions to accelerations go on at ``now``."""
        self._flight.now, self._flight.landing = now, landing
        self._step(STEPS["rewrite_motion"])
        return self._written(now, landing)

    def remember(self, motion: RemainingMotion) -> None:
        """Take a motion as the present one."""
        self.motions.append(motion)
        self._flight.now, self._flight.landing = motion.begin, motion.end
        self._called["coefficients"][:] = motion.coefficients
        self._step(STEPS["remember_motion"])

    def _written(self, now: float, landing: float) -> RemainingMotion:
        first = self._first
        coefficients = self._called["coefficients"].copy()
        return RemainingMotion(first.centre, first.amplitude, now, landing, coefficients, first.table)

    def _step(self, step: int) -> None:
        found = kernel()
        given = self._robot.structure, self._constraints.structure, self._filled.structure
        found.flight(*given, step, found.instructions)

    def _of_instants(self, grid: GaussGrid) -> dict[str, Array]:
        """What a motion, and its changes y, are made of where it is looked at."""
        values = self.views.functions.values(grid.s)
        free = np.stack([part[:, CONDITIONS:] @ self.views.whitening for part in values])
        basis = (free[:, :, None, :] / self._first.amplitude[:, None]).reshape(*free.shape[:2], -1).swapaxes(1, 2)
        of_basis = {name: part.T for name, part in zip(("value", "first", "second"), values, strict=True)}
        return {"s": grid.s, "integrals": grid.integrals[grid.nodes :], "basis": basis, **of_basis}


def _of_limits(blocks: Sequence[LimitRows], first: list[int]) -> dict[str, Any]:
    windows = np.array([rows.window for rows in blocks]).reshape(-1, 2) + ROUNDING * np.array([-1.0, 1.0])
    return {
        "blocks": len(blocks),
        "block_first": first,
        "aim": np.array([rows.aim for rows in blocks]),
        "softness": np.array([rows.softness for rows in blocks]),
        "row_window": np.repeat(windows, np.diff(first), axis=0),
    }


def _of_masses(tree: PlanarTree, bodies: Bodies) -> dict[str, Array]:
    """C, what it changes by with each mass, and the places of the centres of mass, by the rotations of the bodies."""
    by_links = tree.point_weights(np.arange(len(tree.mass)), tree.center)
    own, weights = by_links * bodies.rotations.sum(axis=0), bodies.of_points(by_links)
    back = (own if bodies.is_mirrored else own.conj()) * tree.mass[:, None]
    parts = {"by_mass": back[:, :, None] * weights[:, None, :], "weights": weights, "nominal": bodies.links}
    sides = {f"{name}_real": part.real for name, part in parts.items()}
    return sides | {f"{name}_imaginary": part.imag for name, part in parts.items()}
