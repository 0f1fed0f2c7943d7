"""What an update computes, in the compiled kernel; see :mod:`floatplan.inflight.reckoning`, which is the reference."""

from __future__ import annotations

from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.inflight import identification as filtered
from floatplan.inflight import law as lawful
from floatplan.inflight.estimate import Estimate
from floatplan.inflight.law import Law
from floatplan.inflight.limits import JointRows, Rows, TorqueRows
from floatplan.inflight.measurement import Expected, Measurement
from floatplan.inflight.motion import RemainingMotion, Rewriting
from floatplan.inflight.outlook import Outlook, Views
from floatplan.inflight.reckoning import GAP_NODES, MEMORY, Foreseen, Reckoning
from floatplan.kernel import library
from floatplan.kernel.filled import Filled
from floatplan.kernel.library import FlightStep, Kernel
from floatplan.motion.planar.momentum import TurningBodies, centroidal_coupling
from floatplan.motion.quadrature import gauss_legendre
from floatplan.motion.sine_polynomial import CONDITIONS
from floatplan.robot.planar.tree import PlanarTree

KINDS = {"velocities": 0, "accelerations": 1, "orientation_rate": 2, "torque": 3}


class CompiledReckoning(Reckoning):
    """The same in C++; where distances are limited, the law itself in NumPy."""

    def __init__(self, kernel: Kernel, tree: PlanarTree, views: Views, rewriting: Rewriting, law: Law) -> None:
        super().__init__(views, rewriting, law)
        self._kernel = kernel
        n, m, width = len(rewriting.first.amplitude), len(tree.mass), len(views.whitening)
        groups, columns, states = len(TurningBodies.of(tree).turns), CONDITIONS + width, 2 + 2 * m
        rows = _rows([] if views.has_distances else views.rows, m, n)
        instants, size = len(views.instants.grid.s), n * width
        most = 1 + lawful.MOST_ROWS * (len(rows["block_first"]) - 1)
        ahead = columns * n + (8 * n + 8 * groups + 2 * m + 3 + 2 * len(rows["row_kind"])) * instants
        self._called = {
            "positions": np.zeros(n),
            "velocities": np.zeros(n),
            "map": np.zeros(n + 1),
            "measured_positions": np.zeros(n),
            "measured_velocities": np.zeros(n),
            "coefficients": np.zeros((columns, n)),
            "warm_start": np.zeros((width, n)),
            "worst": np.zeros(len(rows["aim"])),
        }
        memory = {
            "rows_real": m * groups,
            "rows_imaginary": m * groups,
            "merged_real": groups * groups,
            "merged_imaginary": groups * groups,
            "inertia": m,
            "motions": MEMORY * (2 + 3 * columns * n),
            "scratch": 2 * m + 3 * groups,
            "law_memory": (4 + size + most) * size + most + columns * n + len(rows["aim"]),
            "ahead_memory": 2 * (ahead + 8 * 40),
            "filter_memory": 3 * states + max(3 * groups, (columns + 1) * n),
            "gap_memory": (2 * GAP_NODES + 1) * (2 * n + 3 * groups),
        }
        self._filled = Filled(
            library.Flight,
            joints=n,
            groups=groups,
            bodies=m,
            width=width,
            instants=instants,
            nodes=views.instants.grid.nodes,
            gap_nodes=GAP_NODES,
            memory=MEMORY,
            most_rows=lawful.MOST_ROWS,
            most_rows_of_all=most,
            goal=views.flight.final_orientation,
            **_of_motions(views, rewriting),
            **_of_bodies(tree),
            **rows,
            **_of_law(law),
            **_of_filter(),
            **self._called,
            **{name: np.zeros(count) for name, count in memory.items()},
        )
        self._flight = self._filled.structure

    def __getstate__(self) -> dict[str, Any]:
        """All but the kernel, and where numbers lie in memory."""
        return {name: value for name, value in self.__dict__.items() if name not in ("_kernel", "_flight")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        compiled = library.kernel()
        if compiled is None:
            raise InputError("a Replanner that was pickled with the compiled kernel needs it: floatplan --version")
        self.__dict__.update(state)
        self._kernel, self._flight = compiled, self._filled.structure

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
        flight.known = 0
        self._step(FlightStep.ADAPT)
        super().begin(estimate)

    def expected(self, measured: Measurement, now: float) -> Expected:
        """Return what is expected to be measured; the motion may change from ``now`` on, s."""
        flight, called = self._flight, self._called
        flight.began, flight.measured, flight.now = self.estimate.time, measured.time, now
        called["measured_positions"][:] = measured.positions
        called["measured_velocities"][:] = measured.velocities
        self._step(FlightStep.EXPECT)
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
        self._step(FlightStep.LEARN)
        self.estimate.inertial.has_changed()

    def turned(self, dt: float) -> float:
        """By how much the base turns in the ``dt`` s since the measurement that was learnt from last, rad."""
        return float(self._flight.turn_after)

    def corrected(
        self, now: float, orientation: float, landing: float, evaluations: int, warm_start: Array | None = None
    ) -> Foreseen:
        """Return the present motion from ``now`` to the landing, s, corrected; it is the one that holds from now on."""
        if self.views.has_distances:
            return super().corrected(now, orientation, landing, evaluations, warm_start)
        flight = self._flight
        flight.now, flight.landing, flight.evaluations = now, landing, evaluations
        flight.is_warm = warm_start is not None
        if warm_start is not None:
            self._called["warm_start"][:] = warm_start
        self._step(FlightStep.CORRECT)
        motion = self._written(now, landing)
        self.motions.append(motion)
        outlook = Outlook(self.views, motion, self.present(now, orientation))
        return Foreseen(outlook, flight.foreseen.miss, self._called["worst"].copy(), flight.foreseen.share)

    def _rewritten(self, now: float, landing: float) -> RemainingMotion:
        self._flight.now, self._flight.landing = now, landing
        self._step(FlightStep.REWRITE)
        return self._written(now, landing)

    def _remember(self, motion: RemainingMotion) -> None:
        super()._remember(motion)
        self._flight.now, self._flight.landing = motion.begin, motion.end
        self._called["coefficients"][:] = motion.coefficients
        self._step(FlightStep.REMEMBER)

    def _written(self, now: float, landing: float) -> RemainingMotion:
        first = self._rewriting.first
        coefficients = self._called["coefficients"].copy()
        return RemainingMotion(first.centre, first.amplitude, now, landing, coefficients, first.table)

    def _step(self, step: int) -> None:
        self._kernel.flight(self._flight, step, self._kernel.instructions)


def _of_motions(views: Views, rewriting: Rewriting) -> dict[str, Any]:
    instants, gap, first = views.instants, gauss_legendre(GAP_NODES), rewriting.first
    return {
        "centre": first.centre,
        "amplitude": first.amplitude,
        "weights": instants.grid.weights,
        **{name: part.T for name, part in zip(("value", "first", "second"), instants.values, strict=True)},
        **dict(zip(("free_value", "free_first", "free_second"), instants.free, strict=True)),
        "whitening": views.whitening,
        "table": first.table,
        "points": rewriting.points,
        "of_values": rewriting.of_values,
        "at_landing": np.array(rewriting.landing),
        "gap": gap.nodes,
        "gap_weights": gap.weights,
    }


def _of_bodies(tree: PlanarTree) -> dict[str, Any]:
    """C and the places of the centres of mass, by the rotations of the groups of bodies that turn alike."""
    bodies = TurningBodies.of(tree)
    group = np.abs(bodies.rotations).argmax(axis=1)
    own = bodies.rotations[np.arange(len(group)), group]
    weights = tree.point_weights(np.arange(len(group)), tree.center)
    coupling = own.conj()[:, None] * (centroidal_coupling(tree) @ bodies.rotations)
    return {
        "turn": tree.turn,
        "turns": bodies.turns,
        "group": group,
        "mass": tree.mass,
        "nominal_inertia": tree.inertia,
        **_parts("own", weights * own),
        **_parts("weights", weights @ bodies.rotations),
        **_parts("nominal", coupling),
    }


def _parts(name: str, values: Any) -> dict[str, Array]:
    return {f"{name}_real": values.real, f"{name}_imaginary": values.imag}


def _rows(blocks: Any, bodies: int, joints: int) -> dict[str, Any]:
    """Rows of limits, block after block."""
    kinds: list[int] = []
    joint: list[int] = []
    parts: list[tuple[Array, Array, Array, Array]] = []
    for block in blocks:
        count = len(block.limit)
        parts.append(_block(block, bodies, joints))
        kinds += [KINDS["torque" if isinstance(block, TorqueRows) else block.quantity]] * count
        joint += [0] * count if isinstance(block, TorqueRows) else block.limited.tolist()
    limit, slope, turns, ratios = (
        (np.concatenate(part) for part in zip(*parts, strict=True)) if parts else (np.zeros(0) for _ in range(4))
    )
    sizes = [len(part[0]) for part in parts]
    return {
        "blocks": len(parts),
        "torque_rows": kinds.count(KINDS["torque"]),
        "block_first": np.cumsum([0, *sizes]),
        "aim": np.array([block.aim for block in blocks]),
        "softness": np.array([block.softness for block in blocks]),
        "row_kind": np.array(kinds, dtype=np.int64),
        "row_joint": np.array(joint, dtype=np.int64),
        "row_limit": limit,
        "row_slope": slope,
        "row_turns": turns,
        "row_ratios": ratios,
    }


def _block(block: Rows, bodies: int, joints: int) -> tuple[Array, Array, Array, Array]:
    """Limit, slope, turns, ratios of the rows of a block."""
    if isinstance(block, TorqueRows):
        return block.limit, block.slope, block.turns.T, block.ratios
    assert isinstance(block, JointRows), "distances are not among them"
    count = len(block.limit)
    return block.limit, np.zeros(count), np.zeros((count, bodies)), np.zeros((count, joints))


def _of_law(law: Law) -> dict[str, Any]:
    return {
        "sigma": law.sigma,
        "acceleration": law.acceleration,
        "far": lawful.FAR,
        "weighed": lawful.WEIGHED,
        "settled": lawful.SETTLED,
        "shorter": lawful.SHORTER,
        "kept": lawful.KEPT,
        "scales": lawful.SCALES,
        "evaluations_far": lawful.EVALUATIONS_FAR,
    }


def _of_filter() -> dict[str, Any]:
    return {
        "angle_variance": filtered.ANGLE_NOISE**2,
        "rate_variance": filtered.RATE_NOISE**2,
        "largest_error": filtered.LARGEST_ERROR,
        "surprising": filtered.SURPRISING,
        "most_surprises": filtered.SURPRISES,
    }
