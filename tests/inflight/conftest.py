"""A gymnast's somersault and what corrects it."""

import pytest
from places import PROBLEMS

import floatplan as fp


@pytest.fixture(scope="module")
def plan():
    return fp.plan(fp.load_problem(PROBLEMS / "somersault.toml"))


@pytest.fixture(scope="module")
def shared(plan):
    return fp.Replanner(plan)


@pytest.fixture
def replanner(shared):
    shared.reset()
    return shared
