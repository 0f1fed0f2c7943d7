"""What comes of an attempt: one start, or several that were followed together, up to the best motion of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.compiled.attempts import is_planar
from floatplan.kernel.tolerances import EXCHANGE
from floatplan.planning.transcription.minima import Worst
from floatplan.planning.transcription.variables import DecisionVariables, decision_variables
from floatplan.planning.transcription.work import FlightModel
from floatplan.problem.problem import Problem
from floatplan.tables import Objective as ObjectiveName


@dataclass(eq=False)
class AttemptResult:
    """The best motion that an attempt led to.

    Attributes
    ----------
    problem : Problem
    start_variables : DecisionVariables
        Of the motions that the attempt began with; those of its end are ``variables``.
    model : FlightModel
    x : (size,)
        The motion.
    status : "optimal", "feasible" or "infeasible"
    iterations, evaluations : of all starts that were followed
    level : of the grid that the motion was judged on
    violation : rad, or of a row's scale
        The largest one of (14) or of a constraint's row; 0 where everything holds.
    worst : local minima of the constraints' rows
    missed : (e,) rad
        Residual of (14), with its sign.
    work : instants of one body
        What the attempt took, the drawing of its starts included.
    starts, solved : starts that were followed, and those of them that hold
    coefficients : (n, k+1), optional
        b of (12), powers of t in seconds, where the kernel has computed them.
    integral : float, optional
        The objective, where it is an integral that the kernel has computed.
    branch : (n,), optional
        Of the arcsine at landing, against that of ``start_variables``; None where it is the same.
    """

    problem: Problem
    start_variables: DecisionVariables
    model: FlightModel
    x: Array
    status: str
    iterations: int
    evaluations: int
    level: int
    violation: float
    worst: Worst
    missed: Array = field(default_factory=lambda: np.array([np.nan]))
    work: float = 0.0
    starts: int = 1
    solved: int = 1
    coefficients: Array | None = None
    integral: float | None = None
    branch: IntArray | None = None

    @property
    def holds(self) -> bool:
        """Whether (14) and every constraint hold."""
        return self.violation <= 0

    @property
    def is_optimal(self) -> bool:
        """Whether it holds, and no motion beside it costs less."""
        return self.holds and self.status == "optimal"

    @property
    def is_exhaustive(self) -> bool:
        """Whether the kernel has followed, in one call, as many starts as promise anything."""
        return self.starts > 1

    @property
    def objective(self) -> ObjectiveName:
        """What is minimised."""
        return self.problem.motion.objective

    @cached_property
    def variables(self) -> DecisionVariables:
        """How x makes the motion."""
        if self.branch is None:
            return self.start_variables
        branches = np.stack((np.zeros_like(self.branch), self.branch))
        return decision_variables(self.problem, self.start_variables.degrees, branches, self.start_variables.momentum)

    @cached_property
    def written(self) -> Array:
        """Coefficients b (n, k+1) of (12), powers of t in seconds."""
        if self.coefficients is not None:
            return self.coefficients
        variables, x = self.variables, self.x
        motions = variables.motion_class(variables.angular_momentum(x))
        return motions.powers_of_seconds(variables.free_coefficients(x))

    @cached_property
    def objective_value(self) -> float:
        """The user's objective, which compares motions of any degree and branch."""
        if self.integral is not None:
            return self.integral
        if is_planar(self.model.flight):
            return float(np.linalg.norm(self.written))
        return float(np.linalg.norm(self.x[: self.variables.coefficients]))


def best(results: Sequence[AttemptResult]) -> AttemptResult:
    """Return the result of the least violation, of equals the best; others have no objective.

    Of several that ended at the same motion it is one that is known to be optimal, the first of these.
    """
    least = min(result.violation for result in results)
    nearest = [result for result in results if result.violation == least]
    if len(nearest) == 1:
        return nearest[0]
    lowest = min(nearest, key=lambda result: result.objective_value)
    most = lowest.objective_value + EXCHANGE.same * abs(lowest.objective_value)
    same = (result for result in nearest if result.is_optimal and result.objective_value <= most)
    return lowest if lowest.is_optimal else min(same, key=lambda result: result.objective_value, default=lowest)
