"""A start followed by the compiled kernel, where a problem asks for no more than it does."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from floatplan.kernel.batch import FEASIBLE, OPTIMAL, Rows, Search
from floatplan.kernel.rows import is_plain, is_planar, solver
from floatplan.optimization.nonlinear_program import Settings
from floatplan.optimization.sqp import Solution
from floatplan.planning.starts import Start
from floatplan.planning.transcription.objectives import Objective
from floatplan.planning.transcription.program import FlightProgram
from floatplan.planning.transcription.trajectory import FlightModel, Sampling, Trajectory
from floatplan.problem.problem import Problem

WORDS = {OPTIMAL: "optimal", FEASIBLE: "feasible"}
LEVEL = (
    3  # of the grid that the solution is evaluated on once more, which is judged by a finer one where that is needed
)


def compiled_solution(
    problem: Problem,
    model: FlightModel,
    start: Start,
    degrees: tuple[int, ...],
    settings: Settings,
    make_objective: Callable[[Sampling], Objective],
) -> Solution[Trajectory] | None:
    """Follow a start as :func:`~floatplan.planning.transcription.exchange.solve` does, without constraints.

    Returns
    -------
    Solution or None
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
    answers = found.plan(rows, Search(longest_step=settings.longest_step))
    model.work.evaluated(int(answers.instants[0]), model.flight.bodies, int(answers.evaluations[0]))
    x = variables.variables(answers.z[0], rows.momentum)
    nodes = model.nodes(LEVEL, polynomials.form)
    evaluation = FlightProgram(model, variables, nodes, make_objective(nodes)).evaluate(x)
    status = WORDS.get(int(answers.status[0]), "infeasible")
    return Solution(x, evaluation, status, int(answers.iterations[0]), int(answers.evaluations[0]))
