"""Flights afloat, without gravity and angular momentum: from rest to rest, the base turned by the joints alone."""

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.initial.apart import kept_apart
from floatplan.initial.robots import ChosenRobot
from floatplan.motion.flight import tree_dynamics
from floatplan.planning.options import SearchOptions
from floatplan.planning.planner import planned
from floatplan.planning.repair import proved_plan
from floatplan.plans.measures import PlanWarning
from floatplan.plans.plan import Plan
from floatplan.problem.parts import Flight, Limits, Motion, Posture
from floatplan.problem.problem import Problem
from floatplan.problem.resolution import position_limits
from floatplan.robot.wheels import wheels

FAST = math.radians(2000)  # [rad/s] that no joint of a legged robot turns at, whatever its URDF says
SPUN = 10 * math.tau  # [rad] that a wheel may turn either way
MOTION = Motion(degree="auto", objective="acceleration")
SWINGS = (1.0, 0.6, 0.3)  # [-] of half a joint's range
WIDEST_SWING = math.radians(60)  # [rad]
UNHURRIED = 3.0  # [-] times the duration at the velocity limits
SLOWER = (1.0, 2.0, 4.0)  # [-] of that duration
SHORTEST = 1.0  # [s]
NODES = 40  # [-] of the turn that straight swings make
DIRECTIONS = 512  # [-] of the joints, compared
INSIDE = 0.05  # [-] of a joint's range, kept free at its ends
PATIENCE = 8e6  # [instants of one body] with one of them, until a motion is found
CORRECTIONS = 2  # [-] with lower accelerations, where a locked joint cannot be held
CALMER = 0.8  # [-] of the acceleration that would just do


def limits_of(chosen: ChosenRobot) -> Limits:
    """Return the URDF's limits; where it gives no velocities, what is fast; of wheels a range of many turns."""
    robot = chosen.robot
    spun = {name: (-SPUN, SPUN) for name in wheels(robot) if name in robot.joints}
    return Limits(
        position=spun or "urdf",
        velocity="urdf" if np.isfinite(robot.motor_velocity_limits).any() else FAST,
        torque="urdf" if np.isfinite(robot.motor_torque_limits).any() else "none",
    )


def turns_afloat(chosen: ChosenRobot, asked: float | None = None) -> Iterator[Problem]:
    """Yield problems without gravity and angular momentum, from rest to rest: smaller and slower ones later.

    Of the directions in which the joints may swing they take those that turn the base farthest. All last as long as
    asked, s, where that is given.
    """
    robot = chosen.robot
    limits = limits_of(chosen)
    low, high = position_limits(robot, limits).T
    width = high - low
    start = np.clip(robot.resting, low + INSIDE * width, high - INSIDE * width)
    start = np.deg2rad(np.round(np.rad2deg(start)))
    rates = np.minimum(robot.velocity_limits, FAST)
    directions = _directions(len(robot.joints))
    widest = np.where(high - low < SPUN, WIDEST_SWING, SPUN)
    room = np.minimum(np.where(directions > 0, high - start, start - low) / 2, widest)
    turns = _turns(chosen, start, start + directions * room)
    best = int(np.abs(turns).argmax())
    for swing, slower in product(SWINGS, SLOWER if asked is None else (1.0,)):
        goal = np.deg2rad(np.round(np.rad2deg(start + swing * (directions * room)[best])))
        unhurried = round(max(UNHURRIED * float((np.abs(goal - start) / rates).max()), SHORTEST) * slower, 1)
        turn = float(_turns(chosen, start, goal[None])[0])
        if len(robot.joints) > 1:
            turn = math.radians(round(math.degrees(turn)))
        yield Problem(
            robot,
            Posture(0.0, start),
            Posture(turn, goal),
            Flight(unhurried if asked is None else asked, angular_momentum=0.0, gravity=0.0),
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


def planned_afloat(problem: Problem) -> tuple[tuple[Problem, Plan] | None, float]:
    """Return a problem with its proved plan without warnings, and what that took, instants of one body.

    It is the plan that ``floatplan plan`` finds, given up where that takes long. Where only a locked joint cannot be
    held, it is one that moves more calmly; where links overlap, one that keeps them apart, or else it has that warning.
    """
    work = 0.0
    overlapping: tuple[Problem, Plan] | None = None
    for _ in range(1 + CORRECTIONS):
        try:
            found = planned(problem, SearchOptions(patience=PATIENCE))
        except InputError:
            break
        work += found.work
        proved = proved_plan(found)
        if found.gave_up or not proved.ok or proved.certificate is None or not proved.certificate.proved:
            break
        kinds = {warning.kind for warning in warnings_in_plane(proved)}
        if not kinds:
            return (problem, proved), work
        if kinds == {"overlap"}:
            overlapping = overlapping or (problem, proved)
        try:
            other = _apart(problem, proved) if "overlap" in kinds else _calmer(problem, proved)
        except InputError:  # an end is outside a narrower range, or its links are as near
            break
        if other is None:
            break
        problem = other
    return overlapping, work


def _apart(problem: Problem, plan: Plan) -> Problem | None:
    """The problem with links kept apart that a plan's motion brings into one another; None where nothing is left."""
    return kept_apart(problem, lambda times: plan.joint_motion(times)[0], plan.duration)


def warnings_in_plane(plan: Plan) -> list[PlanWarning]:
    """Warnings of a plan but for that of the plane that the robot leaves, which another flight in it does not cure."""
    return [warning for warning in plan.warnings if warning.kind != "leak"]


def _calmer(problem: Problem, plan: Plan) -> Problem | None:
    """The problem with accelerations low enough for locked joints to hold; None where other warnings remain."""
    warnings = warnings_in_plane(plan)
    shares = [w.limit / w.value for w in warnings if w.kind == "holding_torque" and w.value and w.limit]
    if len(shares) < len(warnings):
        return None
    acceleration = CALMER * min(shares) * float(plan.peaks.joints["acceleration"].max())
    rounded = math.radians(float(f"{math.degrees(acceleration):.2g}"))
    return replace(problem, limits=replace(problem.limits, acceleration=rounded))
