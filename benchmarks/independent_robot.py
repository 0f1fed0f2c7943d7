"""A robot by code that is not the planner's: Pinocchio's free-flyer, and links placed by the URDF's own transforms.

Both take the robot that is planned: the file's, its axes turned exactly onto the plane's normal, locked joints where
they are locked, followers where their leaders put them.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation
from straight_axes import axes_turned_in_file

import floatplan as fp
from floatplan.certificate.certificate import shapes_of

POSE, TWIST = 7, 6  # coordinates and velocities of a free-flyer
UPPER = np.triu(np.ones((TWIST, TWIST), dtype=bool))  # what Pinocchio fills of an inertia


def motor_map(robot: fp.Robot, names: list[str]) -> np.ndarray:
    """Torques (motors, m) of ``robot.motors`` by those of joints: what the file couples is moved by its leader's."""
    by_joint = np.zeros((len(robot.motors), len(names)))
    for column, name in enumerate(names):
        if name in robot.motors:
            by_joint[robot.motors.index(name), column] = 1.0
        elif name in robot.coupled:
            coupling = robot.coupled[name]
            by_joint[robot.motors.index(coupling.leader), column] = coupling.ratio
    return by_joint


def joint_map(robot: fp.Robot, names: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Positions (m,) of joints at planned positions zero, and their derivatives (m, n) by those."""
    rest, by_planned = np.zeros(len(names)), np.zeros((len(names), len(robot.joints)))
    for row, name in enumerate(names):
        if name in robot.joints:
            by_planned[row, robot.joints.index(name)] = 1.0
        elif name in robot.coupled:
            coupling = robot.coupled[name]
            rest[row] = coupling.offset
            by_planned[row, robot.joints.index(coupling.leader)] = coupling.ratio
        else:
            rest[row] = robot.locked[name]
    return rest, by_planned


class Flyer:
    """A robot floating in space, its base held in the plane: three directions free."""

    def __init__(self, robot: fp.Robot) -> None:
        document: Any = ET.fromstring(axes_turned_in_file(robot)[0])
        for link in document.findall("link"):
            for collision in link.findall("collision"):  # Pinocchio does not know every kind of shape
                link.remove(collision)
        self.model = pin.buildModelFromXML(ET.tostring(document, encoding="unicode"), pin.JointModelFreeFlyer())
        self.model.gravity = pin.Motion.Zero()
        self.data = self.model.createData()
        self.joints = list(self.model.joints)[2:]
        self.columns = [joint.idx_v for joint in self.joints]
        names = list(self.model.names)[2:]
        self.rest, self.by_planned = joint_map(robot, names)
        self.by_motor = motor_map(robot, names)
        self.normal = np.array(robot.plane.normal)
        self.free = np.zeros((TWIST, 3))  # the base's velocities in the plane
        self.free[:3, 0], self.free[:3, 1] = robot.plane.horizontal, robot.plane.vertical
        self.free[3:, 2] = self.normal

    def configuration(self, orientation: float, positions: np.ndarray) -> np.ndarray:
        """Configuration with the base at the origin, turned by the orientation about the plane's normal."""
        full = pin.neutral(self.model)
        full[3:POSE] = pin.Quaternion(pin.AngleAxis(float(orientation), self.normal)).coeffs()
        for joint, angle in zip(self.joints, self.rest + self.by_planned @ positions, strict=True):
            turned = (np.cos(angle), np.sin(angle)) if joint.nq == 2 else angle
            full[joint.idx_q : joint.idx_q + joint.nq] = turned
        return full

    def base_rate(self, positions: np.ndarray, velocities: np.ndarray, momentum: float) -> float:
        """(4) solved for theta0'."""
        everything = pin.computeCentroidalMap(self.model, self.data, self.configuration(0.0, positions))
        row = self.normal @ everything[3:]
        of_joints = row[self.columns] @ self.by_planned @ velocities
        return float((momentum - of_joints) / (row[3:TWIST] @ self.normal))

    def torques(
        self, positions: np.ndarray, velocities: np.ndarray, accelerations: np.ndarray, rate: float
    ) -> np.ndarray:
        """Torques (m,) of all joints, each its own, for which no wrench acts on the base in the plane."""
        full = self.configuration(0.0, positions)
        velocity, acceleration = np.zeros(self.model.nv), np.zeros(self.model.nv)
        velocity[self.columns], acceleration[self.columns] = (
            self.by_planned @ velocities,
            self.by_planned @ accelerations,
        )
        velocity[3:TWIST] = rate * self.normal
        inertia = pin.crba(self.model, self.data, full)[:TWIST, :TWIST]
        inertia = np.where(UPPER, inertia, inertia.T)
        wrench = self.free.T @ pin.rnea(self.model, self.data, full, velocity, acceleration)[:TWIST]
        acceleration[:TWIST] = -self.free @ np.linalg.solve(self.free.T @ inertia @ self.free, wrench)
        return np.array(pin.rnea(self.model, self.data, full, velocity, acceleration)[self.columns])


class Skeleton:
    """The links of a robot placed in space at K instants, with the root link's origin at the origin.

    Attributes
    ----------
    rotations : link -> (K, 3, 3)
    origins : link -> (K, 3)
    segments : (link, end (K, 3))
        From a link's origin to those of its children's joints, the paper's links, and of its own, where they differ.
    """

    def __init__(self, robot: fp.Robot, orientation: np.ndarray, positions: np.ndarray) -> None:
        document: Any = ET.fromstring(axes_turned_in_file(robot)[0])
        self._robot = robot
        self._plane = np.array([robot.plane.horizontal, robot.plane.vertical])
        self._links = {link.get("name"): link for link in document.iter("link")}
        joints = document.findall("joint")
        root = (set(self._links) - {joint.find("child").get("link") for joint in joints}).pop()
        turned = Rotation.from_rotvec(orientation[:, None] * np.array(robot.plane.normal)).as_matrix()
        self.rotations, self.origins = {root: turned}, {root: np.zeros((len(orientation), 3))}
        self.segments = []
        waiting = [root]
        while waiting:
            parent = waiting.pop(0)
            for joint in (joint for joint in joints if joint.find("parent").get("link") == parent):
                child = joint.find("child").get("link")
                offset, turn = _origin(joint)
                self.origins[child] = self.origins[parent] + self.rotations[parent] @ offset
                self.rotations[child] = self.rotations[parent] @ turn
                end = self.origins[child]
                if np.abs((end - self.origins[parent]) @ self._plane.T).max() > 0:
                    self.segments.append((parent, end))
                if joint.get("type") != "fixed":
                    self._move(joint, child, positions)
                if np.abs((self.origins[child] - end) @ self._plane.T).max() > 0:
                    self.segments.append((child, end))
                waiting.append(child)

    def _move(self, joint: Any, child: str, positions: np.ndarray) -> None:
        """Displace a joint's child by the joint's motion."""
        (rest,), (by_planned,) = joint_map(self._robot, [joint.get("name")])
        axis = joint.find("axis")
        direction = np.array([1.0, 0.0, 0.0] if axis is None else _numbers(axis.get("xyz")))
        motion = (rest + positions @ by_planned)[:, None] * direction / np.linalg.norm(direction)
        if joint.get("type") == "prismatic":
            self.origins[child] = self.origins[child] + np.einsum("kij,kj->ki", self.rotations[child], motion)
        else:
            self.rotations[child] = self.rotations[child] @ Rotation.from_rotvec(motion).as_matrix()

    @cached_property
    def com(self) -> np.ndarray:
        """Centre of mass (K, 3)."""
        mass, moment = 0.0, np.zeros(3)
        for name, link in self._links.items():
            inertial = link.find("inertial")
            if inertial is not None:
                share = float(inertial.find("mass").get("value"))
                mass += share
                moment = moment + share * (self.origins[name] + self.rotations[name] @ _origin(inertial)[0])
        return moment / mass

    def from_com(self, link: str) -> np.ndarray:
        """Place (K, 2) in the plane of a link's origin, relative to the centre of mass."""
        return (self.origins[link] - self.com) @ self._plane.T

    def capsules(self) -> Iterator[tuple[str, np.ndarray, np.ndarray, float]]:
        """Link, ends (K, 2) relative to the centre of mass, and radius of every capsule.

        Links with collision geometry have the capsules fitted around it; the others are segments from their origin to
        those of their children elsewhere, and a point where there is none.
        """
        fitted = {name for name, link in self._links.items() if link.find("collision") is not None}
        home = Skeleton(self._robot, np.zeros(1), np.zeros((1, len(self._robot.joints)))) if fitted else self
        for link, *ends, radius in shapes_of(self._robot):
            if link in fitted:
                turn = self.rotations[link] @ home.rotations[link][0].T
                start, end = (self.from_com(link) + turn @ (self._plane.T @ end) @ self._plane.T for end in ends)
                yield link, start, end, radius
        for link, end in self.segments:
            if link not in fitted:
                yield link, self.from_com(link), (end - self.com) @ self._plane.T, 0.0
        beginnings = {link for link, _ in self.segments}
        for name, element in self._links.items():
            if name not in fitted | beginnings and element.find("inertial") is not None:
                yield name, self.from_com(name), self.from_com(name), 0.0


def _numbers(text: str) -> list[float]:
    return [float(number) for number in text.split()]


def _origin(element: ET.Element) -> tuple[np.ndarray, np.ndarray]:
    """Translation (3,) and rotation (3, 3) of an element's origin."""
    origin = element.find("origin")
    given = {} if origin is None else origin.attrib
    turn = Rotation.from_euler("xyz", _numbers(given.get("rpy", "0 0 0"))).as_matrix()
    return np.array(_numbers(given.get("xyz", "0 0 0"))), turn
