"""Necessary conditions: reasons, all provable in a line or two, why a problem in a plane has no plan.

They are checked before the search, which is cut short where one is violated.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple, get_args

import numpy as np

from floatplan.arrays import Array, ComplexArray
from floatplan.motion.planar.clearance import point_distances
from floatplan.motion.planar.contact_rates import End, at_end, equations_at, rates_at
from floatplan.problem.parts import Bar, Obstacle
from floatplan.problem.problem import Problem
from floatplan.robot.robot import Robot
from floatplan.tables import ORIENTATION, RELATIVE


def impossibilities(problem: Problem, path_is_clear: bool = False) -> list[str]:
    """Return the reasons why no motion whatever meets the problem, a sentence each; none where none is proved.

    The path is clear where the centre of mass is never deeper in an obstacle than its central point can be away.
    """
    sentences = [*_mean_rates(problem), *_turning(problem), *_frames_at_rest(problem)]
    for index, obstacle in enumerate(problem.obstacles):
        if isinstance(obstacle, Bar) or not (path_is_clear or _stays_out(problem, obstacle)):
            point = central_point(problem)
            (times, path, _) = _path_from(problem, obstacle, 2001)  # as fine as sentences tell of it
            sentences += [*_impassable(index, obstacle, times, path, point), *_barred(index, obstacle, path, point)]
    return sentences


def _path_from(problem: Problem, obstacle: Obstacle, instants: int) -> tuple[Array, ComplexArray, ComplexArray]:
    """Instants (K,) s, and the path of the centre of mass, m, and its velocity, m/s, as seen from an obstacle."""
    times = np.linspace(0, problem.flight.duration, instants)
    fall = problem.path
    com = complex(*fall.position0) + complex(*fall.velocity0) * times - fall.gravity / 2 * 1j * times**2
    velocity = complex(*fall.velocity0) - fall.gravity * 1j * times - complex(*obstacle.velocity)
    return times, np.asarray(com - complex(*obstacle.velocity) * times), np.asarray(velocity, np.complex128)


def _stays_out(problem: Problem, obstacle: Obstacle) -> bool:
    """Whether a few instants tell that the centre of mass is never so deep in an obstacle: its speed is convex."""
    times, path, velocity = _path_from(problem, obstacle, 51)
    between = np.abs(velocity).max() * times[1] / 2
    return bool(obstacle.margin - point_distances(obstacle, path).min() + between < central_reach(problem.robot))


def difficulties(problem: Problem) -> list[str]:
    """Return sentences about an angular momentum outside (9)."""
    low, high = problem.momentum_interval
    momentum = problem.flight.momentum_in_plane
    if isinstance(momentum, str) or low <= momentum <= high:
        return []
    return [
        f"The angular momentum {momentum:.6g} kg m^2/s lies outside the interval of motions that do not turn back,"
        f" [{low:.6g}, {high:.6g}]: it takes a joint, or the base, that turns back on its way;"
        f" the interval's midpoint is {(low + high) / 2:.6g}."
    ]


class CentralPoint(NamedTuple):
    """The point of the robot's shapes that is never further than ``reach`` m, the least, from the centre of mass.

    ``start, goal`` : its places relative to the centre of mass at takeoff and landing, m.
    """

    reach: float
    start: complex
    goal: complex


def central_point(problem: Problem) -> CentralPoint:
    """A point's position from the centre of mass is a sum of rotated vectors; the sum of their lengths is its reach."""
    tree = problem.robot.tree
    weights = _central_weights(problem.robot)
    states = (problem.initial, problem.final)
    angles = (tree.absolute_angles(np.array(state.orientation), state.positions) for state in states)
    return CentralPoint(
        central_reach(problem.robot), *(complex(tree.rotations(posture) @ weights) for posture in angles)
    )


@lru_cache(maxsize=16)
def central_reach(robot: Robot) -> float:
    """How far that point is from the centre of mass at most, m; infinite where the robot has no shapes."""
    return float(np.abs(_central_weights(robot)).sum()) if robot.shapes else np.inf


@lru_cache(maxsize=16)
def _central_weights(robot: Robot) -> ComplexArray:
    """Weights (m,) of that point."""
    shapes = robot.shapes
    count = 9  # [-] of a link's shape: candidates for the point that stays nearest to the centre of mass
    bodies = np.repeat([shape.body for shape in shapes], count)
    fraction = np.tile(np.linspace(0, 1, count), len(shapes))
    starts = np.repeat([shape.start for shape in shapes], count)
    ends = np.repeat([shape.end for shape in shapes], count)
    weights = robot.tree.point_weights(bodies, (1 - fraction) * starts + fraction * ends)
    return np.asarray(weights[np.argmin(np.abs(weights).sum(axis=1))], dtype=np.complex128)


def _mean_rates(problem: Problem) -> Iterator[str]:
    """Somewhere in the flight a rate is at least as large as its mean."""
    duration = problem.flight.duration
    for name, start, goal, limit in zip(
        problem.robot.joints, problem.initial.positions, problem.final.positions, problem.velocity_limits, strict=True
    ):
        mean = abs(goal - start) / duration
        if mean > limit * (1 + RELATIVE):
            yield (
                f"Joint {name} moves by {goal - start:+.4g} rad in {duration:.4g} s: that needs {mean:.4g} rad/s on"
                f" average, more than its velocity limit of {limit:.4g} rad/s."
            )
    rate = problem.limits.orientation_rate
    change = problem.final.orientation - problem.initial.orientation
    if rate is not None and abs(change) / duration > rate * (1 + RELATIVE):
        yield (
            f"The orientation changes by {change:+.4g} rad in {duration:.4g} s: that needs {abs(change) / duration:.4g}"
            f" rad/s on average, more than the orientation rate limit of {rate:.4g} rad/s."
        )


def _frames_at_rest(problem: Problem) -> Iterator[str]:
    """A frame leaves or meets the ground at rest with rates within the limits, or not at all."""
    if not np.isfinite(problem.velocity_limits).any():
        return
    momentum = problem.angular_momentum
    takeoff = (problem.initial, problem.takeoff.frame)
    landing = (problem.final, problem.landing.frame)
    for end, (state, frame) in zip(get_args(End), (takeoff, landing), strict=True):
        if state.frame_rests:
            equations = equations_at(problem.robot, *at_end(problem, end))
            contact = rates_at(problem.robot, equations, problem.velocity_limits, momentum)
            if contact.exist and contact.ratio is not None and contact.ratio > 1 + RELATIVE:
                whatever = ", whatever the angular momentum," if momentum is None else ""
                yield (
                    f"At {end} frame {frame!r} is at rest only{whatever} with rates of {contact.ratio:.4g} times the"
                    f" velocity limits or more."
                )


def _turning(problem: Problem) -> Iterator[str]:
    """By (4) the base turns with ``(h - sum_i D_i q_i') / D_0``, which bounds on D, q' and h enclose."""
    if problem.angular_momentum is None or not np.isfinite(problem.velocity_limits).all():
        return
    low, high = problem.inertia_extremes
    by_joints = float(np.maximum(np.abs(low[1:]), np.abs(high[1:])) @ problem.velocity_limits)
    momentum = problem.angular_momentum
    duration = problem.flight.duration
    change = problem.final.orientation - problem.initial.orientation
    least = momentum - by_joints
    most = momentum + by_joints
    slowest = duration * least / (high[0] if least > 0 else low[0])
    fastest = duration * most / (low[0] if most > 0 else high[0])
    if not slowest - ORIENTATION <= change <= fastest + ORIENTATION:
        yield (
            f"Under the velocity limits the orientation changes by {slowest:+.4g} to {fastest:+.4g} rad in"
            f" {duration:.4g} s whatever the joints do; the goal needs {change:+.4g} rad."
        )


def _impassable(index: int, obstacle: Obstacle, times: Array, path: ComplexArray, point: CentralPoint) -> Iterator[str]:
    """Deep inside an obstacle the centre of mass takes its central point with it."""
    low, high = obstacle.window or (-np.inf, np.inf)
    exists = (times >= low) & (times <= high)
    depth = np.where(exists, obstacle.margin - point_distances(obstacle, path), -np.inf)
    deepest = int(np.argmax(depth))
    if depth[deepest] > point.reach:
        yield (
            f"Obstacle {index} ({obstacle.kind}) cannot be passed whatever the posture:"
            f" at t = {times[deepest]:.3f} s the centre of mass is {depth[deepest]:.3g} m inside it and its"
            f" margin, and some point of the robot is never further than {point.reach:.3g} m from the centre of mass."
        )


def _barred(index: int, obstacle: Obstacle, path: ComplexArray, point: CentralPoint) -> Iterator[str]:
    """A long bar: the central point must cross its line, and wherever it can, the bar is in the way."""
    if not isinstance(obstacle, Bar) or obstacle.window is not None or obstacle.start == obstacle.end:
        return
    if obstacle.radius + obstacle.margin == 0:
        return
    along = complex(*obstacle.end) - complex(*obstacle.start)
    upright = along.conjugate() / abs(along)  # turns the bar's line into the real axis, its start into 0
    position = (path - complex(*obstacle.start)) * upright
    sides = (position[0] + point.start * upright).imag, (position[-1] + point.goal * upright).imag
    step = float(np.abs(np.diff(position)).max(initial=0))  # the path between two instants is nearer than that to one
    crossing = position[np.abs(position.imag) <= point.reach + step]
    if sides[0] * sides[1] >= 0 or not crossing.size:
        return
    low = crossing.real.min() - point.reach - step
    high = crossing.real.max() + point.reach + step
    if low >= 0 and high <= abs(along):
        yield (
            f"Obstacle {index} ({obstacle.kind}) cannot be passed whatever the posture: it is {abs(along):.3g} m long,"
            f" the flight ends on its other side, and the point of the robot that is never further than"
            f" {point.reach:.3g} m from the centre of mass would have to pass through it."
        )
