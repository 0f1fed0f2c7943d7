"""Problems drawn around a witness: the motion solves them, and together they have every feature."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from long_cases import cases
from witness_problems import VERIFIED, verified, witness_problem

import floatplan as fp

SEEDS = (3, 6, 8, 11, 12, 14)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    folder = tmp_path_factory.mktemp("witnesses")
    return cache(lambda seed: witness_problem(seed, folder))


def test_a_seed_draws_one_problem(drawn, tmp_path):
    first, again = drawn(SEEDS[0]), witness_problem(SEEDS[0], tmp_path)
    assert again.problem.robot.xml == first.problem.robot.xml
    np.testing.assert_array_equal(again.plan.coefficients, first.plan.coefficients)


def test_verification_sees_a_witness_that_misses(drawn):
    """A limit just below the witness's peak, and an obstacle moved on to it, are violations."""
    witness = next(one for one in map(drawn, SEEDS) if np.isfinite(one.problem.torque_limits).all())
    limits = replace(witness.problem.limits, torque=witness.plan.peaks.torque * 0.999)
    assert verified(replace(witness.plan, problem=replace(witness.problem, limits=limits))).label == "torque"
    place = witness.plan.at(np.array([0.1])).com_position[0]
    circle = fp.Circle(center=(float(place[0]), float(place[1])), radius=0.3)
    hit = verified(replace(witness.plan, problem=replace(witness.problem, obstacles=(circle,))))
    assert hit.amount > 0.05
    assert hit.label.startswith("clearance")


@pytest.mark.parametrize("seed", cases(SEEDS[:4], SEEDS[2:4]))
def test_the_certificate_proves_witnesses_too(drawn, seed):
    witness = drawn(seed)
    assert verified(witness.plan).amount <= VERIFIED
    assert fp.certify(witness.plan).verdict == "proved"
