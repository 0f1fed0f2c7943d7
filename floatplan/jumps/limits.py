"""Limits of a problem times factors, however the problem gives them."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from floatplan.problem.parts import Limits
from floatplan.problem.problem import Problem


def scaled_limits(problem: Problem, torque: float = 1.0, velocity: float = 1.0) -> Limits:
    """Return a problem's limits, those of torques with torque-speed curves and those of rates times factors."""
    limits = problem.limits
    curves = {name: replace(curve, stall=torque * curve.stall) for name, curve in limits.motor.items()}
    return replace(
        limits,
        motor=curves,
        torque=_times(torque, limits.torque, _of_file(problem, "torque")),
        velocity=_times(velocity, limits.velocity, _of_file(problem, "velocity")),
    )


def _of_file(problem: Problem, kind: str) -> dict[str, float]:
    """Limits of the robot's own file, by motor."""
    robot = problem.robot
    return dict(zip(robot.motors, getattr(robot, f"motor_{kind}_limits").tolist(), strict=True))


def _times(factor: float, given: Any, own: Mapping[str, float]) -> Any:
    """Limits, as a problem gives them, times a factor; ``own`` are those of the robot's file."""
    if isinstance(given, str):
        given = {name: most for name, most in own.items() if given == "urdf" and math.isfinite(most)} or "none"
    if isinstance(given, Mapping):
        return {name: factor * most for name, most in given.items()}
    return given if given == "none" else (factor * np.asarray(given)).tolist()
