"""Heights of a robot's collision geometry during a flight, by Pinocchio's own reading of it: corners, rims, balls."""

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

import floatplan as fp


def lowest_by_link(plan: fp.Plan, times: np.ndarray, packages: Path | None = None) -> dict[str, np.ndarray]:
    """Height (N,) of the lowest point of each link that has collision geometry, m, in the problem's world."""
    robot = plan.robot
    assert robot.path is not None
    model = pin.buildModelFromUrdf(str(robot.path), pin.JointModelFreeFlyer())
    folders = [str(robot.path.parent if packages is None else packages)]
    geometry = pin.buildGeomFromUrdf(model, str(robot.path), pin.GeometryType.COLLISION, package_dirs=folders)
    data, placed = model.createData(), pin.GeometryData(geometry)
    up = np.asarray(robot.plane.vertical)
    found: dict[str, np.ndarray] = {}
    for index, q in enumerate(plan.q(times)):
        pin.updateGeometryPlacements(model, data, geometry, placed, q)
        for each, place in zip(geometry.geometryObjects, placed.oMg, strict=True):
            link = model.frames[each.parentFrame].name
            low = up @ place.translation + least(each.geometry, place.rotation.T @ up)
            heights = found.setdefault(link, np.full(len(times), np.inf))
            heights[index] = min(heights[index], low)
    return found


def least(shape: Any, up: np.ndarray) -> float:
    """Least component along ``up`` (3,) of a shape's points, in its own frame, m."""
    kind = type(shape).__name__
    if kind == "Box":
        return -float(np.abs(up) @ np.asarray(shape.halfSide))
    if kind == "Sphere":
        return -float(shape.radius)
    if kind == "Cylinder":
        return -float(abs(up[2]) * shape.halfLength + np.hypot(up[0], up[1]) * shape.radius)
    return float((np.asarray(shape.vertices()) @ up).min())
