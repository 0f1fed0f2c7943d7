"""Which motors' torques are drawn: leaders, and those followers whose torque differs from their leader's."""

from __future__ import annotations

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.motion.flight_state import FlightState
from floatplan.plans.plan import Plan
from floatplan.view.style import palette

ALIKE = 0.01  # [-] of a leader's peak: followers that differ by less are not drawn


def leaders(plan: Plan) -> IntArray:
    """Index (m,) of the planned joint that each motor turns or follows."""
    return np.asarray(np.abs(plan.robot.motor_ratios).argmax(axis=1))


def shown_motors(plan: Plan, state: FlightState) -> list[int]:
    """Indices of the motors to draw, leaders first."""
    torques, leader = state.motor_torques, leaders(plan)
    differing = [
        motor
        for motor in range(len(plan.robot.joints), len(plan.robot.motors))
        if _difference(torques[:, motor], torques[:, leader[motor]]) > ALIKE
    ]
    return [*range(len(plan.robot.joints)), *differing]


def motor_colours(plan: Plan, motors: list[int]) -> list[Array]:
    """Colours of motors: those of the planned joints that they turn or follow."""
    colours, leader = palette(len(plan.robot.joints) + 1)[1:], leaders(plan)
    return [colours[leader[motor]] for motor in motors]


def available_torques(plan: Plan, velocities: Array) -> Array:
    """Largest torque (N, m) of each motor at joint velocities (N, n), N m: its limit, or less by its curve."""
    problem = plan.problem
    rates = np.abs(velocities @ plan.robot.motor_ratios.T)
    return np.minimum(problem.motor_torque_limits, problem.motor_stall - problem.motor_slope * rates)


def _difference(follower: Array, leader: Array) -> float:
    """Largest difference, up to sign, over the leader's peak."""
    peak = max(float(np.abs(leader).max()), 1e-300)
    return float(min(np.abs(follower - leader).max(), np.abs(follower + leader).max())) / peak
