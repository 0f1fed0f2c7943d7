"""Flights from a foot at rest to a hand at rest, drawn around a motion that makes them: seeds fixed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import count

import numpy as np
import pinocchio as pin
from generated_problems import random_chain
from sampled_flight import sample_nodes, trajectory

import floatplan as fp
from floatplan.motion.flight import flight_of
from floatplan.motion.planar.closed_form import frame_from_com
from floatplan.motion.planar.contact_rates import equations_at, rates_at
from floatplan.motion.planar.flight import gauss_grid
from floatplan.planning.variables import decision_variables

FASTEST = 12.0  # [rad/s] of joints at takeoff and landing: motions drawn with faster ones are left out
DENSE = 192  # nodes
ROUNDS = 40  # of the goal's orientation, which settles the rates that it follows from
SETTLED = 1e-11  # rad
RELAXED = 0.5  # [-] of each correction


def rest_problems() -> Iterator[fp.Problem]:
    """Yield problems without end; every third one with h free."""
    found = 0
    for seed in count():
        problem = rest_problem(seed)
        if problem is not None:
            found += 1
            yield (
                replace(problem, flight=replace(problem.flight, angular_momentum="free")) if found % 3 == 0 else problem
            )


def rest_problem(seed: int) -> fp.Problem | None:
    """Draw a chain of 3 to 6 joints and a motion with the foot at rest at takeoff, the hand at landing.

    None where the motion that is drawn is too fast, or its end does not settle.
    """
    rng = np.random.default_rng([seed, 2026])
    joints = int(rng.integers(3, 7))
    robot = random_chain(rng, joints)
    positions = rng.uniform(-0.8 * np.pi, 0.8 * np.pi, (2, joints))
    orientation, turn = rng.uniform(-np.pi, np.pi), rng.uniform(-4.0, 4.0)
    duration = float(rng.uniform(0.6, 1.2))
    com_velocity = np.array([rng.uniform(-1, 1), 9.81 * duration / 2 + rng.uniform(-1, 1)])
    momentum = float(rng.uniform(-6.0, 6.0))
    unlimited = np.full(joints, np.inf)
    z = rng.uniform(0.05, 0.4) * rng.normal(size=(joints, 2))

    def rates(frame: str, at: float, posture: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        return rates_at(
            robot, equations_at(robot, robot.frames[frame], at, posture, velocity), unlimited, momentum
        ).rates

    takeoff = rates("foot", float(orientation), positions[0], com_velocity)
    if not np.abs(takeoff).max() < FASTEST:
        return None
    problem = fp.Problem(
        robot,
        fp.Posture(float(orientation), positions[0], takeoff),
        fp.Posture(float(orientation + turn), positions[1]),
        fp.Flight(
            duration, momentum, fp.Takeoff("foot"), fp.Landing("hand", 0.0), horizontal_velocity=float(com_velocity[0])
        ),
        name=f"rest_{seed}",
    )
    down = com_velocity - [0.0, 9.81 * duration]
    for _ in range(ROUNDS):
        landing = rates("hand", problem.final.orientation, positions[1], down)
        if not np.abs(landing).max() < FASTEST:
            return None
        problem = replace(problem, goal=replace(problem.goal, velocities=landing))
        missed = _missed(problem, z)
        goal = replace(
            problem.goal, orientation=problem.goal.angle + (missed if abs(missed) < SETTLED else RELAXED * missed)
        )
        problem = replace(problem, goal=goal)
        if abs(missed) < SETTLED:
            return _asked(problem, float(com_velocity[1]))
    return None


def _missed(problem: fp.Problem, z: np.ndarray) -> float:
    """By how much the drawn motion turns further than to the goal, rad."""
    branches = np.zeros((2, len(problem.robot.joints)), dtype=np.int64)
    variables = decision_variables(problem, problem.degrees, branches, flight_of(problem).momentum_set)
    nodes = sample_nodes(gauss_grid(DENSE), variables.polynomials.form)
    motion = trajectory(flight_of(problem), variables, nodes, variables.variables(z, variables.momentum.centre))
    return float(motion.residual.item())


def _asked(problem: fp.Problem, rise: float) -> fp.Problem:
    """The problem whose rates follow, landing at the height that the CM's first velocity leads to."""
    flight, robot = problem.flight, problem.robot
    places = [
        frame_from_com(robot, frame, state).imag
        for frame, state in ((problem.takeoff_frame, problem.initial), (problem.landing_frame, problem.final))
    ]
    height = rise * flight.duration - flight.gravity * flight.duration**2 / 2 + places[1] - places[0]
    return replace(
        problem,
        start=replace(problem.start, velocities="takeoff"),
        goal=replace(problem.goal, velocities="landing"),
        flight=replace(flight, landing=fp.Landing("hand", float(height))),
    )


def frame_speeds(plan: fp.Plan) -> np.ndarray:
    """Speeds (2,) of the takeoff frame at takeoff and of the landing frame at landing, m/s, by Pinocchio."""
    problem, robot = plan.problem, plan.robot
    model, data = robot.model, robot.model.createData()
    kinds = (pin.FrameType.BODY, pin.FrameType.FIXED_JOINT)
    axes = np.stack((robot.plane.horizontal, robot.plane.vertical))
    speeds = []
    for instant, name in ((0.0, problem.takeoff.frame), (plan.duration, problem.landing.frame)):
        state = plan.at(instant)
        positions = robot.reference + robot.selection @ state.positions
        rates = robot.selection @ state.velocities
        positions[2], rates[2] = state.orientation, state.orientation_rate
        pin.centerOfMass(model, data, positions, rates)
        com = state.com_velocity - axes @ data.vcom[0]
        pin.forwardKinematics(model, data, positions, rates)
        pin.updateFramePlacements(model, data)
        frame = next(model.getFrameId(name, kind) for kind in kinds if model.existFrame(name, kind))
        moved = pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED).linear
        speeds.append(float(np.linalg.norm(axes @ moved + com)))
    return np.array(speeds)
