"""An update of a flight's corrections: the state that is expected, the filter, the rest of the flight corrected.

All of it is computed by the kernel, ``flight.hpp``, ``law.hpp`` and ``rest.hpp``; this fills what these read.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.inflight import estimate as filtering
from floatplan.inflight.estimate import Estimate
from floatplan.inflight.limits import LENGTH_SCALE, ROUNDING, DistanceRows, JointRows, Rows, TorqueRows
from floatplan.inflight.measurement import Expected, Measurement
from floatplan.inflight.motion import RemainingMotion, Rewriting
from floatplan.inflight.prediction import Instants, Prediction, Present, Views
from floatplan.kernel.filled import Filled
from floatplan.kernel.layout import ENUMERATIONS
from floatplan.kernel.library import Kernel, kernel
from floatplan.kernel.watch import PAIR, written_obstacle
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.planar.clearance import LinkShapes
from floatplan.motion.planar.closed_form import TurningBodies, centroidal_coupling
from floatplan.motion.quadrature import gauss_legendre
from floatplan.problem.parts import Obstacle
from floatplan.robot.planar.tree import PlanarTree

EVALUATIONS = 1  # [-] of changed motions at most
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
STEPS = ENUMERATIONS["Step"].__members__
KINDS = {"velocities": 0, "accelerations": 1, "orientation_rate": 2}
TORQUE, DISTANCE = 3, 4
ALWAYS = (-np.inf, np.inf)


@dataclass(eq=False)
class Corrected:
    """The motion that was chosen and what it leads to: its miss, rad, the least value of each block of rows.

    ``share`` of the correction was taken.
    """

    prediction: Prediction
    miss: float
    worst: Array
    share: float

    @property
    def motion(self) -> RemainingMotion:
        """The joints' motion."""
        return self.prediction.motion


class Update:
    """Of one flight at a time: ``motions`` are those of the joints so far, the last one holds now.

    A miss of ``sigma`` rad at the landing is worth a correction by ``acceleration`` rad/s^2.
    """

    def __init__(self, tree: PlanarTree, views: Views, rewriting: Rewriting, sigma: float, acceleration: float) -> None:
        self.views, self._first = views, rewriting.first
        self.motions: deque[RemainingMotion] = deque(maxlen=MEMORY)
        self._kernel: Kernel = kernel()
        n, m, width = len(rewriting.first.amplitude), len(tree.mass), len(views.whitening)
        groups, columns = len(TurningBodies.of(tree).turns), CONDITIONS + width
        shapes = views.flight.link_shapes if views.has_distances else LinkShapes(tree, ())
        instants, capsules, blocks = len(views.instants.grid.s), len(shapes.radius), len(views.rows)
        rows = _rows(views.rows, shapes, m, n)
        of_instant = 8 * n + 8 * groups + 2 * m + 6 + 4 * capsules + 2 * len(rows["row_kind"])
        self._called = {
            "positions": np.zeros(n),
            "velocities": np.zeros(n),
            "map": np.zeros(n + 1),
            "path": np.zeros(5),
            "measured_positions": np.zeros(n),
            "measured_velocities": np.zeros(n),
            "coefficients": np.zeros((columns, n)),
            "warm_start": np.zeros((width, n)),
            "worst": np.zeros(blocks),
        }
        self._filled = Filled(
            "Flight",
            joints=n,
            groups=groups,
            bodies=m,
            width=width,
            instants=instants,
            nodes=views.instants.grid.nodes,
            gap_nodes=GAP_NODES,
            memory=MEMORY,
            most_rows=MOST_ROWS,
            most_rows_of_all=1 + MOST_ROWS * blocks,
            capsules=capsules,
            length_scale=LENGTH_SCALE,
            goal=views.flight.final_orientation,
            **_of_motions(views, rewriting),
            **_of_instants(views.instants),
            **_of_bodies(tree),
            **_of_capsules(tree, shapes),
            **rows,
            **_of_law(),
            sigma=sigma,
            acceleration=acceleration,
            **_of_filter(),
            **dict.fromkeys(("state", "covariance", "surprises", "wander", "deviations")),  # see begin()
            **self._called,
            **_memory(n, groups, m, width, blocks),
            ahead_memory=np.zeros(2 * (columns * n + of_instant * instants + 8 * 40)),
            drift=np.zeros(views.instants.grid.nodes * n * width),
        )
        self._flight = self._filled.structure

    def __getstate__(self) -> dict[str, Any]:
        """All but the kernel, and where numbers lie in memory."""
        return {name: value for name, value in self.__dict__.items() if name not in ("_kernel", "_flight")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._kernel, self._flight = kernel(), self._filled.structure

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

    def corrected(
        self, now: float, orientation: float, landing: float, evaluations: int, warm_start: Array | None = None
    ) -> Corrected:
        """Return the present motion from ``now`` to the landing, s, corrected; it is the one that holds from now on."""
        flight, present = self._flight, self.present(now, orientation)
        if self.views.has_distances:
            com = present.com
            self._called["path"][:] = (*com.position0, *com.velocity0, com.gravity)
            instants = self.views.between(now, landing)
            if instants is not self.views.instants:
                self._filled.point_to(**{k: np.ascontiguousarray(part) for k, part in _of_instants(instants).items()})
        flight.now, flight.landing, flight.evaluations = now, landing, evaluations
        flight.is_warm = warm_start is not None
        if warm_start is not None:
            self._called["warm_start"][:] = warm_start
        self._step(STEPS["correct_motion"])
        motion = self._written(now, landing)
        self.motions.append(motion)
        prediction = Prediction(self.views, motion, present)
        return Corrected(prediction, flight.corrected.miss, self._called["worst"].copy(), flight.corrected.share)

    def present(self, now: float, orientation: float) -> Present:
        """The robot at a time not before the last measurement, at which its orientation is known, rad."""
        estimate = self.estimate
        inertial = estimate.inertial
        return Present(now, orientation, inertial.angular_momentum, estimate.path_from(now), inertial.as_found())

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
        self._kernel.flight(self._flight, step, self._kernel.instructions)


def _memory(joints: int, groups: int, bodies: int, width: int, blocks: int) -> dict[str, Array]:
    """What the kernel works in, but for what is of each instant."""
    size, columns, states, most = joints * width, CONDITIONS + width, 2 + 2 * bodies, 1 + MOST_ROWS * blocks
    counts = {
        "rows_real": bodies * groups,
        "rows_imaginary": bodies * groups,
        "merged_real": groups * groups,
        "merged_imaginary": groups * groups,
        "inertia": bodies,
        "motions": MEMORY * (2 + 3 * columns * joints),
        "scratch": 2 * bodies + 3 * groups,
        "law_memory": (4 + size + most) * size + most + columns * joints + blocks,
        "filter_memory": 3 * states + max(3 * groups, (columns + 1) * joints),
        "gap_memory": (2 * GAP_NODES + 1) * (2 * joints + 3 * groups),
    }
    return {name: np.zeros(count) for name, count in counts.items()}


def _of_instants(instants: Instants) -> dict[str, Array]:
    grid = instants.grid
    return {
        "s": grid.s,
        "integrals": grid.integrals[grid.nodes :],
        **{name: part.T for name, part in zip(("value", "first", "second"), instants.values, strict=True)},
        **dict(zip(("free_value", "free_first", "free_second"), instants.free, strict=True)),
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


def _of_capsules(tree: PlanarTree, shapes: LinkShapes) -> dict[str, Any]:
    """Places of the capsules' ends by the rotations of the groups."""
    ends = np.stack(shapes.weights, axis=1) @ TurningBodies.of(tree).rotations
    return {"radius": shapes.radius, **_parts("ends", ends)}


def _rows(blocks: Sequence[Rows], capsules: LinkShapes, bodies: int, joints: int) -> dict[str, Any]:
    """Rows of limits, block after block: kind, joint or capsule, shape, other, limit, slope, window, turns, ratios."""
    written: list[tuple[Any, ...]] = []
    obstacles: list[list[float]] = []
    first = [0]
    nothing = np.zeros(bodies), np.zeros(joints)
    for block in blocks:
        if isinstance(block, TorqueRows):
            parts = zip(block.limit, block.slope, block.turns.T, block.ratios, strict=True)
            written += [(TORQUE, 0, 0, 0, limit, slope, ALWAYS, *weights) for limit, slope, *weights in parts]
        elif isinstance(block, JointRows):
            limited = zip(block.limited, block.limit, strict=True)
            written += [(KINDS[block.quantity], i, 0, 0, limit, 0.0, ALWAYS, *nothing) for i, limit in limited]
        else:
            assert isinstance(block, DistanceRows), "the blocks that there are"
            window = block.window[0] - ROUNDING, block.window[1] + ROUNDING
            if isinstance(block.of, Obstacle):
                shapes, numbers = written_obstacle(block.of)
                pairs = [(shape, i, len(obstacles)) for shape in shapes for i in capsules.facing(block.of)]
                obstacles.append(numbers)
            else:
                pairs = [(PAIR, i, j) for i in block.of[0] for j in block.of[1]]
            written += [(DISTANCE, i, shape, j, block.margin, 0.0, window, *nothing) for shape, i, j in pairs]
        first.append(len(written))
    names = ("row_kind", "row_joint", "row_shape", "row_other", "row_limit", "row_slope", "row_window", "row_turns")
    columns = zip(*written, strict=True) if written else [()] * (len(names) + 1)
    return {
        "blocks": len(blocks),
        "torque_rows": sum(row[0] == TORQUE for row in written),
        "block_first": np.array(first),
        "aim": np.array([block.aim for block in blocks]),
        "softness": np.array([block.softness for block in blocks]),
        "obstacles": np.array(obstacles),
        **{name: np.array(column) for name, column in zip((*names, "row_ratios"), columns, strict=True)},
    }


def _of_law() -> dict[str, Any]:
    return {
        "far": FAR,
        "weighed": WEIGHED,
        "settled": SETTLED,
        "shorter": SHORTER,
        "kept": KEPT,
        "scales": SCALES,
        "evaluations_near": EVALUATIONS,
        "evaluations_far": EVALUATIONS_FAR,
    }


def _of_filter() -> dict[str, Any]:
    return {
        "angle_variance": filtering.ANGLE_NOISE**2,
        "rate_variance": filtering.RATE_NOISE**2,
        "largest_error": filtering.LARGEST_ERROR,
        "surprising": filtering.SURPRISING,
        "most_surprises": filtering.SURPRISES,
    }
