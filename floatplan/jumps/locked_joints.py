"""Torques of locked joints, in CasADi: what bodies beyond a joint, and forces on them, exert about its axis.

Most of these joints have an axis in the plane: forces of the plane have levers out of it there. All bodies beyond such
a joint move in the plane, and take about its origin p the moment

``M = sum_k (c_k - p) x m_k (c_k'' + g) + phi_k'' I_k n + phi_k'^2 n x I_k n - sum_f (f - p) x F_f``

with centres c_k, inertias I_k, and the plane's normal n; the joint's torque is the component of M along its axis.

These torques are no rows at first, since most joints bear little. Where some bear too much, they mostly do so from the
first feasible motion to the best one: the search then stops at the first, and goes on with rows for them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.jumps.contacts import GroundContact
from floatplan.jumps.model import Pair, PlanarModel, casadi
from floatplan.robot.standing import Spot


@dataclass(frozen=True, eq=False)
class LockedJoints:
    """Joints of a robot that are locked, and rotate about an axis with an effort in the file.

    Attributes
    ----------
    model : PlanarModel
    """

    model: PlanarModel

    @cached_property
    def _axes(self) -> Array:
        """Horizontal, vertical and their cross product (3, 3)."""
        plane = self.model.robot.plane
        return np.stack((plane.horizontal, plane.vertical, np.cross(plane.horizontal, plane.vertical)))

    @cached_property
    def _data(self) -> Any:
        """Pinocchio's, in the reference posture."""
        robot = self.model.robot
        data = robot.model.createData()
        pin.computeJointJacobians(robot.model, data, np.array(robot.reference))
        return data

    @cached_property
    def efforts(self) -> dict[str, float]:
        """N m, by joint."""
        robot = self.model.robot
        efforts = {}
        for name in robot.locked:
            column = robot.model.joints[robot.model.getJointId(name)].idx_v
            effort = robot.joint_tree.joint[name].effort
            if effort < np.inf and self._data.J[3:, column].any():
                efforts[name] = effort
        return efforts

    def shares(self, names: Sequence[str], contacts: Sequence[GroundContact], forces: Sequence[Pair]) -> Any:
        """Torques over efforts, an expression (joints,) of y, v, a and forces.

        Parameters
        ----------
        names : of joints in ``efforts``
        contacts : that stand, the anchor first; none in flight
        forces : of each, the sum over its points, N
        """
        return casadi().vertcat(*[self._torque(name, contacts, forces) / self.efforts[name] for name in names])

    def _components(self, body: int, vector: Array) -> tuple[Any, Any, float]:
        """Horizontal, vertical, third component of a vector (3,) of the reference posture that rotates with a body."""
        tree = self.model.robot.tree
        (c, s), *_ = self.model.rotations
        x, z, out = self._axes @ vector
        local = complex(x, z) * complex(np.exp(-1j * tree.turn * tree.offsets[body]))
        return c[body] * local.real - s[body] * local.imag, c[body] * local.imag + s[body] * local.real, float(out)

    def _torque(self, name: str, contacts: Sequence[GroundContact], forces: Sequence[Pair]) -> Any:
        """Torque about a joint's axis, N m."""
        model = self.model
        robot = model.robot
        data = self._data
        joint = robot.model.getJointId(name)
        home = robot.frames[name]
        hinge = Spot(home.body, home.local)
        origin = data.oMi[joint].translation
        x, z, out = self._components(home.body, data.J[3:, robot.model.joints[joint].idx_v])
        anchor = contacts[0].spots[0] if contacts else None
        gravity = model.gravity if contacts else 0.0

        beyond = list(robot.model.subtrees[joint])
        spots: list[Spot] = []  # centres of mass of what is beyond the joint
        points: list[Array] = []  # the same (3,) in the reference posture
        spins = dict[int, Array]()  # I n of what moves with a body, in the reference posture
        for index in beyond:
            inertia = robot.model.inertias[index]
            placement = data.oMi[index]
            frame = robot.frames[robot.model.names[index]]
            point = placement.act(inertia.lever)
            offset = self._axes[:2] @ (point - placement.translation)
            to_body = complex(np.exp(-1j * robot.tree.turn * robot.tree.offsets[frame.body]))
            points.append(point)
            spots.append(Spot(frame.body, frame.local + complex(*offset) * to_body))
            spin = placement.rotation @ inertia.inertia @ placement.rotation.T @ robot.plane.normal
            spins[frame.body] = spins.get(frame.body, 0.0) + spin
        mass = np.array([robot.model.inertias[index].mass for index in beyond])
        levers = mass * ((np.array(points) - origin) @ self._axes[2])
        torque = out * robot.tree.turn * casadi().sum1(model.work(spots, mass, hinge, anchor))
        weighted = model.positions(levers[None] @ model.weights(spots, anchor), 2)
        torque += z * weighted[0] - x * (weighted[1] + gravity * levers.sum())
        for body, spin in spins.items():
            spin_x, spin_z, spin_out = self._components(body, spin)
            _, rate, acceleration = (angles[body] for angles in model.angles)
            torque += acceleration * (out * spin_out + x * spin_x + z * spin_z) + robot.tree.turn * rate**2 * (
                z * spin_x - x * spin_z
            )
        for contact, force in zip(contacts, forces, strict=True):
            count = len(contact.spots)
            horizontal = force[0] / count
            vertical = force[1] / count
            for foot, spot in zip(contact.frames, contact.spots, strict=True):
                at = robot.model.frames[robot.model.getFrameId(robot.frames[foot].link, pin.FrameType.BODY)]
                if at.parentJoint not in beyond:
                    continue
                # The force acts at the foot's lowest point, as far out of the plane as its frame is.
                point = data.oMi[at.parentJoint].act(at.placement.translation)
                lever = float(self._axes[2] @ (point - origin))
                foot_x, foot_z = model.positions(model.weights([Spot(spot.body, spot.place)], hinge))
                along = foot_x * vertical - (foot_z - spot.radius) * horizontal
                torque -= out * along + lever * (z * horizontal - x * vertical)
        return torque


def stop_when_overloaded(size: int, low: Array, high: Array) -> Any:
    """Return a callback for IPOPT that stops it where locked joints bear too much in the first feasible motion.

    Its ``overloaded_joints`` returns names of locked joints that bear too much, of variables with directions (size,);
    it is set while IPOPT runs, since a program that its own solver refers to would never be freed. Its ``overloaded``
    is None before that motion; then names of these joints.

    Parameters
    ----------
    size : of the variables with directions
    low, high : bounds (rows,) of the program
    """
    ca = casadi()
    sizes = {"x": size, "f": 1, "g": len(low), "lam_x": size, "lam_g": len(low), "lam_p": 0}
    tolerance = 1e-3  # [-] what rows may be off in a motion that counts as feasible here

    class StopWhenOverloaded(ca.Callback):  # type: ignore[misc, name-defined]
        """Called with what CasADi's solvers return, at each iterate."""

        def __init__(self) -> None:
            super().__init__()
            self.overloaded_joints: Callable[[Array], tuple[str, ...]] | None = None
            self.overloaded: tuple[str, ...] | None = None
            self.construct("stop_when_overloaded", {})

        def get_n_in(self) -> int:
            return int(ca.nlpsol_n_out())

        def get_n_out(self) -> int:
            return 1

        def get_sparsity_in(self, index: int) -> Any:
            return ca.Sparsity.dense(sizes[ca.nlpsol_out(index)])

        def eval(self, arguments: Any) -> list[int]:
            """Return whether to stop."""
            iterate = dict(zip(ca.nlpsol_out(), arguments, strict=True))
            values = np.asarray(iterate["g"]).ravel()
            is_feasible = max((low - values).max(), (values - high).max()) < tolerance
            if self.overloaded_joints is not None and self.overloaded is None and is_feasible:
                self.overloaded = self.overloaded_joints(np.asarray(iterate["x"]).ravel())
            return [int(bool(self.overloaded))]

    return StopWhenOverloaded()
