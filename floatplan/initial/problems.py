"""Problems of first flights: of candidates that can begin and end, and turns afloat where no leap fits."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product

import numpy as np

from floatplan.arrays import Array
from floatplan.initial.candidates import DIGITS, Candidates
from floatplan.initial.robots import ChosenRobot
from floatplan.initial.stance import FAST
from floatplan.motion.planar.closed_form import tree_dynamics
from floatplan.problem.parts import Flight, Landing, Limits, Motion, Posture, Takeoff
from floatplan.problem.problem import Problem
from floatplan.problem.resolution import position_limits

MOTION = Motion(degree="auto", objective="acceleration")
SWINGS = (1.0, 0.6, 0.3)  # [-] of half a joint's range
WIDEST_SWING = math.radians(60)  # [rad]
UNHURRIED = 3.0  # [-] times the duration at the velocity limits
SLOWER = (1.0, 2.0, 4.0)  # [-] of that duration
SHORTEST = 1.0  # [s]
NODES = 40  # [-] of the turn that straight swings make
DIRECTIONS = 512  # [-] of the joints, compared
INSIDE = 0.05  # [-] of a joint's range, kept free at its ends


def problem_of(chosen: ChosenRobot, frame: str, candidate: Candidates) -> Problem:
    """Return the problem whose motion makes a flight of a single candidate, on a frame."""
    begin, end = candidate.orientations.tolist()
    return Problem(
        chosen.robot,
        Posture(begin, candidate.positions[0], "takeoff", "free"),
        Posture(end, candidate.positions[1], "landing", "free"),
        Flight(
            float(candidate.duration),
            angular_momentum=float(f"{candidate.angular_momentum:.{DIGITS}g}"),
            takeoff=Takeoff(frame),
            landing=Landing(frame),
            horizontal_velocity=float(candidate.horizontal_velocity),
        ),
        MOTION,
        limits_of(chosen),
        name=chosen.robot.name,
        ground=True,
    )


def limits_of(chosen: ChosenRobot) -> Limits:
    """Return the URDF's limits; where it gives no velocities, what is fast."""
    robot = chosen.robot
    known = np.isfinite(robot.motor_velocity_limits).any()
    return Limits(
        velocity="urdf" if known else FAST, torque="urdf" if np.isfinite(robot.motor_torque_limits).any() else "none"
    )


def turns_afloat(chosen: ChosenRobot) -> Iterator[Problem]:
    """Yield problems without gravity and angular momentum, from rest to rest: smaller and slower ones later.

    Of the directions in which the joints may swing they take those that turn the base farthest.
    """
    robot = chosen.robot
    limits = limits_of(chosen)
    low, high = position_limits(robot, limits).T
    width = high - low
    start = np.clip(robot.resting, low + INSIDE * width, high - INSIDE * width)
    start = np.deg2rad(np.round(np.rad2deg(start)))
    rates = np.minimum(robot.velocity_limits, FAST)
    directions = _directions(len(robot.joints))
    room = np.minimum(np.where(directions > 0, high - start, start - low) / 2, WIDEST_SWING)
    turns = _turns(chosen, start, start + directions * room)
    best = int(np.abs(turns).argmax())
    for swing, slower in product(SWINGS, SLOWER):
        goal = np.deg2rad(np.round(np.rad2deg(start + swing * (directions * room)[best])))
        duration = round(max(UNHURRIED * float((np.abs(goal - start) / rates).max()), SHORTEST) * slower, 1)
        turn = float(_turns(chosen, start, goal[None])[0])
        if len(robot.joints) > 1:
            turn = math.radians(round(math.degrees(turn)))
        yield Problem(
            robot,
            Posture(0.0, start),
            Posture(turn, goal),
            Flight(duration, angular_momentum=0.0, gravity=0.0),
            MOTION,
            limits,
            name=robot.name,
        )


def _directions(joints: int) -> Array:
    """Signs (K, n), the first all positive: every one of a few joints, seeded ones of many."""
    if 2**joints <= DIRECTIONS:
        return np.array(list(product((1.0, -1.0), repeat=joints)))
    drawn = np.random.default_rng(0).choice((1.0, -1.0), (DIRECTIONS - 1, joints))
    return np.concatenate((np.ones((1, joints)), drawn))


def _turns(chosen: ChosenRobot, start: Array, goals: Array) -> Array:
    """What straight swings from a posture (n,) to others (K, n) make of the orientation (K,), rad."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    shares = (nodes + 1) / 2
    ways = goals - start
    positions = start + shares[:, None, None] * ways
    rows = tree_dynamics(chosen.robot.tree).momentum_map(positions.reshape(-1, len(start)))
    rows = rows.reshape(NODES, len(goals), -1)
    rates = (rows[:, :, 1:] * ways).sum(axis=2) / rows[:, :, 0]
    return np.asarray(-(weights @ rates) / 2)
