"""Which blocks of inequalities a problem asks for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from floatplan.arrays import Array
from floatplan.planning.transcription.constraints import (
    ALWAYS,
    Constraint,
    LinkClearance,
    MagnitudeLimit,
    MotorLimit,
    ObstacleClearance,
    Window,
)
from floatplan.planning.transcription.quantities import QUANTITIES
from floatplan.planning.transcription.trajectory import FlightModel
from floatplan.problem.parts import Obstacle
from floatplan.problem.problem import Problem
from floatplan.tables import JOINT_LIMITS, LIMIT_TABLE, LimitRow


def constraints(problem: Problem, model: FlightModel) -> tuple[Constraint, ...]:
    """All constraints of a problem that need watching."""
    blocks: list[Constraint] = [
        ObstacleClearance(
            obstacle,
            f"obstacle {index} ({obstacle.kind})",
            model.flight.links_measured(obstacle),
            _window(obstacle, problem.flight.duration),
        )
        for index, obstacle in enumerate(problem.obstacles)
    ]
    if problem.ground:
        ground = problem.ground_plane
        blocks.append(ObstacleClearance(ground, "the ground", model.flight.links_measured(ground)))
    for pair in problem.self_clearances:
        first, second = (
            tuple(index for index, link in enumerate(model.flight.links) if link == name) for name in pair.links
        )
        blocks.append(LinkClearance(first, second, pair.links, pair.margin))
    return (
        *blocks,
        *_torque_limits(problem),
        *_joint_limits(problem),
        *_motor_limits(problem),
        *_base_limits(problem, model.flight.tangent),
    )


def _window(obstacle: Obstacle, duration: float) -> Window:
    """The window of an obstacle, as far as the flight lasts."""
    if obstacle.window is None:
        return ALWAYS
    low, high = obstacle.window
    return max(low / duration, 0.0), min(high / duration, 1.0)


def _torque_limits(problem: Problem) -> Iterator[Constraint]:
    """Limits of the motors' own torques; and of generalised ones, where the motors' own do not imply them."""
    robot, row = problem.robot, LIMIT_TABLE["torque"]
    yield from _magnitudes(row, "torque", robot.motors, problem.motor_torque_limits)
    generalized = problem.torque_limits
    if np.isfinite(generalized).any():
        own = np.isfinite(problem.motor_torque_limits)
        implied = ((robot.motor_ratios == 0) | own[:, None]).all(axis=0)
        limits = np.where(implied, np.inf, generalized)
        yield from _magnitudes(row, "generalized torque", robot.joints, limits, robot.motor_ratios.T)


def _joint_limits(problem: Problem) -> Iterator[Constraint]:
    """Limits of the planned joints' motion."""
    for row in JOINT_LIMITS:
        yield from _magnitudes(row, row.key, problem.robot.joints, problem.joint_limits[row.key])


def _base_limits(problem: Problem, tangent: int) -> Iterator[Constraint]:
    """Limits of the base's rate about each of the directions in which it can turn."""
    rate = problem.limits.orientation_rate
    if rate is not None:
        limits, row = np.full(tangent, rate), LIMIT_TABLE["orientation_rate"]
        names = ("orientation rate",) * tangent
        yield MagnitudeLimit(QUANTITIES[row.quantity], names, np.eye(tangent), limits, row.unit)


def _magnitudes(
    row: LimitRow, what: str, subjects: Sequence[str], limits: Array, combinations: Array | None = None
) -> Iterator[Constraint]:
    """The subjects' own quantities, or combinations (r, m) of them, that have a finite limit (r,), as one block."""
    limited = np.flatnonzero(np.isfinite(limits))
    if limited.size:
        names = tuple(f"{what} of {subjects[i]}" for i in limited.tolist())
        rows = np.eye(len(limits)) if combinations is None else combinations
        yield MagnitudeLimit(QUANTITIES[row.quantity], names, rows[limited], limits[limited], row.unit)


def _motor_limits(problem: Problem) -> Iterator[Constraint]:
    robot = problem.robot
    limited = np.flatnonzero(np.isfinite(problem.motor_stall))
    if limited.size:
        names = tuple(robot.motors[i] for i in limited)
        stall, slope = problem.motor_stall[limited], problem.motor_slope[limited]
        yield MotorLimit(tuple(limited.tolist()), names, robot.motor_ratios[limited], stall, slope)
