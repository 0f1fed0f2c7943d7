"""What the joints do to the robot in flight, by Pinocchio: (4), (14), (15) and (A.1); and where its links are, (20)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, ComplexArray
from floatplan.robot.robot import Robot

BASE = 3  # first coordinates of ``robot.model``: horizontal, vertical, orientation
ORIENTATION = 2
QUANTITIES = ("velocities", "accelerations", "orientation_rate", "torques", "motor_torques")  # of limits, objectives


class Quantity(NamedTuple):
    """Values (Q,) and their derivatives (Q, 3n+2) by the state u."""

    values: Array
    jacobian: Array


class Dynamics:
    """A robot in flight; its base stays at the origin, unturned: momentum and torques are the same anywhere."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.model = robot.model
        self.data = robot.model.createData()
        self.n = len(robot.joints)

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
        """Torques (nv,) of (A.1), N m; those of the base are zero, which settles how it accelerates."""
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

    def quantities(self, u: Array) -> dict[str, Quantity]:
        """All that objectives and limits may be about, by name: those of the joints (n), the motors or the base."""
        n = self.n
        moving = np.eye(len(u))
        torques = self.torques(u)
        by_name = {
            "velocities": Quantity(u[n : 2 * n], moving[n : 2 * n]),
            "accelerations": Quantity(u[2 * n : 3 * n], moving[2 * n : 3 * n]),
            "orientation_rate": self.base_rate(u),
        }
        for name, sums in (("torques", self.robot.selection), ("motor_torques", self.robot.transmission)):
            by_name[name] = Quantity(sums.T @ torques.values, sums.T @ torques.jacobian)
        return by_name

    def points(self, u: Array, weights: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Points (P,) seen from the CM, (6), (20), and derivatives by u: sums of the bodies' unit vectors, weighted."""
        tree = self.robot.tree
        terms = weights * tree.rotations(tree.absolute_angles(u[-1], u[: self.n]))
        jacobian = np.zeros((len(weights), len(u)), dtype=np.complex128)
        jacobian[:, : self.n] = 1j * tree.turn * terms @ tree.turns
        jacobian[:, -1] = 1j * tree.turn * terms.sum(axis=1)
        return terms.sum(axis=1), jacobian

    def _positions_and_rates(self, u: Array, base_rate: float) -> tuple[Array, Array]:
        rates = self.robot.selection @ u[self.n : 2 * self.n]
        rates[ORIENTATION] = base_rate
        return self.robot.reference + self.robot.selection @ u[: self.n], rates
