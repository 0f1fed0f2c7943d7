"""Starts followed by the compiled kernel, where a problem asks for no more than it does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array
from floatplan.kernel.batch import FEASIBLE, OPTIMAL, Rows, Search
from floatplan.kernel.rows import is_plain, is_planar, solver
from floatplan.optimization.sqp import Solution
from floatplan.planning.starts import Start
from floatplan.planning.transcription.program import FlightProgram, decision_variables, objective
from floatplan.planning.transcription.trajectory import FlightModel, Trajectory
from floatplan.planning.transcription.variables import DecisionVariables
from floatplan.problem.problem import Problem

WORDS = {OPTIMAL: "optimal", FEASIBLE: "feasible"}
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


def compiled_solution(
    problem: Problem, model: FlightModel, start: Start, degrees: tuple[int, ...], search: Search
) -> Compiled | None:
    """Follow a start as :func:`~floatplan.planning.transcription.exchange.solve` does, without constraints.

    Where ``search`` allows more than one, others follow that the kernel draws.

    Returns
    -------
    Compiled or None
        None where the problem needs more than the kernel, or there is none.
    """
    found = solver(problem, degrees) if is_planar(model.flight) and is_plain(problem) else None
    if found is None:
        return None
    variables = start.variables
    polynomials = variables.polynomials
    rows = Rows(
        duration=np.array([polynomials.duration]),
        momentum=variables.angular_momentum(start.x),
        change=np.array([problem.final.orientation - problem.initial.orientation]),
        boundary=polynomials.boundary[None],
        start=variables.free_coefficients(start.x)[None],
    )
    answers = found.plan(rows, search)
    model.work.evaluated(int(answers.instants[0]), model.flight.bodies, int(answers.evaluations[0]))
    if answers.branch[0].any():
        branches = np.array([np.zeros_like(answers.branch[0]), answers.branch[0]])
        variables = decision_variables(problem, degrees, branches, variables.momentum)
    x = variables.variables(answers.z[0], rows.momentum)
    nodes = model.nodes(LEVEL, polynomials.form)
    evaluation = FlightProgram(model, variables, nodes, objective(problem, model, variables, nodes)).evaluate(x)
    status = WORDS.get(int(answers.status[0]), "infeasible")
    solution = Solution(x, evaluation, status, int(answers.iterations[0]), int(answers.evaluations[0]))
    return Compiled(variables, solution, answers.coefficients[0], int(answers.starts[0]), int(answers.solved[0]))
