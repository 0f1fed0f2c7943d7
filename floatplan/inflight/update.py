"""An update of a flight's corrections: the state that is expected, the filter, the rest of the flight corrected.

All of it is computed by the kernel, ``flight.hpp``, ``correcting.hpp`` and ``prediction.hpp``; this fills what these
read.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.inflight import estimate as filtering
from floatplan.inflight.estimate import Estimate, Expected, Measurement
from floatplan.inflight.motion import RemainingMotion, Rewriting
from floatplan.inflight.prediction import Instants, LimitRows, Views
from floatplan.kernel.bodies import Bodies, filled_robot
from floatplan.kernel.constraints import CompiledConstraints
from floatplan.kernel.layout import ENUMERATIONS, Filled, constants
from floatplan.kernel.library import kernel
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.quadrature import gauss_legendre
from floatplan.robot.planar.tree import PlanarTree

EVALUATIONS_NEAR = 1  # [-] of changed motions at most
EVALUATIONS_FAR = 6  # [-] the same where the landing is far from the goal
FAR = 0.06  # [rad]
WEIGHED = 10.0  # [-] sigmas of the landing at most, against limits: one that is farther is approached from where it is
SETTLED = 0.1  # [-] of sigma, and of the cost: less is not worth a step
SHORTER = 0.3  # [-] of a step that is no better
MOST_ROWS = 24  # [-] of a block that are looked at in a step
KEPT = 1e-3  # [-] a row that is less below zero counts as kept
SCALES = (0.5, 0.25)  # [-] shares of a correction that are tried where the whole breaks a limit
MEMORY = 64  # [-] motions that are remembered, for measurements that come late
GAP_NODES = 5  # [-] of the quadrature between measurements
ROUNDING = 1e-9  # [s] of instants at the ends of a window
STEPS = ENUMERATIONS["Step"].__members__


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

    A miss of ``sigma`` rad at the landing is worth a correction by ``acceleration`` rad/s^2.
    """

    def __init__(self, tree: PlanarTree, views: Views, rewriting: Rewriting, sigma: float, acceleration: float) -> None:
        self.views, self._first, self._instants = views, rewriting.first, views.instants
        self.motions: deque[RemainingMotion] = deque(maxlen=MEMORY)
        blocks = views.rows
        constraints = CompiledConstraints(views.flight, [rows.block for rows in blocks])
        bodies, n, width = constraints.bodies, constraints.joints, len(views.whitening)
        columns = CONDITIONS + width
        self._constraints, self._path = constraints.filled, constraints.path
        # Of the masses found: the robot's too.
        found = {
            "real": np.zeros_like(bodies.real),
            "imaginary": np.zeros_like(bodies.imaginary),
            "link_real": np.zeros(bodies.links.shape),
            "link_imaginary": np.zeros(bodies.links.shape),
        }
        self._robot = filled_robot(bodies, [width] * n)
        self._robot.point_to(**found)
        self._robot.structure.is_real = False
        self._called = {
            "positions": np.zeros(n),
            "velocities": np.zeros(n),
            "map": np.zeros(n + 1),
            "measured_positions": np.zeros(n),
            "measured_velocities": np.zeros(n),
            "coefficients": np.zeros((columns, n)),
            "warm_start": np.zeros((width, n)),
            "worst": np.zeros(len(blocks)),
            "torque_peak": np.zeros(tree.motor_turns.shape[1]),
            "row_values": np.zeros((constraints.rows, len(views.instants.grid.s))),
        }
        self._filled = Filled(
            "Flight",
            width=width,
            instants=len(views.instants.grid.s),
            nodes=views.instants.grid.nodes,
            goal=views.flight.final_orientation,
            motors=tree.motor_turns.shape[1],
            motor_turns=tree.motor_turns,
            **_of_motions(views, rewriting),
            **self._of_instants(views.instants),
            columns=width * np.arange(n + 1),
            **_of_masses(tree, bodies),
            **_of_limits(blocks, constraints.block_first),
            sigma=sigma,
            acceleration=acceleration,
            law=constants("Law", vars(filtering), globals()),
            **dict.fromkeys(("state", "covariance", "surprises", "wander", "deviations")),  # see begin()
            **found,
            **self._called,
            motions=np.zeros((MEMORY, 2 + 3 * columns * n)),
            room=None,
        )
        self._filled.point_to(room=np.zeros(kernel().flight_room(*self._structures)))

    @cached_property
    def _flight(self) -> Any:
        """What the kernel reads and writes."""
        return self._filled.structure

    @cached_property
    def _structures(self) -> tuple[Any, Any, Any]:
        return self._robot.structure, self._constraints.structure, self._flight

    def __getstate__(self) -> dict[str, Any]:
        """All but where numbers lie in memory: a copy has its own."""
        return {name: value for name, value in vars(self).items() if name not in ("_flight", "_structures")}

    def begin(self, estimate: Estimate) -> None:
        """Begin another flight, of which so much is known."""
        inertial, flight = estimate.inertial, self._flight
        self._filled.point_to(
            state=inertial.state,
            covariance=inertial.covariance,
            surprises=inertial.surprises,
            wander=inertial.wander,
            deviations=inertial.deviations,
        )
        flight.known, flight.turn_after = 0, 0.0
        self._step(STEPS["adapt_masses"])
        self.estimate = estimate
        self.motions.clear()
        self.remember(self._first)

    def expected(self, measured: Measurement, now: float) -> Expected:
        """Return what is expected to be measured; the motion may change from ``now`` on, s."""
        flight, called = self._flight, self._called
        flight.began, flight.measured, flight.now = self.estimate.time, measured.time, now
        called["measured_positions"][:] = measured.positions
        called["measured_velocities"][:] = measured.velocities
        self._step(STEPS["expect_state"])
        orientation = self.estimate.inertial.orientation + flight.turn_before
        return Expected(
            called["positions"],
            called["velocities"],
            orientation,
            flight.expected_rate,
            flight.aside,
            flight.variance,
            flight.noise,
        )

    def learn(self, measured: Measurement, expected: Expected) -> None:
        """Take in a measurement that is as it was expected."""
        self._flight.measured_orientation, self._flight.measured_rate = measured.orientation, measured.orientation_rate
        self._step(STEPS["learn_state"])
        self.estimate.inertial.has_changed()

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
        return np.asarray(begin + (end - begin) * self._instants.grid.s)

    @property
    def row_values(self) -> Array:
        """Values (rows, K) of the rows at all instants under the motion predicted last; infinite where none applies."""
        return self._called["row_values"]

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
        found.flight(*self._structures, step, found.instructions)

    def _of_instants(self, instants: Instants) -> dict[str, Array]:
        grid, free = instants.grid, np.stack(instants.free)
        basis = free[:, :, None, :] / self._first.amplitude[:, None]
        return {
            "s": grid.s,
            "integrals": grid.integrals[grid.nodes :],
            "basis": basis.reshape(*free.shape[:2], -1),
            **{name: part.T for name, part in zip(("value", "first", "second"), instants.values, strict=True)},
        }


def _of_motions(views: Views, rewriting: Rewriting) -> dict[str, Any]:
    gap, first = gauss_legendre(GAP_NODES), rewriting.first
    return {
        "centre": first.centre,
        "amplitude": first.amplitude,
        "weights": views.instants.grid.weights,
        "whitening": views.whitening,
        "table": first.table,
        "points": rewriting.points,
        "of_values": rewriting.of_values,
        "at_landing": np.array(rewriting.landing),
        "gap": gap.nodes,
        "gap_weights": gap.weights,
    }


def _of_limits(blocks: Sequence[LimitRows], first: IntArray) -> dict[str, Any]:
    windows = np.array([rows.window for rows in blocks]).reshape(-1, 2) + ROUNDING * np.array([-1.0, 1.0])
    return {
        "blocks": len(blocks),
        "block_first": first,
        "aim": np.array([rows.aim for rows in blocks]),
        "softness": np.array([rows.softness for rows in blocks]),
        "row_window": np.repeat(windows, np.diff(first), axis=0),
    }


def _of_masses(tree: PlanarTree, bodies: Bodies) -> dict[str, Array]:
    """C and the places of the centres of mass, by the rotations of the links and of the bodies that turn alike."""
    weights = tree.point_weights(np.arange(len(tree.mass)), tree.center)
    own = weights * bodies.rotations.sum(axis=0)
    parts = {
        "own": own.conj() if bodies.is_mirrored else own,
        "weights": bodies.of_points(weights),
        "nominal": bodies.links,
    }
    return {
        "mass": tree.mass,
        "inertia": tree.inertia,
        **{f"{name}_real": part.real for name, part in parts.items()},
        **{f"{name}_imaginary": part.imag for name, part in parts.items()},
    }
