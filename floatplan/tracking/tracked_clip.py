"""A recorded motion as a controller follows it: joints, torques, and what of the robot touches the ground."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

from floatplan.arrays import Array, read_only
from floatplan.clips.clip import Clip
from floatplan.clips.flights import FOOT_CLEARANCE
from floatplan.clips.formats import continuous_signs
from floatplan.errors import InputError
from floatplan.robot.robot import Robot
from floatplan.robot.shapes.solids import LinkSolid
from floatplan.robot.urdf.base import FREE_FLYER as BASE
from floatplan.simulation.contact.shapes import ContactShapes, Hull, solid_hull
from floatplan.simulation.contact.tracked_motion import PERIOD, TrackedMotion, control_times
from floatplan.simulation.control_loop import Motors
from floatplan.simulation.mujoco_model import free_base
from floatplan.simulation.reduced_model import ReducedModel, reduced_model
from floatplan.tables import GRAVITY


def tracked_clip(clip: Clip, friction: float) -> TrackedMotion:
    """Return a recorded motion that is to be tracked, on one level ground of some friction.

    Joints and base move as the clip's splines; torques are by inverse dynamics: in the air those of free flight, on the
    ground with the least forces within the friction that come nearest to what the base needs. A clip without flights is
    tracked as one flight, so that its attitude at the end is judged as at a landing.

    Raises
    ------
    InputError
        It stands on several levels: a floor has one; or it lasts too long.
    """
    times = control_times(clip.duration)
    heights = clip.ground.heights
    largest_step = 0.03  # [m] less is noise of the frames
    if float(np.ptp(heights)) > largest_step:
        reason = f"stands on levels that are {np.ptp(heights):.2g} m apart, and the floor is level"
        raise InputError(reason, source=clip.path, advice="cut it, or give --ground")
    robot = clip.robot
    reduced = reduced_model(robot, GRAVITY, rigid=())
    ground = float(np.median(heights))
    feet = _foot_solids(clip)
    positions, velocities = _motion(clip, times)
    flights = [(flight.begin, flight.end) for flight in clip.flights] or [(0.0, clip.duration)]
    landings = [min(int(np.ceil(end / PERIOD)), len(times) - 1) for _, end in flights]
    efforts = [robot.joint_tree.joint[name].effort for name in reduced.joints]
    return TrackedMotion(
        robot=robot,
        reduced=reduced,
        gravity=GRAVITY,
        shapes=_shapes(robot, feet, ground),
        duration=clip.duration,
        flights=tuple(flights),
        positions=positions,
        velocities=velocities,
        torques=_torques(clip, reduced, feet, (positions, velocities), friction),
        goals=tuple(positions[landings, 3:7]),
        begin_ground=ground,
        end_ground=ground,
        base_ends=free_base(positions[[0, -1]]),
        motors=Motors(effort=np.array(efforts), stall=np.full(len(efforts), np.inf), slope=np.zeros(len(efforts))),
    )


def _motion(clip: Clip, times: Array) -> tuple[Array, Array]:
    """Configurations (K, 7 + J) and velocities (K, 6 + J) of the robot's model at times (K,), s.

    After the clip's end positions stay, and velocities are zero.
    """
    inside = np.minimum(times, clip.duration)
    attitudes = clip.curve.attitudes(inside)
    quaternions = continuous_signs(Rotation.from_matrix(attitudes).as_quat())
    positions = np.concatenate((clip.curve.base_positions(inside), quaternions, clip.curve.positions(inside)), axis=1)
    linear, angular, joints = clip.curve.velocities(inside)
    linear_in_base = np.einsum("kba,kb->ka", attitudes, linear)
    angular_in_base = np.einsum("kba,kb->ka", attitudes, angular)
    velocities = np.concatenate((linear_in_base, angular_in_base, joints), axis=1)
    velocities[times > clip.duration] = 0.0
    return read_only(positions), read_only(velocities)


def _foot_solids(clip: Clip) -> list[tuple[LinkSolid, ...]]:
    """The solids (F) of each foot that stand on the ground: of the shank of the same body none does."""
    scene = clip.scene
    near = 0.03  # [m] over a foot's lowest point: heel and toe of a sole that is a little tilted
    feet = []
    for foot, solids in enumerate(scene.foot_solids.groups):
        clearances = scene.clearances[:, foot]
        stands = np.flatnonzero(clearances < FOOT_CLEARANCE)
        instant = stands[0] if len(stands) else int(clearances.argmin())
        poses = clip.curve.poses(scene.times[[instant]])
        body = scene.foot_bodies[foot]
        down = -poses.rotations[0, body, 2]
        depths = np.array([solid.reach(down[None])[0] for solid in solids])
        lowest = solids[int(depths.argmax())]
        own = []
        for solid, depth in zip(solids, depths, strict=True):
            if solid.link == lowest.link and depth > depths.max() - near:
                own.append(solid)
        feet.append(tuple(own))
    return feet


def _shapes(robot: Robot, feet: list[tuple[LinkSolid, ...]], ground: float) -> ContactShapes:
    """What touches the ground: a foot's balls as they are, all else as hulls."""
    balls: dict[str, tuple[int, Array, float]] = {}
    soles: list[Hull] = []
    of_feet = [solid for foot in feet for solid in foot]
    for number, solid in enumerate(of_feet):
        hull = solid_hull(solid)
        if _is_ball(solid):
            balls[f"{solid.link} {number}"] = (solid.body, solid.points[0], float(np.linalg.norm(solid.axes[:, 0])))
        elif hull is not None:
            soles.append(hull)
    others: list[Hull] = []
    for solid in robot.solids:
        hull = None if any(solid is foot for foot in of_feet) else solid_hull(solid)
        if hull is not None:
            others.append(hull)
    return ContactShapes(ground=ground, balls=balls, soles=tuple(soles), hulls=tuple(others))


def _is_ball(solid: LinkSolid) -> bool:
    radii = np.linalg.norm(solid.axes, axis=0)
    return len(solid.points) == 1 and bool(radii.min() > 0.99 * radii.max() > 0)


def _torques(
    clip: Clip,
    reduced: ReducedModel,
    feet: list[tuple[LinkSolid, ...]],
    motion: tuple[Array, Array],
    friction: float,
) -> Array:
    """Torques (K, J), N m, that a motion takes, by inverse dynamics."""
    positions, velocities = motion
    model = reduced.model
    data = model.createData()
    accelerations = np.gradient(velocities, PERIOD, axis=0)
    accelerations[int(clip.duration / PERIOD) :] = 0.0  # it stands from there on
    clearances = clip.scene.foot_clearances(np.minimum(np.arange(len(positions)) * PERIOD, clip.duration))
    weight = clip.robot.mass * GRAVITY
    torques = np.empty((len(positions), model.nv - BASE))
    for k, (q, v, a) in enumerate(zip(positions, velocities, accelerations, strict=True)):
        needed = pin.rnea(model, data, q, v, a)
        standing = np.flatnonzero(clearances[k] < FOOT_CLEARANCE)
        if len(standing):
            pin.computeJointJacobians(model, data, q)
            of_feet = [_pushes(model, data, feet[foot], friction) for foot in standing]
            counts = [len(pushes) for pushes in of_feet]
            pushes = np.concatenate(of_feet)
            heights = np.repeat(np.maximum(clearances[k, standing], 0.0), counts)
            needed = needed - _forces(pushes[:, :BASE], needed[:BASE], weight, heights) @ pushes
        torques[k] = needed[BASE:]
    return read_only(torques)


def _pushes(model: object, data: object, foot: tuple[LinkSolid, ...], friction: float) -> Array:
    """Generalised forces (4 P, nv) of unit forces along the edges of the friction's pyramids at a foot's P points."""
    body = foot[0].body
    placement = data.oMi[body]  # type: ignore[attr-defined]
    jacobian = pin.getJointJacobian(model, data, body, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
    # Friction acts in four horizontal directions: of each pyramid the edges.
    sides = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    edges = (friction * sides + [0.0, 0.0, 1.0]) / np.hypot(1.0, friction)
    points = _pressing_points(foot, placement.rotation)
    rows = []
    for point in points:
        moments = np.cross(point, edges)
        rows.append(edges @ jacobian[:3] + moments @ jacobian[3:])
    return np.concatenate(rows)


def _pressing_points(foot: tuple[LinkSolid, ...], rotation: Array) -> Array:
    """Points (P, 3), m, at which a foot presses on the ground, from its body's origin in the axes of the world."""
    down = -rotation[2]
    points = np.concatenate([solid.points + _support(solid, down) for solid in foot]) @ rotation.T
    nearly = 5e-3  # [m] what is no higher than this over the lowest point presses on the ground
    points = points[points[:, 2] < points[:, 2].min() + nearly]
    largest = 0.06  # [m] across: larger feet are soles, which press with their corners
    if np.ptp(points[:, :2], axis=0).max() <= largest:
        return np.asarray(points.mean(axis=0, keepdims=True))
    diagonals = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]])
    corners = np.unique((points[:, :2] @ diagonals.T).argmax(axis=0))
    return np.asarray(points[corners])


def _support(solid: LinkSolid, direction: Array) -> Array:
    """What a solid's ellipsoid adds (3,) to its points farthest along a unit vector, m."""
    along = direction @ solid.axes
    length = float(np.linalg.norm(along))
    return np.asarray(solid.axes @ along / length) if length > 0 else np.zeros(3)


def _forces(pushes: Array, needed: Array, weight: float, heights: Array) -> Array:
    """The least forces (G,), N, none negative, whose sum comes nearest to what the base needs (6,).

    Feet at a height (G,), m, over the ground, as they leave it or come to it, bear the less the higher they are.
    """
    arm = 0.2  # [m] by which moments are compared with forces: of the size of levers in a legged robot
    leaves = 3e-3  # [m] at this height a force costs twice as much as on the ground
    # The forces' own size has the weight 1e-3: it decides only between forces with nearly the same sum.
    small = 1e-3 * (1.0 + (heights / leaves) ** 2) / weight
    scale = np.array([1.0, 1.0, 1.0, *np.full(3, 1.0 / arm)]) / weight
    rows = np.concatenate(((pushes * scale).T, np.diag(small)))
    solution, _ = nnls(rows, np.concatenate((needed * scale, np.zeros(len(pushes)))))
    return np.asarray(solution)
