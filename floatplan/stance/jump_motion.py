"""The motion of a whole jump, stances and flight: its state at any time, and in the coordinates of the file's model.

Those are the coordinates of ``pinocchio.buildModelFromUrdf(file, pinocchio.JointModelFreeFlyer())``; axes, origin and
orders are those of a plan: :mod:`floatplan.motion.planar.full_model`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from floatplan.arguments import numbers
from floatplan.arrays import Array, ComplexArray
from floatplan.errors import InputError
from floatplan.motion.planar.full_model import FREE_FLYER, free_flyer
from floatplan.plans.plan import Plan
from floatplan.pool import one_thread
from floatplan.problem.jump import JumpRequest
from floatplan.problem.problem import Problem
from floatplan.robot import Robot
from floatplan.stance.motion import BASE, JumpState, Stance, flight_state, joined


@dataclass(frozen=True)
class JumpPhase:
    """A time of a jump in which contacts do not change.

    Attributes
    ----------
    kind : "stance" or "flight"
    contacts : names of all points that stand, followers' too
    begin, end : s, from the jump's start
    """

    kind: str
    contacts: tuple[str, ...]
    begin: float
    end: float


@dataclass(frozen=True, eq=False, repr=False)
class JumpMotion:
    """A jump as a function of time; its world is that of its flight.

    Attributes
    ----------
    problem : Problem, as given
    request : JumpRequest
    flight : the Plan in its middle, whose t = 0 is the takeoff; None where nothing was found
    before, after : stances of takeoff and landing, in order of time
    """

    problem: Problem
    request: JumpRequest
    flight: Plan | None = None
    before: tuple[Stance, ...] = ()
    after: tuple[Stance, ...] = ()

    @property
    def stances(self) -> tuple[Stance, ...]:
        """All stances."""
        return (*self.before, *self.after)

    @property
    def takeoff_time(self) -> float:
        """When the flight begins, s from the jump's start."""
        return self.before[-1].span[1] if self.before else 0.0

    @property
    def duration(self) -> float:
        """From standing to standing, s."""
        return self.after[-1].span[1] if self.after else 0.0

    @property
    def ground(self) -> float:
        """Height of the ground, m."""
        return min(stance.place.imag - stance.contacts[0].depth for stance in self.stances)

    @property
    def phases(self) -> tuple[JumpPhase, ...]:
        """Phases in order of time."""
        if self.flight is None:
            return ()
        before, after = (
            [JumpPhase("stance", tuple(n for c in each.contacts for n in c.names), *each.span) for each in side]
            for side in (self.before, self.after)
        )
        flight = JumpPhase("flight", (), self.takeoff_time, self.takeoff_time + self.flight.duration)
        return (*before, flight, *after)

    @one_thread
    def at(self, times: npt.ArrayLike) -> JumpState:
        """State at times (N,) s from the jump's start; at a change of contacts that of the phase before.

        Raises
        ------
        InputError
            A time is not a number or lies outside the jump; or no jump was found.
        """
        instants = np.atleast_1d(np.asarray(numbers(times, "times"), dtype=np.float64)).ravel()
        if self.flight is None:
            raise InputError("no jump was found", element="times")
        if not ((instants >= 0) & (instants <= self.duration)).all():
            raise InputError(f"a time lies outside the jump, [0, {self.duration:g}] s", element="times")
        phases = self.phases
        index = np.searchsorted([phase.end for phase in phases[:-1]], instants)
        stances = iter(self.stances)
        parts = []
        for number, phase in enumerate(phases):
            stance = None if phase.kind == "flight" else next(stances)
            chosen = np.flatnonzero(index == number)
            if len(chosen):
                within = instants[chosen]
                state = stance.at(within) if stance else flight_state(self.flight, within, self.takeoff_time)
                parts.append((chosen, state))
        return joined(instants, parts, [name for phase in phases for name in phase.contacts])

    def q(self, times: npt.ArrayLike) -> Array:
        """Configuration (..., nq) as of :meth:`floatplan.Plan.q`, m and rad; times as of :meth:`at`, of any shape."""
        return self._in_file(times, configurations)

    def v(self, times: npt.ArrayLike) -> Array:
        """Velocity (..., nv), m/s and rad/s, as of :meth:`floatplan.Plan.v`."""
        return self._in_file(times, velocities)

    def a(self, times: npt.ArrayLike) -> Array:
        """Acceleration (..., nv), m/s^2 and rad/s^2, as of :meth:`floatplan.Plan.a`."""
        return self._in_file(times, accelerations)

    def tau(self, times: npt.ArrayLike) -> Array:
        """Torques (..., nv), N m: 0 on the base, then each joint's own, also of followers and locked ones."""
        return self._in_file(times, torques)

    def forces(self, times: npt.ArrayLike) -> dict[str, Array]:
        """Forces (..., 3), N, in the world's axes, of every point that stands at some time; zero where it does not."""
        found = forces(self.problem.robot, self.at(times))
        return {name: values.reshape(*np.shape(times), 3) for name, values in found.items()}

    def contact_points(self, times: npt.ArrayLike) -> dict[str, Array]:
        """Where those forces act (..., 3), m, in the world; NaN where the point is not in contact.

        Of a point it is the origin of its frame, of a foot that rolls the lowest point of its circle.
        """
        return {name: place.reshape(*np.shape(times), 3) for name, place in self.at(times).points.items()}

    def _in_file(self, times: npt.ArrayLike, quantity: Callable[[Robot, JumpState], Array]) -> Array:
        values = quantity(self.problem.robot, self.at(times))
        return values.reshape(*np.shape(times), values.shape[1])


def configurations(robot: Robot, state: JumpState) -> Array:
    """Configurations (N, nq): place of the root link, quaternion x y z w, all joints; m and rad."""
    order, joints = free_flyer(robot), state.positions[:, BASE:]
    half = state.positions[:, 2, None] / 2
    q = np.empty((len(state.times), order.nq))
    q[:, :3] = _in_space(robot, _planar(state.positions))
    q[:, 3:7] = np.concatenate((np.sin(half) * robot.plane.normal, np.cos(half)), axis=1)
    q[:, order.in_q] = joints
    angles, first = joints[:, order.continuous], order.in_q[order.continuous]
    q[:, first], q[:, first + 1] = np.cos(angles), np.sin(angles)
    return q


def velocities(robot: Robot, state: JumpState) -> Array:
    """Velocities (N, nv): of the base in its own axes, linear and angular, then of all joints; m/s and rad/s."""
    linear = _planar(state.velocities) * _back(robot, state)
    return _spread(robot, linear, state.velocities)


def accelerations(robot: Robot, state: JumpState) -> Array:
    """Accelerations (N, nv): derivative of the velocities, m/s^2 and rad/s^2."""
    carried = 1j * robot.tree.turn * state.velocities[:, 2] * _planar(state.velocities)
    return _spread(robot, (_planar(state.accelerations) - carried) * _back(robot, state), state.accelerations)


def torques(robot: Robot, state: JumpState) -> Array:
    """Torques (N, nv), N m: nothing on the base, and each joint's own."""
    order = free_flyer(robot)
    values = np.zeros((len(state.times), order.nv))
    values[:, order.in_v] = state.torques[:, BASE:]
    return values


def forces(robot: Robot, state: JumpState) -> dict[str, Array]:
    """Forces (N, 3) N of all points, along the world's axes."""
    return {name: _in_space(robot, values[:, 0] + 1j * values[:, 1]) for name, values in state.forces.items()}


def _planar(values: Array) -> ComplexArray:
    return np.asarray(values[:, 0] + 1j * values[:, 1])


def _back(robot: Robot, state: JumpState) -> ComplexArray:
    """Rotations (N,) of vectors of the plane into the base's axes."""
    return robot.tree.rotations(-state.positions[:, 2])


def _in_space(robot: Robot, vectors: ComplexArray) -> Array:
    return np.asarray(vectors.real[:, None] * robot.plane.horizontal + vectors.imag[:, None] * robot.plane.vertical)


def _spread(robot: Robot, linear: ComplexArray, rates: Array) -> Array:
    order = free_flyer(robot)
    values = np.empty((len(rates), order.nv))
    values[:, :3] = _in_space(robot, linear)
    values[:, 3:FREE_FLYER] = rates[:, 2, None] * robot.plane.normal
    values[:, order.in_v] = rates[:, BASE:]
    return values
