"""Data of the report's page: samples of the motion, and the weights that place the robot's links from them.

The page places the robot as :class:`~floatplan.robot.planar.tree.PlanarTree` does, from orientation and joints, so that
a few numbers per instant move any robot. Columns are in SI units and radians.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from floatplan.arrays import Array, ComplexArray, IntArray
from floatplan.files import plain
from floatplan.plans.plan import Plan
from floatplan.problem.parts import Obstacle
from floatplan.view.figures.snapshots import picture_box, snapshot_times
from floatplan.view.postures import posture_at, postures
from floatplan.view.style import OBSTACLES, palette
from floatplan.view.surroundings import ground_lines, obstacle_outline

FEWEST_SAMPLES, MOST_SAMPLES = 601, 2401  # [-] samples of a flight; odd, so that its middle is one
SAMPLE_RATE = 300  # [Hz]
DIGITS = 11  # [-] of the numbers in the page, which compares with the plan to 1e-6
BOX_PAD = 0.02  # [-] room around what is drawn


def motion_data(plan: Plan) -> dict[str, Any]:
    """Return all that moves: duration, columns (names to samples), robot, frames, obstacles, ghosts, ground, box."""
    times = sample_grid(plan.duration)
    placed = postures(plan, snapshot_times(plan))
    return {
        "duration": plan.duration,
        "columns": {name: rounded(values) for name, values in columns(plan, times).items()},
        "robot": robot_data(plan),
        "frames": _frames(plan),
        "obstacles": [_obstacle(obstacle, index) for index, obstacle in enumerate(plan.problem.obstacles)],
        "ghosts": rounded(placed.times),
        "goal": _goal(plan),
        "ground": [[level, low.real, high.real] for level, low, high in ground_lines(placed)],
        "box": _box(plan),
    }


def sample_grid(duration: float) -> Array:
    """Instants (N,) of the columns, s: evenly spaced, the middle of the flight among them."""
    count = int(np.clip(duration * SAMPLE_RATE, FEWEST_SAMPLES - 1, MOST_SAMPLES - 1)) // 2 * 2 + 1
    return np.linspace(0.0, duration, count)


def columns(plan: Plan, times: Array) -> dict[str, Array]:
    """Return the sampled quantities (N,) by name; those of joint i and obstacle i end in ``.i``."""
    state = plan.at(times)
    inertia = plan.dynamics.momentum_map(state.positions)
    base = inertia[:, 0] * state.orientation_rate
    sampled = {
        "orientation": state.orientation,
        "orientation_rate": state.orientation_rate,
        "com_x": state.com_position[:, 0],
        "com_y": state.com_position[:, 1],
        "momentum_base": base,
        "momentum_joints": state.angular_momentum - base,
        "angular_momentum": state.angular_momentum,
    }
    sampled |= {f"inertia.{index}": column for index, column in enumerate(inertia.T)}
    for name in ("positions", "velocities", "accelerations", "motor_torques"):
        sampled |= {f"{name}.{index}": column for index, column in enumerate(getattr(state, name).T)}
    for index, obstacle in enumerate(plan.problem.obstacles):
        sampled[f"clearance.{index}"] = plan.clearances(times, [obstacle])
    return sampled


def robot_data(plan: Plan) -> dict[str, Any]:
    """Return bodies, links and colours: what the page needs to place and to paint the robot."""
    robot = plan.robot
    placed = posture_at(plan, plan.problem.initial, 0.0)
    bodies = np.array([shape.body for shape in robot.shapes], dtype=np.int64)
    start, end = (np.array([getattr(shape, side) for shape in robot.shapes]) for side in ("start", "end"))
    moved = np.arange(1, len(robot.tree.mass))
    links = zip(
        placed.part.tolist(),
        placed.radius.tolist(),
        _weights(plan, bodies, start),
        _weights(plan, bodies, end),
        strict=True,
    )
    return {
        "joints": list(robot.joints),
        "turn": robot.tree.turn,
        "turns": rounded(robot.tree.turns),
        "offsets": rounded(robot.tree.offsets),
        "links": [{"part": part, "radius": radius, "start": a, "end": b} for part, radius, a, b in links],
        "pivots": _weights(plan, moved, np.zeros(len(moved), dtype=np.complex128)),
        "colours": [hex_colour(colour) for colour in palette(len(robot.joints) + 1)],
    }


def hex_colour(colour: Array) -> str:
    """Return a colour (3,), from 0 to 1, as the web writes it."""
    return "#" + "".join(f"{round(255 * float(part)):02x}" for part in colour)


def rounded(values: Any) -> Any:
    """Return numbers as lists, of so many digits; None for what is not finite."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim > 1:
        return [rounded(row) for row in array]
    return plain([float(f"{value:.{DIGITS}g}") for value in array.tolist()])


def _weights(plan: Plan, bodies: IntArray, local: ComplexArray) -> list[Any]:
    """Weights of points, each a list of (real, imaginary) per body."""
    return [_pairs(row) for row in plan.robot.tree.point_weights(bodies, local)]


def _pairs(values: Iterable[complex]) -> list[list[float]]:
    return [[float(f"{value.real:.{DIGITS}g}"), float(f"{value.imag:.{DIGITS}g}")] for value in values]


def _frames(plan: Plan) -> list[dict[str, Any]]:
    """Frames that leave a trail, and how they are marked; one that takes off and lands is one."""
    problem = plan.problem
    roles = {problem.takeoff.frame: "takes off"}
    roles[problem.landing.frame] = "takes off and lands" if problem.landing.frame in roles else "lands"
    frames = [(name, role, plan.robot.frames[name]) for name, role in roles.items()]
    return [
        {"name": name, "role": role, "weights": _weights(plan, np.array([frame.body]), np.array([frame.local]))[0]}
        for name, role, frame in frames
    ]


def _obstacle(obstacle: Obstacle, index: int) -> dict[str, Any]:
    """Outlines of an obstacle and its margin where it is given, how it moves, and when it exists."""
    return {
        "kind": obstacle.kind,
        "colour": OBSTACLES[index % len(OBSTACLES)],
        "outline": rounded(obstacle_outline(obstacle, 0.0, 0.0)),
        "margin": rounded(obstacle_outline(obstacle, 0.0, obstacle.margin)) if obstacle.margin > 0 else None,
        "velocity": list(obstacle.velocity),
        "window": None if obstacle.window is None else list(obstacle.window),
    }


def _goal(plan: Plan) -> dict[str, Any]:
    final = plan.problem.final
    place = plan.ballistics.positions(np.array([plan.duration]))[0]
    return {"orientation": final.orientation, "positions": final.positions.tolist(), "com": place.tolist()}


def _box(plan: Plan) -> list[float]:
    """Left, low, right, high of all that is drawn at any time, m."""
    low, high = picture_box(plan, postures(plan, np.linspace(0.0, plan.duration, 65)))
    room = BOX_PAD * max((high - low).real, (high - low).imag)
    return [low.real - room, low.imag - room, high.real + room, high.imag + room]
