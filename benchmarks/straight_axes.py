"""A robot's file with the axes of moving joints exactly along the plane's normal: the robot that is planned."""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from floatplan.robot import Robot


def axes_turned_in_file(robot: Robot) -> tuple[str, float]:
    """The robot's URDF with the axes of moving joints written exactly along the normal, and the largest turn, rad.

    Forward kinematics of its own, by SciPy, at planned positions zero; joint origins stay as they are.
    """
    root: Any = ElementTree.fromstring(robot.xml)
    joints = {joint.find("child").get("link"): joint for joint in root.findall("joint")}
    orientations: dict[str, Rotation] = {}
    largest = 0.0

    def orientation(link: str) -> Rotation:
        """Of a link in the root link; turns the axes above it on the way."""
        nonlocal largest
        if link not in joints:
            return Rotation.identity()
        if link in orientations:
            return orientations[link]
        joint = joints[link]
        name, origin, axis = joint.get("name"), joint.find("origin"), joint.find("axis")
        angles = "0 0 0" if origin is None else origin.get("rpy", "0 0 0")
        rotation = orientation(joint.find("parent").get("link")) * Rotation.from_euler("xyz", _numbers(angles))
        direction = np.array([1.0, 0.0, 0.0]) if axis is None else _numbers(axis.get("xyz"))
        if name in robot.joints or name in robot.coupled:
            normal = rotation.inv().apply(np.array(robot.plane.normal))
            exact = np.copysign(1.0, normal @ direction) * normal
            unit = direction / np.linalg.norm(direction)
            largest = max(largest, float(np.arctan2(np.linalg.norm(np.cross(unit, exact)), unit @ exact)))
            written = ElementTree.SubElement(joint, "axis") if axis is None else axis
            written.set("xyz", " ".join(repr(float(value)) for value in exact))
            direction = exact
        position = robot.coupled[name].offset if name in robot.coupled else robot.locked.get(name, 0.0)
        turns = joint.get("type") in ("revolute", "continuous")
        motion = position * direction / np.linalg.norm(direction) if turns else np.zeros(3)
        orientations[link] = rotation * Rotation.from_rotvec(motion)
        return orientations[link]

    for link in joints:
        orientation(link)
    return ElementTree.tostring(root, encoding="unicode"), largest


def _numbers(text: str) -> np.ndarray:
    return np.array([float(word) for word in text.split()])
