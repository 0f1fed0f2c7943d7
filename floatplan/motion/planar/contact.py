"""Contact with the ground: whether links that stand on it at takeoff or landing can leave or reach it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from floatplan.errors import InputError
from floatplan.motion.dynamics import MomentumSet
from floatplan.motion.planar.ballistics import ballistics
from floatplan.motion.planar.closed_form import Dynamics
from floatplan.motion.planar.end_rates import end_rates
from floatplan.problem.parts import JointState
from floatplan.problem.problem import Problem
from floatplan.tables import CLEARANCE

STILL = 1e-9  # [m/s] speed below which a point is at rest


def motion_into_ground(problem: Problem, angular_momentum: float) -> list[InputError]:
    """Return what moves into the ground at takeoff or landing, with this angular momentum, kg m^2/s."""
    return [*_moving_into_ground(problem, angular_momentum)] if problem.ground else []


def _moving_into_ground(problem: Problem, angular_momentum: float) -> Iterator[InputError]:
    given = MomentumSet(np.array([angular_momentum]), np.empty((1, 0)))
    rates, _ = end_rates(problem, given)(given.centre)
    start, goal = (
        replace(state, velocities=each) for state, each in zip((problem.initial, problem.final), rates, strict=True)
    )
    for name, state, instant, sign, direction in (
        ("start", start, 0.0, 1.0, "down into the ground at takeoff"),
        ("goal", goal, problem.flight.duration, -1.0, "up out of the ground at landing"),
    ):
        link, velocity = _slowest_contact(problem, state, instant, sign, angular_momentum)
        if velocity < -STILL:
            yield InputError(
                f"{link} moves {direction}, at {-velocity:.4g} m/s",
                element=f"{name}.velocities",
                advice="give other rates there, another angular momentum, posture or duration",
            )


def _slowest_contact(
    problem: Problem, state: JointState, instant: float, sign: float, angular_momentum: float
) -> tuple[str, float]:
    """Of the points on the ground the one that is slowest upwards, or downwards for sign -1: its link, m/s."""
    robot, path = problem.robot, ballistics(problem)
    tree, shapes = robot.tree, problem.ground_shapes
    rate = Dynamics(tree).base_rate(state.positions[None], state.velocities[None], angular_momentum)[0]
    rotations = tree.rotations(tree.absolute_angles(np.array(state.orientation), state.positions))
    swings = 1j * tree.turn * (rate + tree.turns @ state.velocities) * rotations
    bodies = np.array([shape.body for shape in shapes])
    com_height = path.positions(np.array([instant]))[0, 1]
    com_velocity = path.velocities(np.array([instant]))[0, 1]
    slowest, radius = ("", np.inf), np.array([shape.radius for shape in shapes])
    for end in ("start", "end"):
        weights = tree.point_weights(bodies, np.array([getattr(shape, end) for shape in shapes]))
        height = com_height + (weights @ rotations).imag - radius - problem.ground_plane.point[1]
        velocity = sign * (com_velocity + (weights @ swings).imag)
        for index in np.flatnonzero(np.abs(height) < CLEARANCE):
            slowest = min(slowest, (shapes[index].link, float(velocity[index])), key=lambda contact: contact[1])
    return slowest
