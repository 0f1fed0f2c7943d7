"""Where a robot's links are, as outlines that can be drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array, ComplexArray, IntArray
from floatplan.motion.planar.clearance import LinkShapes
from floatplan.plans.plan import Plan
from floatplan.problem.parts import JointState
from floatplan.problem.problem import Problem
from floatplan.robot.robot import Frame, Robot

ARC = 12  # [-] corners of a half circle
LINK_RADIUS = 0.055  # [-] radius, as drawn, of links without a thickness of their own over their median length
REACH_RADIUS = 0.02  # [-] the same over the reach of the robot from its centre of mass; the larger one counts
MARGIN_RADIUS = 0.8  # [-] the same over an obstacle's margin, at most
LEAST_RADIUS = 0.4  # [-] of the former


@dataclass(frozen=True, eq=False)
class Postures:
    """The robot at K instants.

    Attributes
    ----------
    times : (K,) s
    com : (K,) complex, m
    start, end : (K, S) complex, m
        Ends of the links' capsules.
    radius : (S,) m
        As drawn: a link that has none gets one.
    part : (S,) int
        Colour of each capsule: 0 for the base, i + 1 for what joint i moves.
    takeoff, landing : (K,) complex, m
        Places of the frames that take off and land.
    """

    times: Array
    com: ComplexArray
    start: ComplexArray
    end: ComplexArray
    radius: Array
    part: IntArray
    takeoff: ComplexArray
    landing: ComplexArray

    @property
    def low(self) -> ComplexArray:
        """Lower left corners (K,) of the boxes around the postures."""
        return _corner(self, np.minimum, -1.0)

    @property
    def high(self) -> ComplexArray:
        """Upper right corners (K,) of the boxes around the postures."""
        return _corner(self, np.maximum, 1.0)

    def outlines(self, index: int) -> list[Array]:
        """Closed outlines (points, 2) of the capsules at instant ``index``, m."""
        places = zip(self.start[index], self.end[index], self.radius, strict=True)
        return [stadium(complex(start), complex(end), float(radius)) for start, end, radius in places]


def postures(plan: Plan, times: Array) -> Postures:
    """Return the robot in flight at times (K,), s."""
    return _placed(plan, times, com_path(plan, times), plan.orientation(times), plan.joint_motion(times)[0])


@dataclass(frozen=True, eq=False)
class Poses:
    """The bodies of the robot at K instants.

    Attributes
    ----------
    places : (K, m) complex, m; of the bodies' origins
    angles : (K, m) rad; about the plane's normal
    """

    places: ComplexArray
    angles: Array


def body_poses(robot: Robot, orientation: Array, positions: Array, com: ComplexArray) -> Poses:
    """Poses of the bodies from orientation (K,), positions (K, n) and centre of mass (K,)."""
    tree = robot.tree
    bodies = len(tree.mass)
    origins = tree.point_weights(np.arange(bodies), np.zeros(bodies, dtype=np.complex128))
    angles = tree.absolute_angles(orientation, positions)
    return Poses(places=com[:, None] + tree.rotations(angles) @ origins.T, angles=angles)


def com_path(plan: Plan, times: Array) -> ComplexArray:
    """Places (K,) of the centre of mass at times (K,), m."""
    places = plan.ballistics.positions(times)
    return np.asarray(places[:, 0] + 1j * places[:, 1])


def robot_size(plan: Plan) -> float:
    """Largest extent of the robot during the flight, horizontal or vertical, m."""
    placed = postures(plan, np.linspace(0, plan.duration, 33))
    return float(np.abs(np.concatenate(((placed.high - placed.low).real, (placed.high - placed.low).imag))).max())


def posture_at(plan: Plan, state: JointState, time: float) -> Postures:
    """Return the robot in a given posture, its centre of mass where the flight has it at ``time``."""
    times = np.array([time])
    return _placed(plan, times, com_path(plan, times), np.array([state.orientation]), state.positions[None])


def _placed(plan: Plan, times: Array, com: ComplexArray, orientation: Array, positions: Array) -> Postures:
    robot, problem = plan.robot, plan.problem
    angles = robot.tree.absolute_angles(orientation, positions)
    segments = LinkShapes(robot.tree, robot.shapes).place(com, angles)
    rotations = robot.tree.rotations(angles)

    def place(frame: Frame) -> ComplexArray:
        weights = robot.tree.point_weights(np.array([frame.body]), np.array([frame.local]))[0]
        return np.asarray(com + rotations @ weights)

    return Postures(
        times=times,
        com=com,
        start=segments.start,
        end=segments.end,
        radius=drawn_radius(problem),
        part=drawn_part(robot),
        takeoff=place(problem.takeoff_frame),
        landing=place(problem.landing_frame),
    )


def stadium(start: complex, end: complex, radius: float) -> Array:
    """Outline (points, 2) of all points within ``radius`` of a segment, m."""
    along = np.angle(end - start) if end != start else 0.0
    half = np.linspace(-np.pi / 2, np.pi / 2, ARC + 1)
    points = np.concatenate((end + radius * np.exp(1j * (along + half)), start - radius * np.exp(1j * (along + half))))
    return np.stack((points.real, points.imag), axis=1)


def _corner(placed: Postures, extreme: np.ufunc, side: float) -> ComplexArray:
    def reach(start: Array, end: Array) -> Array:
        return np.asarray(extreme.reduce(extreme(start, end) + side * placed.radius, axis=1))

    corner = reach(placed.start.real, placed.end.real) + 1j * reach(placed.start.imag, placed.end.imag)
    return np.asarray(corner, dtype=np.complex128)


def drawn_radius(problem: Problem) -> Array:
    """Return the radii (S,) of the capsules as drawn, m.

    Where there is none: a fraction of the links' usual length or of the robot's reach; less where that would fill the
    margin of an obstacle that the link keeps clear of.
    """
    robot, shapes = problem.robot, problem.robot.shapes
    radius = np.array([shape.radius for shape in shapes])
    lengths = np.array([abs(shape.end - shape.start) for shape in shapes])
    usual = float(np.median(lengths[lengths > 0])) if (lengths > 0).any() else 0.0
    ends, bodies = np.array([shape.end for shape in shapes]), np.array([shape.body for shape in shapes])
    reach = float(np.abs(robot.tree.point_weights(bodies, ends)).sum(axis=1).max())
    drawn = max(LINK_RADIUS * usual, REACH_RADIUS * reach)
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
    return part[[shape.body for shape in robot.shapes]]
