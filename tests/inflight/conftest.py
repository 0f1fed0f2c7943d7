"""A gymnast's somersault and what corrects it."""

from pathlib import Path

import pytest

import floatplan as fp

PROBLEMS = Path(__file__).resolve().parents[2] / "problems"


@pytest.fixture(scope="module")
def plan() -> fp.Plan:
    return fp.plan(fp.load_problem(PROBLEMS / "somersault.toml"))


@pytest.fixture(scope="module")
def shared(plan: fp.Plan) -> fp.Replanner:
    return fp.Replanner(plan)


@pytest.fixture
def replanner(shared: fp.Replanner) -> fp.Replanner:
    shared.reset()
    return shared
