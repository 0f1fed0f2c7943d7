"""The path of the centre of mass: a parabola that takeoff, landing and duration determine, (2), (3) and (6)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array, read_only
from floatplan.problem.parts import Flight, JointState, Landing, Takeoff
from floatplan.robot.robot import Robot
from floatplan.robot.shapes.solids import frame_position


@dataclass(frozen=True, eq=False)
class Ballistics:
    """Path of the centre of mass: ``position0 + velocity0 t - (0, gravity t^2 / 2)``, m, (horizontal, vertical).

    In space x, y and z, the last of which is the vertical.
    """

    position0: Array
    velocity0: Array
    gravity: float

    def positions(self, times: Array) -> Array:
        """Places (N, 2) or (N, 3), m, at times (N,), s."""
        path = self.position0 + times[:, None] * self.velocity0
        path[:, -1] -= self.gravity * times**2 / 2
        return np.asarray(path)

    def velocities(self, times: Array) -> Array:
        """Velocities (N, 2) or (N, 3), m/s, at times (N,), s."""
        velocities = np.tile(self.velocity0, (len(times), 1))
        velocities[:, -1] -= self.gravity * times
        return velocities


def ballistics(
    robot: Robot, flight: Flight, takeoff: Takeoff, initial: JointState, landing: Landing, final: JointState
) -> Ballistics:
    """Path from a frame at takeoff to one at landing, in these states: (2), (3) integrated, with (6) at both ends."""
    foot = frame_from_com(robot, takeoff.frame, initial)
    position0 = np.array(takeoff.position[: len(foot)]) - foot
    height_of_landing = frame_from_com(robot, landing.frame, final)[-1]
    vertical = rising(position0[-1], height_of_landing, landing.height or 0.0, flight.gravity, flight.duration)
    horizontal = np.broadcast_to(flight.horizontal_velocity, len(foot) - 1)
    return Ballistics(read_only(position0), read_only([*horizontal, vertical]), float(flight.gravity))


def rising(takeoff: Any, landing: Any, height: Any, gravity: Any, duration: Any) -> Any:
    """Vertical velocity of the centre of mass at takeoff, m/s, by (2), (3) and (6), of one flight or of many.

    ``takeoff`` is its height there, ``landing`` that of the landing frame over it at landing, ``height`` that frame's
    own, m.
    """
    return (height - landing - takeoff) / duration + gravity * duration / 2


def frame_from_com(robot: Robot, frame: str, state: JointState) -> Array:
    """Position of a frame relative to the centre of mass, m: horizontal and vertical, (6); x, y and z in space."""
    if state.attitude is None:
        weights = robot.frames[frame].weights
        position = robot.tree.places_from_com(weights, np.array(state.orientation), state.positions)
        return np.array([position.real, position.imag])
    q = robot.configuration(state.positions)
    data = robot.model.createData()  # of its own, as others may be computing with the robot's
    com = pin.centerOfMass(robot.model, data, q)
    joint, local = frame_position(robot.model, robot.joint_tree, frame)
    carrier = data.oMi[joint]
    return np.asarray(state.attitude.matrix @ (carrier.translation - com + carrier.rotation @ local))
