"""A robot as notebooks show it: a table, and a drawing of its solids, joints at zero, seen from one side."""

from __future__ import annotations

from collections.abc import Collection
from itertools import islice

import numpy as np
import pinocchio as pin
from matplotlib.colors import to_hex

from floatplan.arguments import html_table
from floatplan.errors import InputError
from floatplan.motion.spatial.bodies import BodyPoses
from floatplan.robot.robot import Robot
from floatplan.view.outlines import box_around, pairs, seen_robot
from floatplan.view.style import palette


def robot_html(robot: Robot) -> str:
    """Return a table and a drawing of a robot; where a shape cannot be read, the reason stands instead of a drawing."""
    rows = [
        ("base", robot.base),
        ("planned joints", _names(robot.joints)),
        ("motors", f"{len(robot.motors)}"),
        ("mass", f"{robot.mass:.4g} kg"),
    ]
    if robot.locked:
        rows.append(("locked", _names(robot.locked)))
    try:
        drawing = robot_svg(robot)
    except InputError as error:
        return html_table(robot.name, [*rows, ("no drawing", str(error))])
    table = html_table(robot.name, rows)
    return f'<div style="display: flex; align-items: flex-start; gap: 1em">{drawing}{table}</div>'


def _names(joints: Collection[str]) -> str:
    """Names in a row; more than 12 are counted."""
    shown = list(islice(joints, 12))
    if len(joints) > len(shown):
        shown.append(f"{len(joints) - len(shown)} more")
    return ", ".join(shown)


def robot_svg(robot: Robot) -> str:
    """Draw a robot with the base level and its joints at zero: an outline for each solid, a colour for each joint.

    Raises
    ------
    InputError
        The geometry of a link is wrong.
    """
    placed = seen_robot(robot, np.zeros(1), _resting_poses(robot), np.zeros(1, dtype=np.complex128))
    outlines = placed.outlines(0)
    low, high = box_around(np.concatenate(outlines), 0.04)
    width = (high - low).real
    height = (high - low).imag
    scale = 220 / max(width, height)  # [px/m] the longer side has 220 pixels
    colours = palette(1 + len(robot.joints))
    polygons = []
    for shape, _, _ in placed.painted(0):
        corners = pairs(outlines[shape] - complex(low.real, high.imag)) * [scale, -scale]  # y points down in a drawing
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners.tolist())
        polygons.append(f'<polygon points="{points}" fill="{to_hex(colours[placed.segment[shape]])}"/>')
    size = f'width="{scale * width:.0f}" height="{scale * height:.0f}"'
    look = 'style="flex: none" stroke="#222" stroke-width="0.7" fill-opacity="0.85"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size} {look}>{"".join(polygons)}</svg>'


def _resting_poses(robot: Robot) -> BodyPoses:
    """Poses of the bodies where the base is level and the joints are at zero."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.resting_configuration)
    places = [placement.translation for placement in data.oMi]
    rotations = [placement.rotation for placement in data.oMi]
    return BodyPoses(np.array([places]), np.array([rotations]))
