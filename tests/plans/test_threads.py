"""Answers from any thread are those from one: of a plan, of the planner, of proof and replay, of figures."""

import pickle
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace

import flint
import matplotlib
import numpy as np
import pytest
from generated_problems import random_problem

import floatplan as fp
from floatplan.view.figures.figures import save_figures

THREADS = 8
ASKED = 80  # answers, most of them wrong where all threads share one workspace of Pinocchio


@pytest.fixture(autouse=True)
def fast_switching():
    """Threads that interrupt each other between any two calls."""
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    yield
    sys.setswitchinterval(interval)


def from_threads(function, arguments, threads=THREADS):
    """What a function returns for each argument, asked from several threads at once."""
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(function, arguments))


def same_arrays(one, other):
    """Whether two frozen dataclasses hold the same arrays, to the last bit."""
    return all(np.array_equal(getattr(one, field.name), getattr(other, field.name)) for field in fields(one))


@pytest.fixture
def plan(planned):
    """A motion with nothing computed yet."""
    return replace(planned("somersault"))


def test_states(plan):
    instants = [np.linspace(0, plan.duration, 40 + index) for index in range(ASKED)]
    expected = [plan.at(times) for times in instants]
    assert all(map(same_arrays, from_threads(plan.at, instants), expected))


def test_pickled(plan):
    expected = plan.at([0.0, 0.5])
    copy = pickle.loads(pickle.dumps(plan))
    assert same_arrays(copy.at([0.0, 0.5]), expected)
    assert np.array_equal(copy.peaks.torque, plan.peaks.torque)


def test_planner():
    """Whole searches at once, of different robots and of the same."""
    problems = [random_problem(seed, joints) for seed, joints in enumerate((2, 3, 4))]

    def found(problem):
        plan = fp.plan(problem)
        return plan.status, plan.coefficients.tolist(), plan.angular_momentum, plan.solver["evaluations"]

    assert from_threads(found, problems * 3) == [found(problem) for problem in problems] * 3


def test_certificate(planned):
    """Arb's precision is given back as it was."""
    plans = [planned("obstacle"), planned("somersault")]
    precision = flint.ctx.prec
    expected = [replace(fp.certify(plan), seconds=0.0).to_dict() for plan in plans]
    proofs = from_threads(lambda plan: replace(fp.certify(plan), seconds=0.0).to_dict(), plans * 3)
    assert proofs == expected * 3
    assert flint.ctx.prec == precision


@pytest.mark.parametrize("engine", ["pinocchio", pytest.param("mujoco", marks=pytest.mark.long)])
def test_replay(planned, engine):
    """MuJoCo has one callback for all threads."""
    plans = [planned("somersault"), planned("new_configuration")]

    def flown(plan):
        return {**fp.replay(plan, engine=engine, step=2e-3).to_dict(), "seconds": 0.0}

    assert from_threads(flown, plans, threads=2) == [flown(plan) for plan in plans]


@pytest.mark.long
def test_figures(plan, tmp_path):
    """Files of the same plan are the same to the last byte, and matplotlib's settings are as they were."""
    settings = dict(matplotlib.rcParams)

    def drawn(folder):
        return [path.read_bytes() for path in save_figures(replace(plan), tmp_path / folder, formats=["svg"])]

    expected = drawn("one")
    assert all(files == expected for files in from_threads(drawn, ["two", "three"], threads=2))
    assert all(len(each) == len(expected) for each in from_threads(lambda _: plan.figures(), range(2), threads=2))
    assert dict(matplotlib.rcParams) == settings
