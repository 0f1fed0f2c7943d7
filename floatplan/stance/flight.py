"""The flight of a jump: an ordinary problem whose both ends are those of the stances, planned by :func:`plan`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from floatplan.planning.planner import plan
from floatplan.plans.plan import Plan
from floatplan.problem.parts import Flight, HalfPlane, Landing, Posture, Takeoff
from floatplan.problem.problem import Problem
from floatplan.stance.contacts import Contact, corners, ground_below, heights_over_com, undersides
from floatplan.stance.model import Spot
from floatplan.stance.program import JumpProgram, Solution
from floatplan.tables import POINT_FEET

DEGREES = (7, 8, 10, 12)  # [-] of the polynomials, tried one after the other


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
    first, last = program.starts[index], program.starts[index + 1]
    start, goal = (
        Posture(float(solution.y[0, node]), solution.y[1:, node].copy(), solution.v[1:, node], solution.a[1:, node])
        for node in (first, last)
    )
    before, after = program.phases[index - 1].anchor, program.phases[index + 1].anchor
    lifted = problem.takeoff.position[1] - before.depth
    ground = lifted + _from_frame(program, before, solution.y[:, first]).imag
    height = ground + after.depth - _from_frame(program, after, solution.y[:, last]).imag
    model = program.model
    speed = model.function("speed", model.com_from(before.spots[0], 1))
    horizontal, _ = speed(solution.y[:, first], solution.v[:, first], solution.a[:, first])
    time = float(solution.durations[index])
    windows = [(each, each.window or (0.0, time)) for each in problem.obstacles]
    there = [each for each, (begin, end) in windows if begin < time and end > 0]
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
        obstacles=(*there, _ground(problem, program, solution, ground)),
        ground=False,
        written=None,
    )


def _ground(problem: Problem, program: JumpProgram, solution: Solution, ground: float) -> HalfPlane:
    """The half-plane below the links' capsules at both ends, which are thicker than what stands."""
    index, depth, robot = program.flight, 0.0, problem.robot
    for side, node in ((index - 1, program.starts[index]), (index + 1, program.starts[index + 1])):
        anchor = program.phases[side].anchor
        y = solution.y[:, node]
        lowest = undersides(robot, corners(robot.shapes), y).min()
        depth = max(depth, ground_below(robot, anchor, y) - float(lowest))
    return HalfPlane(point=(0.0, round(ground - depth - POINT_FEET, 4)))


def planned_flight(problem: Problem, seed: int) -> Plan:
    """Return the plan of a flight's problem: of a low degree where that does, else of higher ones."""
    for degree in DEGREES:
        found = plan(replace(problem, motion=replace(problem.motion, degree=degree), jump=None), seed=seed)
        if found.ok:
            break
    return replace(found, problem=replace(found.problem, jump=problem.jump))
