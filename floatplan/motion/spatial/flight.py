"""Flight in space as search and constraints see it, see :mod:`floatplan.motion.dynamics`: e = 3."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.motion.dynamics import FlightGrid, Partials
from floatplan.motion.sine_polynomial import JointMotion
from floatplan.motion.spatial.attitude import Cells, IntegrationError, Turning, cells, turn
from floatplan.motion.spatial.dynamics import BASE, SpatialDynamics
from floatplan.motion.spatial.rotations import cross_matrix, logarithm, unwrapped_angles
from floatplan.problem.attitude import STEEPEST, Attitude, tilt
from floatplan.problem.parts import JointState, Obstacle
from floatplan.problem.problem import Problem
from floatplan.robot.robot import Robot

LEVELS = ((8, 6), (16, 5), (16, 8), (32, 8), (64, 8))  # cells and stages, by levels
WORK_OF_A_BODY = 10  # [instants of one body of a plane]: what an instant of one in space costs
A_TURN_OFF = 1.0  # [rad] from the angles asked for: less is what the search corrects, more are other turns
NO_SHAPES = "the distances of a robot in space are not known yet"
SLOWEST = 1e-3  # [rad] turned in a flight: the rates of less are not resolved relative to themselves


@dataclass(frozen=True, eq=False)
class SpatialGrid:
    """Stages of cells, then other instants: in which cell each is, and the integrals (K, S) from its beginning."""

    cells: Cells
    s: Array
    cell: IntArray
    integrals: Array

    @property
    def nodes(self) -> int:
        """Number N of stages."""
        return len(self.cells.s)

    @cached_property
    def weights(self) -> Array:
        """Quadrature weights (N,) of the stages."""
        return np.tile(self.cells.gauss.weights, self.cells.count) / self.cells.count

    def also(self, instants: Array) -> SpatialGrid:
        """Return the grid with more instants."""
        cell, integrals = self.cells.place(instants)
        return SpatialGrid(
            self.cells,
            np.concatenate((self.s, instants)),
            np.concatenate((self.cell, cell)),
            np.concatenate((self.integrals, integrals)),
        )


@lru_cache(maxsize=16)
def spatial_grid(level: int) -> SpatialGrid:
    """Return the stages of a level alone."""
    of_level = cells(*LEVELS[level])
    return SpatialGrid(of_level, of_level.s, *of_level.place(of_level.s))


@dataclass(frozen=True, eq=False)
class SpatialFlight:
    """What a problem fixes of every motion in space: dynamics, attitudes (3, 3) at takeoff and landing, duration, s."""

    dynamics: SpatialDynamics
    transmission: Array
    start: Attitude
    goal: Attitude
    duration: float
    bodies: int
    tangent: int = 3
    links: tuple[str, ...] = ()
    node_counts: tuple[int, ...] = tuple(count * stages for count, stages in LEVELS)

    @cached_property
    def initial_attitude(self) -> Array:
        """Attitude (3, 3) at takeoff."""
        return self.start.matrix

    @cached_property
    def final_attitude(self) -> Array:
        """Attitude (3, 3) that is asked for at landing."""
        return self.goal.matrix

    @cached_property
    def change(self) -> Array:
        """By how much (3,) the goal's angles differ from those at takeoff, rad, whole turns included; else 0."""
        goal = self.goal
        return np.zeros(3) if goal.axes is None else np.array(goal.angles) - self.start.angles_about(goal.axes)

    def wrong(self, attitudes: Array) -> str:
        """What is wrong with the way (K, 3, 3) from takeoff to landing, its turns or its tilt; empty for nothing."""
        if self.goal.axes is None:
            return ""
        angles = unwrapped_angles(self.goal.axes, attitudes)
        off = np.abs(angles[-1] - angles[0] - self.change)
        if not off.max() < A_TURN_OFF:
            return "it makes other turns than are asked for"
        steepest = tilt(self.goal.axes, angles[:, 1]).max()
        if steepest > STEEPEST:
            return (
                f"it tilts by {np.degrees(steepest):.0f} degrees, near 90, where the other two angles are not defined"
            )
        return ""

    def links_measured(self, obstacle: Obstacle) -> tuple[str, ...]:
        """No link is measured yet."""
        raise NotImplementedError(NO_SHAPES)

    def grid(self, level: int) -> SpatialGrid:
        """Return the stages of a level."""
        return spatial_grid(range(len(LEVELS))[level])

    def fly(self, grid: FlightGrid, joints: JointMotion, angular_momentum: Array) -> SpatialBaseMotion:
        """Turn the base as joints and angular momentum (3,), kg m^2/s, make it."""
        assert isinstance(grid, SpatialGrid), "the grids of a flight are its own"
        return SpatialBaseMotion(self, grid, joints, angular_momentum)


@dataclass(eq=False)  # not frozen, for its speed: there is one per evaluation
class SpatialBaseMotion:
    """The base's motion in space. What cannot be integrated has NaN for its numbers.

    Attitudes are rotation matrices (K, 3, 3), rates in the base's axes.
    """

    flight: SpatialFlight
    grid: SpatialGrid
    joints: JointMotion
    angular_momentum: Array

    @cached_property
    def maps(self) -> tuple[Array, Array]:
        """I (K, 3, 3) and A (K, 3, n)."""
        return self.flight.dynamics.momentum_maps(self.joints.positions)

    @cached_property
    def integrated(self) -> Turning | None:
        """How the base turns; None where that cannot be integrated."""
        (inertia, joint_map), own, flight = self.maps, slice(self.grid.nodes), self.flight
        relative = np.einsum("kan,kn->ka", joint_map[own], self.joints.velocities[own])
        h, attitude = self.angular_momentum, flight.initial_attitude
        try:
            return turn(self.grid.cells, flight.duration, inertia[own], relative, h, attitude)
        except IntegrationError:
            return None

    @property
    def turning(self) -> Turning:
        """The same; an error where there is none."""
        if self.integrated is None:
            raise IntegrationError
        return self.integrated

    @cached_property
    def attitude(self) -> Array:
        """Attitudes (K, 3, 3)."""
        grid, turning = self.grid, self.integrated
        if turning is None:
            return np.full((len(grid.s), 3, 3), np.nan)
        return np.concatenate((turning.attitudes, turning.at(grid.s[grid.nodes :])))

    @cached_property
    def rate(self) -> Array:
        """Omega (K, 3), rad/s, in the base's axes."""
        inertia, joint_map = self.maps
        h = self.angular_momentum
        left = np.einsum("kba,b->ka", self.attitude, h) - np.einsum("kan,kn->ka", joint_map, self.joints.velocities)
        return np.asarray(np.linalg.solve(inertia, left[..., None])[..., 0])

    @cached_property
    def residual(self) -> Array:
        """Vector of rotation (3,), rad, from the attitude asked for at landing to that at landing."""
        if self.integrated is None:
            return np.full(3, np.nan)
        return np.asarray(logarithm((self.flight.final_attitude.T @ self.integrated.ends[-1])[None])[0])

    @property
    def missed(self) -> float:
        """Length of the residual, rad; infinite where the way there is wrong."""
        turning = self.integrated
        if turning is None or self.flight.wrong(turning.way):
            return math.inf
        return float(np.linalg.norm(self.residual))

    @property
    def wrong_way(self) -> str:
        """What is wrong with the way; empty for nothing."""
        return self.flight.wrong(self.turning.way)

    def transport(self, drift: Array) -> Array:
        """Small turns zeta (K, 3, c) that c drifts (N, 3, c) at the stages make."""
        return self.turning.transport(drift, self.grid.cell, self.grid.integrals)

    @cached_property
    def unresolved(self) -> float:
        """Root of the relative error of the attitude, as the tail of the rates' Legendre coefficients foretells it.

        Rates that fall as ``x^j`` with the degree j in a cell of S stages leave an error of ``x^(2 S)``.
        """
        cells = self.grid.cells
        if self.integrated is None:
            return math.inf
        rates = self.turning.rates.reshape(cells.count, cells.stages, 3)
        tail = np.abs(np.einsum("js,csa->cja", cells.gauss.transform[-2:], rates)).max()
        relative = float(tail) / max(float(np.abs(rates).max()), SLOWEST / self.flight.duration)
        return float(relative ** (cells.stages / (cells.stages - 2)))

    def level_needed(self, error: float) -> int:
        """Level at which the attitude at landing is exact to an error, rad: half the length of a cell halves x."""
        own, finest = self.grid.cells, len(LEVELS) - 1
        if not self.unresolved < 1:
            return finest
        decay = max(self.unresolved, 1e-16) ** (1 / own.stages)
        turned = max(float(np.abs(self.turning.rates).max()) * self.flight.duration, error)
        for level, (count, stages) in enumerate(LEVELS):
            if turned * (decay * own.count / count) ** (2 * stages) < error:
                return level
        return finest

    @cached_property
    def _joint_torques(self) -> Array:
        motion = self.joints
        return self.flight.dynamics.torques(motion.positions, motion.velocities, motion.accelerations, self.rate)

    @property
    def torques(self) -> Array:
        """Generalised joint torques (K, n) N m."""
        return np.asarray(self._joint_torques @ self.flight.dynamics.selection)

    @property
    def motor_torques(self) -> Array:
        """Each motor's own torque (K, m) N m."""
        return np.asarray(self._joint_torques @ self.flight.transmission)

    def obstacle_distances(self, obstacle: Obstacle) -> Array:
        """Not known yet."""
        raise NotImplementedError(NO_SHAPES)

    def pair_distances(self, first: tuple[int, ...], second: tuple[int, ...]) -> Array:
        """Not known yet."""
        raise NotImplementedError(NO_SHAPES)

    def at_goal(self) -> SpatialBaseMotion:
        """Return the same motion with the attitudes asked for at takeoff and landing."""
        other = replace(self)
        attitude = self.attitude.copy()
        attitude[self.grid.s == 0], attitude[self.grid.s == 1] = (
            self.flight.initial_attitude,
            self.flight.final_attitude,
        )
        other.__dict__.update(maps=self.maps, integrated=self.integrated, attitude=attitude)
        return other

    @cached_property
    def _inverse_inertia(self) -> Array:
        return np.asarray(np.linalg.inv(self.maps[0]), dtype=np.float64)

    @cached_property
    def _slopes(self) -> Array:
        return self.flight.dynamics.momentum_slopes(self.joints.positions, self.joints.velocities, self.rate)

    @cached_property
    def rate_partials(self) -> Partials:
        """Of omega."""
        inverse, back = self._inverse_inertia, np.swapaxes(self.attitude, 1, 2)
        return Partials(
            by_position=-inverse @ self._slopes,
            by_velocity=-inverse @ self.maps[1],
            by_attitude=inverse @ back @ cross_matrix(self.angular_momentum),
            by_momentum=inverse @ back,
        )

    @cached_property
    def drift(self) -> Partials:
        """Of g at the stages."""
        rates, nodes = self.rate_partials, self.grid.nodes
        turned = self.turning.attitudes
        assert rates.by_position is not None
        assert rates.by_velocity is not None
        assert rates.by_momentum is not None
        return Partials(
            by_position=turned @ rates.by_position[:nodes],
            by_velocity=turned @ rates.by_velocity[:nodes],
            by_momentum=turned @ rates.by_momentum[:nodes],
        )

    @property
    def residual_partials(self) -> Partials:
        """Of the residual."""
        transitions, weights = self.turning.carried
        missed = self.residual
        onward = left_jacobian_inverse(missed) @ self.flight.final_attitude.T
        to_end = np.empty_like(weights)
        for cell in range(len(weights) - 1, -1, -1):
            to_end[cell] = onward @ weights[cell]
            onward = onward @ transitions[cell]
        each = to_end.reshape(-1, 3, 3) / (self.flight.duration * self.grid.weights[:, None, None])
        drift = self.drift
        assert drift.by_position is not None
        assert drift.by_velocity is not None
        assert drift.by_momentum is not None
        return Partials(
            by_position=each @ drift.by_position,
            by_velocity=each @ drift.by_velocity,
            by_momentum=each @ drift.by_momentum,
        )

    def _torque_partials(self, rows: Array) -> Partials:
        """Of the joints' torques, combined by the columns of (J, r)."""
        motion, rates = self.joints, self.rate_partials
        slopes = self.flight.dynamics.torque_slopes(
            motion.positions, motion.velocities, motion.accelerations, self.rate
        )
        by_q, by_v, by_a, by_rate = (rows.T @ each for each in slopes)
        assert rates.by_position is not None
        assert rates.by_velocity is not None
        assert rates.by_attitude is not None
        assert rates.by_momentum is not None
        return Partials(
            by_position=by_q + by_rate @ rates.by_position,
            by_velocity=by_v + by_rate @ rates.by_velocity,
            by_acceleration=by_a,
            by_attitude=by_rate @ rates.by_attitude,
            by_momentum=by_rate @ rates.by_momentum,
        )

    @property
    def torque_partials(self) -> Partials:
        """Of the generalised torques."""
        return self._torque_partials(self.flight.dynamics.selection)

    @property
    def motor_torque_partials(self) -> Partials:
        """Of the motors' own torques."""
        return self._torque_partials(self.flight.transmission)

    def obstacle_partials(self, obstacle: Obstacle) -> Partials:
        """Not known yet."""
        raise NotImplementedError(NO_SHAPES)

    def pair_partials(self, first: tuple[int, ...], second: tuple[int, ...]) -> Partials:
        """Not known yet."""
        raise NotImplementedError(NO_SHAPES)


@lru_cache(maxsize=16)
def spatial_dynamics(robot: Robot) -> SpatialDynamics:
    """Return a robot's dynamics, prepared once."""
    return SpatialDynamics(robot.model, robot.reference[BASE + 1 :], robot.selection[BASE:])


@lru_cache(maxsize=8)
def spatial_flight(problem: Problem) -> SpatialFlight:
    """Prepare a problem's flight once for all motions."""
    robot = problem.robot
    start, goal = (attitude_of(state) for state in (problem.initial, problem.final))
    return SpatialFlight(
        spatial_dynamics(robot),
        robot.transmission[BASE:],
        start,
        goal,
        problem.flight.duration,
        bodies=WORK_OF_A_BODY * robot.model.njoints,
    )


def attitude_of(state: JointState) -> Attitude:
    """The attitude of a state in space."""
    assert state.attitude is not None, "the robot flies in space"
    return state.attitude


def left_jacobian_inverse(turn: Array) -> Array:
    """Derivative (3, 3) of the vector of rotation (3,), rad, by a small turn that is done after it."""
    angle = float(np.linalg.norm(turn))
    across = cross_matrix(turn)
    half = angle / 2
    factor = 1 / 12 if angle < 1e-3 else (1 - half / math.tan(half)) / angle**2
    return np.asarray(np.eye(3) - across / 2 + factor * across @ across)
