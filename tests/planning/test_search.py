"""The search: enough is enough, budgets of work and of seconds, Ctrl-C, several processes."""

import contextlib
import os
import signal
from dataclasses import replace

import pytest

import floatplan as fp
from floatplan.planning import search as search_module
from floatplan.planning.options import SearchOptions
from floatplan.planning.search import MOST_ATTEMPTS, Search
from floatplan.pool import executor


def run(problem, most=MOST_ATTEMPTS, **options):
    search = Search(problem, SearchOptions(**options))
    search.__dict__["impossible"] = []  # as far as is known
    return search.run(most)


@pytest.fixture(scope="module")
def problem(root):
    return fp.load_problem(root / "problems" / "handstand.toml")


@pytest.fixture(scope="module")
def hopeless(problem):
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


def test_it_ends_with_the_usual_work(hopeless, monkeypatch):
    monkeypatch.setattr(search_module, "DEFAULT_WORK", 3e6)
    found = run(hopeless)
    again = run(hopeless)
    assert found.ran_out_of_time
    assert found.counts["solved"] == 0
    assert found.counts["evaluations"] * 1000 < 3e6 + found.best.work
    assert found.counts["starts"] == again.counts["starts"]
    assert found.best.x.tobytes() == again.best.x.tobytes()


@pytest.mark.parametrize("after", [0, 2])
def test_ctrl_c_leaves_the_best_so_far(hopeless, monkeypatch, after):
    follow = Search.follow_numbered
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


class Killed(executor.WorkerPool):
    """A pool whose processes the system kills."""

    def submit(self, *arguments, **options):
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
