"""What the joints do to the robot in flight, by Pinocchio: (4), (14), (15) and (A.1); and where its links are, (20)."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, ComplexArray
from floatplan.robot.robot import Robot

BASE = 3  # first coordinates of ``robot.model``: horizontal, vertical, orientation


class Dynamics:
    """A robot in flight; its base stays at the origin, unturned: momentum and torques are the same anywhere."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.data = robot.model.createData()
        self.n = len(robot.joints)
        self.moving = np.insert(robot.selection, 0, np.eye(robot.model.nv)[BASE - 1], axis=1)  # by theta_0, q

    def pinocchio(self, function: Callable[..., Any], q: Array, *rates: Array) -> Array:
        """What a function of Pinocchio returns (N, ...) at jets of q (N, n, 1+m), rates, accelerations (N, nv, 1+m)."""
        full = self.robot.reference + q[..., 0] @ self.robot.selection.T
        states = zip(full, *(rate[..., 0] for rate in rates), strict=True)
        return np.array([np.array(function(self.robot.model, self.data, *state)) for state in states])

    def momentum_map(self, q: Array) -> Array:
        """D_0, ..., D_n (N, n+1) of (4), kg m^2, for jets of q (N, n, 1+m)."""
        by_rates = self.pinocchio(pin.computeCentroidalMap, q)[:, 3:]
        return np.asarray(self.robot.plane.normal @ by_rates @ self.moving)

    def rates(self, u: Array) -> Array:
        """theta_0', q_1', ..., q_n' (N, n+1, 1+m), rad/s, by (4); derivatives of theta_0' by h and q_i' are (15)."""
        q, joint_rates, _, h, _ = np.split(u, [self.n, 2 * self.n, 3 * self.n, 3 * self.n + 1], axis=1)
        D_0, D = np.split(self.momentum_map(q)[:, None], [1], axis=2)
        rates = np.concatenate(((h - D @ joint_rates) / D_0, joint_rates), axis=1)
        state = (q, self.moving @ rates, np.zeros((len(u), len(self.moving), 1)))
        by_full = self.pinocchio(pin.computeCentroidalDynamicsDerivatives, *state)[:, 0, 3:]
        momentum_by_q = self.robot.plane.normal @ by_full @ self.robot.selection
        rates[:, :1, 1:] -= momentum_by_q[:, None] @ q[..., 1:] / D_0
        return rates

    def torques(self, u: Array) -> Array:
        """Torques (N, nv, 1+m) of (A.1), N m; those of the base are zero, which settles how it accelerates."""
        q = u[:, : self.n]
        rates = self.moving @ self.rates(u)
        accelerations = self.robot.selection @ u[:, 2 * self.n : 3 * self.n]
        M_base = self.pinocchio(pin.crba, q)[:, :BASE, :BASE]
        torques = self.pinocchio(pin.rnea, q, rates, accelerations)  # of a base that does not accelerate
        accelerations[:, :BASE, 0] = -np.linalg.solve(M_base, torques[:, :BASE, None])[..., 0]
        by_q, by_rates, M = self.pinocchio(pin.computeRNEADerivatives, q, rates, accelerations).swapaxes(0, 1)
        forces = by_q @ self.robot.selection @ q + by_rates @ rates + M @ accelerations
        forces[..., 0] = torques
        return np.asarray(forces - M[..., :BASE] @ np.linalg.solve(M_base, forces[:, :BASE]))

    def points(self, u: Array, weights: ComplexArray) -> ComplexArray:
        """Points (N, P, 1+m) seen from the CM, (6), (20): sums of the bodies' unit vectors, by weights (P, bodies)."""
        tree = self.robot.tree
        unit_vectors = tree.rotations(tree.absolute_angles(u[:, -1, 0], u[:, : self.n, 0]))
        vectors = 1j * tree.turn * unit_vectors[..., None] * (tree.turns @ u[:, : self.n] + u[:, [-1]])
        vectors[..., 0] = unit_vectors
        return np.asarray(weights @ vectors)


QUANTITIES: dict[str, Callable[[Dynamics, Array], Array]] = {  # of limits and objectives: jets (N, Q, 1+m) in states u
    "velocities": lambda dynamics, u: u[:, dynamics.n : 2 * dynamics.n],
    "accelerations": lambda dynamics, u: u[:, 2 * dynamics.n : 3 * dynamics.n],
    "orientation_rate": lambda dynamics, u: dynamics.rates(u)[:, :1],
    "torques": lambda dynamics, u: dynamics.robot.selection.T @ dynamics.torques(u),
    "motor_torques": lambda dynamics, u: dynamics.robot.transmission.T @ dynamics.torques(u),
}
