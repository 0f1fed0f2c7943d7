"""Torques of joints that are held, in CasADi: what parts beyond a joint, and forces on them, exert about its axis.

Most of these joints turn about an axis in the plane: forces of the plane have levers out of it there. All parts beyond
such a joint move in the plane, and take about its origin p the moment

``M = sum_k (c_k - p) x m_k (c_k'' + g) + phi_k'' I_k n + phi_k'^2 n x I_k n - sum_f (f - p) x F_f``

with centres c_k, inertias I_k, and the plane's normal n; the joint's torque is the part of M along its axis.

These torques are no rows at first, since most joints bear little. Where some bear too much, they mostly do so from the
first motion that holds to the best one: the search then stops at the first, and goes on with rows for them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.jumps.contacts import Contact
from floatplan.jumps.model import Pair, PlanarModel, casadi
from floatplan.robot.standing import Spot

HOLDS = 1e-3  # [-] what rows may be off in a motion that is looked at


@dataclass(frozen=True, eq=False)
class HeldJoints:
    """Joints of a robot that are held, and turn about an axis with an effort in the file.

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
        found = {}
        for name in robot.locked:
            column = robot.model.joints[robot.model.getJointId(name)].idx_v
            effort = robot.joint_tree.joint[name].effort
            if effort < np.inf and self._data.J[3:, column].any():
                found[name] = effort
        return found

    def shares(self, names: Sequence[str], contacts: Sequence[Contact], forces: Sequence[Pair]) -> Any:
        """Torques over efforts, an expression (joints,) of y, v, a and forces.

        Parameters
        ----------
        names : of joints in ``efforts``
        contacts : that stand, the anchor first; none in flight
        forces : of each, all its points together, N
        """
        return casadi().vertcat(*[self._torque(name, contacts, forces) / self.efforts[name] for name in names])

    def _turned(self, body: int, vector: Array) -> tuple[Any, Any, float]:
        """Horizontal, vertical and third part of a vector (3,) of the reference posture that turns with a body."""
        tree = self.model.robot.tree
        (c, s), *_ = self.model.rotations
        x, z, out = self._axes @ vector
        local = complex(x, z) * complex(np.exp(-1j * tree.turn * tree.offsets[body]))
        return c[body] * local.real - s[body] * local.imag, c[body] * local.imag + s[body] * local.real, float(out)

    def _torque(self, name: str, contacts: Sequence[Contact], forces: Sequence[Pair]) -> Any:
        """Torque about a joint's axis, N m."""
        model = self.model
        robot = model.robot
        data = self._data
        joint = robot.model.getJointId(name)
        home = robot.frames[name]
        beyond = list(robot.model.subtrees[joint])
        origin = data.oMi[joint].translation
        turn = robot.tree.turn
        x, z, out = self._turned(home.body, data.J[3:, robot.model.joints[joint].idx_v])
        anchor, gravity = (contacts[0].spots[0], model.gravity) if contacts else (None, 0.0)

        def moment(spot: Spot, point: Array, force: Pair) -> Any:
            """Of a force at a spot's lowest part, as far out of the plane as a point (3,) of the reference posture."""
            own = model.places(model.weights([Spot(spot.body, spot.place)], Spot(home.body, home.local)))
            lever = float(self._axes[2] @ (point - origin))
            along = own[0] * force[1] - (own[1] - spot.radius) * force[0]
            return out * along + lever * (z * force[0] - x * force[1])

        hinge = Spot(home.body, home.local)
        spots: list[Spot] = []
        points: list[Array] = []
        spins = dict[int, Array]()  # I n of what moves with a body, in the reference posture
        for each in beyond:
            inertia = robot.model.inertias[each]
            placement = data.oMi[each]
            frame = robot.frames[robot.model.names[each]]
            points.append(placement.act(inertia.lever))
            way = self._axes[:2] @ (points[-1] - placement.translation)
            back = complex(np.exp(-1j * turn * robot.tree.offsets[frame.body]))
            spots.append(Spot(frame.body, frame.local + complex(*way) * back))
            spin = placement.rotation @ inertia.inertia @ placement.rotation.T @ robot.plane.normal
            spins[frame.body] = spins.get(frame.body, 0.0) + spin
        mass = np.array([robot.model.inertias[each].mass for each in beyond])
        levers = mass * ((np.array(points) - origin) @ self._axes[2])
        torque = out * turn * casadi().sum1(model.work(spots, mass, hinge, anchor))
        pushed = model.places(levers[None] @ model.weights(spots, anchor), 2)
        torque += z * pushed[0] - x * (pushed[1] + gravity * levers.sum())
        for body, spin in spins.items():
            spin_x, spin_z, spin_out = self._turned(body, spin)
            _, rate, change = (angles[body] for angles in model.angles)
            torque += change * (out * spin_out + x * spin_x + z * spin_z) + turn * rate**2 * (z * spin_x - x * spin_z)
        for contact, force in zip(contacts, forces, strict=True):
            part = force[0] / len(contact.spots), force[1] / len(contact.spots)
            for foot, spot in zip(contact.frames, contact.spots, strict=True):
                at = robot.model.frames[robot.model.getFrameId(robot.frames[foot].link, pin.FrameType.BODY)]
                if at.parentJoint in beyond:
                    torque -= moment(spot, data.oMi[at.parentJoint].act(at.placement.translation), part)
        return torque


def first_look(size: int, low: Array, high: Array) -> Any:
    """Return a callback for IPOPT that stops it where held joints bear too much in the first motion that holds.

    Its ``overloaded`` returns names of held joints that bear too much, of variables with directions (size,); it is set
    while IPOPT runs, since a program that its own solver holds would never be freed. Its ``strained`` is None before
    that motion; then names of these joints.

    Parameters
    ----------
    size : of the variables with directions
    low, high : bounds (rows,) of the program
    """
    ca = casadi()
    sizes = {"x": size, "f": 1, "g": len(low), "lam_x": size, "lam_g": len(low), "lam_p": 0}

    class Look(ca.Callback):  # type: ignore[misc, name-defined]
        """Called with what CasADi's solvers return, at each iterate."""

        def __init__(self) -> None:
            super().__init__()
            self.overloaded: Callable[[Array], tuple[str, ...]] | None = None
            self.strained: tuple[str, ...] | None = None
            self.construct("look", {})

        def get_n_in(self) -> int:
            return int(ca.nlpsol_n_out())

        def get_n_out(self) -> int:
            return 1

        def get_sparsity_in(self, index: int) -> Any:
            return ca.Sparsity.dense(sizes[ca.nlpsol_out(index)])

        def eval(self, arguments: Any) -> list[int]:
            """Return whether to stop."""
            now = dict(zip(ca.nlpsol_out(), arguments, strict=True))
            values = np.asarray(now["g"]).ravel()
            holds = max((low - values).max(), (values - high).max()) < HOLDS
            if self.overloaded is not None and self.strained is None and holds:
                self.strained = self.overloaded(np.asarray(now["x"]).ravel())
            return [int(bool(self.strained))]

    return Look()
