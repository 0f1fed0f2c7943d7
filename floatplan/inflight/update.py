"""An update of a flight's corrections: the state that is expected, the filter, the rest of the flight corrected.

All of it is computed by the kernel, ``flight.hpp``, ``correcting.hpp`` and ``prediction.hpp``; this fills what these
read. The rest of the flight, joint motions (12) from now to the landing, is written anew exactly at each correction.
"""

from collections import deque
from collections.abc import Sequence
from copy import copy
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
from floatplan.kernel.tolerances import CORRECTION_GAINS
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.flight import GaussGrid
from floatplan.motion.quadrature import gauss_legendre
from floatplan.planning.kernel_input.bodies import Bodies
from floatplan.planning.kernel_input.rows import PlanarRows
from floatplan.robot.planar.tree import PlanarTree

ROUNDING = 1e-9  # [s] of instants at the ends of a window
FILTER = ("state", "covariance", "surprises", "wander", "deviations")  # what is of an estimate
STEPS = enumeration("Step").__members__


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

    A miss of ``sigma`` rad at the landing is worth a correction by ``acceleration`` rad/s^2; ``gains`` say the rest.
    """

    def __init__(self, tree: PlanarTree, views: Views, rewriting: Rewriting, sigma: float, acceleration: float) -> None:
        self.views = views
        self.gains = CORRECTION_GAINS
        self.motions: deque[RemainingMotion] = deque(maxlen=self.gains.memory)
        blocks = views.rows
        grid = views.instants
        constraints = PlanarRows(tree, [rows.block for rows in blocks], flight=views.flight)
        bodies = constraints.own_bodies
        n = tree.turns.shape[1]
        width = len(views.whitening)
        motors = tree.motor_turns.shape[1]
        self._first = rewriting.first
        self._instants = grid
        self._constraints = constraints.struct
        self._path = constraints.path
        self._block_first = constraints.block_first
        # The robot's C is of the masses that are estimated, which the kernel writes: no longer real, for one.
        real = np.zeros_like(bodies.real)
        imaginary = np.zeros_like(bodies.real)
        link_real = np.zeros(bodies.links.shape)
        link_imaginary = np.zeros(bodies.links.shape)
        self._robot = copy(bodies.struct)
        self._robot.point_to(real=real, imaginary=imaginary, link_real=link_real, link_imaginary=link_imaginary)
        self._robot.pointer.is_real = False
        self._called = _called_arrays(constraints, n, len(grid.s), width, motors)
        self._struct = Struct(
            "Flight",
            instants=len(grid.s),
            width=width,
            nodes=grid.nodes,
            blocks=len(blocks),
            motors=motors,
            law=Struct.of_numbers(self.gains),
            goal=views.flight.final_orientation,
            sigma=sigma,
            acceleration=acceleration,
            mass=doubles(tree.mass),
            inertia=doubles(tree.inertia),
            turns=np.concatenate((tree.turns, tree.motor_turns), axis=1),
            link_real=link_real,
            link_imaginary=link_imaginary,
            real=real,
            imaginary=imaginary,
            motions=np.zeros((self.gains.memory, 2 + 3 * (CONDITIONS + width) * n)),
            room=None,  # once it is known how much
            **dict.fromkeys(FILTER),  # see begin()
            **_of_masses(tree, bodies),
            **_of_limits(blocks, constraints.block_first),
            **_of_plan(rewriting, views, grid, self.gains.gap_nodes),
            **self._of_instants(grid),
            **self._called,
        )
        room = kernel().flight_room(self._robot.pointer, self._constraints.pointer, self._flight)
        self._struct.point_to(room=np.zeros(room))

    @property
    def row_values(self) -> Array:
        """Values (rows, K) of the rows at all instants under the motion predicted last; infinite where none applies."""
        return self._called["row_values"]

    @property
    def _flight(self) -> Any:
        """What the kernel reads and writes."""
        return self._struct.pointer

    def begin(self, estimate: Estimate) -> None:
        """Begin another flight, of which so much is known."""
        inertial, flight = estimate.inertial, self._flight
        self._struct.point_to(**{name: getattr(inertial, name) for name in FILTER})
        flight.known, flight.turn_after = 0, 0.0
        self._step(STEPS["adapt_masses"])
        self.estimate = estimate
        self.motions.clear()
        self.remember(self._first)

    def aim_as_planned(self) -> None:
        """Aim no further from limits than the motion predicted last is: it comes to the ground, as feet do."""
        landing, views = int(np.argmax(self._instants.s)), self.views
        values = [self._called["row_values"][begin:end] for begin, end in pairwise(self._block_first)]
        views.rows = [rows.as_planned(own, landing) for rows, own in zip(views.rows, values, strict=True)]
        self._struct.point_to(aim=doubles([rows.aim for rows in self.views.rows]))

    def expected(self, measured: Measurement, now: float) -> Expected:
        """Return what is expected to be measured; the motion may change from ``now`` on, s."""
        flight = self._flight
        flight.began, flight.measured, flight.now = self.estimate.time, measured.time, now
        self._called["measured_positions"][:] = measured.positions
        self._called["measured_velocities"][:] = measured.velocities
        self._step(STEPS["expect_state"])
        orientation = self.estimate.inertial.orientation + flight.turn_before
        base = orientation, flight.expected_rate, flight.aside, flight.variance, flight.noise
        return Expected(self._called["positions"], self._called["velocities"], *base)

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
            self._instants = instants
            self._struct.point_to(**self._of_instants(instants))

    def _judged(self, motion: RemainingMotion) -> Corrected:
        found = self._flight.corrected
        return Corrected(
            motion, found.miss, self._called["worst"].copy(), self._called["torque_peak"].copy(), found.share
        )

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
        compiled = kernel()
        compiled.flight(self._robot.pointer, self._constraints.pointer, self._flight, step, compiled.instructions)

    def _of_instants(self, grid: GaussGrid) -> dict[str, Array]:
        """What a motion, and its changes y, are made of where it is looked at."""
        values = self.views.functions.values(grid.s)
        free = np.stack([part[:, CONDITIONS:] @ self.views.whitening for part in values])
        basis = (free[:, :, None, :] / self._first.amplitude[:, None]).reshape(*free.shape[:2], -1).swapaxes(1, 2)
        value, first, second = values
        return {
            "s": doubles(grid.s),
            "integrals": doubles(grid.integrals[grid.nodes :]),
            "basis": doubles(basis),
            "value": doubles(value.T),
            "first": doubles(first.T),
            "second": doubles(second.T),
        }


def _called_arrays(constraints: PlanarRows, n: int, instants: int, width: int, motors: int) -> dict[str, Array]:
    """What the kernel reads and writes at each call, by the names of its struct ``Flight``."""
    coefficients = (CONDITIONS + width, n)
    return {
        "measured_positions": np.zeros(n),
        "measured_velocities": np.zeros(n),
        "positions": np.zeros(n),
        "velocities": np.zeros(n),
        "map": np.zeros(n + 1),
        "asked": np.zeros((3, n)),
        "torques": np.zeros(n + motors),
        "warm_start": np.zeros((width, n)),
        "coefficients": np.zeros(coefficients),
        "planned": np.zeros(coefficients),
        "worst": np.zeros(len(constraints.block_first) - 1),
        "row_values": np.zeros((constraints.rows, instants)),
        "torque_peak": np.zeros(motors),
    }


def _of_plan(rewriting: Rewriting, views: Views, grid: GaussGrid, gap_nodes: int) -> dict[str, Array | IntArray]:
    """The plan's motion, and what its changes and motions on a shorter time are made of."""
    first = rewriting.first
    width = len(views.whitening)
    gap = gauss_legendre(gap_nodes)
    motion = [part @ first.coefficients / first.end**order for order, part in enumerate(first.table)]
    return {
        "centre": doubles(first.centre),
        "amplitude": doubles(first.amplitude),
        "weights": doubles(grid.weights),
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
    windows = np.array([rows.window for rows in blocks]).reshape(-1, 2) + ROUNDING * np.array([-1.0, 1.0])
    return {
        "block_first": integers(first),
        "aim": doubles([rows.aim for rows in blocks]),
        "softness": doubles([rows.softness for rows in blocks]),
        "row_window": doubles(np.repeat(windows, np.diff(first), axis=0)),
    }


def _of_masses(tree: PlanarTree, bodies: Bodies) -> dict[str, Array]:
    """C, what it changes by with each mass, and the places of the centres of mass, by the rotations of the bodies."""
    by_links = tree.point_weights(np.arange(len(tree.mass)), tree.center)
    own, weights = by_links * bodies.rotations.sum(axis=0), bodies.of_points(by_links)
    back = (own if bodies.is_mirrored else own.conj()) * tree.mass[:, None]
    by_mass = back[:, :, None] * weights[:, None, :]
    return {
        "by_mass_real": doubles(by_mass.real),
        "by_mass_imaginary": doubles(by_mass.imag),
        "weights_real": doubles(weights.real),
        "weights_imaginary": doubles(weights.imag),
        "nominal_real": doubles(bodies.links.real),
        "nominal_imaginary": doubles(bodies.links.imag),
    }
