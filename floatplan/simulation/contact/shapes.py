"""What of a robot touches the ground in MuJoCo: feet are spheres or hulls, other links hulls."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.jumps.contacts import links_of
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.jumps.motion import point_in_joint
from floatplan.jumps.spatial.jump_motion import SpatialJumpMotion
from floatplan.jumps.spatial.standing import feet_links
from floatplan.problem.ground_step import GroundStep
from floatplan.robot.robot import Robot
from floatplan.robot.shapes.solids import LinkSolid, evenly

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
    step : of the ground of a jump, where it has one; ``ground`` is the lower one
    """

    ground: float
    balls: Mapping[str, tuple[int, Array, float]]
    soles: tuple[Hull, ...] = ()
    hulls: tuple[Hull, ...] = ()
    step: GroundStep | None = None


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
