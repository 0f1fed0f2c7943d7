"""Limits of a problem times factors, in whatever form the problem has them."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.problem.parts import Limits
from floatplan.problem.problem import Problem


def scaled_limits(problem: Problem, torque: float = 1.0, velocity: float = 1.0) -> Limits:
    """Return a problem's limits, those of torques with torque-speed curves and those of rates times factors."""
    limits = problem.limits
    robot = problem.robot
    curves = {name: replace(curve, stall=torque * curve.stall) for name, curve in limits.motor.items()}
    return replace(
        limits,
        motor=curves,
        torque=_times(torque, limits.torque, robot.motors, robot.motor_torque_limits),
        velocity=_times(velocity, limits.velocity, robot.motors, robot.motor_velocity_limits),
    )


def _times(factor: float, limits: Any, motors: tuple[str, ...], of_file: Array) -> Any:
    """Limits, as a problem has them, times a factor; ``of_file`` are those of the robot's file, by motor."""
    if isinstance(limits, str) and limits == "urdf":
        limits = {}
        for name, most in zip(motors, of_file.tolist(), strict=True):
            if math.isfinite(most):
                limits[name] = most
        limits = limits or "none"
    if isinstance(limits, Mapping):
        return {name: factor * most for name, most in limits.items()}
    return limits if isinstance(limits, str) else (factor * np.asarray(limits)).tolist()
