"""Replay of flights in space: the attitude of a record by its own equation, and forward dynamics on a free base.

As for flights in a plane nothing is shared with the planner: joints from the coefficients by (12), the base's rate from
the joint-space inertia matrix, its attitude by a Runge-Kutta method of order 8, torques from RNEA.
"""

from __future__ import annotations

from functools import cached_property
from itertools import count
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

from floatplan.arrays import Array
from floatplan.errors import FloatplanError, InputError
from floatplan.robot.planar.model import FREE_FLYER
from floatplan.simulation.forward import MOST_EVALUATIONS
from floatplan.simulation.recorded_motion import ModelState, RecordedMotion

TIGHT = 1e-12  # [-] per step, of the attitude
STATED = 1e-6  # [rad] by which the attitude that a record states at landing may be off
NUDGE = 1e-6  # [-] of h, by which the sensitivity is found
PLACE, TURN = slice(0, 3), slice(3, 7)  # of a configuration


class RecordedInSpace(RecordedMotion):
    """The motion of a record in space; of m joints, its configurations are (7 + m,), its velocities (6 + m,)."""

    def joints(self, time: float) -> ModelState:
        """All joints at a time, s; the base at the identity and at rest."""
        planned, rates, curvatures = self.planned(time)
        selection = self.reduced.selection
        positions = self.reduced.reference.copy()
        positions[FREE_FLYER + 1 :] += selection[FREE_FLYER:] @ planned
        return ModelState(positions, selection @ rates, selection @ curvatures)

    def turned(self, state: ModelState, momentum: Array) -> tuple[Array, Array, Array]:
        """Velocity (6,) of the base that gives this angular momentum (3,), in its axes, and no other.

        Also the inverse of the base's part (6, 6) of the inertia matrix, and the joints' part (6, m).
        """
        rows = pin.crba(self._model, self._data, state.positions)[:FREE_FLYER]
        base = np.triu(rows[:, :FREE_FLYER])
        inverse, coupling = np.linalg.inv(base + np.triu(base, 1).T), rows[:, FREE_FLYER:]
        wanted = np.concatenate((np.zeros(3), momentum))
        return inverse @ (wanted - coupling @ state.velocities[FREE_FLYER:]), inverse, coupling

    def attitudes(self, angular_momentum: Array) -> Any:
        """The quaternion x, y, z, w as a function of time, s, for an angular momentum (3,) in the world."""
        evaluations = count()

        def rate(time: float, quaternion: Array) -> Array:
            if next(evaluations) == MOST_EVALUATIONS:
                raise FloatplanError("the motion's attitude could not be integrated: it turns too fast")
            rotation = _matrix(quaternion)
            omega = self.turned(self.joints(time), rotation.T @ angular_momentum)[0][3:]
            return _spun(quaternion, omega)

        start = np.array(self.record.orientation["start"]["quaternion_xyzw"])
        options: dict[str, Any] = {"method": "DOP853", "rtol": TIGHT, "atol": TIGHT / 10, "dense_output": True}
        found = solve_ivp(rate, (0.0, self.record.duration), start, **options)
        if found.status != 0:
            raise FloatplanError(f"the motion's attitude could not be integrated: {found.message}")
        return found.sol

    @cached_property
    def attitude(self) -> Any:
        """As :meth:`attitudes`, for the record's h; InputError where it ends elsewhere than is stated."""
        found = self.attitudes(np.asarray(self.record.angular_momentum))
        off = off_by(found(self.record.duration), self.record.orientation["end"]["quaternion_xyzw"])
        if off > STATED:
            raise InputError(f"is {off:.3g} rad beside where the motion ends", element="orientation.end")
        return found

    def torques(self, time: float) -> Array:
        """Torques (m,) of all joints, coupled ones each with their own, N m."""
        state = self.joints(time)
        momentum = _matrix(self.attitude(time)).T @ self.record.angular_momentum
        base, inverse, coupling = self.turned(state, momentum)
        state.velocities[:FREE_FLYER] = base
        forces = pin.rnea(self._model, self._data, state.positions, state.velocities, state.accelerations)
        return np.asarray(forces[FREE_FLYER:] - coupling.T @ (inverse @ forces[:FREE_FLYER]))

    def takeoff(self, angular_momentum: Any) -> tuple[Array, Array]:
        """Configuration (7 + m,) and velocity (6 + m,) at time zero, in the world."""
        state = self.joints(0.0)
        quaternion = np.array(self.record.orientation["start"]["quaternion_xyzw"])
        rotation = _matrix(quaternion)
        base = self.turned(state, rotation.T @ angular_momentum)[0]
        com = pin.centerOfMass(self._model, self._data, state.positions)
        state.positions[PLACE] = np.asarray(self.record.com["position0"]) - rotation @ com
        state.positions[TURN] = quaternion
        state.velocities[:FREE_FLYER] = base
        state.velocities[:3] += rotation.T @ np.asarray(self.record.com["velocity0"])
        return state.positions, state.velocities

    def moved_at(self, positions: Array, velocities: Array) -> Array:
        """Derivative (7 + m,) of a configuration by time at a velocity (6 + m,)."""
        turned = _spun(positions[TURN], velocities[3:FREE_FLYER])
        return np.concatenate((_matrix(positions[TURN]) @ velocities[:3], turned, velocities[FREE_FLYER:]))

    def off_goal(self, landed: Array) -> float:
        """By how much a configuration misses the goal's attitude, rad."""
        return off_by(landed[TURN], self.record.orientation["goal"]["quaternion_xyzw"])

    def off_path(self, times: Array, flown: Array) -> tuple[Array, float]:
        """By how much (N,) configurations miss the path's attitude at times (N,), rad, and its sensitivity to h."""
        pairs = zip(flown, times.tolist(), strict=True)
        return np.array([off_by(each[TURN], self.attitude(time)) for each, time in pairs]), self.sensitivity()

    def sensitivity(self) -> float:
        """By how much the attitude at landing turns with h along itself, 1/(kg m^2): radians per kg m^2/s."""
        h = np.asarray(self.record.angular_momentum)
        size = float(np.linalg.norm(h))
        nudge = NUDGE * (h if size else np.array([1.0, 0.0, 0.0]))
        landed = _matrix(self.attitudes(h + nudge)(self.record.duration))
        turn = pin.log3(landed @ _matrix(self.attitude(self.record.duration)).T)
        return float(np.linalg.norm(turn) / np.linalg.norm(nudge))


def off_by(quaternion: Array, other: Any) -> float:
    """Angle between two attitudes, rad, as quaternions x, y, z, w."""
    return float(np.linalg.norm(pin.log3(_matrix(quaternion).T @ _matrix(np.asarray(other)))))


def _matrix(quaternion: Array) -> Array:
    return np.asarray(pin.Quaternion(quaternion / np.linalg.norm(quaternion)).matrix())


def _spun(quaternion: Array, omega: Array) -> Array:
    """Derivative (4,) of a quaternion x, y, z, w by time, for an angular velocity (3,) in the body's axes."""
    vector, scalar = quaternion[:3], quaternion[3]
    return np.append(scalar * omega + np.cross(vector, omega), -vector @ omega) / 2
