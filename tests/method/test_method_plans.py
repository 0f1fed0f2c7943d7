"""Plans of the reference method and of the kernel: each is held to the other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from generated_problems import random_problem
from long_cases import cases
from method_flights import at_motion
from needed import skip_or_fail
from plain_problems import plain_problems

import floatplan as fp
from floatplan.method import solve
from floatplan.method.dynamics import QUANTITIES
from floatplan.robot.urdf.tree import robots_folder

ROOT = Path(__file__).resolve().parents[2]
PROBLEMS = ROOT / "problems"
SAME = 1e-6  # [-] relative, of objectives
ONE_MINIMUM = (  # where both begin with the plain motion, and end in one minimum
    "new_configuration",
    "new_configuration_midpoint",
    "new_configuration_moving",
    "handstand",
    "handstand_ground",
    "somersault",
    "somersault_low_torque",
    "torque_limited",
    "obstacle",
    "moving_hoop",
)
SEVERAL = ("obstacle_hard", "falling_cat")  # where they may end in others
ROBOTS = ("go2", "bolt", "solo", "double_pendulum", "borinot")  # of the gallery: one minimum too, of each objective
STEADY = ("g1", "solo12", "human")  # and where the kernel's plan is held to be a minimum
CHAINS = [(joints, seed) for joints in (1, 2, 3, 5, 8) for seed in range(4) if (joints, seed) != (1, 2)]
TREES = range(0, 96, 4)  # numbers of ``plain_problems``: two of each robot, every other one a tree


def same_minimum(plan: fp.Plan) -> fp.Plan:
    """Return the plan of the minimum to which the reference method goes from a plan's motion."""
    program, x = at_motion(plan)
    there = solve(program, x)
    assert there.status == "optimal"
    assert there.residual < 1e-8
    return there.plan(program.problem, seed=0)


@pytest.mark.parametrize("name", cases(ONE_MINIMUM, {*ONE_MINIMUM[1::3]}))
def test_both_planners_find_one_minimum(name: str, planned: Callable[[str], fp.Plan]) -> None:
    kernel, plan = planned(name), fp.method.plan(PROBLEMS / f"{name}.toml")
    assert plan.ok
    assert plan.status == "optimal"
    assert plan.objective_value == pytest.approx(kernel.objective_value, rel=SAME)
    assert plan.angular_momentum == pytest.approx(kernel.angular_momentum, rel=1e-3, abs=1e-9)
    assert fp.certify(plan).proved


@pytest.mark.parametrize("name", cases(ROBOTS, ROBOTS[1:]))
def test_both_find_one_minimum_of_real_robots(name: str, planned: Callable[[str], fp.Plan]) -> None:
    """Coupled legs, limits of all kinds, least torques or accelerations."""
    if robots_folder() is None:
        skip_or_fail("example-robot-data is not installed")
    kernel, plan = planned(f"gallery/{name}"), fp.method.plan(PROBLEMS / "gallery" / f"{name}.toml")
    assert plan.status == "optimal"
    assert plan.objective_value == pytest.approx(kernel.objective_value, rel=SAME)


@pytest.mark.long
@pytest.mark.parametrize("name", STEADY)
def test_plans_of_real_robots_are_minima_of_the_reference(name: str, planned: Callable[[str], fp.Plan]) -> None:
    if robots_folder() is None:
        skip_or_fail("example-robot-data is not installed")
    kernel = planned(f"gallery/{name}")
    assert same_minimum(kernel).objective_value == pytest.approx(kernel.objective_value, rel=SAME)


@pytest.mark.long
@pytest.mark.parametrize("name", SEVERAL)
def test_each_finds_a_plan_and_the_kernel_s_is_a_minimum_of_the_reference(
    name: str, planned: Callable[[str], fp.Plan]
) -> None:
    kernel, plan = planned(name), fp.method.plan(PROBLEMS / f"{name}.toml")
    assert plan.ok, plan.explanation
    assert fp.certify(plan).proved
    assert same_minimum(kernel).objective_value == pytest.approx(kernel.objective_value, rel=SAME)


@pytest.mark.long
def test_torques_that_touch_their_limits_at_many_instants(planned: Callable[[str], fp.Plan]) -> None:
    """One minimum at degree 11; there the share of a limit that both keep free counts 1e-6 of the objective."""
    kernel, plan = planned("torque_limited_hard"), fp.method.plan(PROBLEMS / "torque_limited_hard.toml")
    assert plan.status == "optimal"
    assert fp.certify(plan).proved
    assert plan.objective_value == pytest.approx(kernel.objective_value, rel=5e-6)
    assert same_minimum(kernel).objective_value == pytest.approx(kernel.objective_value, rel=5e-6)


@pytest.mark.parametrize("chain", cases(CHAINS, CHAINS[5:]), ids=str)
def test_random_chains(chain: tuple[int, int]) -> None:
    joints, seed = chain
    problem = random_problem(seed, joints, moving=seed % 2 == 1)
    kernel, plan = fp.plan(problem), fp.method.plan(problem)
    assert plan.ok
    assert plan.objective_value == pytest.approx(kernel.objective_value, rel=SAME)


@pytest.mark.parametrize("number", cases(TREES, TREES[4:]))
def test_plans_of_random_trees_are_minima_of_the_reference(number: int) -> None:
    """Trees in four planes, some with a coupled joint, all with locked ones, degrees mixed."""
    kernel = fp.plan(plain_problems(number + 1)[number])
    if not kernel.ok:
        pytest.skip("the kernel finds no plan")
    assert same_minimum(kernel).objective_value == pytest.approx(kernel.objective_value, rel=SAME)


def test_a_plan_s_motion_is_a_point_of_the_program(planned: Callable[[str], fp.Plan]) -> None:
    """Of the kernel's plan past the pole (14) and (23) hold there, as its torques do those of the full model."""
    plan = planned("obstacle")
    program, x = at_motion(plan)
    there = program.evaluate(x, np.zeros(0))
    assert np.abs(there.rows[:2]).max() < 1e-9
    assert program.inequalities(x, np.linspace(0, 1, 201)).min() > -1e-9
    times = np.linspace(0, plan.duration, 9)
    u = program.states(x[:, None], times / plan.duration)[-9:]
    assert QUANTITIES["torques"](program.dynamics, u)[..., 0] == pytest.approx(plan.at(times).torques, abs=1e-8)


def test_what_has_no_plan_has_the_nearest_motion_and_its_violation() -> None:
    """With degree 5 nothing is left to steer with, (16)."""
    problem = replace(fp.load_problem(PROBLEMS / "new_configuration.toml"), motion=fp.Motion(degree=5))
    plan = fp.method.plan(problem)
    assert (plan.ok, plan.status) == (False, "infeasible")
    assert f"{plan.whole.missed:.3g} rad" in plan.explanation


REFUSED = {  # problem files, and the key that is named
    "backflip": "ground",
    "falling_cat_apart": "self_clearance",
    "high_jump": "obstacles.0.kind",
    "space/cat": "robot.base",
    "jumps/acrobat": "jump",
}


@pytest.mark.parametrize(("name", "key"), REFUSED.items())
def test_what_is_not_taken_is_refused_by_its_key(name: str, key: str) -> None:
    with pytest.raises(fp.InputError, match=f"(?s){key}.*kernel"):
        fp.method.plan(PROBLEMS / f"{name}.toml")


def test_limits_and_windows_that_are_not_known_are_refused(handstand: fp.Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = handstand.problem
    motors = replace(problem, limits=replace(problem.limits, motor={"q1": fp.Motor(6.0, 0.3)}))
    with pytest.raises(fp.InputError, match=r"limits.motor"):
        fp.method.plan(motors)
    pole = fp.Circle(center=(1.485, 3.342), radius=0.2, window=(0.4, 1.1))
    with pytest.raises(fp.InputError, match=r"obstacles.0.window"):
        fp.method.plan(replace(problem, obstacles=[pole]))
    monkeypatch.setattr("floatplan.method.QUANTITIES", ("motor_torques",))
    with pytest.raises(fp.InputError, match=r"limits.velocity.*motor_torques"):
        fp.method.plan(replace(problem, limits=replace(problem.limits, velocity=9.0)))


def test_the_command_line_has_it(floatplan: Callable[..., Any], tmp_path: Path) -> None:
    out = tmp_path / "out"
    command = ("plan", str(PROBLEMS / "handstand.toml"), "--method", "reference", "-o", str(out), "--quiet")
    assert floatplan(*command).code == 0
    plan = fp.load_plan(out / "plan.json")
    assert plan.ok
    assert plan.certificate is not None
    assert plan.certificate.proved
    assert floatplan(*command, "--starts", "2").code == 2
    refused = floatplan("plan", str(PROBLEMS / "backflip.toml"), "--method", "reference", "-o", str(out))
    assert refused.code == 2
    assert "backflip.toml: ground: the reference method" in refused.stderr
    assert refused.stderr.count("\n") == 1
