"""Flights afloat, without gravity and angular momentum: between motionless postures, the base rotated by the joints."""

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.initial.robots import ChosenRobot
from floatplan.initial.separation import separated
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

FAST = math.radians(2000)  # [rad/s] beyond the rates of legged robots, whatever the URDF says
WHEEL_RANGE = 10 * math.tau  # [rad] of a wheel, either way


def limits_of(chosen: ChosenRobot) -> Limits:
    """Return the URDF's limits; where it has no velocities, what is fast; of wheels a range of many turns."""
    robot = chosen.robot
    driven = [name for name in wheels(robot) if name in robot.joints]
    ranges = dict.fromkeys(driven, (-WHEEL_RANGE, WHEEL_RANGE))
    return Limits(
        position=ranges or "urdf",
        velocity="urdf" if np.isfinite(robot.motor_velocity_limits).any() else FAST,
        torque="urdf" if np.isfinite(robot.motor_torque_limits).any() else "none",
    )


def problems_afloat(chosen: ChosenRobot, duration: float | None = None) -> Iterator[Problem]:
    """Yield problems without gravity and angular momentum, between motionless postures: smaller and slower ones later.

    Of the directions in which the joints may move they take those that rotate the base farthest. All have the same
    duration, s, where that is set.
    """
    robot = chosen.robot
    limits = limits_of(chosen)
    low, high = position_limits(robot, limits).T
    margin = 0.05 * (high - low)  # of the start from the ends of joint ranges
    start = np.clip(robot.resting, low + margin, high - margin)
    start = np.deg2rad(np.round(np.rad2deg(start)))
    rates = np.minimum(robot.velocity_limits, FAST)
    directions = _directions(len(robot.joints))
    widest = np.where(high - low < WHEEL_RANGE, math.radians(60), WHEEL_RANGE)
    half_ranges = np.where(directions > 0, high - start, start - low) / 2
    changes = directions * np.minimum(half_ranges, widest)
    best = int(np.abs(_rotations(chosen, start, start + changes)).argmax())
    slower_factors = (1.0, 2.0, 4.0) if duration is None else (1.0,)
    for share, slower in product((1.0, 0.6, 0.3), slower_factors):
        goal = np.deg2rad(np.round(np.rad2deg(start + share * changes[best])))
        at_limits = float((np.abs(goal - start) / rates).max())  # s
        unhurried = round(max(3.0 * at_limits, 1.0) * slower, 1)
        rotation = float(_rotations(chosen, start, goal[None])[0])
        if len(robot.joints) > 1:
            rotation = math.radians(round(math.degrees(rotation)))
        yield Problem(
            robot,
            Posture(0.0, start),
            Posture(rotation, goal),
            Flight(unhurried if duration is None else duration, angular_momentum=0.0, gravity=0.0),
            Motion(degree="auto", objective="acceleration"),
            limits,
            name=robot.name,
        )


def _directions(joints: int) -> Array:
    """Signs (K, n), the first all positive: every one of a few joints, seeded ones of many."""
    most = 512  # that are compared
    if 2**joints <= most:
        return np.array(list(product((1.0, -1.0), repeat=joints)))
    random = np.random.default_rng(0).choice((1.0, -1.0), (most - 1, joints))
    return np.concatenate((np.ones((1, joints)), random))


def _rotations(chosen: ChosenRobot, start: Array, goals: Array) -> Array:
    """Changes of the orientation (K,), rad, by straight motions of the joints from a posture (n,) to others (K, n)."""
    count = 40  # nodes of the quadrature
    nodes, weights = np.polynomial.legendre.leggauss(count)
    shares = (nodes + 1) / 2
    changes = goals - start
    positions = start + shares[:, None, None] * changes
    rows = tree_dynamics(chosen.robot.tree).momentum_map(positions.reshape(-1, len(start)))
    rows = rows.reshape(count, len(goals), -1)
    rates = (rows[:, :, 1:] * changes).sum(axis=2) / rows[:, :, 0]
    return np.asarray(-(weights @ rates) / 2)


def planned_afloat(problem: Problem) -> tuple[tuple[Problem, Plan] | None, float]:
    """Return a problem with its proved plan without warnings, and the work of the search, instants of one body.

    It is the plan that ``floatplan plan`` makes, abandoned where that takes long. Where only a locked joint bears too
    much, it is one that moves more calmly; where links overlap, one that separates them, or else it has that warning.
    """
    work = 0.0
    overlapping: tuple[Problem, Plan] | None = None
    for _ in range(3):  # plans: the first, then with lower accelerations or separated links
        try:
            result = planned(problem, SearchOptions(patience=8e6))  # 8e6 instants of one body take about 1.3 s
        except InputError:
            break
        work += result.work
        plan = proved_plan(result)
        if result.gave_up or not plan.ok or plan.certificate is None or not plan.certificate.proved:
            break
        kinds = {warning.kind for warning in warnings_in_plane(plan)}
        if not kinds:
            return (problem, plan), work
        if kinds == {"overlap"}:
            overlapping = overlapping or (problem, plan)
        try:
            other = _separated(problem, plan) if "overlap" in kinds else _calmer(problem, plan)
        except InputError:  # an end is outside a narrower range, or its links are as near
            break
        if other is None:
            break
        problem = other
    return overlapping, work


def _separated(problem: Problem, plan: Plan) -> Problem | None:
    """The problem with limits that separate the links which overlap in a plan; None where no limit helps."""
    return separated(problem, lambda times: plan.joint_motion(times)[0], plan.duration)


def warnings_in_plane(plan: Plan) -> list[PlanWarning]:
    """Warnings of a plan but for that of the plane that the robot leaves, which another flight in it does not cure."""
    return [warning for warning in plan.warnings if warning.kind != "leak"]


def _calmer(problem: Problem, plan: Plan) -> Problem | None:
    """The problem with accelerations low enough for locked joints to hold; None where other warnings remain."""
    shares = []
    for warning in warnings_in_plane(plan):
        if warning.kind != "holding_torque" or not warning.value or not warning.limit:
            return None
        shares.append(warning.limit / warning.value)
    calmer = 0.8  # of the acceleration that would just do
    acceleration = calmer * min(shares) * float(plan.peaks.joints["acceleration"].max())
    rounded = math.radians(float(f"{math.degrees(acceleration):.2g}"))
    return replace(problem, limits=replace(problem.limits, acceleration=rounded))
