"""The centre of mass in flight, (2), (3) and (6): a parabola that takeoff, landing and duration determine."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from floatplan.arrays import Array, ComplexArray, read_only
from floatplan.problem.parts import JointState
from floatplan.problem.problem import Problem
from floatplan.robot.robot import Frame, Robot


@dataclass(frozen=True, eq=False)
class Ballistics:
    """Path of the centre of mass: ``position0 + velocity0 t - (0, gravity t^2 / 2)``, m, (horizontal, vertical)."""

    position0: Array
    velocity0: Array
    gravity: float

    def positions(self, times: Array) -> Array:
        """Places (N, 2), m, at times (N,), s."""
        path = self.position0 + times[:, None] * self.velocity0
        path[:, 1] -= self.gravity * times**2 / 2
        return np.asarray(path)

    def velocities(self, times: Array) -> Array:
        """Velocities (N, 2), m/s, at times (N,), s."""
        velocities = np.tile(self.velocity0, (len(times), 1))
        velocities[:, 1] -= self.gravity * times
        return velocities


@lru_cache(maxsize=64)
def frame_weights(robot: Robot, frame: Frame) -> ComplexArray:
    """Weights (m,) of a frame's place relative to the centre of mass; see ``PlanarTree.point_weights``."""
    weights: ComplexArray = robot.tree.point_weights(np.array([frame.body]), np.array([frame.local]))[0]
    weights.setflags(write=False)
    return weights


def frame_from_com(robot: Robot, frame: Frame, state: JointState) -> complex:
    """Place of a frame relative to the centre of mass, (6), m, as a complex number."""
    angles = robot.tree.absolute_angles(np.array(state.orientation), state.positions)
    return complex(robot.tree.rotations(angles) @ frame_weights(robot, frame))


@lru_cache(maxsize=8)
def ballistics(problem: Problem) -> Ballistics:
    """CM path of a problem: (2), (3) integrated, with boundary conditions from (6) at takeoff and at landing."""
    flight = problem.flight
    takeoff = complex(*problem.takeoff.position) - frame_from_com(problem.robot, problem.takeoff_frame, problem.initial)
    landing = frame_from_com(problem.robot, problem.landing_frame, problem.final)
    height_change = problem.landing_height - landing.imag - takeoff.imag
    vertical_velocity = height_change / flight.duration + flight.gravity * flight.duration / 2
    return Ballistics(
        position0=read_only([takeoff.real, takeoff.imag]),
        velocity0=read_only([flight.horizontal_velocity, vertical_velocity]),
        gravity=float(flight.gravity),
    )
