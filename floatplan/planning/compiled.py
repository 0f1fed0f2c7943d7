"""Starts followed by the compiled kernel, where a problem asks for no more than it does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array
from floatplan.kernel.batch import FEASIBLE, INFEASIBLE, OPTIMAL, Answers, Rows, Search
from floatplan.kernel.rows import Numbers, is_plain, is_planar, solver
from floatplan.optimization.sqp import Solution
from floatplan.planning.starts import Start
from floatplan.planning.transcription.program import FlightProgram, decision_variables, objective
from floatplan.planning.transcription.trajectory import FlightModel, Trajectory
from floatplan.planning.transcription.variables import DecisionVariables
from floatplan.planning.work import Work
from floatplan.plans.plan import Plan
from floatplan.plans.plans import Answer
from floatplan.problem.problem import Problem

WORDS: dict[int, str] = {OPTIMAL: "optimal", FEASIBLE: "feasible"}
LEVEL = (
    3  # of the grid that the solution is evaluated on once more, which is judged by a finer one where that is needed
)


@dataclass(frozen=True, eq=False)
class Compiled:
    """The best of the starts followed: its variables, solution and b, how many were followed, and how many solved."""

    variables: DecisionVariables
    solution: Solution[Trajectory]
    coefficients: Array
    starts: int
    solved: int


@dataclass(frozen=True, eq=False)
class Followed:
    """Starts of a plain problem that the kernel has followed together: h (1,), kg m^2/s, and the answers of one row."""

    momentum: Array
    answers: Answers
    bodies: int

    @property
    def holds(self) -> bool:
        """Whether one of them leads to a plan."""
        return int(self.answers.status[0]) != INFEASIBLE

    @property
    def work(self) -> float:
        """What it took, instants of one body."""
        work = Work()
        work.evaluated(int(self.answers.instants[0]), self.bodies, int(self.answers.evaluations[0]))
        return work.done

    def plan(self, problem: Problem, seed: int, seconds: float) -> Plan:
        """Return the best of them as a plan."""
        answers = self.answers
        answer = Answer(
            WORDS[int(answers.status[0])],
            angular_momentum=float(self.momentum[0]),
            coefficients=answers.coefficients[0],
            evaluations=int(answers.evaluations[0]),
            iterations=int(answers.iterations[0]),
            starts=int(answers.starts[0]),
            solved=int(answers.solved[0]),
        )
        return answer.plan(problem, seed, seconds)


def follow_together(problem: Problem, search: Search) -> Followed | None:
    """Follow the plain motion of a problem, and random starts as the search says; None where it asks for more."""
    if problem.raises_degree or not is_plain(problem):
        return None
    found = solver(problem, problem.degrees)
    rows = Numbers.of_problems([problem]).rows()
    return Followed(rows.momentum, found.plan(rows, search), found.bodies)


def compiled_solution(
    problem: Problem, model: FlightModel, start: Start, degrees: tuple[int, ...], longest_step: float
) -> Compiled | None:
    """Follow a start as :func:`~floatplan.planning.transcription.exchange.solve` does, without constraints.

    Returns
    -------
    Compiled or None
        None where the problem needs more than the kernel.
    """
    if not (is_planar(model.flight) and is_plain(problem)):
        return None
    found = solver(problem, degrees)
    variables = start.variables
    polynomials = variables.polynomials
    rows = Rows(
        duration=np.array([polynomials.duration]),
        momentum=variables.angular_momentum(start.x),
        change=np.array([problem.final.orientation - problem.initial.orientation]),
        boundary=polynomials.boundary[None],
        start=variables.free_coefficients(start.x)[None],
    )
    followed = Followed(rows.momentum, found.plan(rows, Search(longest_step=longest_step)), found.bodies)
    return solution_of(followed, problem, model, variables, degrees)


def solution_of(
    followed: Followed, problem: Problem, model: FlightModel, variables: DecisionVariables, degrees: tuple[int, ...]
) -> Compiled:
    """Evaluate what the kernel answered; ``variables`` are those of the motions on the branches that it began on."""
    answers = followed.answers
    model.work.done += followed.work
    if answers.branch[0].any():
        branches = np.array([np.zeros_like(answers.branch[0]), answers.branch[0]])
        variables = decision_variables(problem, degrees, branches, variables.momentum)
    x = variables.variables(answers.z[0], followed.momentum)
    nodes = model.nodes(LEVEL, variables.polynomials.form)
    evaluation = FlightProgram(model, variables, nodes, objective(problem, model, variables, nodes)).evaluate(x)
    status = WORDS.get(int(answers.status[0]), "infeasible")
    solution = Solution(x, evaluation, status, int(answers.iterations[0]), int(answers.evaluations[0]))
    return Compiled(variables, solution, answers.coefficients[0], int(answers.starts[0]), int(answers.solved[0]))
