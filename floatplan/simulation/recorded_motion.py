"""The motion that a plan file states, and the torques that it takes, by Pinocchio's inverse dynamics.

Nothing is shared with the planner: joints from the coefficients by (12), the base's rate from the joint-space inertia
matrix, torques from RNEA. In flight the torques do not depend on gravity, on the orientation or on where the robot is,
so all of this is computed with the centre of mass at rest, the base at the origin and without gravity.
"""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import flint
import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, read_only
from floatplan.plans.record import PlanRecord
from floatplan.robot.planar.model import BASE_COORDINATES
from floatplan.robot.robot import Robot

NODES = 96  # [-] of Gauss-Legendre quadrature on each panel
SLOW = 0.5  # [rad/s] about which friction changes its sign: a step could not be integrated


@dataclass(frozen=True, eq=False)
class ReducedModel:
    """A robot of m moving joints, the locked ones rigid; its configuration is ``reference + selection @ positions``.

    Attributes
    ----------
    model : pinocchio.Model with nq = nv = 3 + m, gravity on; 7 + m and 6 + m in space
    reference : (nq,) rad
    selection : (nv, n)
        With zeros for the base.
    axes : (2, 3)
        The plane's horizontal and vertical axis; the identity in space.
    losses : (2, m) damping and friction of the joints, N m s/rad and N m
    """

    model: Any
    reference: Array
    selection: Array
    axes: Array
    losses: Array

    @property
    def joints(self) -> tuple[str, ...]:
        """Names (m,) of the joints that move."""
        return tuple(self.model.names)[-len(self.losses[0]) or len(self.model.names) :]

    @property
    def of_joints(self) -> tuple[slice, slice]:
        """Entries of configurations and of velocities that are joints; the others are the base's."""
        m = len(self.losses[0])
        return slice(self.model.nq - m, None), slice(self.model.nv - m, None)

    def lost(self, velocities: Array) -> Array:
        """Torques (m,) N m that the joints lose by damping and friction at velocities (m,), rad/s."""
        return np.asarray(self.losses[0] * velocities + self.losses[1] * np.tanh(velocities / SLOW))

    def off_goal(self, joints: Array, goal: Any) -> tuple[Array, Array]:
        """Magnitudes of errors at a goal (n,), rad, of joints (m,).

        The largest (n,) of each planned joint and those that follow it, and of each joint that follows none.
        """
        of_positions, of_velocities = self.of_joints
        selection = self.selection[of_velocities]
        off = np.abs(joints - (self.reference[of_positions] + selection @ np.asarray(goal, np.float64)))
        follows = selection != 0.0
        return read_only((off[:, None] * follows).max(axis=0, initial=0.0)), off[~follows.any(axis=1)]


def reduced_model(robot: Robot, gravity: float, rigid: Collection[str] | None = None) -> ReducedModel:
    """Return the robot's model falling with ``gravity`` (m/s^2) down the plane.

    Its locked joints, or those that ``rigid`` names, are made rigid where the reference has them. Built joint by joint:
    ``buildReducedModel`` fails where a link and a joint share a name.
    """
    source = robot.model
    rigid = robot.locked if rigid is None else rigid
    data = source.createData()
    pin.forwardKinematics(source, data, np.array(robot.reference))
    model = pin.Model()
    model.gravity = pin.Motion(-gravity * robot.up, np.zeros(3))
    carrier = {0: (0, pin.SE3.Identity())}  # joint of the source -> joint here, and where in its frame
    kept: list[int] = []  # entries of velocities
    kept_positions: list[int] = []
    for joint in range(1, source.njoints):
        parent, placement = carrier[source.parents[joint]]
        name = source.names[joint]
        if name in rigid:
            carrier[joint] = (parent, placement * data.liMi[joint])
        else:
            added = model.addJoint(parent, source.joints[joint], placement * source.jointPlacements[joint], name)
            carrier[joint] = (added, pin.SE3.Identity())
            own = source.joints[joint]
            kept += range(own.idx_v, own.idx_v + own.nv)
            kept_positions += range(own.idx_q, own.idx_q + own.nq)
        model.appendBodyToJoint(carrier[joint][0], source.inertias[joint], carrier[joint][1])
    model.armature = source.armature[kept]
    plane = robot.in_plane and robot.plane
    axes = np.stack([plane.horizontal, plane.vertical]) if plane else np.eye(3)
    names = [name for name in robot.model_joints if name not in rigid]
    losses = [[each.get(name, 0.0) for name in names] for each in (robot.damping, robot.friction)]
    arrays: Any = (robot.reference[kept_positions], robot.selection[kept], axes, losses)
    return ReducedModel(model, *map(read_only, arrays))


@dataclass(frozen=True, eq=False)
class ModelState:
    """Coordinates of the reduced model at one instant and their rates, (3 + m,) each, the base's first."""

    positions: Array
    velocities: Array
    accelerations: Array


class RecordedMotion:
    """The motion of a record, evaluated at any time; holds Pinocchio's scratch data, so use one per thread."""

    def __init__(self, record: PlanRecord, reduced: ReducedModel) -> None:
        self.record = record
        self.reduced = reduced
        self._model = reduced.model.copy()
        self._model.gravity = pin.Motion.Zero()
        self._data = self._model.createData()
        self._middle = 0.5 * record.duration
        p = _recentred(record.coefficients, self._middle)
        self._exponents = np.arange(len(p))
        self._polynomials = np.concatenate((p, _derivative(p), _derivative(_derivative(p))), axis=1)

    def planned(self, time: float) -> tuple[Array, Array, Array]:
        """Positions, rates and accelerations (n,) of the planned joints at a time, s: (12) and its derivatives."""
        p, rate, curvature = ((time - self._middle) ** self._exponents @ self._polynomials).reshape(3, -1)
        sine, cosine = self.record.amplitude * np.sin(p), self.record.amplitude * np.cos(p)
        return self.record.centre + sine, cosine * rate, cosine * curvature - sine * rate**2

    def joints(self, time: float) -> ModelState:
        """All joints at a time, s, the base's coordinates zero."""
        (positions, rates, curvatures), selection = self.planned(time), self.reduced.selection
        return ModelState(self.reduced.reference + selection @ positions, selection @ rates, selection @ curvatures)

    def base_velocity(self, state: ModelState, angular_momentum: float) -> tuple[Array, Array, Array]:
        """Velocity (3,) of the base that gives no momentum but the angular.

        Also the first rows of the inertia matrix, which give the momenta along the plane's axes and about the base's
        origin: the inverse of the base's part (3, 3), and the joints' part (3, m).
        """
        rows = pin.crba(self._model, self._data, state.positions)[:BASE_COORDINATES]  # only its upper triangle counts
        base = rows[:, :BASE_COORDINATES].copy()
        base[1, 0], base[2, 0], base[2, 1] = base[0, 1], base[0, 2], base[1, 2]
        inverse, coupling = np.linalg.inv(base), rows[:, BASE_COORDINATES:]
        momentum = np.array([0.0, 0.0, angular_momentum]) - coupling @ state.velocities[BASE_COORDINATES:]
        return inverse @ momentum, inverse, coupling

    def torques(self, time: float) -> Array:
        """Torques (m,) of all joints, coupled ones each with their own, N m.

        The base accelerates as the momenta's constancy demands: RNEA gives no wrench on it.
        """
        state = self.joints(time)
        base, inverse, coupling = self.base_velocity(state, self.record.angular_momentum)
        state.velocities[:BASE_COORDINATES] = base
        forces = pin.rnea(self._model, self._data, state.positions, state.velocities, state.accelerations)
        return np.asarray(forces[BASE_COORDINATES:] - coupling.T @ (inverse @ forces[:BASE_COORDINATES]))

    def takeoff(self, angular_momentum: float) -> tuple[Array, Array]:
        """Positions and velocities (3 + m,) at time zero, in the world."""
        state = self.joints(0.0)
        state.positions[BASE_COORDINATES - 1] = self.record.orientation["start"]
        state.velocities[:BASE_COORDINATES] = self.base_velocity(state, angular_momentum)[0]
        state.velocities[: BASE_COORDINATES - 1] += np.asarray(self.record.com["velocity0"])
        com = self.reduced.axes @ pin.centerOfMass(self._model, self._data, state.positions)
        state.positions[: BASE_COORDINATES - 1] = np.asarray(self.record.com["position0"]) - com
        return state.positions, state.velocities

    def com_position(self, time: float) -> Array:
        """Where the centre of mass (2,), (3,) in space, is on its parabola, m."""
        com = self.record.com
        path: Array = np.asarray(com["position0"]) + time * np.asarray(com["velocity0"])
        path[-1] -= 0.5 * com["gravity"] * time**2
        return path

    def moved_at(self, positions: Array, velocities: Array) -> Array:
        """Derivative of a configuration by time at a velocity: the velocity itself in a plane."""
        return velocities

    def off_goal(self, landed: Array) -> float:
        """By how much a configuration misses the goal's orientation, rad."""
        return abs(float(landed[BASE_COORDINATES - 1]) - float(self.record.orientation["goal"]))

    def off_path(self, times: Array, flown: Array) -> tuple[Array, float]:
        """By how much (N,) configurations miss the path's orientation at times (N,), rad, and its sensitivity to h."""
        orientation, sensitivity = self.orientation(times)
        return np.abs(flown[:, BASE_COORDINATES - 1] - orientation), sensitivity

    def orientation(self, times: Array) -> tuple[Array, float]:
        """Orientations (N,) at rising times (N,), and d orientation / d h at the last, by quadrature of (15).

        With the joints on their paths, the orientation rate is ``(h - sum_i D_i q_i') / D_0``: its derivative by h is
        ``1 / D_0``, and so is, integrated, that of the orientation (its variational equation has no other term).
        """
        nodes, weights = np.polynomial.legendre.leggauss(NODES)
        orientation, sensitivity, began = float(self.record.orientation["start"]), 0.0, 0.0
        orientations = []
        for time in times.tolist():
            half = (time - began) / 2
            for node, weight in zip(nodes, weights, strict=True):
                state = self.joints(began + half * (1 + node))
                velocity, inverse, _ = self.base_velocity(state, self.record.angular_momentum)
                orientation += half * weight * velocity[BASE_COORDINATES - 1]
                sensitivity += half * weight * inverse[BASE_COORDINATES - 1, BASE_COORDINATES - 1]
            began = time
            orientations.append(orientation)
        return np.array(orientations), float(sensitivity)


def _derivative(powers: Array) -> Array:
    """Coefficients (k + 1, n) of the derivative, powers of t in rows."""
    derived = np.zeros_like(powers)
    derived[:-1] = powers[1:] * np.arange(1, len(powers))[:, None]
    return derived


def _recentred(coefficients: Array, middle: float) -> Array:
    """Powers (k+1, n) of ``t - middle`` from those of t (n, k+1): far fewer digits cancel in their sums."""
    line = flint.fmpq_poly([_fraction(middle), 1])
    rows = [flint.fmpq_poly([_fraction(value) for value in row])(line).coeffs() for row in coefficients.tolist()]
    size = coefficients.shape[1]
    return np.array([[int(c.p) / int(c.q) for c in row] + [0.0] * (size - len(row)) for row in rows]).T


def _fraction(value: float) -> Any:
    return flint.fmpq(*value.as_integer_ratio())
