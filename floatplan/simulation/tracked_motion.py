"""A motion that a controller tracks: what joints do at each of its periods, and what of the robot touches the ground.

A jump is one, and a recorded motion is. Feet are spheres or hulls, other links hulls.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.jumps.contacts import GroundStep, links_of
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.jumps.motion import JumpState, point_in_joint
from floatplan.jumps.spatial.jump_motion import SpatialJumpMotion
from floatplan.jumps.spatial.standing import feet_links
from floatplan.robot.robot import Robot
from floatplan.robot.shapes.solids import LinkSolid, evenly
from floatplan.simulation.base_states import base_states
from floatplan.simulation.control_loop import Motors
from floatplan.simulation.reduced_model import ReducedModel, reduced_model
from floatplan.simulation.simulated_jump import STANDING

PERIOD = 2e-3  # [s] of the joints' control
SMALLEST = 5e-3  # [m] radius of a foot's sphere
Hull: TypeAlias = tuple[str, int, Array]  # link; joint that carries it; points (c, 3), m, in that joint's axes


@dataclass(frozen=True, eq=False)
class ContactShapes:
    """What of a robot touches a level ground.

    Attributes
    ----------
    ground : height of the ground, m
    balls : name of a foot's point -> joint that carries it; centre (3,), m, in that joint's axes; radius, m
    soles : hulls of feet that are no balls
    hulls : hulls of links that are no feet
    step : of the ground of a jump in a plane, where it has one; ``ground`` is the lower one
    """

    ground: float
    balls: Mapping[str, tuple[int, Array, float]]
    soles: tuple[Hull, ...] = ()
    hulls: tuple[Hull, ...] = ()
    step: GroundStep | None = None


@dataclass(frozen=True, eq=False)
class TrackedMotion:
    """A motion of a robot of J moving joints, at the K periods of control from its beginning until it has stood.

    Attributes
    ----------
    robot : Robot
    reduced : ReducedModel, of which nothing is rigid
    gravity : m/s^2
    shapes : ContactShapes
    duration : of the motion, s; then it stays as in its end for ``STANDING``
    flights : when each flight begins and ends, s
    positions : (K, nq) of the reduced model; orientations go on from one to the next
    velocities : (K, nv)
    torques : (K, J) N m, which the motion takes without what the joints lose
    goals : the base's orientation where each flight ends, as of ``BaseStates``
    end_ground : height of the ground on which it stands at the end, m
    base_ends : (2, 7), the base's position, m, and quaternion w, x, y, z, at its beginning and its end
    motors : Motors
    """

    robot: Robot
    reduced: ReducedModel
    gravity: float
    shapes: ContactShapes
    duration: float
    flights: tuple[tuple[float, float], ...]
    positions: Array
    velocities: Array
    torques: Array
    goals: tuple[Any, ...]
    end_ground: float
    base_ends: Array
    motors: Motors

    @property
    def begin_velocities(self) -> Array | None:
        """Velocities (nv,) with which it begins in space; None in a plane, where they are zero."""
        is_planar = self.reduced.model.nq == self.reduced.model.nv
        return None if is_planar else np.asarray(self.velocities[0])


def control_times(duration: float) -> Array:
    """Return the beginnings (K,), s, of the periods of a motion of a duration, s, at whose end the robot stands."""
    return np.asarray(np.arange(int((duration + STANDING) / PERIOD) + 1) * PERIOD, dtype=np.float64)


def tracked_jump(jump: JumpMotion) -> tuple[TrackedMotion, JumpState]:
    """Return a jump that is to be tracked, and its states at the periods of control."""
    assert jump.flight is not None
    problem = jump.problem
    robot = problem.robot
    reduced = reduced_model(robot, problem.flight.gravity, rigid=())
    base = base_states(reduced)
    planned = jump.at(np.minimum(control_times(jump.duration), jump.duration))
    planned = replace(planned, positions=base.continuous(planned.positions))
    motors = Motors(
        effort=np.array([robot.joint_tree.joint[name].effort for name in reduced.joints]),
        stall=np.full(len(reduced.joints), np.inf),
        slope=np.zeros(len(reduced.joints)),
    )
    of_motors = list(map(reduced.joints.index, robot.motors))
    motors.effort[of_motors] = problem.motor_torque_limits
    motors.stall[of_motors] = problem.motor_stall
    motors.slope[of_motors] = problem.motor_slope
    flights = jump.timed_flights
    tracked = TrackedMotion(
        robot=robot,
        reduced=reduced,
        gravity=problem.flight.gravity,
        shapes=shapes_of_jump(jump),
        duration=jump.duration,
        flights=tuple((flight.begin, flight.end) for flight in flights),
        positions=planned.positions,
        velocities=planned.velocities,
        torques=planned.torques[:, reduced.of_joints[1]],
        goals=tuple(base.goal(flight.plan.problem) for flight in flights),
        end_ground=jump.stances[-1].ground,
        base_ends=np.asarray(jump.q([0.0, jump.duration])[:, [0, 1, 2, 6, 3, 4, 5]]),
        motors=motors,
    )
    return tracked, planned


def shapes_of_jump(jump: JumpMotion) -> ContactShapes:
    """Return the shapes of a robot that jumps.

    Feet are spheres about their frames, as large as these are high above the ground where they stand; each end of a
    sole, in space its heel and each toe, is one of ``SMALLEST``. Other links of jumps in a plane are prisms.
    """
    hulls = _solid_hulls(jump) if isinstance(jump, SpatialJumpMotion) else _prisms(jump)
    return ContactShapes(ground=jump.ground, balls=feet_spheres(jump), hulls=tuple(hulls), step=jump.step)


def solid_hull(solid: LinkSolid) -> Hull | None:
    """Return the hull of a link's solid; None of one that is flat."""
    directions = evenly(60)  # so many points make a round solid round to 3 % of its radius
    around = directions @ solid.axes.T if solid.axes.any() else np.zeros((1, 3))
    points = (solid.points[:, None] + around).reshape(-1, 3)
    return None if _is_flat(points) else (solid.link, solid.body, points)


def _is_flat(points: Array) -> bool:
    """Whether points (c, 3) are in a plane, or points (c, 2) on a line."""
    thickness = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[-1]
    return bool(thickness < 1e-4)  # m


def feet_spheres(jump: JumpMotion) -> dict[str, tuple[int, Array, float]]:
    """Return the joint that carries each foot's sphere, its centre (3,) m in the joint's axes, and its radius, m."""
    robot = jump.problem.robot
    if isinstance(jump, SpatialJumpMotion):
        return _feet_in_space(jump)
    y = jump.before[0].grid.y[:, 0]
    upwards = 1j * robot.tree.rotations(-robot.tree.absolute_angles(y[0], y[1:]))
    feet: dict[str, tuple[int, Array, float]] = {}
    for contact in jump.contacts:
        radius = SMALLEST if contact.of_sole else max(contact.depth, SMALLEST)
        for name, frame, spot in zip(contact.names, contact.frames, contact.spots, strict=True):
            centre = spot.place + (radius - contact.depth) * upwards[spot.body]
            feet[name] = (*point_in_joint(robot, frame, complex(centre)), radius)
    return feet


def _feet_in_space(jump: JumpMotion) -> dict[str, tuple[int, Array, float]]:
    """The same of a jump in space."""
    model = jump.robot.model
    data = model.createData()
    pin.forwardKinematics(model, data, jump.at(0.0).positions[0])
    feet: dict[str, tuple[int, Array, float]] = {}
    for foot in jump.contacts:
        radius = max(foot.depth, SMALLEST)
        upwards = data.oMi[foot.body].rotation.T @ jump.robot.up
        feet[foot.name] = (foot.body, foot.local + (radius - foot.depth) * upwards, radius)
    return feet


def _prisms(jump: JumpMotion) -> Iterator[Hull]:
    """Links but those that stand, the joints that carry them, and corners (c, 3) m of prisms in these joints' axes."""
    robot = jump.problem.robot
    standing = links_of(robot, jump.contacts)
    for link in robot.link_hulls:
        prism = None if link in standing else _prism(robot, link)
        if prism is not None:
            yield link, *prism


def _solid_hulls(jump: JumpMotion) -> Iterator[Hull]:
    """The same in space: points on the solids of links."""
    robot = jump.problem.robot
    standing = feet_links(robot, jump.contacts)
    for solid in robot.solids:
        hull = None if solid.link in standing else solid_hull(solid)
        if hull is not None:
            yield hull


def _prism(robot: Robot, link: str) -> tuple[int, Array] | None:
    """The joint that carries a link, and its prism (2 c, 3) m in the joint's axes; None of what is no shape."""
    corners = np.array([[side.start, side.end] for side in robot.link_hulls[link]]).ravel()
    if _is_flat(np.stack((corners.real, corners.imag), axis=1)):
        return None
    in_joint = [point_in_joint(robot, link, complex(corner)) for corner in corners]
    joint = in_joint[0][0]
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.reference.copy())
    half_width = 0.02 / 2  # m
    across = half_width * data.oMi[joint].rotation.T @ robot.plane.normal
    middle = np.array([point for _, point in in_joint])
    return joint, np.concatenate((middle - across, middle + across))
