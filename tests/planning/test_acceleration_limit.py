"""Limits of the joints' accelerations: kept by the search, proved, drawn, and told."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import floatplan as fp
from floatplan.view.report.report import report_data

EXAMPLE = Path(__file__).resolve().parents[2] / "problems" / "new_configuration.toml"


def limited(problem: fp.Problem, acceleration: object) -> fp.Problem:
    return replace(problem, limits=replace(problem.limits, acceleration=acceleration))


@pytest.fixture(scope="module")
def free() -> fp.Plan:
    """The plan without the limit."""
    return fp.plan(fp.load_problem(EXAMPLE))


@pytest.fixture(scope="module")
def limits(free: fp.Plan) -> list[float]:
    return [0.95 * peak for peak in free.peaks.joints["acceleration"].tolist()]


@pytest.fixture(scope="module")
def plan(free: fp.Plan, limits: list[float]) -> fp.Plan:
    found = fp.plan(limited(free.problem, limits))
    assert found.ok, found.explanation
    return found


def test_the_search_keeps_it_at_all_times(plan, free, limits):
    peaks = np.abs(plan.at(np.linspace(0, plan.duration, 5001)).accelerations).max(axis=0)
    assert (peaks <= np.array(limits) * (1 + 1e-9)).all()
    assert plan.objective_value > free.objective_value


def test_it_is_proved_and_a_tighter_one_refuted(plan, free, limits):
    certificate = fp.certify(plan)
    assert certificate.proved
    found = {finding.label: finding for finding in certificate.findings}
    assert [found[f"acceleration {joint}"].limit for joint in plan.robot.joints] == limits
    refuted = fp.certify(replace(free, problem=plan.problem))
    assert refuted.verdict == "refuted"
    wrong = {finding.label for finding in refuted.findings if finding.verdict == "refuted"}
    assert wrong == {f"acceleration {joint}" for joint in plan.robot.joints}


def test_what_is_proved_bounds_what_is_measured(plan):
    found = {finding.label: finding.bound for finding in fp.certify(plan).findings}
    peaks = dict(zip(plan.robot.joints, plan.peaks.joints["acceleration"].tolist(), strict=True))
    for joint, peak in peaks.items():
        assert peak * (1 - 1e-9) <= found[f"acceleration {joint}"] <= peak * (1 + 2e-6)


def test_files_hold_it(plan, limits, tmp_path):
    path = plan.save(tmp_path / "plan.json")
    assert json.loads(path.read_text())["problem"]["limits"]["acceleration"] == limits
    assert fp.certify(path).proved
    assert fp.load_plan(path).problem.joint_limits["acceleration"].tolist() == limits
    again = fp.load_problem(fp.save_problem(plan.problem, tmp_path / "problem.toml"))
    assert again.joint_limits["acceleration"].tolist() == limits


def test_a_plan_file_may_leave_it_out(free, tmp_path):
    path = free.save(tmp_path / "plan.json")
    content = json.loads(path.read_text())
    assert content["problem"]["limits"].pop("acceleration") == [None, None]
    path.write_text(json.dumps(content))
    assert fp.certify(path).proved
    assert not np.isfinite(fp.load_plan(path).problem.joint_limits["acceleration"]).any()


def test_utilisation_tells_of_it(plan, free, limits):
    for use in plan.utilisation:
        index = plan.robot.joints.index(use.joint)
        assert use.acceleration_limit == limits[index]
        assert use.acceleration_peak == plan.peaks.joints["acceleration"][index]
        assert use.acceleration_utilisation == use.worst == use.acceleration_peak / limits[index]
        assert use.instant == use.acceleration_instant
    assert [use.acceleration_limit for use in free.utilisation] == [None, None]


def test_pictures_and_report_show_it_where_it_is_limited(plan, free):
    assert "accelerations" in plan.figures()
    assert "accelerations" not in free.figures()
    data = report_data(plan)
    (chart,) = [chart for chart in data["charts"] if chart["title"] == "Accelerations"]
    assert (chart["unit"], len(chart["series"]), len(chart["lines"])) == ("rad/s^2", 2, 4)
    (motors,) = [section for section in data["sections"] if "motors" in section]
    titles, rows = motors["motors"]
    assert [title.replace("²", "^2") for title in titles].count("rad/s^2") == 1
    assert all(len(row) == len(titles) for row in rows)
    assert "Accelerations" not in [chart["title"] for chart in report_data(free)["charts"]]


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("none", [np.inf, np.inf]),
        (9.0, [9.0, 9.0]),
        ({"q2": 4.0}, [np.inf, 4.0]),
        ([3.0, np.inf], [3.0, np.inf]),
    ],
)
def test_how_it_is_given(free, given, expected):
    assert limited(free.problem, given).joint_limits["acceleration"].tolist() == expected


@pytest.mark.parametrize("given", ["urdf", "some", -1.0, {"nose": 1.0}, [1.0]])
def test_what_is_refused(free, given):
    with pytest.raises(fp.InputError, match="acceleration"):
        limited(free.problem, given)


def test_every_wrong_limit_is_reported(free):
    limits = fp.Limits(velocity={"ear": 1.0}, acceleration={"nose": 1.0})
    with pytest.raises(fp.InputError, match=r"(?s)limits\.velocity.*limits\.acceleration"):
        replace(free.problem, limits=limits)
    with pytest.raises(fp.InputError, match=r"(?s)velocity.*acceleration"):
        fp.Limits(velocity=-1.0, acceleration=-1.0)


def test_a_goal_beyond_it_is_impossible(free):
    goal = replace(free.problem.goal, accelerations=[5.0, 0.0])
    plan = fp.plan(limited(replace(free.problem, goal=goal), 4.0))
    assert not plan.ok
    assert "At landing the goal itself is impossible: acceleration of q1 is violated by 1 rad/s^2" in plan.explanation
