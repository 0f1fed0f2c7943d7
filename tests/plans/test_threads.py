"""Answers from any thread are those from one: of a plan, of the planner, of proof and replay, of figures."""

from __future__ import annotations

import contextlib
import pickle
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace
from operator import attrgetter

import flint
import matplotlib
import numpy as np
import pinocchio as pin
import pytest
from generated_problems import random_problem

import floatplan as fp
from floatplan.certificate import certificate
from floatplan.view.figures.figures import save_figures
from floatplan.view.scene.scene import silence, write_scene
from floatplan.view.style import styled

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


def test_states_of_a_thread_that_is_interrupted(plan, monkeypatch):
    """Another thread asks for something else before what Pinocchio left in its workspace is read."""
    times = np.linspace(0, plan.duration, 3)
    expected = plan.at(times)
    original, busy = pin.computeCentroidalMapTimeVariation, threading.Lock()

    def interrupted(*arguments):
        answer = original(*arguments)
        if busy.acquire(blocking=False):
            from_threads(plan.at, [0.3], threads=1)
            busy.release()
        return answer

    monkeypatch.setattr(pin, "computeCentroidalMapTimeVariation", interrupted)
    assert same_arrays(plan.at(times), expected)


def test_coordinates_of_the_file_s_model(plan):
    def ask(times):
        return np.concatenate([quantity(times) for quantity in (plan.q, plan.v, plan.a, plan.tau)], axis=1)

    instants = [np.linspace(0, plan.duration, 20 + index) for index in range(ASKED // 4)]
    expected = [ask(times) for times in instants]
    assert all(map(np.array_equal, from_threads(ask, instants), expected))


def test_what_a_plan_computes_once(plan, tmp_path):
    """Threads that want different things first, each of which needs some of the others."""

    def saved(each):
        return each.save(tmp_path / f"{id(each)}.json").read_text()

    def largest(each):
        return each.peaks.torque.tolist(), each.peaks.velocity.tolist(), each.peaks.clearance

    def state(each):
        return each.at(np.linspace(0, each.duration, 50)).torques.tolist()

    questions = [saved, largest, state, attrgetter("objective_value", "final_orientation", "out_of_plane_leak")]
    expected = [ask(replace(plan)) for ask in questions]
    for _ in range(8):
        new = replace(plan)
        assert from_threads(lambda ask, new=new: ask(new), questions * 6) == expected * 6


def test_pickled(plan):
    expected = plan.at([0.0, 0.5])
    copy = pickle.loads(pickle.dumps(plan))
    assert same_arrays(copy.at([0.0, 0.5]), expected)
    assert np.array_equal(copy.peaks.torque, plan.peaks.torque)


def test_pickled_after_it_was_asked_what_holds_its_locked_joints(planned):
    plan = replace(planned("gallery/go2"))
    assert plan.holding_torques.keys() == plan.robot.locked.keys() != set()
    assert pickle.loads(pickle.dumps(plan)).holding_torques == plan.holding_torques


class Meddler:
    """While it is pickled, somebody has a plan compute and remember something."""

    plan: fp.Plan

    def __reduce__(self):
        assert self.plan.peaks
        return dict, ()


def test_pickled_while_another_thread_computes(plan):
    meddler = Meddler()
    meddler.plan = replace(plan, solver={"seed": meddler})
    assert pickle.loads(pickle.dumps(meddler.plan)).solver == {"seed": {}}


def test_planner():
    """Whole searches at once, of different robots and of the same."""
    problems = [random_problem(seed, joints) for seed, joints in enumerate((2, 3, 4))]

    def found(problem):
        plan = fp.plan(problem)
        return plan.status, plan.coefficients.tolist(), plan.angular_momentum, plan.solver["evaluations"]

    assert from_threads(found, problems * 3) == [found(problem) for problem in problems] * 3


class Room:
    """Two threads try to be in it at the same time."""

    def __init__(self):
        self._meeting = threading.Barrier(2)
        self.met = False

    def visit(self):
        with contextlib.suppress(threading.BrokenBarrierError):
            self._meeting.wait(timeout=0.3)
            self.met = True


@pytest.mark.parametrize("alone", [styled, silence])
def test_what_only_one_thread_may_change(alone):
    """Settings of matplotlib, and standard output."""
    room = Room()

    def enter(_):
        with alone():
            room.visit()

    from_threads(enter, range(2), threads=2)
    assert not room.met


def test_one_certificate_at_a_time(planned, monkeypatch):
    """Arb's precision is one for all threads."""
    room = Room()
    prove = certificate._proved
    monkeypatch.setattr(certificate, "_proved", lambda *given: (room.visit(), prove(*given))[1])
    from_threads(fp.certify, [planned("somersault")] * 2, threads=2)
    assert not room.met


def test_certificate(planned):
    """Arb's precision is given back as it was."""
    plans = [planned("obstacle"), planned("somersault")]
    precision = flint.ctx.prec
    expected = [replace(fp.certify(plan), seconds=0.0).to_dict() for plan in plans]
    proofs = from_threads(lambda plan: replace(fp.certify(plan), seconds=0.0).to_dict(), plans * 3)
    assert proofs == expected * 3
    assert flint.ctx.prec == precision


@pytest.mark.parametrize("engine", [pytest.param("pinocchio", marks=pytest.mark.long), "mujoco"])
def test_replay(planned, engine):
    """MuJoCo has one callback for all threads."""
    plans = [planned("somersault"), planned("handstand"), planned("new_configuration")]

    def flown(plan):
        return {**fp.replay(plan, engine=engine, step=2e-3).to_dict(), "seconds": 0.0}

    assert from_threads(flown, plans, threads=3) == [flown(plan) for plan in plans]


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


def test_scenes_give_standard_output_back(plan, tmp_path):
    pytest.importorskip("viser")
    output = sys.stdout
    pages = from_threads(lambda number: write_scene(plan, tmp_path / f"{number}.html"), range(4), threads=4)
    assert sys.stdout is output
    assert all(page.stat().st_size for page in pages)
