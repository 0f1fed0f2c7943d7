"""A gymnast's somersault and what corrects it."""

import pytest

import floatplan as fp


@pytest.fixture(scope="module")
def plan(planned):
    return planned("somersault")


@pytest.fixture(scope="module")
def shared(plan):
    return fp.Replanner(plan)


@pytest.fixture
def replanner(shared):
    shared.reset()
    return shared
