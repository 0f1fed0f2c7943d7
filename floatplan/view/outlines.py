"""Where the robot, ground and obstacles of a flight or a jump are, as outlines that pictures and pages draw.

Places in the plane are complex, horizontal + i vertical, m; of flights in space, as a camera sees them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from floatplan.arrays import Array, ComplexArray, IntArray
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.plans.plan import Plan
from floatplan.plans.trajectory import Trajectory
from floatplan.problem.parts import HalfPlane, JointState, Obstacle
from floatplan.problem.problem import Problem
from floatplan.robot.robot import Robot
from floatplan.robot.shapes.capsules import convex_hull
from floatplan.robot.shapes.links import LINE_RADIUS, LinkCapsule
from floatplan.view.jumps import moments
from floatplan.view.solids import CAMERA, drawn_solids, face_normals
from floatplan.view.style import round_below

if TYPE_CHECKING:
    from floatplan.motion.spatial.bodies import BodyPoses

ARC = 12  # [-] corners of a half circle, of a link or bar and of a circle
FINE_ARC = 48
REACH_RADIUS = 0.02  # [-] the same over the reach of the robot from its centre of mass; the larger one counts
MARGIN_RADIUS = 0.8  # [-] the same over an obstacle's margin, at most
LEAST_RADIUS = 0.4  # [-] of the former
STEP = 0.45  # [-] path of the centre of mass from snapshot to snapshot, in sizes of the robot
FEWEST_SNAPSHOTS = 7  # [-] along the path
MOST_SNAPSHOTS = 11
STANDING = 0.02  # [-] of the robot's size: how far it may reach below the ground that it stands on
SINKING = 0.15  # [-] of the robot's size: a flight that goes deeper is drawn without ground
FLOOR_SAMPLES = 33
WIDE = 1e3  # [m] half-planes end outside every picture
LIGHT = np.array([-0.35, 0.75, 0.56])  # where it comes from: to the right, upwards, towards who looks
PAD = 0.04  # [-] room around what a picture must hold, in sizes of its box


@dataclass(frozen=True, eq=False)
class Postures:
    """The robot at K instants.

    Attributes
    ----------
    times : (K,) s
    com : (K,) complex, m
    corners : (K, S, k) complex, m
        Of the links' shapes, convex and grown by a radius: both ends of capsules; the last as often as it takes.
    radius : (S,) m
        As drawn: a link that has none gets one.
    part : (S,) int
        Colour of each shape: 0 for the base, i + 1 for what joint i moves.
    takeoff, landing : (K,) complex, m
        Places of the frames that take off and land.
    depth : (K, S, k) m, optional
        Of the corners, towards who looks.
    faces : for each shape its triangles (f, 3), corners by their numbers
    """

    times: Array
    com: ComplexArray
    corners: ComplexArray
    radius: Array
    part: IntArray
    takeoff: ComplexArray
    landing: ComplexArray
    depth: Array | None = None
    faces: Sequence[IntArray] = ()

    def painted(self, index: int) -> list[tuple[int, list[tuple[ComplexArray, float]]]]:
        """Shapes at an instant in the order in which they are painted, what is behind first, each with its seen faces.

        Faces are their corners (3,), m, and how much light falls on them, 0 to 1.
        """
        if self.depth is None:
            return [(shape, []) for shape in range(len(self.radius))]
        corners = self.corners[index]
        found = []
        places = np.stack((corners.real, corners.imag, self.depth[index]), axis=2)
        for shape in np.argsort(self.depth[index].mean(axis=1), kind="stable").tolist():
            normals = face_normals(places[shape], self.faces[shape])
            seen = normals[:, 2] > 0
            lights = np.clip(normals[seen] @ LIGHT, 0.0, 1.0).tolist()
            found.append((shape, list(zip(corners[shape][self.faces[shape][seen]], lights, strict=True))))
        return found

    @property
    def low(self) -> ComplexArray:
        """Lower left corners (K,) of the boxes around the postures."""
        return self._corner(np.minimum, -1.0)

    @property
    def high(self) -> ComplexArray:
        """Upper right corners (K,) of the boxes around the postures."""
        return self._corner(np.maximum, 1.0)

    def _corner(self, extreme: np.ufunc, side: float) -> ComplexArray:
        grown = side * self.radius[:, None]
        across, up = (extreme.reduce(each + grown, axis=(1, 2)) for each in (self.corners.real, self.corners.imag))
        return np.asarray(across + 1j * up)

    def outlines(self, index: int) -> list[ComplexArray]:
        """Closed outlines (points,) of the shapes at instant ``index``, m."""
        if self.depth is not None:
            return [convex_hull(corners) for corners in self.corners[index]]
        shapes = zip(self.corners[index], self.radius.tolist(), strict=True)
        return [stadium(complex(start), complex(end), radius) for (start, end), radius in shapes]


def postures(plan: Trajectory, times: Array) -> Postures:
    """Return the robot at times (K,), s."""
    if isinstance(plan, Plan) and plan.robot.in_plane is None:
        return seen_robot(plan.problem, times, bodies(plan, times), com_path(plan, times))
    return placed_robot(plan.whole_problem, times, *coordinates(plan, times))


def coordinates(plan: Trajectory, times: Array) -> tuple[Array, Array, ComplexArray]:
    """Return orientation (K,) and positions (K, n) rad, and centre of mass (K,) m, at times (K,), s."""
    if isinstance(plan, Plan):  # without its torques, which take longer than all the rest
        return plan.orientation(times), plan.joint_motion(times)[0], com_path(plan, times)
    state = plan.state(times)
    return state.orientation, state.positions, np.asarray(state.com_position @ [1, 1j])


def posture_at(plan: Trajectory, state: JointState, time: float) -> Postures:
    """Return the robot in a given posture, its centre of mass where the motion has it at ``time``."""
    times = np.array([time])
    if isinstance(plan, Plan) and plan.robot.in_plane is None:
        whole: Any = plan.whole
        return seen_robot(plan.problem, times, whole.posture(state, time), com_path(plan, times))
    orientation = np.array([state.orientation])
    com = com_path(plan, times)
    return placed_robot(plan.whole_problem, times, orientation, state.positions[None], com)


def placed_robot(problem: Problem, times: Array, orientation: Array, positions: Array, com: ComplexArray) -> Postures:
    """Return a problem's robot at times (K,) s: orientation (K,), positions (K, n) rad, centre of mass (K,) m."""
    robot = problem.robot
    poses = body_poses(robot, orientation, positions, com)
    shapes = drawn_shapes(robot)
    ends = [(frame.body, frame.local) for frame in (problem.takeoff_frame, problem.landing_frame)]
    takeoff, landing = poses.points(*map(list, zip(*ends, strict=True))).T
    bodies = [shape.body for shape in shapes]
    sides = [poses.points(bodies, [getattr(shape, end) for shape in shapes]) for end in ("start", "end")]
    return Postures(
        times=times,
        com=com,
        corners=np.stack(sides, axis=2),
        radius=drawn_radius(problem),
        part=drawn_part(robot),
        takeoff=takeoff,
        landing=landing,
    )


def bodies(plan: Plan, times: Array) -> BodyPoses:
    """Where the bodies of a robot in space are at times (K,), s."""
    whole: Any = plan.whole
    poses: BodyPoses = whole.bodies(times)
    return poses


def seen_robot(problem: Problem, times: Array, poses: BodyPoses, com: ComplexArray) -> Postures:
    """Return a problem's robot in space as the camera sees it at times (K,) s, its centre of mass at (K,) m."""
    robot = problem.robot
    solids = drawn_solids(problem.robot)
    most = max(len(solid.points) for solid in solids)
    points = [np.pad(solid.points, ((0, most - len(solid.points)), (0, 0)), "edge") for solid in solids]
    placed = np.stack([poses.points(solid.body, local) for solid, local in zip(solids, points, strict=True)], axis=1)
    takeoff, landing = (CAMERA(poses.frame(robot, end.frame)) for end in (problem.takeoff, problem.landing))
    return Postures(
        times=times,
        com=com,
        corners=CAMERA(placed),
        radius=np.zeros(len(solids)),
        part=np.array([solid.part for solid in solids]),
        takeoff=takeoff,
        landing=landing,
        depth=placed @ CAMERA.toward,
        faces=[solid.faces for solid in solids],
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
        """Places (K, P) of points of some bodies, m, from those in the bodies' own axes."""
        return np.asarray(self.places[:, bodies] + self.rotations[:, bodies] * np.asarray(local))


def body_poses(robot: Robot, orientation: Array, positions: Array, com: ComplexArray) -> Poses:
    """Poses of the bodies from orientation (K,), positions (K, n) and centre of mass (K,)."""
    tree = robot.tree
    bodies = len(tree.mass)
    origins = tree.point_weights(np.arange(bodies), np.zeros(bodies, dtype=np.complex128))
    angles = tree.absolute_angles(orientation, positions)
    rotations = tree.rotations(angles)
    return Poses(places=com[:, None] + rotations @ origins.T, angles=angles, rotations=rotations)


def turns(plan: Plan, times: Array) -> Array:
    """Angles (K - 1, m), rad, by which the bodies turn from one of the times (K,), s, to the next."""
    if plan.robot.in_plane is None:
        rotations = bodies(plan, times).rotations
        traces = np.einsum("kmab,kmab->km", rotations[1:], rotations[:-1])
        return np.asarray(np.arccos(np.clip((traces - 1) / 2, -1.0, 1.0)))
    return np.asarray(np.abs(np.diff(body_poses(plan.robot, *coordinates(plan, times)).angles, axis=0)))


def ball(plan: Plan) -> tuple[Array, float]:
    """Return a place (3,) and a radius, m, that hold a flight in space."""
    state = plan.at(np.linspace(0.0, plan.duration, FLOOR_SAMPLES))
    size = float(np.linalg.norm(state.base_position - state.com_position, axis=1).max()) + robot_size(plan) / 2
    low = state.com_position.min(axis=0) - size
    high = state.com_position.max(axis=0) + size
    return (low + high) / 2, float((high - low).max()) / 2


def floor(plan: Plan) -> list[Array]:
    """Lines (2, 3), m, of a grid on the ground that a flight in space leaves, where it stands on it at takeoff."""
    poses = bodies(plan, np.linspace(0.0, plan.duration, FLOOR_SAMPLES))
    solids = drawn_solids(plan.robot)
    placed = np.concatenate([poses.points(solid.body, solid.points) for solid in solids], axis=1)
    low = placed.min(axis=(0, 1))
    high = placed.max(axis=(0, 1))
    level = float(placed[0, :, 2].min())
    size = float((high - low).max())
    stands = poses.frame(plan.robot, plan.problem.takeoff.frame)[0, 2] <= level + 2 * STANDING * size
    if plan.ballistics.gravity == 0 or not stands or low[2] < level - SINKING * size:
        return []
    step = round_below(size / 4)
    low = step * (np.floor(low / step) - 0.5)
    high = step * (np.ceil(high / step) + 0.5)
    lines = []
    for along, across in ((0, 1), (1, 0)):
        for place in np.arange(low[across] + step / 2, high[across], step):
            ends = np.full((2, 3), level)
            ends[:, across] = place
            ends[:, along] = (low[along], high[along])
            lines.append(ends)
    return lines


def com_path(plan: Trajectory, times: Array) -> ComplexArray:
    """Places (K,) of the centre of mass at times (K,), m."""
    places = plan.ballistics.positions(times) if isinstance(plan, Plan) else plan.state(times).com_position
    return CAMERA(places) if plan.robot.in_plane is None else np.asarray(places @ [1, 1j])


def robot_size(plan: Trajectory) -> float:
    """Largest extent of the robot during the motion, horizontal or vertical, m."""
    placed = postures(plan, np.linspace(0, plan.duration, 33))
    return float(np.abs(pairs(placed.high - placed.low)).max())


def snapshot_times(plan: Trajectory) -> Array:
    """Instants (K,): of a jump its moments; else evenly spaced in time, so many that neighbours stand apart."""
    if isinstance(plan, JumpMotion):
        return moments(plan)
    path = float(np.abs(np.diff(com_path(plan, np.linspace(0, plan.duration, 65)))).sum())
    count = int(np.clip(round(path / (STEP * robot_size(plan))) + 1, FEWEST_SNAPSHOTS, MOST_SNAPSHOTS))
    return np.linspace(0, plan.duration, count)


def pairs(places: ComplexArray | complex) -> Array:
    """Complex numbers (...) as pairs (..., 2) of their parts."""
    places = np.asarray(places)
    return np.stack((places.real, places.imag), axis=-1)


def stadium(start: complex, end: complex, radius: float, arc: int = ARC) -> ComplexArray:
    """Outline (points,) of all points within ``radius`` of a segment, m; half a circle has ``arc`` corners."""
    along = np.angle(end - start) if end != start else 0.0
    half = radius * np.exp(1j * (along + np.linspace(-np.pi / 2, np.pi / 2, arc + 1)))
    return np.concatenate((end + half, start - half))


@lru_cache(maxsize=8)
def drawn_shapes(robot: Robot) -> tuple[LinkCapsule, ...]:
    """A robot's capsules as they are drawn: balls of one link, such as heel and toe of a sole, are a bar of its length.

    It is as thick as half of the way from there to the link's joint.
    """
    shapes = list[LinkCapsule]()
    for shape in robot.shapes:
        last = shapes[-1] if shapes else shape
        way = shape.end - last.start
        if last.link != shape.link or last.start != last.end or shape.start != shape.end or not way:
            shapes.append(shape)
            continue
        way /= abs(way)
        above = -(last.start * np.conj(way)).imag
        more = max(abs(above) / 4 - shape.radius, 0.0)
        up = more * 1j * way * np.sign(above)
        bar = {"start": last.start + more * way + up, "end": shape.end - more * way + up}
        shapes[-1] = replace(shape, **bar, radius=shape.radius + more)
    return tuple(shapes)


def drawn_radius(problem: Problem) -> Array:
    """Return the radii (S,) of the capsules as drawn, m.

    Where there is none: a fraction of the links' usual length or of the robot's reach; less where that would fill the
    margin of an obstacle that the link keeps clear of.
    """
    robot = problem.robot
    shapes = drawn_shapes(problem.robot)
    radius = np.array([shape.radius for shape in shapes])
    lengths = np.array([abs(shape.end - shape.start) for shape in shapes])
    usual = float(np.median(lengths[lengths > 0])) if (lengths > 0).any() else 0.0
    ends = np.array([shape.end for shape in shapes])
    bodies = np.array([shape.body for shape in shapes])
    reach = float(np.abs(robot.tree.point_weights(bodies, ends)).sum(axis=1).max())
    drawn = max(LINE_RADIUS * usual, REACH_RADIUS * reach)
    margins = [obstacle.margin for obstacle in problem.obstacles if obstacle.margin > 0]
    if margins:
        drawn = max(min(drawn, MARGIN_RADIUS * min(margins)), LEAST_RADIUS * drawn)
    return np.where(radius > 0, radius, drawn)


def drawn_part(robot: Robot) -> IntArray:
    """Return which joint moves the body of each capsule (S,) against its parent: i + 1 for joint i, 0 for the base."""
    tree = robot.tree
    part = np.zeros(len(tree.parent), dtype=np.int64)
    for body in range(1, len(part)):
        turn = np.abs(tree.turns[body] - tree.turns[tree.parent[body]])
        part[body] = 1 + int(turn.argmax()) if turn.any() else part[tree.parent[body]]
    return part[[shape.body for shape in drawn_shapes(robot)]]


def ground_lines(placed: Postures) -> list[tuple[float, complex, complex]]:
    """Find the ground that a flight leaves and comes back to.

    There is ground where the robot stands on the frame that takes off or lands and nothing of it is below. Ends at one
    height have one ground, and must both stand on it. What flies far below the ground has none.

    Returns
    -------
    list of (height, low, high)
        m; the ground is drawn below the box between the corners.
    """
    if placed.depth is not None:
        return []
    low = placed.low
    high = placed.high
    size = float(np.abs(high - low).max())
    slack = STANDING * size + float(placed.radius.min())
    heights = float(placed.takeoff[0].imag), float(placed.landing[-1].imag)
    stands = [
        low[end].imag >= height - slack and low.imag.min() >= height - SINKING * size
        for end, height in zip((0, -1), heights, strict=True)
    ]
    if abs(heights[0] - heights[1]) <= STANDING * size:
        level = float(min(low[0].imag, low[-1].imag))
        corners = complex(low.real.min(), level), complex(high.real.max(), level)
        return [(level, *corners)] if all(stands) else []
    ends = zip(stands, (0, -1), strict=True)
    return [(float(low[end].imag), complex(low[end]), complex(high[end])) for stand, end in ends if stand]


def obstacle_times(obstacle: Obstacle, duration: float) -> Array:
    """Return the instants at which to draw an obstacle: one where it stands still, else five."""
    low, high = obstacle.window or (0.0, duration)
    if not any(obstacle.velocity):
        return np.array([low])
    return np.linspace(max(low, 0.0), min(high, duration), 5)


def obstacle_outlines(obstacle: Obstacle, time: float, margin: float) -> list[ComplexArray]:
    """Outlines (points,) of an obstacle's pieces grown by a margin, at a time, m."""
    shift = complex(*obstacle.velocity) * time
    return [
        shift + stadium(start, end, radius + margin, FINE_ARC if start == end else ARC)
        for start, end, radius in obstacle_capsules(obstacle)
    ]


def obstacle_capsules(obstacle: Obstacle) -> list[tuple[complex, complex, float]]:
    """Ends and radii of the capsules that an obstacle's pieces are at t = 0, m."""
    return [OUTLINES[piece.kind](piece) for piece in obstacle.pieces]


def _half_plane(wall: HalfPlane) -> tuple[complex, complex, float]:
    """One so large that its side is the edge."""
    down = -WIDE * complex(*wall.normal) / abs(complex(*wall.normal))
    return complex(*wall.point) + down * (1 + 1j), complex(*wall.point) + down * (1 - 1j), WIDE


OUTLINES: dict[str, Callable[[Any], tuple[complex, complex, float]]] = {
    "circle": lambda disc: (complex(*disc.center), complex(*disc.center), disc.radius),
    "capsule": lambda bar: (complex(*bar.start), complex(*bar.end), bar.radius),
    "half-plane": _half_plane,
}


def picture_box(plan: Trajectory, placed: Postures) -> tuple[complex, complex]:
    """Corners of what a picture must hold, m: postures, goal, and obstacles with bounds wherever they are drawn."""
    goal = posture_at(plan, plan.whole_problem.final, plan.duration)
    outlines = [
        outline
        for obstacle in plan.whole_problem.obstacles
        if obstacle.bounded
        for time in obstacle_times(obstacle, plan.duration)
        for outline in obstacle_outlines(obstacle, time, obstacle.margin)
    ]
    return box_around(np.concatenate((placed.low, placed.high, goal.low, goal.high, *outlines)), PAD)


def box_around(points: ComplexArray, room: float) -> tuple[complex, complex]:
    """Corners of the box around points (N,), m, with room around it, in its longer sides."""
    low = pairs(points).min(axis=0)
    high = pairs(points).max(axis=0)
    pad = room * float(np.max(high - low))
    return complex(*(low - pad)), complex(*(high + pad))
