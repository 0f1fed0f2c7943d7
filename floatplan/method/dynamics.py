"""What the joints do to the robot in flight, by Pinocchio: (4), (14), (15) and (A.1); and where its links are, (20)."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, ComplexArray
from floatplan.robot.robot import Robot

BASE = 3  # first coordinates of ``robot.model``: horizontal, vertical, orientation
ORIENTATION = 2
QUANTITIES = ("velocities", "accelerations", "orientation_rate", "torques", "motor_torques")  # of limits, objectives


class Dynamics:
    """A robot in flight; its base stays at the origin, unturned: momentum and torques are the same anywhere.

    Quantities (N, Q) at N states u come with their derivatives (N, Q, 3n+2) by the state.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.data = robot.model.createData()
        self.n = len(robot.joints)
        self.moving = np.insert(robot.selection, 0, np.eye(robot.model.nv)[ORIENTATION], axis=1)  # by theta_0, q

    def pinocchio(self, function: Callable[..., Any], *states: Array) -> Array:
        """What a function of Pinocchio returns for each of N states, (N, ...)."""
        return np.array(
            [np.array(function(self.robot.model, self.data, *state)) for state in zip(*states, strict=True)]
        )

    def momentum_map(self, q: Array) -> Array:
        """D_0, ..., D_n (N, n+1) of (4), kg m^2."""
        full = self.robot.reference + q @ self.robot.selection.T
        by_rates = self.pinocchio(pin.computeCentroidalMap, full)[:, 3:]
        return np.asarray(self.robot.plane.normal @ by_rates @ self.moving)

    def base_rate(self, u: Array) -> tuple[Array, Array]:
        """theta_0' (N, 1), rad/s: (4) solved for it. Its derivatives by h and by q_i' are the g_0 and g_i of (15)."""
        n = self.n
        D_0, D = np.split(self.momentum_map(u[:, :n]), [1], axis=1)
        rate = (u[:, [3 * n]] - (D * u[:, n : 2 * n]).sum(axis=1, keepdims=True)) / D_0
        full, rates = self.coordinates(u, rate)
        derivatives = self.pinocchio(pin.computeCentroidalDynamicsDerivatives, full, rates, np.zeros_like(full))
        by_u = np.zeros((len(u), 1, u.shape[1]))
        by_u[:, 0, :n] = -self.robot.plane.normal @ derivatives[:, 0, 3:] @ self.robot.selection / D_0
        by_u[:, 0, n : 2 * n] = -D / D_0
        by_u[:, 0, [3 * n]] = 1 / D_0
        return rate, by_u

    def coordinates(self, u: Array, base_rate: Array) -> tuple[Array, Array]:
        """Positions and rates (N, nv) of ``robot.model``."""
        rates = np.hstack((base_rate, u[:, self.n : 2 * self.n])) @ self.moving.T
        return self.robot.reference + u[:, : self.n] @ self.robot.selection.T, rates

    def torques(self, u: Array) -> tuple[Array, Array]:
        """Torques (N, nv) of (A.1), N m; those of the base are zero, which settles how it accelerates."""
        n = self.n
        selection = self.robot.selection
        rate, rate_by_u = self.base_rate(u)
        full, rates = self.coordinates(u, rate)
        accelerations = u[:, 2 * n : 3 * n] @ selection.T
        M_base = self.pinocchio(pin.crba, full)[:, :BASE, :BASE]
        forces = self.pinocchio(pin.rnea, full, rates, accelerations)  # of a base at rest
        accelerations[:, :BASE] = -np.linalg.solve(M_base, forces[:, :BASE, None])[..., 0]
        by_full, by_rates, M = self.pinocchio(pin.computeRNEADerivatives, full, rates, accelerations).swapaxes(0, 1)
        by_u = by_rates[..., [ORIENTATION]] @ rate_by_u
        by_u[..., : 3 * n] += np.concatenate((by_full @ selection, by_rates @ selection, M @ selection), axis=2)
        by_u -= M[..., :BASE] @ np.linalg.solve(M_base, by_u[:, :BASE])
        return self.pinocchio(pin.rnea, full, rates, accelerations), by_u

    def quantity(self, name: str, u: Array) -> tuple[Array, Array]:
        """One of QUANTITIES: of the joints, Q = n, of the base or of the motors."""
        if name == "orientation_rate":
            return self.base_rate(u)
        if name in ("torques", "motor_torques"):
            gathered = self.robot.selection if name == "torques" else self.robot.transmission
            torques, by_u = self.torques(u)
            return torques @ gathered, gathered.T @ by_u
        first = self.n * (1 + QUANTITIES.index(name))
        of_joints = slice(first, first + self.n)
        return u[:, of_joints], np.broadcast_to(np.eye(u.shape[1])[of_joints], (len(u), self.n, u.shape[1]))

    def points(self, u: Array, weights: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Points (N, P) seen from the CM, (6), (20): sums of the bodies' unit vectors, by weights (P, bodies)."""
        tree = self.robot.tree
        terms = weights * tree.rotations(tree.absolute_angles(u[:, -1], u[:, : self.n]))[:, None]
        by_u = np.zeros((*terms.shape[:2], u.shape[1]), dtype=np.complex128)
        by_u[..., : self.n] = 1j * tree.turn * terms @ tree.turns
        by_u[..., -1] = 1j * tree.turn * terms.sum(axis=2)
        return terms.sum(axis=2), by_u
