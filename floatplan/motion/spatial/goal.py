"""What is asked of the attitude in space: where it begins and ends, and which turns lead from one to the other."""

from __future__ import annotations

import numpy as np

from floatplan.arrays import Array
from floatplan.motion.spatial.rotations import unwrapped_angles
from floatplan.problem.attitude import Attitude, tilt
from floatplan.problem.parts import JointState
from floatplan.tables import A_TURN_OFF, STEEPEST


def attitude_of(state: JointState) -> Attitude:
    """The attitude of a state in space."""
    assert state.attitude is not None, "the robot flies in space"
    return state.attitude


def angle_changes(start: Attitude, goal: Attitude) -> Array:
    """By how much (3,) the goal's angles differ from those at takeoff, rad, whole turns included; else 0."""
    return np.zeros(3) if goal.axes is None else np.array(goal.angles) - start.angles_about(goal.axes)


def wrong_way(start: Attitude, goal: Attitude, attitudes: Array) -> str:
    """What is wrong with the way (K, 3, 3) from takeoff to landing, its turns or its tilt; empty for nothing."""
    if goal.axes is None:
        return ""
    angles = unwrapped_angles(goal.axes, attitudes)
    off = np.abs(angles[-1] - angles[0] - angle_changes(start, goal))
    if not off.max() < A_TURN_OFF:
        return "it makes other turns than are asked for"
    steepest = tilt(goal.axes, angles[:, 1]).max()
    if steepest > STEEPEST:
        return f"it tilts by {np.degrees(steepest):.0f} degrees, near 90, where the other two angles are not defined"
    return ""
