"""The same robot on Pinocchio's own free-flyer, built from the URDF's text: the oracle for the planar model."""

import numpy as np
import pinocchio as pin

from floatplan.robot import Robot


class FreeFlyer:
    """Full free-flyer model of a robot, asked about motions in the robot's plane.

    ``text`` is a URDF of the robot, the file as it stands where left out.
    ``full``, ``velocity`` and ``acceleration`` (nv,) are those of the robot's own planar model.
    """

    def __init__(self, robot: Robot, text: str | None = None) -> None:
        self.robot = robot
        self.model = pin.buildModelFromXML(text or robot.xml, pin.JointModelFreeFlyer())
        self.model.gravity = pin.Motion.Zero()
        self.data = self.model.createData()
        self.joints = [self.model.joints[self.model.getJointId(name)] for name in list(robot.model.names)[4:]]

    def momentum_row(self, full: np.ndarray) -> np.ndarray:
        """D (n+1,): angular momentum about the CM along the normal, by base rate and planned joint rates."""
        everything = pin.computeCentroidalMap(self.model, self.data, self.configuration(full))
        row = self.robot.plane.normal @ everything[3:]
        turning = row[3:6] @ self.robot.plane.normal
        return np.r_[turning, row[[joint.idx_v for joint in self.joints]] @ self.robot.selection[3:]]

    def torques(self, full: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
        """Torques (n,) of the planned joints by RNEA."""
        plane = self.robot.plane
        rotation = self._rotation(full)
        pushed = rotation.T @ (velocity[0] * plane.horizontal + velocity[1] * plane.vertical)
        turned = velocity[2] * plane.normal
        pushing = rotation.T @ (acceleration[0] * plane.horizontal + acceleration[1] * plane.vertical)
        v = self._spread(np.r_[pushed, turned], velocity)
        a = self._spread(np.r_[pushing - np.cross(turned, pushed), acceleration[2] * plane.normal], acceleration)
        forces = pin.rnea(self.model, self.data, self.configuration(full), v, a)
        return self.robot.selection[3:].T @ forces[[joint.idx_v for joint in self.joints]]

    def configuration(self, full: np.ndarray) -> np.ndarray:
        """Configuration (nq,) of the free-flyer model."""
        plane = self.robot.plane
        q = pin.neutral(self.model)
        q[:3] = full[0] * plane.horizontal + full[1] * plane.vertical
        q[3:7] = pin.Quaternion(self._rotation(full)).coeffs()
        for joint, angle in zip(self.joints, full[3:], strict=True):
            q[joint.idx_q : joint.idx_q + joint.nq] = (np.cos(angle), np.sin(angle)) if joint.nq == 2 else angle
        return q

    def _rotation(self, full: np.ndarray) -> np.ndarray:
        return np.asarray(pin.AngleAxis(float(full[2]), self.robot.plane.normal).matrix())

    def _spread(self, base: np.ndarray, values: np.ndarray) -> np.ndarray:
        spread = np.zeros(self.model.nv)
        spread[:6] = base
        for joint, value in zip(self.joints, values[3:], strict=True):
            spread[joint.idx_v] = value
        return spread


def random_states(robot: Robot, count: int, seed: int = 0):
    """Yield (full, velocity, acceleration) of the planar model, orientation of several turns included."""
    generator = np.random.default_rng(seed)
    n = len(robot.joints)
    for _ in range(count):
        full = robot.reference + robot.selection @ generator.uniform(-3.0, 3.0, n)
        full[:3] = generator.uniform(-9.0, 9.0, 3)
        rates = []
        for _ in range(2):
            rate = robot.selection @ generator.normal(size=n)
            rate[:3] = generator.normal(size=3)
            rates.append(rate)
        yield full, *rates


def relative_error(actual: np.ndarray, expected: np.ndarray) -> float:
    """Largest difference over largest expected value."""
    return float(abs(actual - expected).max() / abs(expected).max())
