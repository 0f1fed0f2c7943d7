"""Problems that are known to have a solution: a motion is drawn first, and the problem is built around it.

The end of the motion is the goal; obstacles stand where the motion passes clear by 3 to 10 mm and where the plan made
without them collides; limits are 3 % above what the motion needs. The planner has no excuse.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from generated_problems import random_chain
from sampled_flight import PlanarBaseMotion, Trajectory, sample_nodes, trajectory

import floatplan as fp
from floatplan.motion.flight import flight_of
from floatplan.motion.planar.flight import gauss_grid
from floatplan.planning.variables import DecisionVariables, decision_variables
from floatplan.problem.parts import Obstacle

GRADES = ("easy", "medium", "hard")
DENSE = 192  # instants at which the drawn motion is looked at
HEADROOM = 1.03
CLEARANCE = (0.003, 0.010)  # m
RADII = (0.02, 0.35)  # m
DEEP_ENOUGH = 0.01  # m, by which the plan made without an obstacle must hit it


@dataclass(frozen=True)
class Drawn:
    """A problem without constraints and a motion that solves it, at ``DENSE`` instants."""

    problem: fp.Problem
    motion: Trajectory


def forward_problem(seed: int, grade: str) -> fp.Problem | None:
    """Return a feasible problem of a grade, or None where the draw leaves nothing to avoid.

    Every third is about limits: torques; torques and rates; these and the orientation rate. The others are about one,
    two or three obstacles.
    """
    difficulty = GRADES.index(grade)
    rng = np.random.default_rng([seed, difficulty])
    drawn = draw(rng, joints=int(rng.integers(2, 6)))
    guess = fp.plan(drawn.problem)
    if not guess.ok:
        return None
    name = f"forward_{grade}_{seed}"
    if rng.random() < 1 / 3:
        limits = _limits_just_above(drawn, difficulty)
        return replace(drawn.problem, limits=limits, name=name) if _exceeds(guess, limits) else None
    drawn_obstacles = [obstacle_between(rng, drawn, guess) for _ in range(difficulty + 1)]
    obstacles = tuple(obstacle for obstacle in drawn_obstacles if obstacle is not None)
    return replace(drawn.problem, obstacles=obstacles, name=name) if len(obstacles) > difficulty else None


def forward_problems(count: int) -> list[fp.Problem]:
    """Return ``count`` problems, the three grades in turn."""
    problems: list[fp.Problem] = []
    seed = 0
    while len(problems) < count:
        problem = forward_problem(seed, GRADES[len(problems) % len(GRADES)])
        if problem is not None:
            problems.append(problem)
        seed += 1
    return problems


def draw(rng: np.random.Generator, joints: int, share: float = 0.0) -> Drawn:
    """Draw a chain and a motion; its h lies ``share`` of the half-width of a random (9) from the middle."""
    robot = random_chain(rng, joints)
    postures = rng.uniform(-0.8 * np.pi, 0.8 * np.pi, (2, joints))
    turn = float(rng.uniform(-2.5, 2.5))
    problem = fp.Problem(
        robot=robot,
        start=fp.Posture(float(rng.uniform(-np.pi, np.pi)), postures[0]),
        goal=fp.Posture(turn, postures[1]),
        flight=fp.Flight(duration=float(rng.uniform(0.8, 1.6)), horizontal_velocity=float(rng.uniform(-1, 2))),
    )
    low, high = problem.momentum_interval
    momentum = float((low + high) / 2 + share * (high - low) / 2)
    flight = replace(problem.flight, angular_momentum=momentum)
    problem = replace(problem, flight=flight)
    dynamics = flight_of(problem)
    branches = np.zeros((2, joints), dtype=np.int64)
    variables = decision_variables(problem, problem.degrees, branches, flight_of(problem).momentum_set)
    polynomials = variables.polynomials
    x = variables.variables(rng.uniform(0.05, 0.4) * rng.normal(size=polynomials.nominal_coefficients.shape), momentum)
    motion = _look(dynamics, variables, x)
    goal = fp.Posture(problem.final.orientation + motion.residual.item(), postures[1])
    problem = replace(problem, goal=goal)
    return Drawn(problem, _look(flight_of(problem), variables, x))


def _look(flight: Any, variables: DecisionVariables, x: np.ndarray) -> Trajectory:
    return trajectory(flight, variables, sample_nodes(gauss_grid(DENSE), variables.polynomials.form), x)


def _segment_distances(motion: Trajectory, point: complex) -> np.ndarray:
    assert isinstance(motion.flown, PlanarBaseMotion), "flights of the benchmark are in a plane"
    segments = motion.flown.shapes
    along = segments.end - segments.start
    share = np.clip((along.conj() * (point - segments.start)).real / np.maximum(np.abs(along) ** 2, 1e-300), 0, 1)
    return np.abs(segments.start + share * along - point)


def obstacle_between(rng: np.random.Generator, drawn: Drawn, guess: fp.Plan) -> Obstacle | None:
    """Return a circle that the drawn motion clears and the guess hits, somewhere on the guess's links."""
    instants = drawn.motion.duration * drawn.motion.sampling.grid.s
    placed = _placed(guess, instants)
    for _ in range(60):
        k, s = int(rng.integers(8, len(instants) - 8)), int(rng.integers(placed.shape[1]))
        share = rng.uniform()
        point = complex((1 - share) * placed[k, s, 0] + share * placed[k, s, 1])
        radius = float(_segment_distances(drawn.motion, point).min() - rng.uniform(*CLEARANCE))
        if RADII[0] + DEEP_ENOUGH <= radius <= RADII[1]:
            return fp.Circle(center=(point.real, point.imag), radius=radius)
    return None


def _placed(plan: fp.Plan, times: np.ndarray) -> np.ndarray:
    """Ends (K, S, 2) of the links' segments as complex places."""
    from floatplan.motion.planar.clearance import LinkShapes

    state = plan.at(times)
    tree = plan.robot.tree
    segments = LinkShapes(tree, plan.robot.shapes).place(
        state.com_position[:, 0] + 1j * state.com_position[:, 1],
        tree.absolute_angles(state.orientation, state.positions),
    )
    return np.stack((segments.start, segments.end), axis=2)


def _limits_just_above(drawn: Drawn, difficulty: int) -> fp.Limits:
    """Limits 3 % above the drawn motion's peaks."""
    flown, velocities = drawn.motion.flown, drawn.motion.motion.velocities
    peaks = [np.abs(values).max(axis=0) for values in (flown.torques, velocities, flown.rate)]
    return fp.Limits(
        torque=HEADROOM * peaks[0],
        velocity=HEADROOM * peaks[1] if difficulty > 0 else "none",
        orientation_rate=float(HEADROOM * peaks[2][0]) if difficulty > 1 else None,
    )


def _exceeds(guess: fp.Plan, limits: fp.Limits) -> bool:
    """Whether the plan made without the limits breaks the torque limits."""
    return bool((guess.peaks.torque > np.asarray(limits.torque)).any())
