"""The flight of a jump: an ordinary problem whose both ends are those of the stances, planned by :func:`plan`."""

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from floatplan.jumps.contacts import Contact, ground_below, is_ground
from floatplan.jumps.limits import scaled_limits
from floatplan.jumps.program import LIFT, JumpProgram, Solution
from floatplan.planning.options import SearchOptions
from floatplan.planning.planner import planned
from floatplan.plans.plan import Plan
from floatplan.problem.parts import Flight, HalfPlane, Landing, Limits, Posture, Takeoff
from floatplan.problem.problem import Problem
from floatplan.robot.standing import Spot, corners, heights_over_com, undersides
from floatplan.tables import POINT_FEET

DEGREES = (7, 8, 10, 12)  # [-] of the polynomials, tried one after the other
PATIENCE = 1.6e7  # [instants of one body] with each of them at first, about a second
BEYOND_NODES = (1.0, 1.04, 1.12)  # [-] of the least largest share, in a flight whose joints are polynomials
HIGH = 0.8  # [-] of what a hop lifts its feet by at most, where it does so
KEPT = 0.6  # [-] of the same: what it keeps there
LIFTED = 0.03  # [m] above the ground is in the air for sure, also where the robot lands a little early


def _from_frame(program: JumpProgram, contact: Contact, y: np.ndarray) -> complex:
    """Place of a contact relative to its frame's origin, m."""
    robot = program.model.robot
    home = robot.frames[contact.frame]
    spots = [contact.spots[0], Spot(home.body, home.local)]
    place, origin = heights_over_com(robot, spots, y)
    return complex(place - origin)


def flight_problem(problem: Problem, program: JumpProgram, solution: Solution) -> Problem:
    """Return the problem of the flight between the stances of a solution.

    Joints, rates, accelerations, angular momentum and duration are pinned, so that the feet are at rest, in velocity
    and acceleration, at both ends, where no force acts.
    """
    index = program.flight
    first = program.starts[index]
    last = program.starts[index + 1]
    start, goal = (
        Posture(float(solution.y[0, node]), solution.y[1:, node].copy(), solution.v[1:, node], solution.a[1:, node])
        for node in (first, last)
    )
    before = program.phases[index - 1].anchor
    after = program.phases[index + 1].anchor
    lifted = problem.takeoff.position[1] - before.depth
    ground = lifted + _from_frame(program, before, solution.y[:, first]).imag
    height = ground + after.depth - _from_frame(program, after, solution.y[:, last]).imag
    model = program.model
    speed = model.function("speed", model.com_from(before.spots[0], 1))
    horizontal, _ = speed(solution.y[:, first], solution.v[:, first], solution.a[:, first])
    time = float(solution.durations[index])
    windows = [(each, each.window or (0.0, time)) for each in problem.obstacles]
    there = [each for each, (begin, end) in windows if begin < time and end > 0 and not is_ground(each, ground)]
    return replace(
        problem,
        start=start,
        goal=goal,
        flight=Flight(
            time,
            angular_momentum=solution.momentum,
            takeoff=Takeoff(before.frame, problem.takeoff.position),
            landing=Landing(after.frame, height=height),
            horizontal_velocity=float(horizontal),
            gravity=model.gravity,
        ),
        obstacles=(*there, *_grounds(problem, program, solution, ground)),
        ground=False,
        written=None,
    )


def _grounds(problem: Problem, program: JumpProgram, solution: Solution, ground: float) -> list[HalfPlane]:
    """Half-planes below the links' capsules, which are thicker than what stands: as deep as these are at both ends.

    Another is as high as the ground, as long as the program's capsules are well above it: so long its feet are lifted.
    """
    index = program.flight
    robot = problem.robot
    shares = program.phases[index].shares
    flown = solution.y[:, program.starts[index] : program.starts[index + 1] + 1]
    anchors = program.phases[index - 1].anchor, program.phases[index + 1].anchor
    before, after = (ground_below(robot, *each) for each in zip(anchors, flown[:, [0, -1]].T, strict=True))
    time = float(solution.durations[index])
    rise = problem.flight.gravity * time**2 / 2 * shares * (1 - shares) - (1 - shares) * before - shares * after
    heights = rise + undersides(robot, corners(robot.shapes), flown).min(axis=1)
    level = ground + min(0.0, *heights[[0, -1]]) - POINT_FEET
    lifted = np.flatnonzero(heights > np.clip(heights.max() / 2, POINT_FEET, LIFTED))
    found = [HalfPlane(point=(0.0, round(level, 4)))]
    if len(lifted) > 1:
        first, last = lifted[[0, -1]]
        level = ground + min(0.0, heights[first : last + 1].min() - POINT_FEET)
        found.append(HalfPlane(point=(0.0, round(level, 4)), window=(time * shares[first], time * shares[last])))
    if program.lift < LIFT:  # of so little, a good part is kept
        first, last = np.flatnonzero(heights >= HIGH * heights.max())[[0, -1]]
        window = time * shares[first], time * shares[last]
        found.append(HalfPlane(point=(0.0, round(ground + KEPT * heights.max(), 4)), window=window))
    return found


def tighter_limits(problem: Problem, program: JumpProgram, solution: Solution) -> list[Limits]:
    """Return limits of a flight that takes no larger share than the whole jump, where that share is least; then wider.

    The solution's factor is the largest share, of what the program's margins leave, at its nodes in flight too. Between
    them a polynomial may need a little more.
    """
    request = problem.jump
    if request is None or request.objective != "limits":
        return []
    velocity = program.node.bounds.velocity
    known = np.isfinite(problem.velocity_limits)
    rates = (velocity[known] / problem.velocity_limits[known]).tolist()
    shares = [program.node.bounds.held, *(rate / request.margin["velocity"] for rate in rates)]
    least = solution.factor * max(shares)
    levels = [least * beyond for beyond in BEYOND_NODES]
    return [
        scaled_limits(problem, level * request.margin["torque"], level * request.margin["velocity"])
        for level in levels
        if level * max(request.margin.values()) < 1
    ]


def planned_flight(problem: Problem, seed: int, tighter: Sequence[Limits] = ()) -> Plan:
    """Return the plan of a flight's problem: of a low degree where that does soon, else of higher ones.

    Limits that are ``tighter`` than the problem's are tried before these, one after the other.
    """
    tries = [*((limits, PATIENCE) for limits in tighter), (problem.limits, PATIENCE), (problem.limits, None)]
    for (limits, patience), degree in itertools.product(tries, DEGREES):
        motion = replace(problem.motion, degree=degree)
        asked = replace(problem, motion=motion, limits=limits, jump=None)
        found = planned(asked, SearchOptions(seed, patience=patience)).plan
        if found.ok:
            break
    return replace(found, problem=replace(found.problem, jump=problem.jump, limits=problem.limits))
