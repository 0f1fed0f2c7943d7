"""The motion of a whole jump in space: its state at any time, in the quantities of a plan."""

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from floatplan.arrays import Array, read_only
from floatplan.jumps.jump_motion import JumpGeometry, JumpMotion
from floatplan.jumps.motion import JumpState
from floatplan.jumps.spatial.geometry import SpatialGeometry
from floatplan.jumps.spatial.model import BASE
from floatplan.jumps.spatial.stance import continuous
from floatplan.motion.dynamics import FlightState
from floatplan.motion.spatial.whole import SpatialFullMotion
from floatplan.robot.robot import Robot

JOINTS = BASE + 1  # first entry of the joints in a configuration


class SpatialJumpMotion(JumpMotion):
    """A jump in space as a function of time; its world is that of its flight."""

    def _orientations(self, ends: FlightState) -> list[Any]:
        """The attitudes of the problem, in which the robot stands."""
        return [self.problem.start.orientation, self.problem.goal.orientation]

    @property
    def dynamics(self) -> Any:
        """The robot's rigid-body dynamics."""
        assert self.flight is not None
        return self.flight.dynamics

    @cached_property
    def geometry(self) -> JumpGeometry:
        """Where the robot's links are."""
        return SpatialGeometry(self.robot, self.contacts, self.step)

    def state_of(self, full: JumpState) -> FlightState:
        """A state of its robot in the quantities of a plan."""
        return state_of(self.robot, full)

    def full_motion(self, times: npt.ArrayLike) -> SpatialFullMotion:
        """Motion of every joint of the robot's file, and of the base, at N times; errors as of :meth:`at`."""
        state = self.at(times)
        positions = read_only(continuous(np.array(state.positions)))
        return SpatialFullMotion(self.robot, replace(state, positions=positions))

    def forces(self, times: npt.ArrayLike) -> dict[str, Array]:
        """Forces (..., 3), N, in the world's axes, of every point that stands at some time; zero where it does not."""
        of_points = self.at(times).forces
        return {name: force.reshape(*np.shape(times), 3) for name, force in of_points.items()}


def planned_joints(robot: Robot, state: JumpState) -> Array:
    """Planned joints with two derivatives (3, N, n), rad."""
    joints = np.linalg.pinv(robot.selection[BASE:]).T
    positions = state.positions[:, JOINTS:] - robot.reference[JOINTS:]
    return np.stack([positions @ joints, state.velocities[:, BASE:] @ joints, state.accelerations[:, BASE:] @ joints])


def state_of(robot: Robot, full: JumpState) -> FlightState:
    """A state of a jump in the quantities of a plan."""
    model = robot.model
    data = model.createData()
    com = np.empty((len(full.times), 3))
    com_velocity = np.empty_like(com)
    momentum = np.empty_like(com)
    for index, (q, v) in enumerate(zip(full.positions, full.velocities, strict=True)):
        pin.computeCentroidalMomentum(model, data, q, v)
        momentum[index] = data.hg.angular
        pin.centerOfMass(model, data, q, v)
        com[index] = data.com[0]
        com_velocity[index] = data.vcom[0]
    positions, velocities, accelerations = planned_joints(robot, full)
    return FlightState(
        times=full.times,
        orientation=read_only(continuous(np.array(full.positions))[:, 3:JOINTS]),
        orientation_rate=read_only(full.velocities[:, 3:BASE]),
        positions=read_only(positions),
        velocities=read_only(velocities),
        accelerations=read_only(accelerations),
        torques=read_only(full.torques @ robot.selection),
        motor_torques=read_only(full.torques @ robot.transmission),
        com_position=read_only(com),
        com_velocity=read_only(com_velocity),
        base_position=read_only(full.positions[:, :3]),
        angular_momentum=read_only(momentum),
    )
