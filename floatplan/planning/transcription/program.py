"""Transcription: a flight with its constraints as a nonlinear program in a few well-scaled numbers.

It minimises (17), or the time integral of a squared quantity. The search scales every objective to about 1 at a
sensible motion of its class; :func:`objective_value` is the user's own, by which motions of different classes compare.
"""

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TypeAlias

import numpy as np

from floatplan.arrays import Array, BoolArray, IntArray
from floatplan.kernel.tolerances import EXCHANGE
from floatplan.optimization.programs import Derivatives, Evaluation
from floatplan.planning.transcription.constraints import Constraint, applies, window_ends
from floatplan.planning.transcription.trajectory import (
    QUANTITIES,
    FlightModel,
    Sampling,
    Trajectory,
    sample_also,
    trajectory,
)
from floatplan.planning.transcription.variables import DecisionVariables
from floatplan.problem.problem import Problem
from floatplan.tables import OBJECTIVE_TABLE, ORIENTATION
from floatplan.tables import Objective as ObjectiveName

EXACT_LEVEL = -1  # of the grids: the finest, for the number that the user sees
RANK = 1e-7  # singular values below this, relative to the largest, are rounding
MOST_RAISED = 100.0  # by how much the equality hardest to change is scaled up against the easiest


@dataclass(frozen=True, eq=False)
class CoefficientNorm:
    """(17). The variables are whitened so that ``|b|^2 = least^2 + unit^2 |x|^2``: here ``|x|^2 / 2``.

    In space, where |b| is 1e3 to 1e5, x is z, and this is the mean square of p's free part.
    """

    coefficients: int

    def value(self, trajectory: Trajectory, x: Array) -> float:
        """Value."""
        coefficients = x[: self.coefficients]
        return float(coefficients @ coefficients) / 2

    def gradient(self, trajectory: Trajectory, x: Array) -> Array:
        """Gradient (size,) by x."""
        gradient = x.copy()
        gradient[self.coefficients :] = 0
        return gradient

    def hessian(self, trajectory: Trajectory) -> Array:
        """Return the identity, which is exact but for the entry of a free h."""
        return np.eye(trajectory.variables.size)


@dataclass(frozen=True, eq=False)
class IntegralOfSquares:
    """Integral over the flight of the square of a quantity, by its name, over the joints, divided by ``scale``."""

    quantity: str
    scale: float

    def value(self, trajectory: Trajectory, x: Array) -> float:
        """Value."""
        values = QUANTITIES[self.quantity].values(trajectory)[: trajectory.sampling.grid.nodes]
        return float((_time_weights(trajectory) / self.scale) @ (values**2).sum(axis=1))

    def gradient(self, trajectory: Trajectory, x: Array) -> Array:
        """Gradient (size,) by x."""
        by_quantity = trajectory.quantity_jacobian(self.quantity)[: trajectory.sampling.grid.nodes]
        return np.asarray(np.einsum("kr,krx->x", self.weights(trajectory), by_quantity))

    def weights(self, trajectory: Trajectory) -> Array:
        """Derivatives (N, r) by the quantity at the nodes."""
        values = QUANTITIES[self.quantity].values(trajectory)[: trajectory.sampling.grid.nodes]
        return np.asarray((2 / self.scale * _time_weights(trajectory))[:, None] * values)

    def hessian(self, trajectory: Trajectory) -> Array:
        """Gauss-Newton approximation, with the least curvature added."""
        weights = np.sqrt(2 * _time_weights(trajectory) / self.scale)
        by_quantity = trajectory.quantity_jacobian(self.quantity)[: trajectory.sampling.grid.nodes]
        rows = (weights[:, None, None] * by_quantity).reshape(-1, by_quantity.shape[2])
        hessian: Array = rows.T @ rows
        diagonal = hessian.diagonal()
        return hessian + EXCHANGE.least_curvature * max(
            float(diagonal.max(initial=0)), EXCHANGE.least_curvature
        ) * np.eye(len(hessian))


Objective: TypeAlias = CoefficientNorm | IntegralOfSquares  # a term to minimise


def objective_term(name: ObjectiveName, variables: DecisionVariables, scale: float = 1.0) -> Objective:
    """Return the row of the table of objectives as the search minimises it; integrals are divided by ``scale``."""
    quantity = OBJECTIVE_TABLE[name].quantity
    return CoefficientNorm(variables.coefficients) if quantity is None else IntegralOfSquares(quantity, scale)


def objective_value(name: ObjectiveName, motion: Trajectory, x: Array) -> float:
    """Value of the user's objective, in the unit that the table of objectives gives.

    It is computed as exactly for every class of motions, and knows nothing of the scaling of the variables x that the
    ``motion`` belongs to.
    """
    model, variables = motion.model, motion.variables
    if OBJECTIVE_TABLE[name].quantity is None:
        if model.flight.tangent > 1:
            return float(np.linalg.norm(x[: variables.coefficients]))
        motions = variables.motion_class(motion.angular_momentum)
        return float(np.linalg.norm(motions.powers_of_seconds(variables.free_coefficients(x))))
    exact = trajectory(model, variables, model.nodes(EXACT_LEVEL, variables.polynomials.form), x)
    return objective_term(name, variables).value(exact, x)


def _time_weights(trajectory: Trajectory) -> Array:
    return trajectory.duration * trajectory.sampling.grid.weights


def objective(problem: Problem, model: FlightModel, variables: DecisionVariables, sampling: Sampling) -> Objective:
    """The problem's objective, scaled to 1 at the motion with no free part; (17) is scaled by its variables."""
    name = problem.motion.objective
    if name == "coefficients":
        return objective_term(name, variables)
    x = variables.plain_motion
    value = objective_term(name, variables).value(trajectory(model, variables, sampling, x), x)
    return objective_term(name, variables, max(value, EXCHANGE.least_scale))


def steerable(s: Array) -> BoolArray:
    """Which instants (K,) of [0, 1] are far enough from the ends of the flight for anything to be changed."""
    return np.asarray((s > EXCHANGE.given) & (s < 1 - EXCHANGE.given))


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
    back_off: float = EXCHANGE.back_off
    combinations: Array | None = None

    @property
    def metric(self) -> Array:
        """Steps of p by 1 rad, root mean square over time and joints, and of h by its whole reach, have length 1."""
        return self.variables.metric

    @cached_property
    def _targets(self) -> tuple[IntArray, ...]:
        """Which of all rows those of each constraint are (K, r), instant by instant; negative where it does not apply.

        At the ends a constraint applies only where it changes.
        """
        targets, count, s = [], 0, self.sampling.grid.s
        for block in self.constraints:
            watched = (steerable(s) | changes_at_ends(self.variables, block)) & applies(block, s)
            shape = int(watched.sum()), len(block.labels)
            target = np.full((len(s), shape[1]), -1)
            target[watched] = count + np.arange(shape[0] * shape[1]).reshape(shape)
            targets.append(target)
            count += shape[0] * shape[1]
        return tuple(targets)

    @cached_property
    def _count(self) -> int:
        """Number of all rows."""
        return sum(int((target >= 0).sum()) for target in self._targets)

    def trajectory(self, x: Array) -> Trajectory:
        """Motion of x at the instants of the sampling."""
        return trajectory(self.model, self.variables, self.sampling, x)

    def evaluate(self, x: Array) -> Evaluation[Trajectory]:
        """Objective, (14) and constraints; their derivatives by x when asked for."""
        motion = self.trajectory(x)
        inequality = np.empty(self._count)
        for block, target in zip(self.constraints, self._targets, strict=True):
            inequality[target[target >= 0]] = (block.values(motion) - self.back_off)[target >= 0]
        equality, differentiate = self._combined(motion.residual), partial(self._derivatives, motion, x)
        return Evaluation(self.objective.value(motion, x), equality, inequality, differentiate, motion)

    def hessian(self, evaluation: Evaluation[Trajectory]) -> Array:
        """Return a positive definite first guess of the Lagrangian's Hessian at a point."""
        return self.objective.hessian(evaluation.detail)

    def _combined(self, residual: Array) -> Array:
        """Equalities (r, ...) of residuals (e, ...)."""
        return residual if self.combinations is None else self.combinations @ residual

    def _derivatives(self, motion: Trajectory, x: Array) -> Derivatives:
        jacobian = np.empty((self._count, len(x)))
        for block, target in zip(self.constraints, self._targets, strict=True):
            jacobian[target[target >= 0]] = block.jacobian(motion)[target >= 0]
        return Derivatives(self.objective.gradient(motion, x), self._combined(motion.residual_jacobian), jacobian)


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
    kept = (sizes > RANK * largest) | (np.abs(turns.T @ motion.residual) > ORIENTATION)
    return replace(program, combinations=(turns * raised).T[kept])


def instants_beside_nodes(variables: DecisionVariables, constraints: tuple[Constraint, ...]) -> Array:
    """Instants, in [0, 1], to watch beside the quadrature nodes from the beginning: the ends, where they can change."""
    matter = any(changes_at_ends(variables, block) for block in constraints)
    return np.array([0.0, 1.0]) if matter else np.empty(0)


def changes_at_ends(variables: DecisionVariables, block: Constraint) -> bool:
    """Whether the values of a block at takeoff or landing depend on what the search chooses."""
    return bool(variables.chosen_at_ends and variables.chosen_at_ends & block.depends_at_ends_on)
