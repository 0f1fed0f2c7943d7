"""Long chains and trees with many legs plan; open loop, what is unstable needs feedback to land."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest
from robot_samples import inertial

import floatplan as fp

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
LEGS = 4
EFFORT = 8.0  # N m


@pytest.fixture
def chain_problem(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return runpy.run_path(str(BENCHMARKS / "long_chains.py"))["chain_problem"]


@pytest.mark.long
def test_a_chain_of_20_joints_plans_and_lands_with_feedback(chain_problem):
    plan = fp.plan(chain_problem(20))
    assert plan.ok, plan.explanation
    assert plan.final_orientation == pytest.approx(1.0, abs=1e-9)
    open_loop, tracked = fp.replay(plan), fp.replay(plan, feedback=30.0)
    assert open_loop.growth.joints[0] < 1e-6 < open_loop.growth.joints[-1]
    assert tracked.landed


def leg(number: int) -> str:
    """A thigh and a shank under the trunk, all legs in the same plane."""
    text = ""
    for name, parent, place, center in (
        (f"thigh{number}", "trunk", f"{0.2 * number - 0.3} 0 0", "0 0 -0.1"),
        (f"shank{number}", f"thigh{number}", "0 0 -0.2", "0 0 -0.1"),
    ):
        limits = f'<limit lower="-2" upper="2" effort="{EFFORT}" velocity="25"/>'
        ends = f'<parent link="{parent}"/><child link="{name}"/><origin xyz="{place}"/>'
        text += f'<link name="{name}">{inertial(0.3, center)}</link>'
        text += f'<joint name="{name}_joint" type="revolute">{ends}<axis xyz="0 1 0"/>{limits}</joint>'
    return text


@pytest.fixture(scope="module")
def tree_plan(tmp_path_factory):
    path = tmp_path_factory.mktemp("tree") / "robot.urdf"
    legs = "".join(leg(number) for number in range(LEGS))
    path.write_text(f'<robot name="tree"><link name="trunk">{inertial(5.0, "0 0 0")}</link>{legs}</robot>')
    robot = fp.Robot.from_urdf(path)
    standing, landing = [0.5, -1.0] * LEGS, [-0.3, -0.8] * LEGS
    problem = fp.Problem(
        robot,
        start=fp.Posture(0.1, standing),
        goal=fp.Posture(1.2, landing),
        flight=fp.Flight(duration=0.6, takeoff=fp.Takeoff("shank0")),
        limits=fp.Limits(torque="urdf", velocity="urdf"),
    )
    return fp.plan(problem)


def test_a_tree_of_four_legs_plans_within_torque_limits(tree_plan):
    assert tree_plan.ok, tree_plan.explanation
    assert len(tree_plan.robot.joints) == 2 * LEGS
    assert (tree_plan.peaks.torque <= EFFORT * (1.0 + 1e-9)).all()
    assert fp.replay(tree_plan).landed
