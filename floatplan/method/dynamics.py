"""What moves: the base by the joints, (4), the torques of (A.1), the places of the links, (20) to (22)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, ComplexArray
from floatplan.robot.robot import Frame, LinkCapsule, Robot

BASE = 3  # coordinates of the base in ``robot.model``: horizontal, vertical, orientation
ORIENTATION = 2  # the index of the last of them


class Quantity(NamedTuple):
    """Values (r,) and their derivatives (r, 3n+2) by the state u."""

    values: Array
    jacobian: Array


class Dynamics:
    """A robot in flight, by Pinocchio.

    Momentum and torques do not depend on where the base is and how it is turned: it stays at the origin, unturned, and
    only its rate counts. Gravity does not count either: the joints of what falls freely do not feel it.
    """

    def __init__(self, robot: Robot) -> None:
        self.model = robot.model
        self.data = robot.model.createData()
        self.plane = robot.plane
        self.reference = robot.reference
        self.selection = robot.selection
        self.joints = len(robot.joints)

    def momentum_map(self, q: Array) -> Array:
        """D_0, ..., D_n (n+1,) of (4), kg m^2: the momentum that a unit rate of theta_0, q_1, ..., q_n makes."""
        full_map = pin.computeCentroidalMap(self.model, self.data, self._full(q))
        about_normal = self.plane.normal @ full_map[3:]
        return np.concatenate((about_normal[[ORIENTATION]], about_normal @ self.selection))

    def momentum_by_position(self, q: Array, rates: Array, base_rate: float) -> Array:
        """Derivatives (n,) of the left side of (4) by q, at rates (n,) and a rate of the base, kg m^2/s."""
        state = self._full(q), self._full_rates(rates, base_rate), np.zeros(self.model.nv)
        derivatives = pin.computeCentroidalDynamicsDerivatives(self.model, self.data, *state)
        return np.asarray(self.plane.normal @ derivatives[0][3:] @ self.selection)

    def base_rate(self, u: Array) -> Quantity:
        """theta_0' (1,), rad/s: (4) solved for it, with g_0 and g_i of (15) its derivatives by h and by q_i'."""
        n = self.joints
        q = u[:n]
        rates = u[n : 2 * n]
        h = u[3 * n]
        D = self.momentum_map(q)
        rate = (h - D[1:] @ rates) / D[0]
        jacobian = np.zeros((1, len(u)))
        jacobian[0, :n] = -self.momentum_by_position(q, rates, rate) / D[0]
        jacobian[0, n : 2 * n] = -D[1:] / D[0]
        jacobian[0, 3 * n] = 1 / D[0]
        return Quantity(np.array([rate]), jacobian)

    def forces(self, u: Array) -> Quantity:
        """Torques (nv,) on all coordinates of the model, (A.1), N m; nothing drives the base, so its three are zero.

        That settles the acceleration of the base, and how it changes with u.
        """
        n = self.joints
        base_rate = self.base_rate(u)
        q = self._full(u[:n])
        v = self._full_rates(u[n : 2 * n], base_rate.values[0])
        a = self.selection @ u[2 * n : 3 * n]
        M_base = pin.crba(self.model, self.data, q)[:BASE, :BASE]
        a[:BASE] = -np.linalg.solve(M_base, pin.rnea(self.model, self.data, q, v, a)[:BASE])
        by_q, by_v, M = pin.computeRNEADerivatives(self.model, self.data, q, v, a)
        forces = np.array(self.data.tau)
        jacobian = by_v[:, [ORIENTATION]] @ base_rate.jacobian
        jacobian[:, :n] += by_q @ self.selection
        jacobian[:, n : 2 * n] += by_v @ self.selection
        jacobian[:, 2 * n : 3 * n] += M @ self.selection
        jacobian -= M[:, :BASE] @ np.linalg.solve(M_base, jacobian[:BASE])
        return Quantity(forces, jacobian)

    def _full(self, q: Array) -> Array:
        return np.asarray(self.reference + self.selection @ q)

    def _full_rates(self, rates: Array, base_rate: float) -> Array:
        full_rates = self.selection @ rates
        full_rates[ORIENTATION] = base_rate
        return np.asarray(full_rates)


class Points:
    """Points that are fixed to bodies of the robot, seen from its centre of mass, as complex numbers.

    The real part is along the plane's horizontal, the imaginary one along its vertical, m.
    """

    def __init__(self, dynamics: Dynamics, robot: Robot, bodies: Sequence[int], local: Sequence[complex]) -> None:
        self.dynamics = dynamics
        self.axes = np.array([robot.plane.horizontal, robot.plane.vertical])
        model, data = dynamics.model, dynamics.data
        pin.framesForwardKinematics(model, data, np.array(robot.reference))
        self.points = []
        for body, place in zip(bodies, local, strict=True):
            frame = model.getFrameId(robot.tree.names[body], pin.FrameType.BODY)
            along_plane = place * np.exp(1j * robot.plane.turn * robot.tree.offsets[body])
            point = data.oMf[frame].translation + np.array([along_plane.real, along_plane.imag]) @ self.axes
            joint = model.frames[frame].parentJoint
            self.points.append((joint, data.oMi[joint].actInv(point)))

    @classmethod
    def of_frame(cls, dynamics: Dynamics, robot: Robot, frame: Frame) -> Points:
        """Return the origin of a link or joint."""
        return cls(dynamics, robot, [frame.body], [frame.local])

    @classmethod
    def of_capsules(cls, dynamics: Dynamics, robot: Robot, capsules: Sequence[LinkCapsule]) -> Points:
        """Return the starts of all capsules, then their ends."""
        bodies = [capsule.body for capsule in capsules]
        ends = [capsule.start for capsule in capsules] + [capsule.end for capsule in capsules]
        return cls(dynamics, robot, [*bodies, *bodies], ends)

    def from_com(self, u: Array) -> tuple[ComplexArray, ComplexArray]:
        """Places (P,) relative to the centre of mass, (6) and (20), and their derivatives (P, 3n+2) by u, m."""
        model, data, n = self.dynamics.model, self.dynamics.data, self.dynamics.joints
        full = self.dynamics._full(u[:n])
        com_by_full = pin.jacobianCenterOfMass(model, data, full)
        pin.computeJointJacobians(model, data, full)
        com = data.com[0]
        to_plane = self.axes[0] + 1j * self.axes[1]
        turned = np.exp(1j * self.dynamics.plane.turn * u[-1])
        places = np.zeros(len(self.points), dtype=np.complex128)
        jacobian = np.zeros((len(self.points), len(u)), dtype=np.complex128)
        for number, (joint, local) in enumerate(self.points):
            arm = data.oMi[joint].rotation @ local
            twist = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)
            by_full = twist[:3] - pin.skew(arm) @ twist[3:] - com_by_full
            places[number] = turned * (to_plane @ (data.oMi[joint].translation + arm - com))
            jacobian[number, :n] = turned * (to_plane @ by_full @ self.dynamics.selection)
        jacobian[:, -1] = 1j * self.dynamics.plane.turn * places
        return places, jacobian
