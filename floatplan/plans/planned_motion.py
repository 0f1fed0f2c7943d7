"""The motion of a plan: a function of time, and what is measured of it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from floatplan.arguments import numbers
from floatplan.arrays import Array, read_only
from floatplan.errors import InputError
from floatplan.motion import flight, quadrature
from floatplan.motion.dynamics import FlightState, Peaks, PlacedShapes, WholeMotion
from floatplan.motion.quadrature import least_by_grids, resolution
from floatplan.motion.sine_polynomial import WrittenMotion, free_part
from floatplan.pool import one_thread
from floatplan.problem.parts import Ground, Obstacle
from floatplan.problem.problem import Problem
from floatplan.problem.reference import REFERENCE_NODES, distance_from
from floatplan.robot.leak import leak_along
from floatplan.robot.robot import Robot
from floatplan.tables import JOINT_LIMITS, OBJECTIVE_TABLE

PEAK_NODES = (33, 65, 129, 257)  # [-] the nodes of each lie among those of the next


def least_distances(segments: PlacedShapes, obstacle: Obstacle, instants: Array) -> Array:
    """Least distances (N,) m of shapes placed at N instants, s, to an obstacle; infinite while it does not exist."""
    low, high = obstacle.window or (-np.inf, np.inf)
    distances = segments.distances(obstacle, instants).min(axis=1)
    return np.where((instants >= low) & (instants <= high), distances, np.inf)


@dataclass(frozen=True, eq=False)
class PlannedMotion(flight.MotionInFile):
    """The motion ``q_i(t) = centre_i + amplitude_i sin(sum_k b_ik t^k)`` and what follows from it at any time.

    Attributes
    ----------
    problem : Problem
    centre, amplitude : (n,) rad
    coefficients : (n, k+1)
        b of (12), powers of t in seconds.
    angular_momentum : kg m^2/s; (3,) in space, in the world's axes
    ballistics : path of the centre of mass
    """

    problem: Problem
    centre: Array
    amplitude: Array
    coefficients: Array
    angular_momentum: Any
    ballistics: flight.Ballistics

    @property
    def robot(self) -> Robot:
        """The robot that flies."""
        return self.problem.robot

    @cached_property
    def whole(self) -> WholeMotion:
        """The whole robot's motion, as the joints' makes it."""
        return flight.flight_of(self.problem).whole_motion(self._written, self.angular_momentum, self.ballistics)

    @property
    def dynamics(self) -> Any:
        """The robot's rigid-body dynamics."""
        return self.whole.dynamics

    @property
    def duration(self) -> float:
        """Flight time, s."""
        return float(self.problem.flight.duration)

    def __call__(self, times: npt.ArrayLike) -> FlightState:
        """Return the state at times; see :meth:`at`."""
        return self.at(times)

    @one_thread
    def at(self, times: npt.ArrayLike) -> FlightState:
        """State of the robot at times of any shape, s, within [0, duration]: its arrays begin with that shape.

        Raises
        ------
        InputError
            A time is not a number or lies outside the flight.
        """
        instants = self._within(times)
        return self._state(instants.ravel()).shaped(instants.shape)

    def _within(self, times: npt.ArrayLike) -> Array:
        """Times as numbers; errors as of :meth:`at`."""
        instants = np.asarray(numbers(times, "times"), dtype=np.float64)
        slack = 1e-12 * self.duration
        if not ((instants >= -slack) & (instants <= self.duration + slack)).all():
            raise InputError(f"a time lies outside the flight, [0, {self.duration}] s", element="times")
        return instants

    def _state(self, instants: Array) -> FlightState:
        """State at times (N,) within the flight."""
        return self.whole.state(instants)

    def full_motion(self, times: npt.ArrayLike) -> flight.FullMotion:
        """Motion of every joint of the URDF, and of the base in space, at N times; errors as of :meth:`at`."""
        motion: flight.FullMotion = self.whole.full_motion(self._state(self._within(times).ravel()))
        return motion

    @property
    def whole_problem(self) -> Problem:
        """The problem: a flight begins and ends where that does."""
        return self.problem

    def state(self, times: npt.ArrayLike) -> FlightState:
        """State of the robot as pictures and files of every motion ask for it: :meth:`at`."""
        return self.at(times)

    @property
    def phases(self) -> tuple[()]:
        """None: nothing of a flight has contacts, as :attr:`floatplan.Jump.phases` are."""
        return ()

    def forces(self, times: npt.ArrayLike) -> dict[str, Array]:
        """Return no forces: nothing touches the ground at times within the flight, s; see :meth:`Jump.forces`."""
        self._within(times)
        return {}

    def contact_points(self, times: npt.ArrayLike) -> dict[str, Array]:
        """Return no places where forces act; as :meth:`forces`."""
        return self.forces(times)

    @one_thread
    def joint_motion(self, times: Array) -> tuple[Array, Array, Array]:
        """Positions, velocities, accelerations (N, n) at times (N,)."""
        return self._written.at(times)

    @cached_property
    def _written(self) -> WrittenMotion:
        return WrittenMotion.from_powers(self.centre, self.amplitude, self.coefficients, self.duration)

    @one_thread
    def orientation(self, times: Array) -> Array:
        """Orientation (N,) rad at times (N,), by (18); refused in space, where it is no number."""
        return self.whole.orientation(times)

    @cached_property
    @one_thread
    def final_orientation(self) -> float:
        """Orientation at the end of the flight, rad; refused in space."""
        return self.whole.final_orientation

    @one_thread
    def clearances(self, times: npt.ArrayLike, obstacles: Sequence[Obstacle] | None = None) -> Array:
        """Least distance (N,) m between any link and any obstacle that exists then; infinite where none does.

        ``obstacles`` are those of the problem where left out.
        """
        instants = np.atleast_1d(np.asarray(times, dtype=np.float64))
        chosen = self.problem.obstacles if obstacles is None else obstacles
        if not chosen:
            return np.full(len(instants), np.inf)
        segments = self.whole.segments(instants, any(isinstance(obstacle, Ground) for obstacle in chosen))
        least = np.full(len(instants), np.inf)
        for obstacle in chosen:
            least = np.minimum(least, least_distances(segments, obstacle, instants))
        return least

    @cached_property
    def _resolved(self) -> FlightState:
        """The state at as many Chebyshev nodes as torques and rates need."""
        state = self.at(quadrature.chebyshev_nodes(PEAK_NODES[0]) * self.duration)
        for count in PEAK_NODES[1:]:
            # tail of the Chebyshev coefficients, relative to the largest value
            if all(resolution(values) < 1e-10 for values in (state.motor_torques, state.velocities)):
                break
            state = state.interleaved(self.at(quadrature.chebyshev_nodes(count)[1::2] * self.duration))
        return state

    @cached_property
    @one_thread
    def peaks(self) -> Peaks:
        """Largest torques and rates, the ranges of motion, and the least clearance, over all times."""
        state = self._resolved
        of_joints = [getattr(state, row.quantity) for row in JOINT_LIMITS]
        columns = [state.torques, state.motor_torques, *of_joints]
        largest, where = quadrature.largest_magnitudes(np.concatenate(columns, axis=1))
        splits = np.cumsum([column.shape[1] for column in columns])[:-1]
        torque, motor_torque, *peaks = np.split(largest, splits)
        _, motor_instant, *instants = np.split(where * self.duration, splits)
        lowest, _, highest, _ = quadrature.extremes(state.positions)
        ends: list[float] = []
        for obstacle in self.problem.obstacles:
            ends += obstacle.window or ()
        clearance = least_by_grids(self.clearances, self.duration, ends)[0] if self.problem.obstacles else np.inf
        peaks_of_joints: dict[str, Array] = {}
        instants_of_joints: dict[str, Array] = {}
        for row, peak, when in zip(JOINT_LIMITS, peaks, instants, strict=True):
            peaks_of_joints[row.key] = read_only(peak)
            instants_of_joints[row.key] = read_only(when)
        return Peaks(
            joints=peaks_of_joints,
            joint_instants=instants_of_joints,
            torque=read_only(torque),
            clearance=clearance if np.isfinite(clearance) else None,
            motor_torque=read_only(motor_torque),
            position=read_only(np.stack((lowest, highest), axis=1)),
            motor_torque_instant=read_only(motor_instant),
        )

    @cached_property
    @one_thread
    def holding_torques(self) -> Mapping[str, tuple[float, float]]:
        """Largest torque, N m (force, N, of a joint that slides), on each locked joint, and when, s."""
        state = self._resolved
        robot = self.robot
        forces = self.whole.forces(state)
        rows = [robot.model.idx_vs[robot.model.getJointId(joint)] for joint in robot.locked]
        largest, where = quadrature.largest_magnitudes(forces[:, rows]) if rows else (np.empty(0), np.empty(0))
        pairs = zip(largest.tolist(), (where * self.duration).tolist(), strict=True)
        return dict(zip(robot.locked, pairs, strict=True))

    @one_thread
    def least_height(self) -> tuple[float, float, str]:
        """Least height, m, of a link's surface over the ground's line; when, s; and which link's it is."""
        height, instant = least_by_grids(lambda times: self.whole.heights(times)[0].min(axis=1), self.duration, ())
        heights, links = self.whole.heights(np.array([instant]))
        return height, instant, links[int(np.argmin(heights[0]))]

    @cached_property
    @one_thread
    def out_of_plane_leak(self) -> float | None:
        """Largest angular momentum that the motion makes out of the plane, over that in it; None in space."""
        if self.robot.in_plane is None:
            return None
        state = self._resolved
        few = slice(None, None, (len(state.times) - 1) // (PEAK_NODES[0] - 1))
        positions = state.positions[few]
        velocities = state.velocities[few]
        turning = state.orientation_rate[few]
        return leak_along(self.robot, positions, velocities, turning, self.angular_momentum)

    @cached_property
    @one_thread
    def out_of_plane(self) -> Array | None:
        """By how much (3,) the robot turns away from its planned attitude until landing, as it leaves the plane, rad.

        A vector of rotation about its own axes: the plane's horizontal, its vertical and its normal. It is the joints'
        motion as planned, integrated in space: 0 for a robot that is its own mirror image in the plane, NaN where the
        motion cannot be integrated, None for a flight in space.
        """
        leak = self.out_of_plane_leak
        if leak is None or not isinstance(self.whole, flight.PlanarMotion):
            return None
        if leak < 1e-12:  # is rounding
            return read_only(np.zeros(3))
        from floatplan.motion.spatial.out_of_plane import missed_in_space  # here, because most plans do without

        return read_only(missed_in_space(self.whole))

    @cached_property
    @one_thread
    def growth_of_errors(self) -> tuple[Array, Array] | None:
        """What errors at takeoff grow to until landing, in space; None in a plane.

        They are K (3,), rad, the turn of the world at landing by ``ln |h|``, and P (3, 3), that by a small turn at
        takeoff, of the same motion of the joints.
        """
        if self.problem.robot.in_plane:
            return None
        from floatplan.motion.spatial.whole import SpatialMotion  # here, because flights in a plane do without

        assert isinstance(self.whole, SpatialMotion), "the robot flies in space"
        return self.whole.growth_of_errors

    @property
    def _size(self) -> float:
        """(17) in a plane; in space the root mean square of p's free part, over time and all joints, rad."""
        if self.problem.minimises_b:
            return float(np.linalg.norm(self.coefficients))
        return free_part(self.coefficients, self.duration)

    @cached_property
    @one_thread
    def objective_value(self) -> float:
        """Value of the problem's objective, in the unit that the table of objectives gives."""
        quantity = OBJECTIVE_TABLE[self.problem.motion.objective].quantity
        if self.problem.reference is not None:
            grid = quadrature.gauss_legendre(REFERENCE_NODES)
            positions = self.at(self.duration * grid.nodes).positions
            return distance_from(self.problem.reference, grid.nodes, grid.weights, positions)
        if self.problem.motion.objective == "robust":
            from floatplan.motion.spatial.whole import SpatialMotion  # here, because flights in a plane do without

            assert isinstance(self.whole, SpatialMotion), "the robot flies in space"
            return self.whole.robust_size(self._size)
        if quantity is None:
            return self._size
        return self.duration * quadrature.integral_of_squares(getattr(self._resolved, quantity))
