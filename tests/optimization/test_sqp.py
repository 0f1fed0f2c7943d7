"""The SQP on textbook programs with known solutions; HS numbers are Hock and Schittkowski's, Test Examples (1981)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import pytest

from floatplan.compiled.quadratic import dual_step
from floatplan.optimization import programs
from floatplan.optimization.programs import Derivatives, Evaluation, Settings, solve_qp
from floatplan.optimization.sqp import minimise


def none(x):
    return []


@dataclass
class Textbook:
    """A program whose derivatives are complex-step differences: exact to rounding for what is analytic."""

    objective: Callable
    start: tuple[float, ...]
    equality: Callable = none
    inequality: Callable = none
    solution: tuple[float, ...] | None = None
    least: float | None = None
    seen: list[np.ndarray] = field(default_factory=list)

    @property
    def metric(self):
        return np.eye(len(self.start))

    def evaluate(self, x):
        self.seen.append(np.array(x))
        everything = (lambda y: np.atleast_1d(self.objective(y))), self.equality, self.inequality
        values = [np.array(f(x), dtype=float) for f in everything]
        step = 1e-30j * np.eye(len(x))
        jacobians = [
            np.array([np.imag(f(x + column)) / 1e-30 for column in step]).T.reshape(len(value), len(x))
            for f, value in zip(everything, values, strict=True)
        ]
        derivatives = Derivatives(jacobians[0][0], jacobians[1], jacobians[2])
        return Evaluation(float(values[0][0]), values[1], values[2], lambda: derivatives, None)

    def solve(self, settings=None, **options):
        guess, settings = np.eye(len(self.start)), settings or Settings(iterations=300)
        return minimise(self, np.array(self.start), guess, settings, **options)


def rosenbrock(x):
    return 100 * (x[1] - x[0] ** 2) ** 2 + (1 - x[0]) ** 2


ROSEN_SUZUKI = Textbook(
    lambda x: x[0] ** 2 + x[1] ** 2 + 2 * x[2] ** 2 + x[3] ** 2 - 5 * x[0] - 5 * x[1] - 21 * x[2] + 7 * x[3],
    (0, 0, 0, 0),
    inequality=lambda x: [
        8 - (x**2).sum() - x[0] + x[1] - x[2] + x[3],
        10 - x[0] ** 2 - 2 * x[1] ** 2 - x[2] ** 2 - 2 * x[3] ** 2 + x[0] + x[3],
        5 - 2 * x[0] ** 2 - x[1] ** 2 - x[2] ** 2 - 2 * x[0] + x[1] + x[3],
    ],
    solution=(0, 1, 2, -1),
    least=-44,
)
HS71 = Textbook(
    lambda x: x[0] * x[3] * (x[0] + x[1] + x[2]) + x[2],
    (1, 5, 5, 1),
    equality=lambda x: [(x**2).sum() - 40],
    inequality=lambda x: [x[0] * x[1] * x[2] * x[3] - 25, *(x - 1), *(5 - x)],
    solution=(1, 4.7429994, 3.8211503, 1.3794082),
    least=17.0140173,
)
TEXTBOOK = {
    "quadratic": Textbook(lambda x: (x[0] - 3) ** 2 + 4 * (x[1] + 1) ** 2, (0, 0), solution=(3, -1), least=0),
    "Rosenbrock": Textbook(rosenbrock, (-1.2, 1), solution=(1, 1), least=0),
    "HS6, equality": Textbook(
        lambda x: (1 - x[0]) ** 2, (-1.2, 1), equality=lambda x: [10 * (x[1] - x[0] ** 2)], solution=(1, 1), least=0
    ),
    "HS7, equality": Textbook(
        lambda x: np.log(1 + x[0] ** 2) - x[1],
        (2, 2),
        equality=lambda x: [(1 + x[0] ** 2) ** 2 + x[1] ** 2 - 4],
        solution=(0, np.sqrt(3)),
        least=-np.sqrt(3),
    ),
    "HS28, linear equality": Textbook(
        lambda x: (x[0] + x[1]) ** 2 + (x[1] + x[2]) ** 2,
        (-4, 1, 1),
        equality=lambda x: [x[0] + 2 * x[1] + 3 * x[2] - 1],
        solution=(0.5, -0.5, 0.5),
        least=0,
    ),
    "HS35, active inequality": Textbook(
        lambda x: (
            9
            - 8 * x[0]
            - 6 * x[1]
            - 4 * x[2]
            + 2 * x[0] ** 2
            + 2 * x[1] ** 2
            + x[2] ** 2
            + 2 * x[0] * x[1]
            + 2 * x[0] * x[2]
        ),
        (0.5, 0.5, 0.5),
        inequality=lambda x: [3 - x[0] - x[1] - 2 * x[2], *x],
        solution=(4 / 3, 7 / 9, 4 / 9),
        least=1 / 9,
    ),
    "inactive inequality": Textbook(
        rosenbrock, (-1.2, 1), inequality=lambda x: [4 - (x**2).sum()], solution=(1, 1), least=0
    ),
    "HS43, curved inequalities": ROSEN_SUZUKI,
    "HS71, everything": HS71,
    "HS10, infeasible start": Textbook(
        lambda x: x[0] - x[1],
        (-10, 10),
        inequality=lambda x: [-3 * x[0] ** 2 + 2 * x[0] * x[1] - x[1] ** 2 + 1],
        solution=(0, 1),
        least=-1,
    ),
    "Maratos' circle": Textbook(
        lambda x: 2 * ((x**2).sum() - 1) - x[0],
        (np.cos(1.5), np.sin(1.5)),
        equality=lambda x: [(x**2).sum() - 1],
        solution=(1, 0),
        least=-1,
    ),
    "linearisation that contradicts itself": Textbook(
        lambda x: x[0] ** 2 + x[1] ** 2,
        (0.1, 0.3),
        equality=lambda x: [x[0] ** 2 - 4],
        inequality=lambda x: [3 - x[0]],
        solution=(2, 0),
        least=4,
    ),
    "the same constraint three times": Textbook(
        lambda x: (x[0] - 2) ** 2 + x[1] ** 2,
        (0, 1),
        inequality=lambda x: [1 - x[0], 2 - 2 * x[0], 1 - x[0] + 1e-3 * x[1] ** 2],
        solution=(1, 0),
        least=1,
    ),
    "the same equation twice": Textbook(
        lambda x: (x**2).sum(),
        (3, 0),
        equality=lambda x: [x[0] + x[1] - 1, 2 * x[0] + 2 * x[1] - 2],
        solution=(0.5, 0.5),
        least=0.5,
    ),
}


class TestTextbook:
    @pytest.mark.parametrize("name", TEXTBOOK)
    def test_solution_is_found(self, name):
        program = TEXTBOOK[name]
        found = program.solve()
        assert found.status == "optimal"
        assert found.evaluation.worst_violation <= 1e-9
        assert found.evaluation.objective == pytest.approx(program.least, abs=1e-6)
        assert found.x == pytest.approx(np.array(program.solution), abs=2e-4)
        assert found.evaluation.objective == pytest.approx(program.objective(found.x), rel=1e-14)

    def test_multipliers_of_the_wrong_sign_are_let_go(self):
        """A constraint that is active at the start, and not at the solution."""
        program = Textbook(lambda x: (x[0] - 2) ** 2 + x[1] ** 2, (0, 0), inequality=lambda x: [x[0], 5 - x[0]])
        assert program.solve().x == pytest.approx([2, 0], abs=1e-6)

    def test_a_vertex_where_no_multipliers_exist_is_approached(self):
        """HS13: at (1, 0) the constraints' gradients do not span the objective's; what is reported is true."""
        program = Textbook(
            lambda x: (x[0] - 2) ** 2 + x[1] ** 2, (0, 1), inequality=lambda x: [(1 - x[0]) ** 3 - x[1], x[0], x[1]]
        )
        found = program.solve()
        assert found.x == pytest.approx([1, 0], abs=0.02)
        assert found.evaluation.worst_violation < 1e-6
        assert (found.status == "infeasible") == (found.evaluation.worst_violation > 1e-9)


INFEASIBLE = {
    "bounds that contradict each other": Textbook(
        lambda x: x[0] ** 2, (0, 0), inequality=lambda x: [-1 - x[0], x[0] - 1]
    ),
    "circle out of a half-plane's reach": Textbook(
        lambda x: x[0], (0.3, 0.2), equality=lambda x: [(x**2).sum() - 1], inequality=lambda x: [x[1] - 1.5]
    ),
    "equation without a root": Textbook(lambda x: x[0], (1, 1), equality=lambda x: [1 + (x**2).sum()]),
}


class TestInfeasible:
    @pytest.mark.parametrize("name", INFEASIBLE)
    def test_is_reported_as_such(self, name):
        found = INFEASIBLE[name].solve()
        assert found.status == "infeasible"
        assert found.evaluation.worst_violation > 0.1
        assert np.isfinite(found.x).all()

    def test_ends_with_less_violation_than_it_began(self):
        program = INFEASIBLE["circle out of a half-plane's reach"]
        assert program.solve().evaluation.violation < program.evaluate(np.array(program.start)).violation / 3


class TestEnds:
    def test_stop_is_asked_before_every_iteration(self):
        asked = []

        def stop():
            asked.append(True)
            return len(asked) > 3

        found = TEXTBOOK["Rosenbrock"].solve(stop=stop)
        assert (found.iterations, len(asked), found.status) == (3, 4, "feasible")
        assert found.evaluation.objective < rosenbrock(np.array([-1.2, 1]))

    def test_stopped_at_once_it_returns_the_start(self):
        found = ROSEN_SUZUKI.solve(stop=lambda: True)
        assert (found.iterations, found.x.tolist()) == (0, [0, 0, 0, 0])
        infeasible = HS71.solve(Settings(polish=False), stop=lambda: True)
        assert (infeasible.status, infeasible.x.tolist()) == ("infeasible", [1, 5, 5, 1])

    def test_iterations_are_bounded(self):
        found = TEXTBOOK["Rosenbrock"].solve(Settings(iterations=5))
        assert found.iterations == 5
        assert found.status == "feasible"

    def test_evaluations_are_counted(self):
        program = Textbook(rosenbrock, (-1.2, 1))
        assert program.solve().evaluations == len(program.seen)

    def test_from_the_solution_nothing_moves(self):
        program = Textbook(lambda x: (x**2).sum(), (0, 0), inequality=lambda x: [1 - x[0]])
        found = program.solve()
        assert (found.status, found.iterations, found.x.tolist()) == ("optimal", 1, [0, 0])


class TestSteps:
    @pytest.mark.parametrize("longest", [0.05, 0.5])
    def test_are_no_longer_than_allowed(self, longest):
        """Line search and correction included, by the program's own measure."""

        class Measured(Textbook):
            metric = np.diag([2.0, 0.5])

        program = Measured(lambda x: (x[0] - 3) ** 2 + (x[1] - 3) ** 2, (0, 0))
        found = program.solve(Settings(longest_step=longest, iterations=20))
        steps = np.diff(program.seen, axis=0) @ Measured.metric
        assert np.linalg.norm(steps, axis=1).max() <= longest * (1 + 1e-12)
        assert np.linalg.norm(steps, axis=1).max() >= longest * (1 - 1e-9)
        assert found.evaluation.objective < 18

    def test_polish_takes_equations_to_rounding(self):
        def solve(**settings):
            return TEXTBOOK["HS7, equality"].solve(Settings(optimality=1e-4, feasibility=1e-4, **settings))

        assert np.abs(solve(polish=True).evaluation.equality).max() < 1e-13
        assert np.abs(solve(polish=False).evaluation.equality).max() > 1e-13

    def test_last_hessian_approaches_the_lagrangian_s(self):
        found = TEXTBOOK["quadratic"].solve(Settings(optimality=1e-14))
        assert found.hessian == pytest.approx(np.diag([2.0, 8.0]), rel=0.2, abs=0.2)


class TestBadLuck:
    def test_qp_that_fails_ends_the_search_where_it_is(self, monkeypatch):
        monkeypatch.setattr(programs, "_proxqp", lambda *arguments: None)
        found = HS71.solve()
        assert found.status == "infeasible"
        assert np.isfinite(found.x).all()

    @pytest.mark.parametrize("scale", [1e-6, 1e6])
    def test_badly_scaled_objective_is_still_minimised(self, scale):
        program = Textbook(lambda x: scale * rosenbrock(x), (-1.2, 1), equality=lambda x: [x[0] - x[1] ** 3])
        found = program.solve(Settings(iterations=500))
        assert found.evaluation.worst_violation <= 1e-9
        assert found.evaluation.objective / scale < 5

    def test_where_a_constraint_has_no_derivative_but_rounding_the_search_ends(self):
        program = Textbook(lambda x: (x**2).sum(), (1e-17, 0), equality=lambda x: [(x**2).sum() - 1])
        found = program.solve(Settings(polish=False), solve=partial(solve_qp, first=dual_step))
        assert (found.status, found.iterations, found.evaluations) == ("infeasible", 1, 1)

    def test_a_program_of_no_variables_is_judged(self):
        """Degree 5 and h given: nothing to choose."""
        program = Textbook(lambda x: 0.0 * x.sum(), (), equality=lambda x: [0.25])
        assert program.solve().status == "infeasible"


def underived():
    raise AssertionError("nobody asked for derivatives")


class TestEvaluation:
    def test_violations_are_those_of_both_kinds(self):
        evaluation = Evaluation(0.0, np.array([0.5, -0.25]), np.array([1.0, -2.0]), underived, None)
        assert (evaluation.violation, evaluation.worst_violation) == (2.75, 2.0)

    def test_without_constraints_nothing_is_violated(self):
        evaluation = Evaluation(0.0, np.empty(0), np.empty(0), underived, None)
        assert (evaluation.violation, evaluation.worst_violation) == (0.0, 0.0)
