"""Problems over all features together, each drawn around a motion that solves it: the planner has no excuse.

A robot and a motion of (12) are drawn; the motion's end is the goal. Limits are 2 to 30 % above what the motion needs,
speed-dependent torque limits are just met, obstacles and margins between links stay 3 to 20 mm off it. That the motion
solves the problem is verified by :mod:`independent`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from independent import Look, Worst, violations_seen
from sampled_flight import Trajectory, sample_nodes, trajectory
from witness_robots import witness_robot

import floatplan as fp
from floatplan.motion.dynamics import MomentumSet
from floatplan.motion.flight import flight_of
from floatplan.motion.planar.clearance import LinkShapes, Segments, obstacle_distances, pair_distances
from floatplan.motion.planar.flight import gauss_grid
from floatplan.motion.quadrature import NODE_COUNTS
from floatplan.planning.variables import DecisionVariables, decision_variables
from floatplan.problem.parts import Obstacle
from floatplan.problem.problem import Problem
from floatplan.tables import OBJECTIVES

HEADROOM = (1.02, 1.3)  # of limits over the witness's peaks
GAP = (0.003, 0.020)  # m, of clearances
RADII = (0.02, 0.35)  # m
DEEP_ENOUGH = 0.01  # m, by which the plain motion hits an obstacle that is in its way
MOST_TURN = 7.0  # rad
UNRESOLVED = 1e-9  # tail of theta0' at the most nodes there are, relative to its largest value
FEWEST_KINDS = 2  # of constraints in a problem
GRID, ZOOMS = 801, 4  # instants of the first look for an extremum, and how often the look narrows 16-fold
VERIFIED_AT = 300  # instants, beside the ends of windows
VERIFIED = 1e-8  # natural units: what the witness may be seen to violate


@dataclass(frozen=True, eq=False)
class Witness:
    """A problem and a motion that solves it."""

    problem: Problem
    plan: fp.Plan


def witness_problems(count: int, folder: Path, first: int = 0) -> Iterator[Witness]:
    """Yield problems of the seeds from ``first`` on; their robots are written into folders in ``folder``."""
    for seed in range(first, first + count):
        yield witness_problem(seed, folder)


def witness_problem(seed: int, folder: Path) -> Witness:
    """Return the problem of a seed, its robot's files in ``folder``.

    Raises
    ------
    AssertionError
        The motion does not solve the problem that is drawn around it.
    """
    rng = np.random.default_rng([seed, 2024])
    own = folder / f"witness_{seed}"
    own.mkdir(parents=True, exist_ok=True)
    drawn = None
    while drawn is None:
        drawn = _witness(rng, own, f"witness_{seed}")
    worst = verified(drawn.plan)
    assert worst.amount <= VERIFIED, f"{drawn.problem.name}: {worst}"
    return drawn


def _witness(rng: np.random.Generator, folder: Path, name: str) -> Witness | None:
    """A problem and its witness; None for a wild motion, or for less than two kinds of constraints."""
    drawn = _flight(rng, witness_robot(rng, folder), name)
    if drawn is None:
        return None
    problem, plan, plain = drawn
    problem = replace(
        problem,
        limits=_limits(rng, plan),
        obstacles=tuple(_obstacles(rng, plan, plain)),
        self_clearances=tuple(_self_clearances(rng, plan)),
    )
    return Witness(problem, replace(plan, problem=problem)) if len(_kinds(problem)) >= FEWEST_KINDS else None


def _kinds(problem: Problem) -> list[str]:
    """What a problem constrains."""
    limits = problem.limits
    kinds = {
        "obstacles": problem.obstacles,
        "self": problem.self_clearances,
        "torque": not isinstance(limits.torque, str),
        "velocity": not isinstance(limits.velocity, str),
        "motor": limits.motor,
        "rate": limits.orientation_rate,
    }
    return [name for name, asked in kinds.items() if asked]


def verified(plan: fp.Plan, instants: int = VERIFIED_AT) -> Worst:
    """Return the largest violation of a plan, by independent code, at many instants and at the ends of windows."""
    ends = [time for obstacle in plan.problem.obstacles for time in obstacle.window or ()]
    times = np.unique(np.clip([*np.linspace(0.0, plan.duration, instants), *ends], 0.0, plan.duration))
    return max(violations_seen(Look(plan, times)), key=lambda worst: worst.amount)


def _flight(rng: np.random.Generator, robot: fp.Robot, name: str) -> tuple[Problem, fp.Plan, fp.Plan] | None:
    """A flight without limits or obstacles, a motion that solves it, and the plain motion; None for a wild draw."""
    n = len(robot.joints)
    problem = Problem(
        robot=robot,
        start=_posture(rng, robot, float(rng.uniform(-math.pi, math.pi))),
        goal=_posture(rng, robot, float(rng.uniform(-math.pi, math.pi))),
        flight=_airborne(rng, robot),
        motion=fp.Motion(_degree(rng, n), OBJECTIVES[rng.choice(len(OBJECTIVES))]),
        name=name,
    )
    bounds = problem.momentum_interval
    kind: Any = rng.choice(["given", "midpoint", "free"], p=[0.5, 0.2, 0.3]).item()
    branches = np.zeros((2, n), dtype=np.int64)
    variables = decision_variables(problem, problem.degrees, branches, flight_of(problem).momentum_set)
    polynomials = variables.polynomials
    z = polynomials.nominal_coefficients + rng.uniform(0.05, 0.4) * rng.normal(
        size=polynomials.nominal_coefficients.shape
    )

    def flown(momentum: float) -> Problem:
        """The problem with this h given and the goal where the motion ends."""
        goal = replace(problem.goal, orientation=_final_orientation(problem, variables, z, momentum))
        return replace(problem, goal=goal, flight=replace(problem.flight, angular_momentum=momentum))

    momentum = float(rng.uniform(*bounds))
    if kind == "midpoint":
        at = [sum(flown(value).momentum_interval) / 2 - value for value in (0.0, 1.0)]  # linear in h
        momentum = at[0] / (at[0] - at[1])
    solved = flown(momentum)
    turn = abs(solved.final.orientation - solved.initial.orientation)
    if not turn < MOST_TURN or _finest(problem, variables, z, momentum).flown.unresolved > UNRESOLVED:
        return None
    if kind != "given":
        solved = replace(solved, flight=replace(solved.flight, angular_momentum=kind))
    drawn, plain = (_as_plan(solved, variables, free, momentum) for free in (z, polynomials.nominal_coefficients))
    return solved, drawn, plain


def _posture(rng: np.random.Generator, robot: fp.Robot, orientation: float) -> fp.Posture:
    """Inside the joints' ranges; every joint at rest or moving."""
    n = len(robot.joints)
    low, high = (np.clip(side, -math.pi, math.pi) for side in robot.position_limits.T)
    moving = rng.random(n) < rng.choice([0.0, 0.5])
    return fp.Posture(
        orientation,
        positions=(low + high) / 2 + rng.uniform(-0.4, 0.4, n) * (high - low),
        velocities=moving * rng.uniform(-3.0, 3.0, n),
        accelerations=moving * rng.uniform(-10.0, 10.0, n),
    )


def _airborne(rng: np.random.Generator, robot: fp.Robot) -> fp.Flight:
    frames = sorted(robot.layout.tree.links)
    place = _pair(rng.uniform(-0.2, 0.2, 2))
    landing = fp.Landing(str(rng.choice(frames)), float(rng.uniform(-0.2, 0.4))) if rng.random() < 0.6 else None
    return fp.Flight(
        duration=float(rng.uniform(0.4, 1.3)),
        takeoff=fp.Takeoff(str(rng.choice(frames)), place) if rng.random() < 0.6 else None,
        landing=landing,
        horizontal_velocity=float(rng.uniform(-1, 2)),
        gravity=float(rng.choice([9.81, 9.81, 1.6, 0.0])),
    )


def _degree(rng: np.random.Generator, joints: int) -> Any:
    """One for all, "auto", or one per joint, three free coefficients at least in all."""
    kind = rng.random()
    if kind < 0.1:
        return "auto"
    if kind < 0.5:
        return int(rng.integers(7, 10))
    degrees = rng.integers(5, 10, joints)
    degrees[int(rng.integers(joints))] = 8
    return tuple(int(degree) for degree in degrees)


def _with_momentum(variables: DecisionVariables, momentum: float) -> DecisionVariables:
    """The same variables with h given."""
    return replace(variables, momentum=MomentumSet(np.array([momentum]), np.empty((1, 0))))


def _final_orientation(problem: Problem, variables: DecisionVariables, z: np.ndarray, momentum: float) -> float:
    return problem.final.orientation + _finest(problem, variables, z, momentum).residual.item()


def _finest(problem: Problem, variables: DecisionVariables, z: np.ndarray, momentum: float) -> Trajectory:
    given = _with_momentum(variables, momentum)
    nodes = sample_nodes(gauss_grid(NODE_COUNTS[-1]), variables.polynomials.form)
    return trajectory(flight_of(problem), given, nodes, given.variables(z, momentum))


def _as_plan(problem: Problem, variables: DecisionVariables, z: np.ndarray, momentum: float) -> fp.Plan:
    polynomials = variables.polynomials
    x = _with_momentum(variables, momentum).variables(z, momentum)
    free = _with_momentum(variables, momentum).free_coefficients(x)
    return fp.Plan(
        problem=problem,
        centre=polynomials.centre,
        amplitude=polynomials.amplitude,
        coefficients=np.array(polynomials.powers_of_seconds(free)),
        angular_momentum=momentum,
        angular_momentum_bounds=problem.momentum_interval,
        ballistics=problem.path,
        status="feasible",
        ok=True,
        explanation="drawn",
        solver={},
    )


def _limits(rng: np.random.Generator, plan: fp.Plan) -> fp.Limits:
    """Limits just above the peaks of a motion; torque limits by planned coordinate or by motor."""
    robot = plan.robot

    def asked(probability: float) -> bool:
        return bool(rng.random() < probability)

    def headroom(peaks: np.ndarray) -> np.ndarray:
        return peaks * rng.uniform(*HEADROOM, len(peaks))

    torque: Any = "none"
    if asked(0.6):
        torque = headroom(_peaks(plan, lambda state: state.torques))
        if len(robot.motors) > len(robot.joints) and asked(0.5):
            each = headroom(_peaks(plan, lambda state: state.motor_torques))
            torque = dict(zip(robot.motors, each.tolist(), strict=True))
    velocity: Any = headroom(_peaks(plan, lambda state: state.velocities)) if asked(0.5) else "none"
    rate = _peaks(plan, lambda state: state.orientation_rate[:, None])[0] * rng.uniform(*HEADROOM)
    return fp.Limits(
        position="urdf" if asked(0.5) else _written_ranges(plan),
        torque=torque,
        velocity=velocity,
        motor=dict(_met_motors(rng, plan)) if asked(0.4) else {},
        orientation_rate=float(rate) if asked(0.4) else None,
    )


def _written_ranges(plan: fp.Plan) -> dict[str, tuple[float, float]]:
    """The ranges of the class of motions, as a problem file would give them."""
    limits = plan.problem.position_limits.tolist()
    return {name: (low, high) for name, (low, high) in zip(plan.robot.joints, limits, strict=True)}


def _met_motors(rng: np.random.Generator, plan: fp.Plan) -> Iterator[tuple[str, fp.Motor]]:
    """Motors of random slopes whose lines the motion just meets."""
    robot = plan.robot
    torques = _peaks(plan, lambda state: state.motor_torques)
    rates = _peaks(plan, lambda state: state.velocities @ robot.motor_ratios.T)
    slopes = rng.uniform(0.05, 1.5, len(robot.motors)) * torques / rates
    stalls = _peaks(
        plan, lambda state: np.abs(state.motor_torques) + slopes * np.abs(state.velocities @ robot.motor_ratios.T)
    )
    for name, stall, slope in zip(robot.motors, stalls.tolist(), slopes.tolist(), strict=True):
        yield name, fp.Motor(stall, slope)


def _peaks(plan: fp.Plan, quantity: Callable[[fp.FlightState], np.ndarray]) -> np.ndarray:
    """Largest magnitudes (r,) of quantities (K, r) over the flight."""
    times = np.linspace(0.0, plan.duration, GRID)
    seen = np.abs(quantity(plan.at(times)))

    def negative(j: int) -> Callable[[np.ndarray], np.ndarray]:
        return lambda near: -np.abs(quantity(plan.at(near))[:, j])

    return np.array([-_least(negative(j), times, -seen[:, j]) for j in range(seen.shape[1])])


def _least(values: Callable[[np.ndarray], np.ndarray], times: np.ndarray, seen: np.ndarray) -> float:
    """Least of values, ``seen`` (K,) at some times (K,); a look ever closer about the three lowest instants."""
    best = float(seen.min())
    for center in times[np.argsort(seen)[:3]]:
        around, reach = center, (times[-1] - times[0]) / (len(times) - 1)
        for _ in range(ZOOMS):
            near = np.clip(np.linspace(around - reach, around + reach, 33), times[0], times[-1])
            found = values(near)
            around, reach = near[int(np.argmin(found))], reach / 16
            best = min(best, float(found.min()))
    return best


def _segments(plan: fp.Plan, times: np.ndarray) -> Segments:
    """The links' capsules at times (K,)."""
    state, tree = plan.at(times), plan.robot.tree
    com = state.com_position[:, 0] + 1j * state.com_position[:, 1]
    return LinkShapes(tree, plan.robot.shapes).place(com, tree.absolute_angles(state.orientation, state.positions))


@dataclass(frozen=True, eq=False)
class _Seen:
    """A motion's links at the instants ``times`` (K,) of a first look."""

    times: np.ndarray
    segments: Segments

    @classmethod
    def of(cls, plan: fp.Plan) -> _Seen:
        times = np.linspace(0.0, plan.duration, GRID)
        return cls(times, _segments(plan, times))

    def distance(self, obstacle: Obstacle) -> float:
        """Least distance to an obstacle while it exists, less its margin, m."""
        low, high = obstacle.window or (0.0, self.times[-1])
        exists = (self.times >= low) & (self.times <= high)
        values = obstacle_distances(self.segments, obstacle, self.times).min(axis=1)
        return float(values[exists].min()) - obstacle.margin


def _obstacles(rng: np.random.Generator, plan: fp.Plan, plain: fp.Plan) -> Iterator[Obstacle]:
    """Obstacles beside the motion; more than half of them, where that can be, in the way of the plain motion."""
    seen, seen_plain = _Seen.of(plan), _Seen.of(plain)
    for _ in range(int(rng.choice(4, p=[0.15, 0.35, 0.3, 0.2]))):
        depth = DEEP_ENOUGH if rng.random() < 0.6 else -math.inf
        candidates = [one for one in (_obstacle(rng, plan.duration, seen) for _ in range(40)) if one is not None]
        hit = (one for one in candidates if seen_plain.distance(one) < -depth)
        chosen = next(hit, next(iter(candidates), None))
        if chosen is not None:
            yield _cleared(plan, chosen)


def _cleared(plan: fp.Plan, obstacle: Obstacle) -> Obstacle:
    """The obstacle, a little smaller where a closer look shows that the motion is nearer to it than ``GAP``."""
    low, high = obstacle.window or (0.0, plan.duration)

    def values(times: np.ndarray) -> np.ndarray:
        return obstacle_distances(_segments(plan, times), obstacle, times).min(axis=1)

    times = np.linspace(max(low, 0.0), min(high, plan.duration), GRID)
    lacking = max(GAP[0] + obstacle.margin - _least(values, times, values(times)), 0.0)
    if isinstance(obstacle, fp.HalfPlane):
        normal = np.array(obstacle.normal) / np.hypot(*obstacle.normal)
        return replace(obstacle, point=_pair(np.array(obstacle.point) - lacking * normal))
    assert isinstance(obstacle, fp.Circle | fp.Bar)
    return replace(obstacle, radius=obstacle.radius - lacking)


def _obstacle(rng: np.random.Generator, duration: float, seen: _Seen) -> Obstacle | None:
    """An obstacle beside the motion seen; None where the draw is too small, too large or in its way."""
    window = None
    if rng.random() < 0.5:
        begin = rng.uniform(-0.1, 0.8) * duration
        window = (float(begin), float(max(begin, 0.0) + rng.uniform(0.05, 0.7) * duration))
    velocity = rng.uniform(-1.2, 1.2, 2) if rng.random() < 0.5 else np.zeros(2)
    low, high = window or (0.0, duration)
    at = int(rng.choice(np.flatnonzero((seen.times >= low) & (seen.times <= high))))
    segments = seen.segments
    link, share = int(rng.integers(len(segments.radius))), rng.random()
    beside = (1 - share) * segments.start[at, link] + share * segments.end[at, link]
    beside += (segments.radius[link] + rng.uniform(0.03, 0.4)) * np.exp(2j * math.pi * rng.random())
    place = np.array([beside.real, beside.imag]) - velocity * seen.times[at]
    shared: dict[str, Any] = {
        "margin": float(rng.choice([0.0, 0.01, rng.uniform(0.0, 0.03)])),
        "velocity": _pair(velocity),
        "window": window,
    }
    gap = float(rng.uniform(*GAP))
    kind = rng.choice(["circle", "capsule", "half-plane"], p=[0.45, 0.35, 0.2])
    if kind == "half-plane":
        angle = rng.uniform(0, 2 * math.pi)
        normal = np.array([math.cos(angle), math.sin(angle)])
        plane = fp.HalfPlane(point=_pair(place), normal=_pair(normal * rng.uniform(0.5, 2.0)), **shared)
        return replace(plane, point=_pair(place + (seen.distance(plane) - gap) * normal))
    if kind == "circle":
        thin: fp.Circle | fp.Bar = fp.Circle(center=_pair(place), radius=0.0, **shared)
    else:
        angle, length = rng.uniform(0, 2 * math.pi), rng.uniform(0.1, 0.6)
        along = length * np.array([math.cos(angle), math.sin(angle)])
        thin = fp.Bar(start=_pair(place), end=_pair(place + along), radius=0.0, **shared)
    radius = seen.distance(thin) - gap
    return replace(thin, radius=radius) if RADII[0] <= radius <= RADII[1] else None


def _pair(point: np.ndarray) -> tuple[float, float]:
    return (float(point[0]), float(point[1]))


def _self_clearances(rng: np.random.Generator, plan: fp.Plan) -> Iterator[fp.SelfClearance]:
    """Pairs of links that the motion keeps apart; about every third problem has one or two."""
    links = [shape.link for shape in plan.robot.shapes]
    names = list(dict.fromkeys(links))
    pairs = [(one, other) for index, one in enumerate(names) for other in names[index + 1 :]]
    wanted = int(rng.choice(3, p=[0.6, 0.25, 0.15]))
    times = np.linspace(0.0, plan.duration, GRID)
    for number in rng.permutation(len(pairs))[: 4 * wanted]:
        first, second = (np.flatnonzero([link == name for link in links]) for name in pairs[number])

        def values(times: np.ndarray, first: np.ndarray = first, second: np.ndarray = second) -> np.ndarray:
            segments = _segments(plan, times)
            return pair_distances(segments.of(first), segments.of(second)).min(axis=1)

        room = _least(values, times, values(times)) - rng.uniform(*GAP)
        if wanted and room > 0:
            wanted -= 1
            yield fp.SelfClearance(pairs[number], float(room))
