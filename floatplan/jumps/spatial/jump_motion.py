"""The motion of a whole jump in space: its state at any time, in the quantities of a plan; where its links are then."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from floatplan.arrays import Array, read_only
from floatplan.jumps.jump_motion import JumpGeometry, JumpMotion
from floatplan.jumps.motion import JumpState
from floatplan.jumps.spatial.model import BASE
from floatplan.jumps.spatial.stance import continuous
from floatplan.jumps.spatial.standing import Foot, feet_links
from floatplan.motion.dynamics import FlightState
from floatplan.motion.spatial.bodies import BodyPoses
from floatplan.motion.spatial.clearance import SpatialSegments, pair_distances_in_space, shapes_in_space
from floatplan.motion.spatial.kinematics import poses_about
from floatplan.motion.spatial.rotations import of_quaternions
from floatplan.motion.spatial.whole import SpatialFullMotion
from floatplan.problem.ground_step import GroundStep
from floatplan.robot.robot import Robot
from floatplan.robot.shapes.solids import LinkSolid

JOINTS = BASE + 1  # first entry of the joints in a configuration


class SpatialGeometry:
    """The geometry of a robot in space; see :class:`~floatplan.jumps.jump_motion.JumpGeometry`.

    Attributes
    ----------
    robot : Robot
    contacts : on which it stands at some time
    step : of the ground, where it has one
    """

    def __init__(self, robot: Robot, contacts: Sequence[Foot], step: GroundStep | None = None) -> None:
        self.robot = robot
        self.step = step
        self.contacts = list({foot.name: foot for foot in contacts}.values())

    def links_of(self, contacts: Iterable[Foot]) -> set[str | None]:
        """Links on which feet stand."""
        return feet_links(self.robot, list(contacts))

    def locate(self, state: FlightState) -> BodyPoses:
        """Where the bodies are at the N instants of a state."""
        return poses_about(self.robot, of_quaternions(state.orientation), state.positions, state.com_position)

    def lowest(self, located: BodyPoses) -> Iterator[tuple[str, Array]]:
        """Links with the heights (N,) of their lowest points, m, by their solids.

        Where the ground has a step, points over the higher one count by so much less.
        """
        return self._lowest(located, self.step)

    def _lowest(self, located: BodyPoses, step: GroundStep | None) -> Iterator[tuple[str, Array]]:
        heights: dict[str, Array] = {}
        for solid in self.robot.solids:
            own = located.lowest(solid) if step is None else _over_step(located, solid, step)
            heights[solid.link] = np.minimum(heights[solid.link], own) if solid.link in heights else own
        yield from heights.items()

    def segments(self, located: BodyPoses) -> SpatialSegments:
        """The links' capsules."""
        return shapes_in_space(self.robot).place(located)

    def distances(self, segments: SpatialSegments, links: Sequence[str]) -> Array:
        """Distances (N, r) between the capsules of two links, m."""
        owners = np.array([capsule.link for capsule in self.robot.solid_capsules])
        first, second = (segments.of(np.flatnonzero(owners == link)) for link in links)
        return pair_distances_in_space(first, second)

    def rotated_heights(self, state: FlightState, error: float) -> Iterator[float]:
        """Least heights over the ground of all but feet, m, of a robot that is rotated on its feet.

        It is rotated about either horizontal axis and either way. The ground is level, as high as its lowest foot is:
        a step is not turned with the robot.
        """
        poses = self.locate(state)
        links = self.links_of(self.contacts)
        for axis in np.vstack((np.eye(3)[:2], -np.eye(3)[:2])):
            rotation = pin.exp3(error * axis)
            rotated = BodyPoses(poses.places @ rotation.T, rotation @ poses.rotations)
            grounds = []
            for foot in self.contacts:
                position = rotated.points(foot.body, np.array([foot.local]))
                grounds.append(position[:, 0, 2] - foot.depth)
            ground = np.min(grounds, axis=0)
            for link, heights in self._lowest(rotated, None):
                if link not in links:
                    yield float((heights - ground).min())


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


def _over_step(located: BodyPoses, solid: LinkSolid, step: GroundStep) -> Array:
    """Heights (N,) of a solid's lowest point, m, points over the higher ground counting by its height less."""
    points = located.points(solid.body, solid.points)
    down = np.array([0.0, 0.0, -1.0])
    around = np.linalg.norm(down @ located.rotations[:, solid.body] @ solid.axes, axis=-1)
    heights = points[..., 2] - step.above_low(points[..., step.axis])
    return np.asarray(heights.min(axis=1) - around)
