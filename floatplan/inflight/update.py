"""An update of a flight's corrections: the expected state, the filter, the remaining flight corrected.

All of it is computed by the kernel, ``flight.hpp``, ``correcting.hpp`` and ``prediction.hpp``; this fills what these
read. The remaining flight, joint motions (12) from now to the landing, is written anew exactly at each correction.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.inflight.estimate import Estimate
from floatplan.inflight.measurement import Expected, Measurement
from floatplan.inflight.prediction import LimitRows, Views
from floatplan.inflight.remaining_motion import RemainingMotion, Rewriting
from floatplan.kernel.library import kernel
from floatplan.kernel.structs import Struct, doubles, enumeration, integers
from floatplan.kernel.tolerances import CORRECTION_OPTIONS, CORRECTION_OPTIONS_IN_SPACE
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.quadrature import gauss_legendre
from floatplan.planning.kernel_input.rows import KernelRows

FILTER_ARRAYS = ("state", "covariance", "attitude", "surprises", "wander", "deviations")  # of the filter of an estimate
STEPS = enumeration("Step").__members__


@dataclass(eq=False)
class Prediction:
    """The motion that was chosen and its prediction: its miss, rad, the least value of each block of rows.

    In space the miss is the vector (3,) of the rotation from the goal to the attitude at landing, in the goal's axes.
    ``torque_peak`` (m,) N m is each motor's largest; ``share`` of the correction was taken.
    """

    motion: RemainingMotion
    miss: Any
    worst: list[float]
    torque_peak: Array
    share: float

    @property
    def missed(self) -> float:
        """Size of the miss, rad."""
        return abs(self.miss) if isinstance(self.miss, float) else float(np.linalg.norm(self.miss))

    @property
    def breaks_a_limit(self) -> bool:
        """Whether a row is further below zero than counts as kept."""
        return min(self.worst, default=0.0) < -CORRECTION_OPTIONS.kept


class Update:
    """Of one flight at a time: ``motions`` are those of the joints so far, the last one holds now.

    A miss of ``sigma`` rad at the landing is worth a correction by ``acceleration`` rad/s^2; ``options`` say the rest.
    """

    def __init__(self, views: Views, rewriting: Rewriting, sigma: float, acceleration: float) -> None:
        self.views = views
        flying: Any = views.flying  # whose rows and input of the kernel are of one kind
        self.options = CORRECTION_OPTIONS if flying.orientations.size == 1 else CORRECTION_OPTIONS_IN_SPACE
        self.motions: deque[RemainingMotion] = deque(maxlen=self.options.memory)
        blocks = views.rows
        grid = views.instants
        constraints = flying.rows([rows.block for rows in blocks])
        self._kernel_input: Any = flying.kernel_input(constraints, self.options.gap_nodes)
        n = len(rewriting.first.centre)
        width = len(views.whitening)
        motors = self._kernel_input.members["turns"].shape[1] - n
        self._first = rewriting.first
        self._instants = grid
        self._constraints = constraints.struct
        self._block_first = constraints.block_first
        self._prepared = {filled.nodes: self._of_instants(filled) for _, filled in views.grids}
        self._called = _called_arrays(constraints, n, len(grid.s), width, motors, flying.orientations.size)
        self._struct = Struct(
            "CorrectedFlight",
            instants=len(grid.s),
            width=width,
            nodes=grid.nodes,
            blocks=len(blocks),
            motors=motors,
            options=Struct.of_numbers(self.options),
            sigma=sigma,
            acceleration=acceleration,
            motions=np.zeros((self.options.memory, 2 + 3 * (CONDITIONS + width) * n)),
            room=None,  # allocated below
            **dict.fromkeys(FILTER_ARRAYS),  # see begin()
            **self._kernel_input.members,
            **_of_limits(blocks, constraints.block_first),
            **_of_plan(rewriting, views, grid, self.options.gap_nodes),
            **self._prepared[grid.nodes],
            **self._called,
        )
        compiled = kernel()
        room = getattr(compiled, self._kernel_input.room)
        size = room(self._kernel_input.robot.pointer, self._constraints.pointer, self._flight, compiled.instructions)
        self._struct.point_to(room=np.zeros(size))

    @property
    def row_values(self) -> Array:
        """Values (rows, K) of the rows at all instants under the motion predicted last; infinite where none applies."""
        values = self._called["row_values"]
        instants = len(self._instants.s)
        return values.ravel()[: len(values) * instants].reshape(len(values), instants)

    @property
    def _flight(self) -> Any:
        """What the kernel reads and writes."""
        return self._struct.pointer

    def begin(self, estimate: Estimate) -> None:
        """Begin another flight, with an estimate of its state."""
        flight = self._flight
        self._struct.point_to(**{name: getattr(estimate.inertial, name) for name in FILTER_ARRAYS})
        flight.known = 0
        self._kernel_input.begin()
        self._step(STEPS["adapt_masses"])
        self.estimate = estimate
        self.motions.clear()
        self.remember(self._first)

    def aim_as_planned(self) -> None:
        """Aim no further from limits than the motion predicted last is: it comes to the ground, as feet do."""
        landing = int(np.argmax(self._instants.s))
        blocks = []
        for rows, (begin, end) in zip(self.views.rows, pairwise(self._block_first), strict=True):
            blocks.append(rows.as_planned(self.row_values[begin:end], landing))
        self.views.rows = blocks
        self._struct.point_to(aim=doubles([rows.aim for rows in blocks]))

    def expected(self, measured: Measurement, now: float) -> Expected:
        """Return the expected measurement; the motion may change from ``now`` on, s."""
        flight = self._flight
        flight.began = self.estimate.time
        flight.measured = measured.time
        flight.now = now
        called = self._called
        called["measured_positions"][:] = measured.positions
        called["measured_velocities"][:] = measured.velocities
        called["measured_rate"][:] = measured.orientation_rate
        self._step(STEPS["expect_state"])
        positions_off, velocities_off = called["joints_off"].tolist()
        orientation = self._kernel_input.expected_orientation(self.estimate.inertial.orientation)
        return Expected(
            positions=called["positions"],
            orientation=orientation,
            offset=called["aside"].tolist(),
            allowed=called["allowed"].tolist(),
            positions_off=positions_off,
            velocities_off=velocities_off,
            rate_off=called["rate_off"].tolist(),
        )

    def learn(self, measured: Measurement) -> None:
        """Update the filter by a measurement that is plausible."""
        self._kernel_input.measure(measured.orientation)
        self._step(STEPS["learn_state"])

    def torques(self, positions: Array, velocities: Array, accelerations: Array) -> Array:
        """Generalised torques (n,) of the joints, then those of the motors (m,), N m, by the estimated h and masses."""
        self._called["asked"][:] = positions, velocities, accelerations
        self._step(STEPS["find_torques"])
        return self._called["torques"].copy()

    @property
    def turned(self) -> Any:
        """Rotation of the base from the last measurement that was learnt from until ``now``, rad, in space (3, 3)."""
        return self._kernel_input.turned

    def corrected(self, now: float, landing: float, evaluations: int, warm_start: Array | None = None) -> Prediction:
        """Return the present motion from ``now`` to the landing, s, corrected; it is the present one from now on."""
        flight = self._flight
        self._evaluate_between(now, landing)
        flight.evaluations = evaluations
        flight.is_warm = warm_start is not None
        if warm_start is not None:
            self._called["warm_start"][:] = warm_start
        self._step(STEPS["correct_motion"])
        motion = self._written(now, landing)
        self.motions.append(motion)
        return self._prediction(motion)

    def predicted(self, motion: RemainingMotion) -> Prediction:
        """Return the prediction of a motion as it is; the estimate is that when it begins."""
        self._evaluate_between(motion.begin, motion.end)
        self._called["coefficients"][:] = motion.coefficients
        self._step(STEPS["predict_motion"])
        return self._prediction(motion)

    @property
    def times(self) -> Array:
        """Times (K,), s since takeoff, at which the remaining flight was evaluated last."""
        begin = self._flight.now
        return np.asarray(begin + (self._flight.landing - begin) * self._instants.s)

    def _evaluate_between(self, now: float, landing: float) -> None:
        """Let the kernel evaluate the flight from now to a landing, s."""
        self._flight.now = now
        self._flight.landing = landing
        if self.views.has_distances:
            position, velocity = self.estimate.com_at(self._kernel_input.path_begin(now))
            self._kernel_input.path[:] = (*position, *velocity, self.estimate.gravity)
        instants = self.views.between(now, landing)
        if instants is self._instants:
            return
        self._instants = instants
        self._flight.instants = len(instants.s)
        self._flight.nodes = instants.nodes
        self._kernel_input.integrate_at(self._flight, instants)
        prepared = any(instants is grid for _, grid in self.views.grids)
        self._struct.point_to(**(self._prepared[instants.nodes] if prepared else self._of_instants(instants)))

    def _prediction(self, motion: RemainingMotion) -> Prediction:
        result = self._flight.corrected
        return Prediction(
            motion=motion,
            miss=self._kernel_input.miss(result),
            worst=self._called["worst"].tolist(),
            torque_peak=self._called["torque_peak"].copy(),
            share=result.fraction,
        )

    def rewritten(self, now: float, landing: float) -> RemainingMotion:
        """Return the present motion from ``now``, s, to a landing: positions to accelerations go on at ``now``."""
        self._flight.now = now
        self._flight.landing = landing
        self._step(STEPS["rewrite_motion"])
        return self._written(now, landing)

    def remember(self, motion: RemainingMotion) -> None:
        """Make a motion the present one."""
        self.motions.append(motion)
        self._flight.now = motion.begin
        self._flight.landing = motion.end
        self._called["coefficients"][:] = motion.coefficients
        self._step(STEPS["remember_motion"])

    def _written(self, now: float, landing: float) -> RemainingMotion:
        first = self._first
        coefficients = self._called["coefficients"].copy()
        return RemainingMotion(first.centre, first.amplitude, now, landing, coefficients, first.table)

    def _step(self, step: int) -> None:
        compiled = kernel()
        compute = getattr(compiled, self._kernel_input.step)
        compute(
            self._kernel_input.robot.pointer,
            self._constraints.pointer,
            self._struct.pointer,
            step,
            compiled.instructions,
        )

    def _of_instants(self, grid: Any) -> dict[str, Any]:
        """What a motion, and its changes y, are made of at the instants of a grid."""
        value, first, second = self.views.functions.values(grid.s)
        free = np.stack([order[:, CONDITIONS:] @ self.views.whitening for order in (value, first, second)])
        basis = (free[:, :, None, :] / self._first.amplitude[:, None]).reshape(*free.shape[:2], -1).swapaxes(1, 2)
        return {
            "s": doubles(grid.s),
            "integrals": self.views.flying.integrals(grid),
            "basis": doubles(basis),
            "value": doubles(value.T),
            "first": doubles(first.T),
            "second": doubles(second.T),
        }


def _called_arrays(
    constraints: KernelRows, n: int, instants: int, width: int, motors: int, size: int
) -> dict[str, Array]:
    """What the kernel reads and writes at each call, by the names of ``CorrectedFlight``; ``size`` is e."""
    coefficients = (CONDITIONS + width, n)
    return {
        "measured_positions": np.zeros(n),
        "measured_velocities": np.zeros(n),
        "measured_rate": np.zeros(size),
        "positions": np.zeros(n),
        "joints_off": np.zeros((2, n)),
        "rate_off": np.zeros(size),
        "allowed": np.zeros(size),
        "expected_rate": np.zeros(size),
        "aside": np.zeros(size),
        "noise": np.zeros(size),
        "asked": np.zeros((3, n)),
        "torques": np.zeros(n + motors),
        "warm_start": np.zeros((width, n)),
        "coefficients": np.zeros(coefficients),
        "planned": np.zeros(coefficients),
        "worst": np.zeros(len(constraints.block_first) - 1),
        "row_values": np.zeros((constraints.rows, instants)),
        "torque_peak": np.zeros(motors),
    }


def _of_plan(rewriting: Rewriting, views: Views, grid: Any, gap_nodes: int) -> dict[str, Array | IntArray | None]:
    """The plan's motion, and what its changes and motions on a shorter time are made of."""
    first = rewriting.first
    width = len(views.whitening)
    gap = gauss_legendre(gap_nodes)
    motion = [series @ first.coefficients / first.end**order for order, series in enumerate(first.table)]
    return {
        "centre": doubles(first.centre),
        "amplitude": doubles(first.amplitude),
        "weights": None if grid.weights is None else doubles(grid.weights),
        "columns": integers(width * np.arange(len(first.centre) + 1)),
        "whitening": doubles(views.whitening),
        "unwhitening": doubles(views.unwhitening),
        "plan": np.concatenate(([first.begin, first.end], np.ravel(motion))),
        "table": doubles(first.table),
        "points": doubles(rewriting.points),
        "of_values": doubles(rewriting.of_values),
        "at_landing": doubles(rewriting.landing),
        "gap": doubles(gap.nodes),
        "gap_weights": doubles(gap.weights),
    }


def _of_limits(blocks: Sequence[LimitRows], first: list[int]) -> dict[str, Array | IntArray]:
    """The blocks of rows: where each begins, its aim, softness, and the window of its rows, s."""
    rounding = 1e-9  # [s] of instants at the ends of a window
    windows = np.array([rows.window for rows in blocks]).reshape(-1, 2) + rounding * np.array([-1.0, 1.0])
    return {
        "block_first": integers(first),
        "aim": doubles([rows.aim for rows in blocks]),
        "softness": doubles([rows.softness for rows in blocks]),
        "row_window": doubles(np.repeat(windows, np.diff(first), axis=0)),
    }
