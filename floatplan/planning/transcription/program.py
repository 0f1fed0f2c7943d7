"""Transcription: a flight with its constraints as a nonlinear program in a few well-scaled numbers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from floatplan.arrays import Array, BoolArray, IntArray
from floatplan.motion.dynamics import MomentumSet
from floatplan.motion.sine_polynomial import SinePolynomials
from floatplan.optimization.nonlinear_program import Derivatives, Evaluation
from floatplan.planning.transcription.boundary import Boundary, boundary, sine_polynomials
from floatplan.planning.transcription.compiled_rows import CompiledRows, compiled_rows
from floatplan.planning.transcription.constraints import Constraint, applies, window_ends
from floatplan.planning.transcription.objectives import IntegralOfSquares, Objective, objective_term, whitened_variables
from floatplan.planning.transcription.trajectory import FlightModel, Sampling, Trajectory, sample_also, trajectory
from floatplan.planning.transcription.variables import DecisionVariables
from floatplan.problem.problem import Problem
from floatplan.tables import ORIENTATION

BACK_OFF = 2e-7  # of each row's scale: the search keeps this far inside, so that its plan holds between instants too


RANK = 1e-7  # singular values below this, relative to the largest, are rounding
MOST_RAISED = 100.0  # by how much the equality hardest to change is scaled up against the easiest
GIVEN = 1e-9  # of the flight: nearer to its ends than that, nothing moves that is not given


def steerable(s: Array) -> BoolArray:
    """Which instants (K,) of [0, 1] are far enough from the ends of the flight for anything to be changed."""
    return np.asarray((s > GIVEN) & (s < 1 - GIVEN))


def watching(nodes: Sampling, constraints: tuple[Constraint, ...], extra: Array) -> Sampling:
    """Return a sampling at nodes, at the ends of the constraints' windows as they are, and at ``extra`` instants."""
    ends = window_ends(constraints)
    return sample_also(nodes, np.union1d(extra, ends)) if extra.size or ends else nodes


@dataclass(frozen=True, eq=False)
class FlightProgram:
    """Minimise an objective subject to (14) and to the constraints, ``back_off`` inside, at instants of a sampling.

    ``combinations`` (r, e) of the e residuals at landing are the equalities; None for the residuals themselves.
    """

    model: FlightModel
    variables: DecisionVariables
    sampling: Sampling
    objective: Objective
    constraints: tuple[Constraint, ...] = ()
    back_off: float = BACK_OFF
    combinations: Array | None = None

    @property
    def metric(self) -> Array:
        """Steps of p by 1 rad, root mean square over time and joints, and of h by its whole reach, have length 1."""
        return self.variables.metric

    @cached_property
    def _watched(self) -> tuple[BoolArray, ...]:
        """Of each constraint, at which instants (K,) it applies; at the ends only where it changes."""
        inside = steerable(self.sampling.s)
        return tuple(
            np.asarray((inside | changes_at_ends(self.variables, block)) & applies(block, self.sampling.s))
            for block in self.constraints
        )

    @cached_property
    def _compiled(self) -> CompiledRows | None:
        """The rows by the kernel, where it can."""
        if not (self.constraints or isinstance(self.objective, IntegralOfSquares)):
            return None
        return compiled_rows(
            self.model, self.variables, self.sampling, self.constraints, self._watched, self.objective, self.back_off
        )

    def trajectory(self, x: Array) -> Trajectory:
        """Motion of x at the instants of the sampling."""
        return trajectory(self.model, self.variables, self.sampling, x)

    def evaluate(self, x: Array) -> Evaluation[Trajectory]:
        """Objective, (14) and constraints; their derivatives by x when asked for."""
        motion, rows = self.trajectory(x), self._compiled
        if rows:
            seen = rows.see(motion)
            return Evaluation(
                inequality=seen.values(),
                objective=self.objective.value(motion, x),
                equality=self._combined(motion.residual[0]),
                differentiate=lambda: rows.derivatives(motion, seen, x),
                detail=motion,
            )
        return Evaluation(
            objective=self.objective.value(motion, x),
            equality=self._combined(motion.residual[0]),
            inequality=self._inequality(motion),
            differentiate=lambda: Derivatives(
                self.objective.gradient(motion, x),
                self._combined(motion.residual_jacobian),
                self._inequality_jacobian(motion, len(x)),
            ),
            detail=motion,
        )

    def _combined(self, residual: Array) -> Array:
        """Equalities (r, ...) of residuals (e, ...)."""
        return residual if self.combinations is None else self.combinations @ residual

    def hessian(self, evaluation: Evaluation[Trajectory]) -> Array:
        """Return a positive definite first guess of the Lagrangian's Hessian at a point."""
        return self.objective.hessian(evaluation.detail)

    def _inequality(self, motion: Trajectory) -> Array:
        """The constraints at the instants that are watched."""
        if not self.constraints:
            return np.empty(0)
        watched = zip(self.constraints, self._watched, strict=True)
        return np.concatenate([(block.values(motion) - self.back_off)[instants].ravel() for block, instants in watched])

    def _inequality_jacobian(self, motion: Trajectory, size: int) -> Array:
        if not self.constraints:
            return np.empty((0, size))
        watched = zip(self.constraints, self._watched, strict=True)
        return np.concatenate([block.jacobian(motion)[instants].reshape(-1, size) for block, instants in watched])


def scaled(program: FlightProgram, x: Array) -> FlightProgram:
    """Return the program with equalities whose derivatives at x have rows orthogonal in the metric, of like size.

    By their singular values: in space some turns are much harder to make than others, and turns that nothing makes, as
    those out of the plane of a planar flight, are left out where they are not wanted either.
    """
    if program.model.flight.tangent == 1:
        return program
    motion = program.trajectory(x)
    by_step = motion.residual_jacobian @ np.linalg.inv(program.metric)
    sizes, turns = np.linalg.eigh(by_step @ by_step.T)
    sizes = np.sqrt(np.maximum(sizes, 0))
    largest = sizes[-1] or 1.0
    raised = largest / np.maximum(sizes, largest / MOST_RAISED)
    kept = (sizes > RANK * largest) | (np.abs(turns.T @ motion.residual[0]) > ORIENTATION)
    return replace(program, combinations=(turns * raised).T[kept])


def instants_beside_nodes(variables: DecisionVariables, constraints: tuple[Constraint, ...]) -> Array:
    """Instants, in [0, 1], to watch beside the quadrature nodes from the beginning: the ends, where they can change."""
    matter = any(changes_at_ends(variables, block) for block in constraints)
    return np.array([0.0, 1.0]) if matter else np.empty(0)


def changes_at_ends(variables: DecisionVariables, block: Constraint) -> bool:
    """Whether the values of a block at takeoff or landing depend on what the search chooses."""
    return bool(variables.chosen_at_ends & block.depends_at_ends_on)


def decision_variables(
    problem: Problem, degrees: tuple[int, ...], branches: IntArray, momentum: MomentumSet
) -> DecisionVariables:
    """Variables of a problem's motions, for arcsine branches (2, n) at takeoff and at landing."""
    conditions = boundary(problem, branches, momentum)
    polynomials = sine_polynomials(problem, degrees, conditions(momentum.centre))
    follows = momentum.free and (problem.initial.frame_rests or problem.final.frame_rests)
    return scaled_variables(problem, polynomials, momentum, conditions if follows else None)


def scaled_variables(
    problem: Problem, polynomials: SinePolynomials, momentum: MomentumSet, following: Boundary | None
) -> DecisionVariables:
    """Variables scaled for the problem's objective."""
    size = sum(polynomials.free)
    if problem.motion.objective == "coefficients" and size:
        return DecisionVariables(polynomials, *whitened_variables(polynomials), momentum, following)
    return DecisionVariables(polynomials, np.zeros(size), np.eye(size), momentum, following)


def objective(problem: Problem, model: FlightModel, variables: DecisionVariables, sampling: Sampling) -> Objective:
    """The problem's objective, scaled to 1 at the motion with no free part; (17) is scaled by its variables."""
    name = problem.motion.objective
    if name == "coefficients":
        return objective_term(name, variables)
    x = variables.plain_motion()
    value = objective_term(name, variables).value(trajectory(model, variables, sampling, x), x)
    return objective_term(name, variables, max(value, 1e-6))
