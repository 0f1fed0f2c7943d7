"""The best of several: compared by the number that the user sees, and never worse with more starts or processes."""

from dataclasses import replace
from functools import cache
from itertools import islice, pairwise

import numpy as np
import pytest
from long_cases import cases
from places import ROOT
from starts_problems import starts_problems

import floatplan as fp
from floatplan.planning import repair
from floatplan.planning.options import SearchOptions
from floatplan.planning.planner import planned
from floatplan.planning.repair import alternatives

HANDSTAND = ROOT / "problems" / "handstand.toml"

NUMBERS_OF_STARTS = (1, 3, 8)
DRAWN = 12  # problems


@cache
def problems():
    """By name, in the order in which they are drawn."""
    return {problem.name: problem for problem in islice(starts_problems(), DRAWN)}


def numbered(number):
    return list(problems().values())[number]


def searched(problem, starts):
    return planned(problem, SearchOptions(starts=starts))


@pytest.mark.parametrize("number", cases(range(DRAWN), {0, 5, 8}))  # which take longest
def test_more_starts_are_never_worse(number):
    plans = [fp.plan(numbered(number), starts=starts) for starts in NUMBERS_OF_STARTS]
    values = [plan.objective_value if plan.ok else np.inf for plan in plans]
    assert all(more <= less * (1 + 1e-9) for less, more in pairwise(values))


@pytest.mark.parametrize("number", range(DRAWN))
def test_solutions_are_compared_by_the_number_that_the_user_sees(number):
    found = searched(numbered(number), 4)
    answers = [found, *alternatives(found)]
    assert len(answers) >= 4
    for answer in answers:
        assert answer.best.objective_value == pytest.approx(answer.plan.objective_value, rel=1e-9)
    assert found.plan.objective_value == min(answer.plan.objective_value for answer in answers)


class TestProving:
    """Where the best motion is not proved, the next best is tried."""

    @pytest.fixture
    def refused(self, monkeypatch):
        """Objectives of plans whose certificate says "refuted"."""
        objectives = set()
        certify = repair.certify

        def refusing(plan):
            certificate = certify(plan)
            return replace(certificate, verdict="refuted") if plan.objective_value in objectives else certificate

        monkeypatch.setattr(repair, "certify", refusing)
        return objectives

    def test_the_next_best_is_tried(self, refused):
        problem = fp.load_problem(HANDSTAND)
        found = searched(problem, 8)
        second = next(alternatives(found)).plan
        assert found.plan.objective_value < second.objective_value
        refused.add(found.plan.objective_value)
        plan = fp.plan(problem, starts=8, prove=True)
        assert plan.ok
        assert plan.objective_value == second.objective_value
