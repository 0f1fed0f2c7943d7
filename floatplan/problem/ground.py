"""The ground: a horizontal line through the lowest point of the link that takes off, at t = 0."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from floatplan.arrays import Array
from floatplan.problem.parts import JointState
from floatplan.robot.robot import Frame, Robot

TOUCHING = 2e-3  # [m] what is no higher over the ground than that may be meant to touch it


def frame_height(robot: Robot, frame: Frame, state: JointState) -> float:
    """Height of a frame over the centre of mass, m."""
    return float(_heights(robot, [frame.body], [frame.local], state)[0])


def lowest_point(robot: Robot, link: str, state: JointState) -> float:
    """Height over the centre of mass, m, of the lowest point with which a link stands.

    It is the link's own, or that of the link that it is fixed to; where that has no shape, its origin.

    Raises
    ------
    InputError
        A link's collision geometry is wrong.
    """
    standing = robot.contact_link(link)
    if standing is None:
        return frame_height(robot, robot.frames[link], state)
    shapes = robot.link_hulls[standing]
    bodies = [shape.body for shape in shapes]
    starts, ends = (
        _heights(robot, bodies, [getattr(shape, end) for shape in shapes], state) for end in ("start", "end")
    )
    return float((np.minimum(starts, ends) - [shape.radius for shape in shapes]).min())


def ground_height(robot: Robot, takeoff: str, position: tuple[float, float], initial: JointState) -> float:
    """Height of the ground, m, where the takeoff frame is at ``position`` in the initial state; errors as above."""
    frame = robot.frames[takeoff]
    return position[1] + lowest_point(robot, frame.link, initial) - frame_height(robot, frame, initial)


def resting_height(robot: Robot, landing: str, ground: float, final: JointState) -> float:
    """Height of the landing frame, m, at which its link rests on the ground in the final state; errors as above."""
    frame = robot.frames[landing]
    return ground - lowest_point(robot, frame.link, final) + frame_height(robot, frame, final)


def _heights(robot: Robot, bodies: Sequence[int], local: Sequence[complex], state: JointState) -> Array:
    """Heights (points,) over the centre of mass, m, of points fixed to bodies."""
    angles = robot.tree.absolute_angles(np.array(state.orientation), state.positions)
    weights = robot.tree.point_weights(np.array(bodies), np.array(local))
    return np.asarray((weights @ robot.tree.rotations(angles)).imag)
