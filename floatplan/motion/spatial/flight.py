"""Flight in space as the search sees it, see :mod:`floatplan.motion.dynamics`: e = 3."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from floatplan.arrays import Array
from floatplan.motion.spatial.dynamics import BASE, SpatialDynamics
from floatplan.motion.spatial.rotations import unwrapped_angles
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
