"""Every problem of problems/, and a sample of drawn ones, looked at by code that is not the planner's."""

import json
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from forward_problems import GRADES, forward_problem
from independent import Look, clearance, violations_seen
from long_cases import cases

import floatplan as fp
from floatplan.planning.kernel_problem import KernelProblem
from floatplan.planning.spec import nominal_start, spec_of

PROBLEMS = sorted((Path(__file__).resolve().parents[2] / "problems").glob("*.toml"))
NAMES = [path.stem for path in PROBLEMS]
BUDGET = 60.0  # s: a slow machine is no reason to fail
HOLDS = 1e-6  # m, N m, rad/s, rad
AT_EDGE = 1e-7  # m
DENSE = 1_001  # instants, beside those about the extremes


def problem_of(name):
    return fp.load_problem(next(path for path in PROBLEMS if path.stem == name))


def closer(look, index):
    """Look between the neighbours of a sample, where a fast motion leaves much to see."""
    last = len(look.times) - 1
    return Look(look.plan, np.linspace(look.times[max(index - 1, 0)], look.times[min(index + 1, last)], 201))


def peak(look, quantity):
    """Largest magnitude (n,) of a quantity (K, n): of the highest sample, and of a closer look about it."""
    sampled = np.abs(quantity(look))
    return np.array([np.abs(quantity(closer(look, at)))[:, j].max() for j, at in enumerate(sampled.argmax(axis=0))])


def lowest(look):
    """The instants of the least clearances, by which a fast link sweeps: four at most."""
    values = clearance(look)
    at = np.flatnonzero((values[1:-1] <= values[:-2]) & (values[1:-1] <= values[2:])) + 1
    return look.times[at[np.argsort(values[at])[:4]]]


def check_plan(plan, folder):
    """Everything holds, and what the plan file says of it is so."""
    assert plan.ok, plan.explanation
    look = Look(plan, np.linspace(0, plan.duration, DENSE))
    step = plan.duration / (DENSE - 1)
    seen = violations_seen(look)
    near = [np.linspace(worst.time - step, worst.time + step, 41) for worst in seen]
    near += [np.linspace(time - step, time + step, 201) for time in lowest(look)]
    finely = Look(plan, np.unique(np.clip(np.concatenate([*near, [0.0, plan.duration]]), 0.0, plan.duration)))
    for worst in (*seen, *violations_seen(finely)):
        assert worst.amount < HOLDS, worst
    record = json.loads(plan.save(folder / "plan.json").read_text())
    np.testing.assert_allclose(record["torque_peak"], peak(look, lambda at: at.torques), rtol=1e-6, atol=HOLDS)
    np.testing.assert_allclose(record["velocity_peak"], peak(look, lambda at: at.joints[1]), rtol=1e-6, atol=HOLDS)
    if plan.problem.obstacles:
        assert abs(record["clearance_min"] - min(clearance(look).min(), clearance(finely).min())) < HOLDS
    else:
        assert record["clearance_min"] is None


@pytest.mark.parametrize("name", NAMES)
def test_problem_file_is_planned_and_holds_at_every_instant(planned, name, tmp_path):
    check_plan(planned(name), tmp_path)


@pytest.mark.parametrize("grade", cases(GRADES, {"medium", "hard"}))
def test_problems_built_around_a_motion_are_solved(grade, tmp_path):
    """Among them two where links sweep past an obstacle so fast that a coarse look misses it."""
    problems = (forward_problem(seed, grade) for seed in range(200, 260))
    for problem in islice(filter(None, problems), 4):
        check_plan(fp.plan(problem, budget=BUDGET), tmp_path)


class TestKnownAnswers:
    """Costs that are known from elsewhere, and constraints that change a plan."""

    @pytest.mark.parametrize(("name", "cost"), [("handstand_ground", 8.0), ("obstacle", 20.0)])
    def test_more_starts_find_far_less(self, planned, name, cost):
        several = fp.plan(problem_of(name), starts=24, budget=BUDGET)
        assert several.ok
        assert several.objective_value <= cost < planned(name).objective_value / 1.4


class TestComparedWithOptimaWithoutRows:
    """An optimum without obstacles that is clear of them takes the place of a dearer one past them."""

    def test_cheaper_one_that_is_clear_is_the_plan_alone_and_in_a_batch(self, tmp_path):
        problem = forward_problem(203, "easy")
        spec = spec_of(problem)
        kernel_problem = KernelProblem.of(spec, nominal_start(spec, problem.degrees))
        kernel_problem.search.pointer.compares = 0
        kernel_problem.follow(range(1), np.inf, seed=0)
        first = kernel_problem.result(spec)
        assert first.is_optimal

        plan = fp.plan(problem)
        check_plan(plan, tmp_path)
        assert plan.objective_value < first.objective_value / 4
        without = fp.plan(replace(problem, obstacles=()), starts=12)
        assert plan.objective_value >= without.objective_value * (1 - 1e-9)
        batch = fp.plan_many([problem, problem])
        np.testing.assert_array_equal(batch.objective, plan.objective_value)


class TestContact:
    """The ground at height 0, margin 0: foot and hand are on it at takeoff and landing."""

    def test_ground_is_touched_at_both_ends_and_nowhere_else(self, planned):
        plan = planned("handstand_ground")
        times = np.linspace(0, plan.duration, 2001)
        height = plan.clearances(times)
        assert np.abs(height[[0, -1]]).max() < 1e-9
        assert height[1:-1].min() > 0

    def test_ground_under_a_robot_that_would_dig_in(self):
        problem = problem_of("handstand_ground")
        raised = replace(problem, obstacles=(fp.HalfPlane(point=(0.0, 0.2), window=(0.2, 1.2)),))
        plan = fp.plan(raised, budget=BUDGET)
        assert plan.ok, plan.explanation
        assert plan.clearances(np.linspace(0.2, 1.2, 2001)).min() > -AT_EDGE


class TestWindows:
    """An obstacle bounds only while it exists."""

    def wall(self, window):
        """Example B's pole, grown to cover the start posture and all of the way."""
        return replace(problem_of("handstand"), obstacles=(fp.Circle(center=(0.0, 0.5), radius=0.6, window=window),))

    def test_obstacle_over_the_start_that_comes_later(self):
        assert not fp.plan(self.wall((0.0, 0.1))).ok
        plan = fp.plan(self.wall((0.9, 1.4)), budget=BUDGET)
        assert plan.ok, plan.explanation
        assert plan.clearances(np.linspace(0.9, 1.4, 2001)).min() > -AT_EDGE
        assert np.isinf(plan.clearances([0.1])).all()

    def test_window_narrower_than_the_nodes(self):
        problem = problem_of("obstacle")
        blink = replace(problem.obstacles[0], window=(0.7, 0.705))
        plan = fp.plan(replace(problem, obstacles=(blink,)), budget=BUDGET)
        assert plan.ok, plan.explanation
        assert plan.clearances(np.linspace(0.7, 0.705, 501)).min() > 0.02 - AT_EDGE

    def test_motion_that_is_nearest_at_a_window_s_end_is_found_at_once(self):
        plan = fp.plan(fp.load_problem(Path(__file__).parent / "cases" / "window.toml"), budget=BUDGET)
        assert plan.ok, plan.explanation
        assert plan.solver["starts"] == 1
        assert fp.certify(plan).proved

    @pytest.mark.parametrize(
        "window",
        cases(
            [
                (0.0, 5e-324),
                (-1.0, 5e-324),
                (-1.0, 0.0),
                (1.4, 2.4),
                (0.7, np.nextafter(0.7, 1)),
                (-1.0, 0.7),
                (0.7, 9.0),
            ],
            {(0.0, 5e-324), (-1.0, 0.0), (-1.0, 0.7), (0.7, 9.0)},
        ),
    )
    def test_windows_of_an_instant_and_beyond_the_flight(self, window):
        problem = problem_of("obstacle")
        pole = replace(problem.obstacles[0], window=window)
        plan = fp.plan(replace(problem, obstacles=(pole,)), budget=BUDGET)
        assert plan.ok, plan.explanation
        ends = np.clip(window, 0.0, plan.duration)
        assert plan.clearances(ends).min() >= pole.margin - AT_EDGE
        certificate = fp.certify(plan)
        assert certificate.proved
        assert certificate.clearance_min == pytest.approx(plan.peaks.clearance, abs=1e-5)

    @pytest.mark.parametrize(("window", "end"), [((-1.0, 5e-324), 0.0), ((-1.0, 0.0), 0.0), ((1.4, 2.0), 1.4)])
    def test_obstacle_that_covers_the_robot_at_its_one_instant(self, window, end):
        problem = problem_of("handstand")
        place = fp.plan(problem).at([end]).com_position[0]
        ball = fp.Circle(center=(float(place[0]), float(place[1])), radius=0.1, window=window)
        plan = fp.plan(replace(problem, obstacles=(ball,)), budget=BUDGET)
        assert not plan.ok
        assert "impossible" in plan.explanation
        assert fp.certify(plan).verdict == "refuted"


class TestMovingObstacles:
    def test_one_that_flies_beside_the_robot_is_as_one_that_stands_where_it_flies(self, planned):
        """Seen from the obstacle: velocity of the obstacle against that of the robot."""
        problem = problem_of("obstacle")
        pole = problem.obstacles[0]
        still = replace(problem, flight=replace(problem.flight, horizontal_velocity=0.0))
        moved = replace(still, obstacles=(replace(pole, velocity=(-2.0, 0.0)),))
        plan = fp.plan(moved, budget=BUDGET)
        assert plan.objective_value == pytest.approx(planned("obstacle").objective_value, rel=1e-6)
        np.testing.assert_allclose(plan.coefficients, planned("obstacle").coefficients, atol=1e-5)


class TestObjectives:
    """With h free, the cost is no higher than with its midpoint."""

    @pytest.mark.parametrize("objective", ["torque", "acceleration"])
    @pytest.mark.parametrize("name", ["obstacle", "somersault"])
    def test_free_momentum_costs_less(self, name, objective):
        problem = replace(problem_of(name), motion=fp.Motion(7, objective))
        midpoint, free = (
            fp.plan(replace(problem, flight=replace(problem.flight, angular_momentum=asked)), budget=BUDGET)
            for asked in ("midpoint", "free")
        )
        assert midpoint.ok
        assert free.ok
        assert free.objective_value < midpoint.objective_value
        low, high = free.angular_momentum_bounds
        assert low <= free.angular_momentum <= high
