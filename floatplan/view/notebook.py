"""A robot as notebooks show it: a table, and a drawing of its capsules in the plane, or of its solids from one side."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import to_hex
from scipy.spatial import ConvexHull

from floatplan.arguments import html_table
from floatplan.arrays import ComplexArray
from floatplan.errors import InputError
from floatplan.motion.spatial.bodies import BodyPoses
from floatplan.robot.robot import Robot
from floatplan.view.outlines import body_poses, box_around, drawn_part, drawn_shapes, pairs, stadium
from floatplan.view.solids import CAMERA, drawn_solids
from floatplan.view.style import palette

SIZE = 220  # [pixels] of the drawing's longer side
THINNEST = 0.01  # [-] radius of a link without a shape, in sizes of the robot
MARGIN = 0.04  # [-] around the robot, in sizes of it


def robot_html(robot: Robot) -> str:
    """Return a table and a drawing of a robot; where a shape cannot be read, the reason stands instead of a drawing."""
    flies = f"in the plane {robot.plane.name}" if robot.in_plane else f"in space, its base is {robot.base}"
    rows = [
        ("flies", flies),
        ("planned joints", ", ".join(robot.joints)),
        ("motors", f"{len(robot.motors)}"),
        ("mass", f"{robot.mass:.4g} kg"),
    ]
    if robot.locked:
        rows.append(("locked", ", ".join(robot.locked)))
    try:
        drawing = robot_svg(robot)
    except InputError as error:
        return html_table(robot.name, [*rows, ("no drawing", str(error))])
    table = html_table(robot.name, rows)
    return f'<div style="display: flex; align-items: flex-start; gap: 1em">{drawing}{table}</div>'


def robot_svg(robot: Robot) -> str:
    """Draw a robot with the base level and its joints at rest: an outline for each shape, a colour for each joint.

    Raises
    ------
    InputError
        The geometry of a link is wrong.
    """
    polygons = _in_space(robot) if robot.in_plane is None else _in_plane(robot)
    low, high = box_around(np.concatenate([outline for _, outline in polygons]), MARGIN)
    width, height = (high - low).real, (high - low).imag
    scale = SIZE / max(width, height)
    colours = palette(1 + len(robot.joints))
    drawn = []
    for part, outline in polygons:
        corners = pairs(outline - complex(low.real, high.imag)) * [scale, -scale]  # y points down in a drawing
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners.tolist())
        drawn.append(f'<polygon points="{points}" fill="{to_hex(colours[part])}"/>')
    size = f'width="{scale * width:.0f}" height="{scale * height:.0f}"'
    look = 'style="flex: none" stroke="#222" stroke-width="0.7" fill-opacity="0.85"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size} {look}>{"".join(drawn)}</svg>'


def _in_plane(robot: Robot) -> list[tuple[int, ComplexArray]]:
    """The part and the outline of each capsule, m."""
    poses = body_poses(robot, np.zeros(1), robot.resting[None], np.zeros(1, dtype=np.complex128))
    shapes = drawn_shapes(robot)
    sides = [poses.points([shape.body] * 2, [shape.start, shape.end])[0].tolist() for shape in shapes]
    low, high = box_around(np.ravel(sides), 0.0)
    thinnest = THINNEST * abs(high - low)
    outlines = [
        stadium(start, end, max(shape.radius, thinnest)) for (start, end), shape in zip(sides, shapes, strict=True)
    ]
    return list(zip(drawn_part(robot).tolist(), outlines, strict=True))


def _in_space(robot: Robot) -> list[tuple[int, ComplexArray]]:
    """The part and the outline of each solid as the camera sees it, the farthest first."""
    poses = BodyPoses.of(robot, np.eye(3)[None], robot.resting[None], np.zeros((1, 3)))
    solids = [(solid.part, poses.points(solid.body, solid.points)[0]) for solid in drawn_solids(robot)]
    solids.sort(key=lambda solid: float((solid[1] @ CAMERA.toward).mean()))
    outlines = []
    for part, points in solids:
        seen = CAMERA(points)
        outlines.append((part, seen[ConvexHull(pairs(seen)).vertices]))
    return outlines
