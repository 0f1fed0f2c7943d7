"""What the joints do to the robot in flight, by Pinocchio: (4), (14), (15) and (A.1); and where its links are, (20)."""

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, ComplexArray
from floatplan.robot.robot import Robot

BASE = 3  # first coordinates of ``robot.model``: horizontal, vertical, orientation
ORIENTATION = 2
QUANTITIES = ("velocities", "accelerations", "orientation_rate", "torques", "motor_torques")  # of limits, objectives


class Dynamics:
    """A robot in flight; its base stays at the origin, unturned: momentum and torques are the same anywhere.

    Quantities (Q,) of a state u come with their derivatives (Q, 3n+2) by it.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.model = robot.model
        self.data = robot.model.createData()
        self.n = len(robot.joints)

    def momentum_map(self, q: Array) -> Array:
        """D_0, ..., D_n (n+1,) of (4), kg m^2."""
        full = self.robot.reference + self.robot.selection @ q
        by_rates = self.robot.plane.normal @ pin.computeCentroidalMap(self.model, self.data, full)[3:]
        return np.concatenate((by_rates[[ORIENTATION]], by_rates @ self.robot.selection))

    def base_rate(self, u: Array) -> tuple[Array, Array]:
        """theta_0' (1,), rad/s: (4) solved for it. Its derivatives by h and by q_i' are the g_0 and g_i of (15)."""
        n = self.n
        D = self.momentum_map(u[:n])
        rate = (u[[3 * n]] - D[1:] @ u[n : 2 * n]) / D[0]
        state = *self.coordinates(u, rate), np.zeros(self.model.nv)
        momentum_by_full = pin.computeCentroidalDynamicsDerivatives(self.model, self.data, *state)[0]
        by_u = np.zeros((1, len(u)))
        by_u[0, :n] = -self.robot.plane.normal @ momentum_by_full[3:] @ self.robot.selection / D[0]
        by_u[0, n : 2 * n] = -D[1:] / D[0]
        by_u[0, 3 * n] = 1 / D[0]
        return rate, by_u

    def torques(self, u: Array) -> tuple[Array, Array]:
        """Torques (nv,) of (A.1), N m; those of the base are zero, which settles how it accelerates."""
        selection = self.robot.selection
        rate, rate_by_u = self.base_rate(u)
        full, rates = self.coordinates(u, rate)
        accelerations = selection @ u[2 * self.n : 3 * self.n]
        M_base = pin.crba(self.model, self.data, full)[:BASE, :BASE]
        forces = pin.rnea(self.model, self.data, full, rates, accelerations)  # of a base at rest
        accelerations[:BASE] = -np.linalg.solve(M_base, forces[:BASE])
        by_full, by_rates, M = pin.computeRNEADerivatives(self.model, self.data, full, rates, accelerations)
        by_u = by_rates[:, [ORIENTATION]] @ rate_by_u
        by_u[:, : 3 * self.n] += np.hstack((by_full @ selection, by_rates @ selection, M @ selection))
        by_u -= M[:, :BASE] @ np.linalg.solve(M_base, by_u[:BASE])
        return np.array(self.data.tau), by_u

    def coordinates(self, u: Array, base_rate: Array) -> tuple[Array, Array]:
        """Positions and rates (nv,) of ``robot.model``."""
        rates = self.robot.selection @ u[self.n : 2 * self.n]
        rates[ORIENTATION] = base_rate[0]
        return self.robot.reference + self.robot.selection @ u[: self.n], rates

    def quantities(self, u: Array) -> dict[str, tuple[Array, Array]]:
        """All that objectives and limits may be about, by name: those of the joints (n), the base or the motors."""
        n = self.n
        by_u = np.eye(len(u))
        torques, torques_by_u = self.torques(u)
        joints = self.robot.selection.T
        motors = self.robot.transmission.T
        return {
            "velocities": (u[n : 2 * n], by_u[n : 2 * n]),
            "accelerations": (u[2 * n : 3 * n], by_u[2 * n : 3 * n]),
            "orientation_rate": self.base_rate(u),
            "torques": (joints @ torques, joints @ torques_by_u),
            "motor_torques": (motors @ torques, motors @ torques_by_u),
        }

    def points(self, u: Array, weights: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Points (P,) seen from the CM, (6), (20): sums of the bodies' unit vectors, by weights (P, bodies)."""
        tree = self.robot.tree
        terms = weights * tree.rotations(tree.absolute_angles(u[-1], u[: self.n]))
        by_u = np.zeros((len(weights), len(u)), dtype=np.complex128)
        by_u[:, : self.n] = 1j * tree.turn * terms @ tree.turns
        by_u[:, -1] = 1j * tree.turn * terms.sum(axis=1)
        return terms.sum(axis=1), by_u
