"""Outlines of the robot, the ground and the obstacles of a flight or a jump, for pictures and pages.

Positions in the plane are complex, horizontal + i vertical, m; of flights in space, as a camera sees them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from floatplan.arrays import Array, ComplexArray, IntArray
from floatplan.jumps.contacts import GroundEdge
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.motion.spatial.bodies import BodyPoses
from floatplan.motion.spatial.kinematics import poses_about, posture_about
from floatplan.motion.spatial.rotations import of_quaternions
from floatplan.plans.plan import Plan
from floatplan.plans.trajectory import Trajectory
from floatplan.problem.parts import HalfPlane, JointState, Obstacle
from floatplan.problem.problem import Problem
from floatplan.problem.spatial_obstacles import HalfSpace, SpatialObstacle
from floatplan.robot.robot import Robot
from floatplan.robot.shapes.capsules import convex_hull
from floatplan.robot.shapes.links import LINE_RADIUS, LinkCapsule
from floatplan.view.jumps import flies_in_space, moments
from floatplan.view.solids import CAMERA, face_normals, obstacle_corners, rendered_solids
from floatplan.view.style import round_below

ARC = 12  # [-] corners of the half circle at an end of a link or bar
STANDING = 0.02  # [-] of the robot's size: how far it may reach below the ground that it stands on
SINKING = 0.15  # [-] of the robot's size: a flight that goes deeper has no ground in its picture


@dataclass(frozen=True, eq=False)
class Postures:
    """The robot at K instants.

    Attributes
    ----------
    times : (K,) s
    com : (K,) complex, m
    corners : (K, S, k) complex, m
        Of the links' shapes, convex and grown by a radius: both ends of capsules; the last repeated to fill the row.
    radius : (S,) m
        In the picture: a link of no thickness gets one.
    segment : (S,) int
        Colour of a shape: 0 for the base, i + 1 for what joint i moves.
    takeoff, landing : (K,) complex, m
        Positions of the frames that take off and land.
    depth : (K, S, k) m, optional
        Of the corners, towards the viewer.
    faces : for each shape its triangles (f, 3), corners by their numbers
    shadows : (K, S, k) complex, m, optional
        Of the corners, on the ground straight below them.
    """

    times: Array
    com: ComplexArray
    corners: ComplexArray
    radius: Array
    segment: IntArray
    takeoff: ComplexArray
    landing: ComplexArray
    depth: Array | None = None
    faces: Sequence[IntArray] = ()
    shadows: ComplexArray | None = None

    def painted(self, index: int) -> list[tuple[int, ComplexArray, Array]]:
        """Return the shapes at an instant in the order of painting, from back to front, each with its visible faces.

        Of F faces these are their corners (F, 3), m, and how much light falls on each, (F,), 0 to 1.
        """
        if self.depth is None:
            return [(shape, np.zeros((0, 3), complex), np.zeros(0)) for shape in range(len(self.radius))]
        corners = self.corners[index]
        positions = np.stack((corners.real, corners.imag, self.depth[index]), axis=2)
        painted = []
        for shape in np.argsort(self.depth[index].mean(axis=1), kind="stable").tolist():
            normals = face_normals(positions[shape], self.faces[shape])
            visible = normals[:, 2] > 0
            # unit vector to the light: from the left, from above, from the viewer
            lights = np.clip(normals[visible] @ np.array([-0.35, 0.75, 0.56]), 0.0, 1.0)
            faces = corners[shape][self.faces[shape][visible]]
            painted.append((shape, faces, lights))
        return painted

    @property
    def low(self) -> ComplexArray:
        """Lower left corners (K,) of the boxes around the postures."""
        return self._corner(np.minimum, -1.0)

    @property
    def high(self) -> ComplexArray:
        """Upper right corners (K,) of the boxes around the postures."""
        return self._corner(np.maximum, 1.0)

    def _corner(self, extreme: np.ufunc, side: float) -> ComplexArray:
        growth = side * self.radius[:, None]
        across = extreme.reduce(self.corners.real + growth, axis=(1, 2))
        up = extreme.reduce(self.corners.imag + growth, axis=(1, 2))
        return np.asarray(across + 1j * up)

    def outlines(self, index: int) -> list[ComplexArray]:
        """Closed outlines (points,) of the shapes at instant ``index``, m."""
        if self.depth is not None:
            return list(map(convex_hull, self.corners[index]))
        shapes = zip(self.corners[index], self.radius.tolist(), strict=True)
        return [stadium(complex(start), complex(end), radius) for (start, end), radius in shapes]


def postures(plan: Trajectory, times: Array) -> Postures:
    """Return the robot at times (K,), s."""
    if flies_in_space(plan):
        ground = plan.ground if isinstance(plan, JumpMotion) else None
        return seen_robot(plan.robot, times, bodies(plan, times), com_path(plan, times), _frames(plan), ground)
    return placed_robot(plan.whole_problem, times, *coordinates(plan, times))


def _frames(plan: Trajectory) -> tuple[str, str]:
    """Frames that take off and land."""
    problem = plan.whole_problem
    return problem.takeoff.frame, problem.landing.frame


def coordinates(plan: Trajectory, times: Array) -> tuple[Array, Array, ComplexArray]:
    """Return orientation (K,) and positions (K, n) rad, and centre of mass (K,) m, at times (K,), s."""
    if isinstance(plan, Plan):  # its state would compute torques as well, which takes longer
        return plan.orientation(times), plan.joint_motion(times)[0], com_path(plan, times)
    state = plan.state(times)
    return state.orientation, state.positions, np.asarray(state.com_position @ [1, 1j])


def posture_at(plan: Trajectory, state: JointState, time: float) -> Postures:
    """Return the robot in a posture of its own, its centre of mass where the motion has it at ``time``."""
    times = np.array([time])
    if flies_in_space(plan):
        return seen_robot(plan.robot, times, posed(plan, state, time), com_path(plan, times), _frames(plan))
    orientation = np.array([state.orientation])
    com = com_path(plan, times)
    return placed_robot(plan.whole_problem, times, orientation, state.positions[None], com)


def placed_robot(problem: Problem, times: Array, orientation: Array, positions: Array, com: ComplexArray) -> Postures:
    """Return a problem's robot at times (K,) s: orientation (K,), positions (K, n) rad, centre of mass (K,) m."""
    robot = problem.robot
    poses = body_poses(robot, orientation, positions, com)
    capsules = rendered_capsules(robot)
    takeoff, landing = poses.points(
        [problem.takeoff_frame.body, problem.landing_frame.body],
        [problem.takeoff_frame.local, problem.landing_frame.local],
    ).T
    bodies = [capsule.body for capsule in capsules]
    starts = poses.points(bodies, [capsule.start for capsule in capsules])
    ends = poses.points(bodies, [capsule.end for capsule in capsules])
    return Postures(
        times=times,
        com=com,
        corners=np.stack((starts, ends), axis=2),
        radius=rendered_radii(problem),
        segment=capsule_segments(robot),
        takeoff=takeoff,
        landing=landing,
    )


def bodies(plan: Trajectory, times: Array) -> BodyPoses:
    """Poses of the bodies of a robot in space at times (K,), s."""
    if isinstance(plan, Plan):  # its state would compute torques as well, which takes longer
        whole: Any = plan.whole
        poses: BodyPoses = whole.bodies(times)
        return poses
    state = plan.state(times)
    return poses_about(plan.robot, of_quaternions(state.orientation), state.positions, state.com_position)


def moving_bodies(plan: Trajectory, times: Array) -> Poses | BodyPoses:
    """Poses of the bodies at times (K,), s, in a plane or in space."""
    return bodies(plan, times) if flies_in_space(plan) else body_poses(plan.robot, *coordinates(plan, times))


def paths_in_space(plan: Trajectory, times: Array) -> tuple[Array, Array, Array]:
    """Positions (K, 3), m, of the centre of mass and of the frames that take off and land, at times (K,), s."""
    poses = bodies(plan, times)
    takeoff, landing = (poses.frame(plan.robot, name) for name in _frames(plan))
    return com_positions(plan, times), takeoff, landing


def posed(plan: Trajectory, state: JointState, time: float) -> BodyPoses:
    """Poses of the bodies of a robot in space in a posture, its centre of mass where the motion has it at a time, s."""
    return posture_about(plan.robot, state, com_positions(plan, np.array([time]))[0])


def seen_robot(
    robot: Robot,
    times: Array,
    poses: BodyPoses,
    com: ComplexArray,
    frames: tuple[str, str] | None = None,
    ground: float | None = None,
) -> Postures:
    """Return a robot in space as the camera sees it at times (K,) s, its centre of mass at (K,) m.

    ``frames`` take off and land; without any the centre of mass is marked instead. It casts a shadow on ``ground``, at
    a height, m.
    """
    solids = rendered_solids(robot)
    corners = max(len(solid.points) for solid in solids)
    positions = []
    for solid in solids:
        points = np.pad(solid.points, ((0, corners - len(solid.points)), (0, 0)), "edge")
        positions.append(poses.points(solid.body, points))
    placed = np.stack(positions, axis=1)
    shadows = None
    if ground is not None:
        below = placed.copy()
        below[..., 2] = ground
        shadows = CAMERA(below)
    return Postures(
        times=times,
        com=com,
        corners=CAMERA(placed),
        radius=np.zeros(len(solids)),
        segment=np.array([solid.segment for solid in solids]),
        takeoff=com if frames is None else CAMERA(poses.frame(robot, frames[0])),
        landing=com if frames is None else CAMERA(poses.frame(robot, frames[1])),
        depth=placed @ CAMERA.toward,
        faces=[solid.faces for solid in solids],
        shadows=shadows,
    )


@dataclass(frozen=True, eq=False)
class Poses:
    """The bodies of the robot at K instants.

    Attributes
    ----------
    places : (K, m) complex, m; of the bodies' origins
    angles : (K, m) rad; about the plane's normal
    rotations : (K, m) complex; of these angles in the plane
    """

    places: ComplexArray
    angles: Array
    rotations: ComplexArray

    def points(self, bodies: Sequence[int], local: Sequence[complex] | ComplexArray) -> ComplexArray:
        """Positions (K, P) of points of some bodies, m, from those in the bodies' own axes."""
        return np.asarray(self.places[:, bodies] + self.rotations[:, bodies] * np.asarray(local))


def body_poses(robot: Robot, orientation: Array, positions: Array, com: ComplexArray) -> Poses:
    """Poses of the bodies from orientation (K,), positions (K, n) and centre of mass (K,)."""
    tree = robot.tree
    bodies = len(tree.mass)
    origins = tree.point_weights(np.arange(bodies), np.zeros(bodies, dtype=np.complex128))
    angles = tree.absolute_angles(orientation, positions)
    rotations = tree.rotations(angles)
    return Poses(places=com[:, None] + rotations @ origins.T, angles=angles, rotations=rotations)


def turns(plan: Trajectory, times: Array) -> Array:
    """Angles (K - 1, m), rad, between the attitudes of the bodies at one of the times (K,), s, and at the next."""
    if flies_in_space(plan):
        rotations = bodies(plan, times).rotations
        traces = np.einsum("kmab,kmab->km", rotations[1:], rotations[:-1])
        return np.asarray(np.arccos(np.clip((traces - 1) / 2, -1.0, 1.0)))
    return np.asarray(np.abs(np.diff(body_poses(plan.robot, *coordinates(plan, times)).angles, axis=0)))


def ball(plan: Trajectory) -> tuple[Array, float]:
    """Return centre (3,) and radius, m, of a ball that contains a motion in space, and its bounded obstacles."""
    state = plan.state(np.linspace(0.0, plan.duration, 33))
    size = float(np.linalg.norm(state.base_position - state.com_position, axis=1).max()) + robot_size(plan) / 2
    low = state.com_position.min(axis=0) - size
    high = state.com_position.max(axis=0) + size
    for obstacle in plan.whole_problem.obstacles:
        for time in obstacle_times(obstacle, plan.duration) if obstacle.bounded else ():
            corners = obstacle_corners(obstacle) + time * np.array(obstacle.velocity)
            low = np.minimum(low, corners.min(axis=0))
            high = np.maximum(high, corners.max(axis=0))
    return (low + high) / 2, float((high - low).max()) / 2


def grids(plan: Trajectory) -> list[Array]:
    """Lines (2, 3), m, of grids on the ground of a motion in space, and on its half-spaces at its beginning."""
    lines = floor(plan)
    for obstacle in plan.whole_problem.obstacles:
        if isinstance(obstacle, HalfSpace):
            lines += _wall(plan, obstacle)
    return lines


def _wall(plan: Trajectory, obstacle: HalfSpace) -> list[Array]:
    """Lines (2, 3), m, of a grid on a half-space, nearest to the flight."""
    centre, radius = ball(plan)
    normal = np.array(obstacle.unit_normal)
    middle = centre - normal * ((centre - obstacle.point) @ normal)
    along = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    along /= np.linalg.norm(along)
    across = np.cross(normal, along)
    step = round_below(radius / 3)
    lines = []
    for position in step * np.arange(-np.floor(radius / step), np.floor(radius / step) + 1):
        for one, other in ((along, across), (across, along)):
            lines.append(middle + position * one + np.outer((-radius, radius), other))
    return lines


def floor(plan: Trajectory) -> list[Array]:
    """Lines (2, 3), m, of a grid on the ground on which a motion in space begins, where the robot stands on it."""
    poses = bodies(plan, np.linspace(0.0, plan.duration, 33))
    placed = np.concatenate([poses.points(solid.body, solid.points) for solid in rendered_solids(plan.robot)], axis=1)
    low = placed.min(axis=(0, 1))
    high = placed.max(axis=(0, 1))
    if isinstance(plan, JumpMotion):
        return floor_lines(low, high, plan.ground)
    assert isinstance(plan, Plan)
    level = float(placed[0, :, 2].min())
    size = float((high - low).max())
    stands = poses.frame(plan.robot, plan.problem.takeoff.frame)[0, 2] <= level + 2 * STANDING * size
    if plan.ballistics.gravity == 0 or not stands or low[2] < level - SINKING * size:
        return []
    return floor_lines(low, high, level)


def floor_lines(low: Array, high: Array, level: float) -> list[Array]:
    """Lines (2, 3), m, of a grid at a height under what reaches from ``low`` to ``high`` (3,)."""
    step = round_below(float((high - low).max()) / 4)
    low = step * (np.floor(low / step) - 0.5)
    high = step * (np.ceil(high / step) + 0.5)
    lines = []
    for along, across in ((0, 1), (1, 0)):
        for position in np.arange(low[across] + step / 2, high[across], step):
            ends = np.full((2, 3), level)
            ends[:, across] = position
            ends[:, along] = (low[along], high[along])
            lines.append(ends)
    return lines


def com_positions(plan: Trajectory, times: Array) -> Array:
    """Positions (K, 2), horizontal and vertical, or in space (K, 3), of the centre of mass at times (K,), m."""
    return plan.ballistics.positions(times) if isinstance(plan, Plan) else plan.state(times).com_position


def com_path(plan: Trajectory, times: Array) -> ComplexArray:
    """The same (K,) in pictures."""
    positions = com_positions(plan, times)
    return CAMERA(positions) if flies_in_space(plan) else np.asarray(positions @ [1, 1j])


def robot_size(plan: Trajectory) -> float:
    """Largest extent of the robot during the motion, horizontal or vertical, m."""
    placed = postures(plan, np.linspace(0, plan.duration, 33))
    return float(np.abs(pairs(placed.high - placed.low)).max())


def snapshot_times(plan: Trajectory) -> Array:
    """Instants (K,): of a jump its moments; else evenly spaced in time, so many that neighbours stand apart."""
    if isinstance(plan, JumpMotion):
        return moments(plan)
    path = float(np.abs(np.diff(com_path(plan, np.linspace(0, plan.duration, 65)))).sum())
    # the centre of mass moves by 0.45 sizes of the robot from one to the next: neighbours overlap a little
    count = int(np.clip(round(path / (0.45 * robot_size(plan))) + 1, 7, 11))
    return np.linspace(0, plan.duration, count)


def pairs(positions: ComplexArray | complex) -> Array:
    """Complex numbers (...) as pairs (..., 2) of real and imaginary component."""
    positions = np.asarray(positions)
    return np.stack((positions.real, positions.imag), axis=-1)


def stadium(start: complex, end: complex, radius: float, arc: int = ARC) -> ComplexArray:
    """Outline (points,) of all points within ``radius`` of a segment, m; half a circle has ``arc`` corners."""
    along = np.angle(end - start) if end != start else 0.0
    half = radius * np.exp(1j * (along + np.linspace(-np.pi / 2, np.pi / 2, arc + 1)))
    return np.concatenate((end + half, start - half))


@lru_cache(maxsize=8)
def rendered_capsules(robot: Robot) -> tuple[LinkCapsule, ...]:
    """A robot's capsules in pictures: balls of one link, such as heel and toe of a sole, are a bar of its length.

    Its thickness is half of its distance from the link's joint.
    """
    capsules = list[LinkCapsule]()
    for capsule in robot.shapes:
        last = capsules[-1] if capsules else capsule
        direction = capsule.end - last.start
        two_balls = last.start == last.end and capsule.start == capsule.end and direction
        if last.link != capsule.link or not two_balls:
            capsules.append(capsule)
            continue
        direction /= abs(direction)
        above = -(last.start * np.conj(direction)).imag  # height of the joint above the bar
        growth = max(abs(above) / 4 - capsule.radius, 0.0)
        up = growth * 1j * direction * np.sign(above)
        start = last.start + growth * direction + up
        end = capsule.end - growth * direction + up
        capsules[-1] = replace(capsule, start=start, end=end, radius=capsule.radius + growth)
    return tuple(capsules)


def rendered_radii(problem: Problem) -> Array:
    """Return the radii (S,) of the capsules in pictures, m.

    Where there is none: a fraction of the links' usual length or of the robot's reach; less where that would fill the
    margin of an obstacle that the link keeps clear of.
    """
    robot = problem.robot
    capsules = rendered_capsules(robot)
    radius = np.array([capsule.radius for capsule in capsules])
    ends = np.array([capsule.end for capsule in capsules])
    lengths = np.abs(ends - [capsule.start for capsule in capsules])
    usual = float(np.median(lengths[lengths > 0])) if (lengths > 0).any() else 0.0
    reach = float(
        np.abs(robot.tree.point_weights(np.array([capsule.body for capsule in capsules]), ends)).sum(axis=1).max()
    )
    thickness = max(LINE_RADIUS * usual, 0.02 * reach)  # of a robot of short links 2 % of its reach is still visible
    margins = [obstacle.margin for obstacle in problem.obstacles if obstacle.margin > 0]
    if margins:  # 0.8 of a margin leaves a gap to see, but links do not get thinner than 0.4 of what they were
        thickness = max(min(thickness, 0.8 * min(margins)), 0.4 * thickness)
    return np.where(radius > 0, radius, thickness)


def capsule_segments(robot: Robot) -> IntArray:
    """Return which joint moves the body of each capsule (S,) against its parent: i + 1 for joint i, 0 for the base."""
    tree = robot.tree
    segments = np.zeros(len(tree.parent), dtype=np.int64)
    for body in range(1, len(segments)):
        parent = tree.parent[body]
        ratios = np.abs(tree.turns[body] - tree.turns[parent])
        segments[body] = 1 + int(ratios.argmax()) if ratios.any() else segments[parent]
    return segments[[capsule.body for capsule in rendered_capsules(robot)]]


def ground_lines(plan: Trajectory, placed: Postures) -> list[tuple[float, complex, complex]]:
    """Find the ground that a flight leaves and comes back to, or on which a jump begins and ends.

    Of a jump it is that of its stances; where there are two, the lower one is below all of the picture, and
    :func:`ground_step` is the higher one. Of a flight there is ground where the robot stands on the frame that takes
    off or lands and nothing of it is below. Ends at one height have one ground, and must both stand on it. What flies
    far below the ground has none.

    Returns
    -------
    list of (height, low, high)
        m; the ground is below the box between the corners.
    """
    if placed.depth is not None:
        return []
    low = placed.low
    high = placed.high
    if isinstance(plan, JumpMotion):
        return [(plan.ground, complex(low.real.min(), plan.ground), complex(high.real.max(), plan.ground))]
    size = float(np.abs(high - low).max())
    slack = STANDING * size + float(placed.radius.min())
    heights = float(placed.takeoff[0].imag), float(placed.landing[-1].imag)
    is_level = abs(heights[0] - heights[1]) <= STANDING * size
    lines = []
    for end, height in zip((0, -1), heights, strict=True):
        if low[end].imag >= height - slack and low.imag.min() >= height - SINKING * size:
            lines.append((float(low[end].imag), complex(low[end]), complex(high[end])))
    if not is_level:
        return lines
    if len(lines) < len(heights):
        return []
    level = min(height for height, _, _ in lines)
    return [(level, complex(low.real.min(), level), complex(high.real.max(), level))]


def ground_step(plan: Trajectory) -> tuple[complex, complex] | None:
    """Lower left and upper right corner, m, of the higher ground over the lower one; None where there is one ground."""
    step = plan.step if isinstance(plan, JumpMotion) else None
    if step is None:
        return None
    far = 1e2  # [m] beyond every picture
    left, right = sorted((step.edge, step.edge + step.inwards * far))
    return complex(left, step.low), complex(right, step.high)


def shown_obstacles(problem: Problem) -> list[Obstacle]:
    """Obstacles that pictures show as such: all but the edge of higher ground, which :func:`ground_step` shows."""
    return [obstacle for obstacle in problem.obstacles if not isinstance(obstacle, GroundEdge)]


def obstacle_times(obstacle: Obstacle, duration: float) -> Array:
    """Return the instants at which to draw an obstacle: one where it stands still, else five."""
    low, high = obstacle.window or (0.0, duration)
    if not any(obstacle.velocity):
        return np.array([low])
    return np.linspace(max(low, 0.0), min(high, duration), 5)


def obstacle_outlines(obstacle: Obstacle, time: float, margin: float) -> list[ComplexArray]:
    """Outlines (points,) of an obstacle's pieces grown by a margin, at a time, m; in space as the camera sees it."""
    if isinstance(obstacle, SpatialObstacle):
        corners = obstacle_corners(obstacle, margin) + time * np.array(obstacle.velocity)
        return [convex_hull(CAMERA(corners))] if len(corners) else []
    shift = complex(*obstacle.velocity) * time
    outlines = []
    for start, end, radius in obstacle_capsules(obstacle):
        arc = 48 if start == end else ARC  # a circle is larger in a picture than the end of a bar
        outlines.append(shift + stadium(start, end, radius + margin, arc))
    return outlines


def obstacle_capsules(obstacle: Obstacle) -> list[tuple[complex, complex, float]]:
    """Ends and radii of the capsules that an obstacle's pieces are at t = 0, m."""
    return [OUTLINES[piece.kind](piece) for piece in obstacle.pieces]


def _half_plane(wall: HalfPlane) -> tuple[complex, complex, float]:
    """A capsule so large that its side is the edge of the half-plane: its ends are outside every picture."""
    radius = 1e3  # [m]
    point = complex(*wall.point)
    down = -radius * complex(*wall.normal) / abs(complex(*wall.normal))
    return point + down * (1 + 1j), point + down * (1 - 1j), radius


OUTLINES: dict[str, Callable[[Any], tuple[complex, complex, float]]] = {
    "circle": lambda disc: (complex(*disc.center), complex(*disc.center), disc.radius),
    "capsule": lambda bar: (complex(*bar.start), complex(*bar.end), bar.radius),
    "half-plane": _half_plane,
}


def picture_box(plan: Trajectory, placed: Postures) -> tuple[complex, complex]:
    """Corners of the box that a picture shows, m: around postures, goal, and bounded obstacles wherever they are."""
    goal = posture_at(plan, plan.whole_problem.final, plan.duration)
    points = [placed.low, placed.high, goal.low, goal.high]
    for obstacle in shown_obstacles(plan.whole_problem):
        if obstacle.bounded:
            for time in obstacle_times(obstacle, plan.duration):
                points += obstacle_outlines(obstacle, time, obstacle.margin)
    return box_around(np.concatenate(points), 0.04)


def box_around(points: ComplexArray, margin: float) -> tuple[complex, complex]:
    """Corners of the box around points (N,), m, with a margin around it, in its longer sides."""
    low = pairs(points).min(axis=0)
    high = pairs(points).max(axis=0)
    pad = margin * float(np.max(high - low))
    return complex(*(low - pad)), complex(*(high + pad))
