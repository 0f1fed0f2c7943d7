"""A plan answers from any thread as from one, and survives pickling."""

from __future__ import annotations

import pickle
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace

import numpy as np
import pytest

THREADS = 8
ASKED = 160  # answers, of which 99 were wrong while all threads shared one Pinocchio workspace


@pytest.fixture(autouse=True)
def fast_switching():
    """Threads that interrupt each other between any two calls."""
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    yield
    sys.setswitchinterval(interval)


def from_threads(function, arguments):
    """What a function returns for each argument, asked from several threads at once."""
    with ThreadPoolExecutor(THREADS) as pool:
        return list(pool.map(function, arguments))


def same_state(one, other):
    return all(np.array_equal(getattr(one, field.name), getattr(other, field.name)) for field in fields(one))


def fresh(plan):
    """The same motion with nothing computed yet."""
    return replace(plan)


def test_states(planned):
    plan = planned("somersault")
    instants = [np.linspace(0, plan.duration, 40 + index) for index in range(ASKED)]
    expected = [plan.at(times) for times in instants]
    assert all(map(same_state, from_threads(plan.at, instants), expected))


def test_what_a_plan_computes_once(planned):
    """Every thread asks for the same peaks, and for the record, of a plan that nobody asked before."""
    plan = planned("somersault")
    expected = fresh(plan).record.to_dict()
    for _ in range(3):
        new = fresh(plan)
        assert from_threads(lambda _, new=new: new.record.to_dict(), range(THREADS)) == [expected] * THREADS


def test_pickled(planned):
    plan = planned("somersault")
    times = np.linspace(0, plan.duration, 9)
    expected = plan.at(times)
    copy = pickle.loads(pickle.dumps(plan))
    assert same_state(copy.at(times), expected)
    assert np.array_equal(copy.peaks.torque, plan.peaks.torque)
