"""The search: enough is enough, budgets of work and of seconds, Ctrl-C, several processes."""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import floatplan as fp
from floatplan.planning import search as room
from floatplan.planning.options import SearchOptions
from floatplan.planning.result import SearchResult
from floatplan.planning.search import MOST_ATTEMPTS, Allowance, Search, expiry
from floatplan.pool import executor

MANY = 10**6


def run(problem: fp.Problem, most: int = MOST_ATTEMPTS, **options: Any) -> SearchResult:
    search = Search(problem, SearchOptions(**options))
    search.__dict__["impossible"] = []  # as far as is known
    return search.run(most)


@pytest.fixture(scope="module")
def problem(root) -> fp.Problem:
    return fp.load_problem(root / "problems" / "handstand.toml")


@pytest.fixture(scope="module")
def hopeless(problem) -> fp.Problem:
    """A hundredth of the torque that the flight needs."""
    return replace(problem, limits=fp.Limits(position="full", torque=0.02))


def test_an_easy_problem_needs_one_attempt(problem):
    found = run(problem)
    assert (found.counts["starts"], found.counts["solved"]) == (1, 1)
    assert found.best.is_optimal
    assert not found.ran_out_of_time
    assert not found.interrupted


def test_the_best_of_those_wanted_comes_first(problem):
    found = run(problem, starts=4)
    assert found.counts["solved"] >= 4
    values = [outcome.objective_value for outcome in found.holding]
    assert values == sorted(values)
    assert found.best is found.holding[0]
    assert found.counts["iterations"] >= sum(outcome.iterations for outcome in found.holding)


def test_the_starts_can_be_bounded(hopeless):
    found = run(hopeless, most=2)
    assert (found.counts["starts"], found.counts["solved"]) == (2, 0)
    assert not found.best.holds
    assert found.holding == ()


def test_where_none_may_be_tried_the_plain_motion_is_the_nearest(hopeless):
    found = run(hopeless, most=0)
    assert (found.counts["starts"], found.counts["solved"]) == (0, 0)
    np.testing.assert_array_equal(found.best.x, Search(hopeless).plain_start.x)


def test_it_ends_after_unsolved_attempts(hopeless):
    found = run(hopeless, attempts=3)
    assert found.counts["starts"] == 3
    assert found.ran_out_of_patience
    assert not found.ran_out_of_time


@pytest.mark.parametrize(("attempts", "starts"), [(9, room.FEW), (3, 3)])
def test_few_starts_are_enough_where_none_comes_near(attempts, starts, hopeless):
    found = run(hopeless, attempts=attempts)
    assert found.best.violation > room.FAR
    assert found.counts["starts"] == starts
    assert found.ran_out_of_patience


def test_near_a_plan_all_starts_are_tried(problem):
    """Seven tenths of the largest torque of a plan that has little."""
    plan = fp.plan(replace(problem, motion=fp.Motion(objective="torque")))
    torque = 0.7 * float(plan.peaks.motor_torque.max())
    found = run(replace(problem, limits=fp.Limits(position="full", torque=torque)), attempts=9)
    assert 0 < found.best.violation < room.FAR
    assert found.counts["starts"] == 9


def test_it_goes_on_after_an_attempt_that_is_solved(problem):
    found = run(problem, starts=4, attempts=1)
    assert found.counts["solved"] == 4
    assert not found.ran_out_of_patience


def test_unsolved_attempts_are_counted_at_each_degree(hopeless):
    rising = replace(hopeless, motion=fp.Motion("auto"))
    assert [max(outcome.variables.degrees) for outcome in run(rising, attempts=1).results] == [7, 9, 11, 13]


def test_it_ends_with_the_usual_work(hopeless, monkeypatch):
    monkeypatch.setattr(room, "DEFAULT_WORK", 3e6)
    found = run(hopeless)
    again = run(hopeless)
    assert found.ran_out_of_time
    assert found.counts["solved"] == 0
    assert found.counts["evaluations"] * 1000 < 3e6 + found.best.work
    assert found.counts["starts"] == again.counts["starts"]
    assert found.best.x.tobytes() == again.best.x.tobytes()


def test_a_budget_that_is_used_up_leaves_the_first_attempt(hopeless):
    found = run(hopeless, budget=1e-9)
    assert found.counts["starts"] == 1
    assert found.ran_out_of_time
    assert np.isfinite(found.best.x).all()


@pytest.mark.parametrize("after", [0, 2])
def test_ctrl_c_leaves_the_best_so_far(hopeless, monkeypatch, after):
    follow: Callable[..., Any] = Search.follow_numbered
    calls = []

    def interrupting(self, *args):
        calls.append(args)
        if len(calls) == after + 1:
            raise KeyboardInterrupt
        return follow(self, *args)

    monkeypatch.setattr(Search, "follow_numbered", interrupting)
    found = run(hopeless)
    assert found.interrupted
    assert found.counts["starts"] == max(after, 1)


class TestAllowance:
    def test_the_first_attempt_is_always_granted(self, problem):
        outcome = replace(run(problem).best, work=10.0)
        assert Allowance(1.0).grants(outcome, is_first=True)

    def test_it_is_used_up_by_what_attempts_did(self, problem):
        outcome = replace(run(problem).best, work=10.0)
        allowance = Allowance(25.0)
        granted = [allowance.grants(outcome, is_first=number == 0) for number in range(4)]
        assert granted == [True, True, False, False]
        assert allowance.is_used_up


def test_no_budget_never_expires():
    assert not expiry(None)()
    assert not expiry(MANY)()
    assert expiry(-1.0)()


class Killed(executor.WorkerPool):
    """A pool whose processes the system kills."""

    def submit(self, *arguments: Any, **options: Any) -> Any:
        future = super().submit(*arguments, **options)
        for process in self.process_ids:
            with contextlib.suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
        return future


def test_killed_processes_lose_no_answer(hopeless, monkeypatch):
    objectives = ("torque", "acceleration")
    problems = [replace(hopeless, motion=replace(hopeless.motion, objective=name)) for name in objectives]
    alone = fp.plan_many(problems, attempts=3)
    monkeypatch.setattr(executor, "WorkerPool", Killed)
    shared = fp.plan_many(problems, attempts=3, jobs=2)
    assert shared.starts.tolist() == alone.starts.tolist()
    assert shared.coefficients.tobytes() == alone.coefficients.tobytes()
