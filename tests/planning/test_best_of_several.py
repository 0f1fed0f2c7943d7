"""The best of several: compared by the number that the user sees, and never worse with more starts or processes."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import islice, pairwise
from pathlib import Path

import numpy as np
import pytest
from generated_problems import random_problem
from long_cases import cases
from reduced_program import Derivatives, Evaluation, dual_step
from starts_problems import starts_problems

import floatplan as fp
from floatplan.planning import repair, search
from floatplan.planning.options import SearchOptions
from floatplan.planning.planner import planned
from floatplan.planning.repair import alternatives
from floatplan.planning.result import SearchedPlan, SearchResult

ROOT = Path(__file__).resolve().parents[2]
HANDSTAND = ROOT / "problems" / "handstand.toml"

NUMBERS_OF_STARTS = (1, 3, 8)
DRAWN = 12  # problems


@cache
def problems() -> dict[str, fp.Problem]:
    """By name, in the order in which they are drawn."""
    return {problem.name: problem for problem in islice(starts_problems(), DRAWN)}


def numbered(number: int) -> fp.Problem:
    return list(problems().values())[number]


def searched(problem: fp.Problem, starts: int) -> SearchedPlan:
    return planned(problem, SearchOptions(starts=starts))


@pytest.mark.parametrize("number", cases(range(DRAWN), {0, 5, 8}))  # which take longest
def test_more_starts_are_never_worse(number: int) -> None:
    plans = [fp.plan(numbered(number), starts=starts) for starts in NUMBERS_OF_STARTS]
    values = [plan.objective_value if plan.ok else np.inf for plan in plans]
    assert all(more <= less * (1 + 1e-9) for less, more in pairwise(values))


def test_a_chain_of_eight() -> None:
    """|b| was once worse with sixteen starts, found on another branch of the arcsine, than with one."""
    problem = random_problem(0, 8)
    one, sixteen = (fp.plan(problem, starts=starts).objective_value for starts in (1, 16))
    assert sixteen <= one


@pytest.mark.parametrize("number", range(DRAWN))
def test_solutions_are_compared_by_the_number_that_the_user_sees(number: int) -> None:
    found = searched(numbered(number), 4)
    answers = [found, *alternatives(found)]
    assert len(answers) >= 4
    for answer in answers:
        assert answer.best.objective_value == pytest.approx(answer.plan.objective_value, rel=1e-9)
    assert found.plan.objective_value == min(answer.plan.objective_value for answer in answers)


def test_the_first_of_equal_outcomes_is_the_best() -> None:
    outcome = searched(random_problem(0, 2), 1).best
    assert SearchResult(outcome.spec, 0, [outcome, replace(outcome)]).best is outcome


class TestWork:
    """The usual budget counts work, in the order of the attempts."""

    @pytest.fixture
    def short(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(search, "DEFAULT_WORK", search.DEFAULT_WORK / 300)

    @pytest.fixture
    def hopeless(self) -> fp.Problem:
        """No constraint but torques that do not suffice, and nothing proves it."""
        problem = fp.load_problem(ROOT / "problems" / "new_configuration.toml")
        return replace(problem, limits=fp.Limits("full", torque=[0.23, 0.12]))

    @pytest.mark.usefixtures("short")
    def test_ends_a_search_at_the_same_place(self, hopeless: fp.Problem) -> None:
        once, again = (fp.plan(hopeless) for _ in range(2))
        assert "ran out of time" in once.explanation
        assert again.coefficients.tobytes() == once.coefficients.tobytes()
        assert {**again.solver, "seconds": 0} == {**once.solver, "seconds": 0}

    @pytest.mark.usefixtures("short")
    def test_is_for_those_without_a_clock(self, hopeless: fp.Problem, monkeypatch: pytest.MonkeyPatch) -> None:
        counted = fp.plan(hopeless).solver["starts"]
        monkeypatch.setattr(search, "ATTEMPTS", counted + 5)
        assert fp.plan(hopeless).solver["starts"] == counted
        assert fp.plan(hopeless, budget=60.0).solver["starts"] == counted + 5

    @pytest.mark.usefixtures("short")
    @pytest.mark.parametrize("name", ["starts_4_free_of_constraints_torque", "starts_1_torque_coefficients"])
    def test_more_starts_are_no_worse_where_it_ends_them(self, name: str) -> None:
        values = [fp.plan(problems()[name], starts=starts).objective_value for starts in (1, 8, 64)]
        assert values == sorted(values, reverse=True)


def test_a_qp_has_the_same_solution_wherever_its_memory_lies() -> None:
    rng = np.random.default_rng(0)
    root = rng.normal(size=(9, 9))
    data = (root @ root.T + 1e-3 * np.eye(9), *map(rng.normal, [0] * 4, [1] * 4, [9, (1, 9), 1, (24, 9)]))
    bounds = rng.normal(size=24) - 1
    kept, solutions = [], set()
    for size in rng.integers(1, 400, 60):
        kept.append(np.empty(size))
        hessian, gradient, rows, values, inequality_rows = (np.array(part) for part in data)
        derivatives = Derivatives(gradient, rows, inequality_rows)
        program = Evaluation(0.0, -values, -bounds, lambda found=derivatives: found, None)
        step = dual_step(program, hessian)
        assert step is not None
        solutions.add(step.direction.tobytes())
    assert len(solutions) == 1


class TestProving:
    """Where the best motion is not proved, the next best is tried."""

    @pytest.fixture
    def refused(self, monkeypatch: pytest.MonkeyPatch) -> set[float]:
        """Objectives of plans whose certificate says "refuted"."""
        objectives: set[float] = set()
        certify = repair.certify

        def refusing(plan: fp.Plan) -> object:
            certificate = certify(plan)
            return replace(certificate, verdict="refuted") if plan.objective_value in objectives else certificate

        monkeypatch.setattr(repair, "certify", refusing)
        return objectives

    def test_the_next_best_is_tried(self, refused: set[float]) -> None:
        problem = fp.load_problem(HANDSTAND)
        found = searched(problem, 8)
        second = next(alternatives(found)).plan
        assert found.plan.objective_value < second.objective_value
        refused.add(found.plan.objective_value)
        plan = fp.plan(problem, starts=8, prove=True)
        assert plan.ok
        assert plan.objective_value == second.objective_value

    def test_nothing_else_is_tried_where_the_best_is_proved(self, monkeypatch: pytest.MonkeyPatch) -> None:
        asked = []
        certify = repair.certify
        monkeypatch.setattr(repair, "certify", lambda plan: asked.append(plan) or certify(plan))
        assert fp.plan(fp.load_problem(HANDSTAND), starts=4, prove=True).ok
        assert len(asked) == 1
