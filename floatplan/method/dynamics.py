"""What the joints do to the robot in flight: (4), (15), (20) to (22), (A.1), by Pinocchio."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, ComplexArray
from floatplan.robot.robot import LinkCapsule, Robot

BASE = 3  # first coordinates of ``robot.model``: horizontal, vertical, orientation
ORIENTATION = 2


class Quantity(NamedTuple):
    """Values (Q,) and their derivatives (Q, 3n+2) by the state u."""

    values: Array
    jacobian: Array


class Dynamics:
    """A robot in flight; its base stays at the origin, unturned: momentum and torques are the same anywhere."""

    def __init__(self, robot: Robot, capsules: Sequence[LinkCapsule] = ()) -> None:
        self.robot = robot
        self.model = robot.model
        self.data = robot.model.createData()
        self.n = len(robot.joints)
        self.axes = robot.plane.horizontal + 1j * robot.plane.vertical  # points of the plane are complex numbers
        self.points = [self._fixed_point(capsule.body, capsule.start) for capsule in capsules]
        self.points += [self._fixed_point(capsule.body, capsule.end) for capsule in capsules]

    def momentum_map(self, q: Array) -> Array:
        """D_0, ..., D_n (n+1,) of (4), kg m^2: the momentum that a unit rate of theta_0, q_1, ..., q_n makes."""
        full = self.robot.reference + self.robot.selection @ q
        by_rates = self.robot.plane.normal @ pin.computeCentroidalMap(self.model, self.data, full)[3:]
        return np.concatenate((by_rates[[ORIENTATION]], by_rates @ self.robot.selection))

    def base_rate(self, u: Array) -> Quantity:
        """theta_0' (1,), rad/s: (4) solved for it. Its derivatives by h and by q_i' are the g_0 and g_i of (15)."""
        n = self.n
        D = self.momentum_map(u[:n])
        rate = (u[3 * n] - D[1:] @ u[n : 2 * n]) / D[0]
        state = *self._positions_and_rates(u, rate), np.zeros(self.model.nv)
        momentum_by_full = pin.computeCentroidalDynamicsDerivatives(self.model, self.data, *state)[0]
        jacobian = np.zeros((1, len(u)))
        jacobian[0, :n] = -self.robot.plane.normal @ momentum_by_full[3:] @ self.robot.selection / D[0]
        jacobian[0, n : 2 * n] = -D[1:] / D[0]
        jacobian[0, 3 * n] = 1 / D[0]
        return Quantity(np.array([rate]), jacobian)

    def torques(self, u: Array) -> Quantity:
        """Torques (nv,) of (A.1) on all coordinates, N m: those of the base are zero, which settles how it accelerates."""
        n = self.n
        selection = self.robot.selection
        base_rate = self.base_rate(u)
        full, rates = self._positions_and_rates(u, base_rate.values[0])
        accelerations = selection @ u[2 * n : 3 * n]
        M_base = pin.crba(self.model, self.data, full)[:BASE, :BASE]
        pushed = pin.rnea(self.model, self.data, full, rates, accelerations)[:BASE]
        accelerations[:BASE] = -np.linalg.solve(M_base, pushed)
        by_full, by_rates, M = pin.computeRNEADerivatives(self.model, self.data, full, rates, accelerations)
        jacobian = by_rates[:, [ORIENTATION]] @ base_rate.jacobian
        jacobian[:, : 3 * n] += np.hstack((by_full @ selection, by_rates @ selection, M @ selection))
        jacobian -= M[:, :BASE] @ np.linalg.solve(M_base, jacobian[:BASE])
        return Quantity(np.array(self.data.tau), jacobian)

    def places(self, u: Array) -> tuple[ComplexArray, ComplexArray]:
        """Starts and ends of the capsules from the CM, (6) and (20), m, and their derivatives by u."""
        full = self.robot.reference + self.robot.selection @ u[: self.n]
        cm_by_full = pin.jacobianCenterOfMass(self.model, self.data, full)
        pin.computeJointJacobians(self.model, self.data, full)
        turned = self.axes * np.exp(1j * self.robot.plane.turn * u[-1])
        places = np.zeros(len(self.points), dtype=np.complex128)
        jacobian = np.zeros((len(self.points), len(u)), dtype=np.complex128)
        for index, (joint, local) in enumerate(self.points):
            arm = self.data.oMi[joint].rotation @ local
            twist = pin.getJointJacobian(self.model, self.data, joint, pin.LOCAL_WORLD_ALIGNED)
            by_full = twist[:3] - pin.skew(arm) @ twist[3:] - cm_by_full
            places[index] = turned @ (self.data.oMi[joint].translation + arm - self.data.com[0])
            jacobian[index, : self.n] = turned @ by_full @ self.robot.selection
        jacobian[:, -1] = 1j * self.robot.plane.turn * places
        return places, jacobian

    def _positions_and_rates(self, u: Array, base_rate: float) -> tuple[Array, Array]:
        rates = self.robot.selection @ u[self.n : 2 * self.n]
        rates[ORIENTATION] = base_rate
        return self.robot.reference + self.robot.selection @ u[: self.n], rates

    def _fixed_point(self, body: int, place: complex) -> tuple[int, Array]:
        """The joint that carries a point of a body, and where that is (3,) in its frame."""
        pin.framesForwardKinematics(self.model, self.data, np.array(self.robot.reference))
        frame = self.model.getFrameId(self.robot.tree.names[body], pin.FrameType.BODY)
        along = place * np.exp(1j * self.robot.plane.turn * self.robot.tree.offsets[body])
        shift = (along * self.axes.conj()).real
        joint = self.model.frames[frame].parentJoint
        return joint, self.data.oMi[joint].actInv(self.data.oMf[frame].translation + shift)
