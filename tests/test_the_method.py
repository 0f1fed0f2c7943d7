"""The paper's planner as one short script: alone, and beside the product on the paper's examples and random chains."""

from __future__ import annotations

import ast
import math
import re
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import reduce
from pathlib import Path

import numpy as np
import pytest
import the_method as method
from generated_problems import random_problem
from robot_samples import URDF_FOLDER
from scipy.optimize import minimize_scalar

import floatplan as fp
from floatplan.motion.planar.bounds import angular_momentum_interval, inertia_extremes

ROOT = Path(__file__).resolve().parents[1]
SCRIPT = Path(method.__file__)
SAME = 1e-6  # [-] relative, of |b|
SEEDS = range(4)
MOST = 15  # of the chains that both planners end at the same motion for, each from a plain start of its own


def flight_of(problem: fp.Problem, urdf: Path, h: float) -> method.Flight:
    """The same question, asked of the script."""
    start, goal = (
        method.Posture(
            end.orientation, *(np.array(part) for part in (end.positions, end.velocities, end.accelerations))
        )
        for end in (problem.initial, problem.final)
    )
    degree, speed = max(problem.degrees), problem.flight.horizontal_velocity
    return method.Flight(method.Chain(urdf), start, goal, problem.flight.duration, h, degree, speed=speed)


def branch_of(coefficients: np.ndarray, duration: float) -> np.ndarray:
    """The branch of the arcsine on which a motion ends."""
    at_goal = coefficients @ method.powers(duration, coefficients.shape[1] - 1)[0]
    return np.floor(at_goal / math.pi + 0.5)


def test_it_needs_four_packages_and_at_most_300_lines() -> None:
    text = SCRIPT.read_text(encoding="utf-8")
    imported = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Import | ast.ImportFrom)]
    names = [node.module or "" if isinstance(node, ast.ImportFrom) else node.names[0].name for node in imported]
    assert {name.split(".")[0] for name in names} - sys.stdlib_module_names == {"numpy", "scipy", "pinocchio"}
    assert len(text.splitlines()) <= 300


def test_the_theory_page_quotes_what_is_there() -> None:
    page = (ROOT / "docs" / "theory" / "method.md").read_text(encoding="utf-8")
    sources = re.findall(r"^```\{literalinclude\} (\S+)$", page, re.MULTILINE)
    quoted = re.findall(r"^:pyobject: (\S+)$", page, re.MULTILINE)
    assert {(ROOT / "docs" / "theory" / source).resolve() for source in sources} == {SCRIPT}
    assert len(set(quoted)) == len(quoted) == len(sources) > 10
    for name in quoted:
        assert callable(reduce(getattr, name.split("."), method)), name


def test_both_planners_find_the_same_motions_of_random_chains(tmp_path: Path) -> None:
    """From the product's optimum the script goes nowhere; from its own plain start it mostly ends there too."""
    found = []
    for joints in (2, 3, 4, 5):
        for seed in SEEDS:
            problem = random_problem(seed, joints, moving=seed % 2 == 1)
            problem = replace(problem, motion=fp.Motion(degree=7))
            plan = fp.plan(problem)
            urdf = tmp_path / f"chain_{joints}_{seed}.urdf"
            urdf.write_text(problem.robot.xml, encoding="utf-8")
            flight = flight_of(problem, urdf, plan.angular_momentum)
            fine = replace(flight, nodes=64)
            b0, N = method.motions_between(flight, branch_of(plan.coefficients, plan.duration))
            from_there = method.least(fine, b0, N, plan.coefficients, [])
            assert abs(method.missed(fine, from_there)[0]) < 1e-9
            assert np.linalg.norm(from_there) == pytest.approx(plan.objective_value, rel=SAME), (joints, seed)
            b = method.plan(flight)
            found.append(math.nan if b is None else float(np.linalg.norm(b)) / plan.objective_value)
    assert sum(abs(ratio - 1) < SAME for ratio in found) >= MOST, found


def test_momentum_and_extremes_are_those_of_the_product(tmp_path: Path) -> None:
    problem = random_problem(1, 2)
    urdf = tmp_path / "chain.urdf"
    urdf.write_text(problem.robot.xml, encoding="utf-8")
    flight = flight_of(problem, urdf, 0.0)
    low, high = inertia_extremes(problem.robot, problem.position_limits)
    assert [method.extreme(flight.chain, i, 1) for i in range(3)] == pytest.approx(low, rel=1e-6)
    assert [method.extreme(flight.chain, i, -1) for i in range(3)] == pytest.approx(high, rel=1e-6)
    middle = sum(angular_momentum_interval(problem)) / 2
    assert method.suitable_momentum(flight.chain, flight.start, flight.goal, flight.duration) == pytest.approx(
        middle, abs=1e-6
    )


def test_example_b_is_the_product_s(planned: Callable[[str], fp.Plan]) -> None:
    """Path of the CM, turn of the base, torques and distances from the pole of a plan that the product made."""
    plan = planned("obstacle")
    flight = flight_of(plan.problem, URDF_FOLDER / "gymnast.urdf", plan.angular_momentum)
    (circle,) = plan.problem.obstacles
    flight = replace(flight, nodes=64, center=circle.center, radius=circle.radius)
    times = np.linspace(0, plan.duration, 57)
    state = plan.at(times)
    cm = method.flight_of_cm(flight)
    assert np.array([cm(t) for t in times]) == pytest.approx(state.com_position, abs=1e-9)
    turns = [flight.start.theta0 + method.base_turn(flight, plan.coefficients, t)[0] for t in times]
    assert turns == pytest.approx(state.orientation, abs=1e-9)
    torques = [flight.chain.torques(*method.joint_motion(plan.coefficients, t), flight.h) for t in times]
    assert np.array(torques) == pytest.approx(state.torques, abs=1e-8)

    def distance(t: float) -> float:
        return float(method.clearances(flight, t, plan.coefficients)[0].min())

    before, _, after = sorted(sorted(times, key=distance)[:3])
    nearest = minimize_scalar(distance, bounds=(before, after))
    assert nearest.fun == pytest.approx(plan.peaks.clearance, abs=1e-6)


@pytest.mark.parametrize("until", [0.3, 0.7])
def test_derivatives_are_right(until: float) -> None:
    chain = method.Chain(URDF_FOLDER / "gymnast.urdf")
    start, goal = method.posture(72, 18, -45), method.posture(-90, 0, 0)
    flight = method.Flight(chain, start, goal, 1.4, -1.18, speed=2.0, center=(1.485, 3.342), radius=0.2)
    b, N = method.motions_between(flight, np.zeros(2))
    b = b + np.random.default_rng(3).normal(size=(2, 2)) @ N.T
    for index in np.ndindex(*b.shape):
        step = np.zeros(b.shape)
        step[index] = 1e-6
        ahead, behind = (method.clearances(flight, until, b + sign * step)[0] for sign in (1, -1))
        slope = method.clearances(flight, until, b)[1][:, *index]
        assert (ahead - behind) / 2e-6 == pytest.approx(slope, abs=1e-7), index
