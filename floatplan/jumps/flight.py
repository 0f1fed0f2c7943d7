"""The flight of a jump: an ordinary problem whose both ends are those of the stances, planned by :func:`planned`
of ``planning/planner.py``.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.jumps.contacts import GroundContact, ground_below, is_ground
from floatplan.jumps.phases import grounds_below
from floatplan.jumps.program import JumpProgram
from floatplan.jumps.variables import FOOT_LIFT, JumpSolution
from floatplan.planning.options import SearchOptions
from floatplan.planning.planner import planned
from floatplan.plans.plan import Plan
from floatplan.problem.ground_step import GroundStep, edge_obstacles
from floatplan.problem.parts import Flight, HalfPlane, Landing, Limits, Obstacle, Posture, Takeoff
from floatplan.problem.problem import Problem
from floatplan.robot.standing import Spot, corners, positions_from_com, undersides
from floatplan.tables import POINT_FEET


def _from_frame(program: JumpProgram, contact: GroundContact, y: Array) -> complex:
    """Position of a contact relative to its frame's origin, m."""
    robot = program.model.robot
    home = robot.frames[contact.frame]
    point, origin = positions_from_com(robot, [contact.spots[0], Spot(home.body, home.local)], y)
    return complex(point - origin)


def flight_problem(problem: Problem, program: JumpProgram, solution: JumpSolution, flight_number: int = 0) -> Problem:
    """Return the problem of a flight, by its number, between the stances of a solution.

    Joints, rates, accelerations, angular momentum and duration are pinned, so that the feet do not move or accelerate
    at both ends, where no force acts.
    """
    index = program.flights[flight_number]
    takeoff = program.first_nodes[index]
    landing = program.first_nodes[index + 1]
    postures = []
    for node in (takeoff, landing):
        y = solution.y[:, node]
        postures.append(Posture(float(y[0]), y[1:].copy(), solution.v[1:, node], solution.a[1:, node]))
    before = program.phases[index - 1].anchor
    after = program.phases[index + 1].anchor
    rise = program.phases[index + 1].rise - program.phases[index - 1].rise
    anchor_height = problem.takeoff.position[1] + _from_frame(program, before, solution.y[:, takeoff]).imag
    ground = anchor_height - before.depth
    height = ground + rise + after.depth - _from_frame(program, after, solution.y[:, landing]).imag
    model = program.model
    com_speed = model.function("speed", model.com_from(before.spots[0], 1))
    horizontal, _ = com_speed(solution.y[:, takeoff], solution.v[:, takeoff], solution.a[:, takeoff])
    time = float(solution.durations[index])
    request = problem.jump
    assert request is not None
    edges = edge_obstacles(GroundStep.of(request, problem.takeoff.position, ground))
    return replace(
        problem,
        start=postures[0],
        goal=postures[1],
        flight=Flight(
            time,
            angular_momentum=float(solution.momenta[flight_number]),
            takeoff=Takeoff(before.frame, problem.takeoff.position),
            landing=Landing(after.frame, height=height),
            horizontal_velocity=float(horizontal),
            gravity=model.gravity,
        ),
        obstacles=(
            *obstacles_in((*problem.obstacles, *edges), time, ground),
            *_grounds(problem, program, solution, index, ground),
        ),
        ground=False,
        written=None,
    )


def obstacles_in(obstacles: Sequence[Obstacle], duration: float, ground: float) -> list[Obstacle]:
    """Those obstacles that exist at some time of a flight of so many seconds, but for the ground at a height, m."""
    existing = []
    for obstacle in obstacles:
        begin, end = obstacle.window or (0.0, duration)
        if begin < duration and end > 0 and not is_ground(obstacle, ground):
            existing.append(obstacle)
    return existing


def _grounds(
    problem: Problem, program: JumpProgram, solution: JumpSolution, index: int, ground: float
) -> list[HalfPlane]:
    """Half-planes below the links' capsules, which are thicker than what stands: as deep as these are at both ends.

    Another is as high as the ground, while the program's capsules are well above it: while its feet are lifted. Where
    it lands on other ground than it leaves, ``ground``, m, each of them counts as :func:`grounds_below` says.
    """
    robot = problem.robot
    progress = program.phases[index].progress
    y = solution.y[:, program.nodes_of(index)]
    before = ground_below(robot, program.phases[index - 1].anchor, y[:, 0])
    after = ground_below(robot, program.phases[index + 1].anchor, y[:, -1])
    time = float(solution.durations[index])
    rise = program.phases[index + 1].rise - program.phases[index - 1].rise
    arc = problem.flight.gravity * time**2 / 2 * progress * (1 - progress)
    com_rise = arc - (1 - progress) * before - progress * after
    grounds = grounds_below(progress, 0.0, rise)
    heights = com_rise + progress * rise - grounds + undersides(robot, corners(robot.shapes), y).min(axis=1)
    level = ground + min(0.0, rise) + min(0.0, *heights[[0, -1]]) - POINT_FEET
    half_planes = [HalfPlane(point=(0.0, round(level, 4)))]
    clearly = 0.03  # [m] above the ground is in the air for sure, also where the robot lands a little early
    in_the_air = heights > np.clip(heights.max() / 2, POINT_FEET, clearly)
    for below in np.unique(grounds):
        lifted = np.flatnonzero(in_the_air & (grounds == below))
        if len(lifted) > 1:
            first, last = lifted[[0, -1]]
            level = ground + below + min(0.0, heights[first : last + 1].min() - POINT_FEET)
            window = (time * progress[first], time * progress[last])
            half_planes.append(HalfPlane(point=(0.0, round(level, 4)), window=window))
    if program.lift < FOOT_LIFT and not rise:
        # A low hop never counts as in the air: where its lowest point is above 0.8 of its peak, the flight has to be
        # above 0.6 of it.
        first, last = np.flatnonzero(heights >= 0.8 * heights.max())[[0, -1]]
        window = (time * progress[first], time * progress[last])
        half_planes.append(HalfPlane(point=(0.0, round(ground + 0.6 * heights.max(), 4)), window=window))
    return half_planes


def tighter_limits(problem: Problem, program: JumpProgram, solution: JumpSolution) -> list[Limits]:
    """Return limits of a flight that takes no larger share than the whole jump, where that share counts; then wider.

    The solution's factor is the largest share, of what the program's margins leave, at its nodes in flight too. Between
    them a polynomial may need a little more.
    """
    request = problem.jump
    if request is None or request.objective != "limits":
        return []
    velocity = program.node_rows.limits.velocity
    limited = np.isfinite(problem.velocity_limits)
    rate_shares = (velocity[limited] / problem.velocity_limits[limited]).tolist()
    shares = [program.node_rows.limits.torque_margin, *(share / request.margin["velocity"] for share in rate_shares)]
    least = solution.factor * max(shares)
    tighter = []
    for beyond in (1.0, 1.04, 1.12):  # times the least share, for joints that are polynomials
        level = least * beyond
        if level * max(request.margin.values()) < 1:
            scaled = scaled_limits(problem, level * request.margin["torque"], level * request.margin["velocity"])
            tighter.append(scaled)
    return tighter


def planned_flight(problem: Problem, seed: int, tighter: Sequence[Limits] = (), joints: Array | None = None) -> Plan:
    """Return the plan of a flight's problem: of a low degree where that is quick, else of higher ones.

    Limits that are ``tighter`` than the problem's are tried before these, one after the other. With a motion of the
    ``joints`` at even times (2, n, N), rad and rad/s, higher degrees begin with it, once: of fast twists, and past
    edges, no other start may lead to a plan.
    """
    patience = 1.6e7  # [instants of one body] with each degree at first, about a second
    tries = [*((limits, patience) for limits in tighter), (problem.limits, patience), (problem.limits, None)]
    plan: Plan | None = None
    for (limits, work), degree in itertools.product(tries, (7, 8, 10, 12)):  # of the polynomials
        motion = replace(problem.motion, degree=degree)
        variant = replace(problem, motion=motion, limits=limits, jump=None)
        options = SearchOptions(seed, patience=work)
        near = None
        if plan is not None and joints is not None and degree > 7 and work is not None:
            near = _moving_nearly_as(plan, joints, degree)
        plan = planned(variant, options, near).plan
        if plan.ok:
            break
    assert plan is not None
    return replace(plan, problem=replace(plan.problem, jump=problem.jump, limits=problem.limits))


def _moving_nearly_as(plan: Plan, joints: Array, degree: int) -> Plan:
    """The plan with polynomials of a degree next to a motion of the joints at even times (2, n, N)."""
    centre = plan.centre[:, None]
    amplitude = plan.amplitude[:, None]
    inside = 1 - 1e-6  # [-] of the joints' ranges
    positions, rates = joints
    p = np.arcsin(np.clip((positions - centre) / amplitude, -inside, inside))
    p_rates = plan.duration * rates / (amplitude * np.cos(p))
    progress = np.linspace(0.0, 1.0, positions.shape[1])
    powers = np.arange(degree + 1)
    rows = progress[:, None] ** powers
    rate_rows = powers * progress[:, None] ** np.maximum(powers - 1, 0)
    heavy = 10.0  # [-] weight of both ends, which the problem fixes, over that of what is between
    weights = np.ones((len(progress), 1))
    weights[[0, -1]] = heavy
    left = np.vstack((weights * rows, 0.1 * weights * rate_rows))
    right = np.vstack((weights * p.T, 0.1 * weights * p_rates.T))
    of_share = np.linalg.lstsq(left, right, rcond=None)[0].T
    return replace(plan, coefficients=of_share / plan.duration**powers)


def scaled_limits(problem: Problem, torque: float = 1.0, velocity: float = 1.0) -> Limits:
    """Return a problem's limits, those of torques with torque-speed curves and those of rates times factors."""
    limits = problem.limits
    robot = problem.robot
    curves = {name: replace(curve, stall=torque * curve.stall) for name, curve in limits.motor.items()}
    return replace(
        limits,
        motor=curves,
        torque=_times(torque, limits.torque, robot.motors, robot.motor_torque_limits),
        velocity=_times(velocity, limits.velocity, robot.motors, robot.motor_velocity_limits),
    )


def _times(factor: float, limits: Any, motors: tuple[str, ...], of_file: Array) -> Any:
    """Limits, as a problem has them, times a factor; ``of_file`` are those of the robot's file, by motor."""
    if isinstance(limits, str) and limits == "urdf":
        limits = {}
        for name, most in zip(motors, of_file.tolist(), strict=True):
            if math.isfinite(most):
                limits[name] = most
        limits = limits or "none"
    if isinstance(limits, Mapping):
        return {name: factor * most for name, most in limits.items()}
    return limits if isinstance(limits, str) else (factor * np.asarray(limits)).tolist()
