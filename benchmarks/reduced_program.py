"""Flights in a plane as programs in NumPy, for other solvers and tests; and the kernel's quadratic programs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, Generic, NamedTuple, TypeAlias, TypeVar

import numpy as np
from sampled_flight import (
    QUANTITIES,
    Sampling,
    Trajectory,
    jacobian_of,
    nodes_of,
    sample_also,
    trajectory,
    values_of,
)

from floatplan.arrays import Array, BoolArray, IntArray
from floatplan.kernel.library import kernel
from floatplan.kernel.structs import Struct, doubles
from floatplan.kernel.tolerances import EXCHANGE
from floatplan.planning.constraints import Constraint, RowTable, applies
from floatplan.planning.variables import DecisionVariables
from floatplan.problem.problem import Problem
from floatplan.tables import OBJECTIVE_TABLE
from floatplan.tables import Objective as ObjectiveName

Detail = TypeVar("Detail")
EXACT_LEVEL = -1  # of the grids: the finest, for the number that the user sees


class Derivatives(NamedTuple):
    """Of a program at a point: ``gradient`` (m,), ``equality_jacobian`` (e, m), ``inequality_jacobian`` (k, m)."""

    gradient: Array
    equality_jacobian: Array
    inequality_jacobian: Array


@dataclass(eq=False)  # not frozen, for its speed: there is one per evaluation
class Evaluation(Generic[Detail]):
    """A program at a point of m variables; the derivatives are computed when asked for.

    ``equality`` (e,), ``inequality`` (k,) with >= 0 wanted. ``detail`` is what the program remembers of the point.
    """

    objective: float
    equality: Array
    inequality: Array
    differentiate: Callable[[], Derivatives]
    detail: Detail

    @cached_property
    def _derivatives(self) -> Derivatives:
        return self.differentiate()

    @property
    def gradient(self) -> Array:
        """Gradient (m,) of the objective."""
        return self._derivatives.gradient

    @property
    def equality_jacobian(self) -> Array:
        """Derivatives (e, m) of the equalities."""
        return self._derivatives.equality_jacobian

    @property
    def inequality_jacobian(self) -> Array:
        """Derivatives (k, m) of the inequalities."""
        return self._derivatives.inequality_jacobian

    @cached_property
    def violation(self) -> float:
        """Sum of what the constraints lack."""
        return total_violation(self.equality, self.inequality)

    @cached_property
    def worst_violation(self) -> float:
        """Largest amount by which one constraint fails."""
        worst = max(map(abs, self.equality.tolist()), default=0.0)
        return max(worst, -float(self.inequality.min())) if self.inequality.size else worst


def total_violation(equality: Array, inequality: Array) -> float:
    """Sum of what equalities (e,) and inequalities (k,) lack."""
    violation: float = sum(map(abs, equality.tolist()))
    return violation - float(np.minimum(inequality, 0).sum()) if inequality.size else violation


AnyEvaluation: TypeAlias = Evaluation[Any]  # whose detail does not matter


class Multipliers(NamedTuple):
    """Lagrange multipliers ``equality`` (e,) and ``inequality`` (k,) >= 0 of a program."""

    equality: Array
    inequality: Array

    @property
    def largest(self) -> float:
        """The largest magnitude."""
        largest = max(map(abs, self.equality.tolist()), default=0.0)
        return max(largest, float(self.inequality.max())) if self.inequality.size else largest


class Step(NamedTuple):
    """Solution of a QP."""

    direction: Array
    multipliers: Multipliers


def dual_step(current: AnyEvaluation, hessian: Array) -> Step | None:
    """Make violated rows active one by one: None where rows contradict one another, or it takes too many changes."""
    size, equalities = len(hessian), len(current.equality)
    count = len(current.inequality)
    rows = -(-count // 8) * 8
    inequality = np.full(rows, np.inf)
    inequality[:count] = current.inequality
    packs = np.zeros((rows, size))
    packs[:count] = current.inequality_jacobian
    active = np.empty(size, dtype=np.int64)
    solution = np.empty(2 * size + equalities)
    program = Struct(
        "Quadratic",
        size=size,
        equalities=equalities,
        rows=rows,
        changes=EXCHANGE.qp_changes,
        tolerance=EXCHANGE.qp_tolerance,
        hessian=doubles(hessian),
        gradient=doubles(current.gradient),
        equality=doubles(current.equality),
        equality_rows=doubles(current.equality_jacobian),
        inequality=inequality,
        inequality_rows=doubles(packs.reshape(-1, 8, size).swapaxes(1, 2)),
        active=active,
        solution=solution,
    )
    compiled = kernel()
    if not compiled.quadratic(program.pointer, compiled.instructions):
        return None
    found = program.pointer.count
    multipliers = np.zeros(count)
    multipliers[active[:found]] = solution[size + equalities : size + equalities + found]
    return Step(solution[:size], Multipliers(solution[size : size + equalities], multipliers))


@dataclass(frozen=True, eq=False)
class CoefficientNorm:
    """(17). The variables are whitened so that ``|b|^2 = least^2 + unit^2 |x|^2``: here ``|x|^2 / 2``."""

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
    flight, variables = motion.flight, motion.variables
    if OBJECTIVE_TABLE[name].quantity is None:
        motions = variables.motion_class(motion.angular_momentum)
        return float(np.linalg.norm(motions.powers_of_seconds(variables.free_coefficients(x))))
    exact = trajectory(flight, variables, nodes_of(EXACT_LEVEL, variables.polynomials.form), x)
    return objective_term(name, variables).value(exact, x)


def _time_weights(trajectory: Trajectory) -> Array:
    return trajectory.duration * trajectory.sampling.grid.weights


def objective(problem: Problem, flight: Any, variables: DecisionVariables, sampling: Sampling) -> Objective:
    """The problem's objective, scaled to 1 at the motion with no free part; (17) is scaled by its variables."""
    name = problem.motion.objective
    if name == "coefficients":
        return objective_term(name, variables)
    x = variables.nominal_motion
    value = objective_term(name, variables).value(trajectory(flight, variables, sampling, x), x)
    return objective_term(name, variables, max(value, EXCHANGE.least_scale))


def steerable(s: Array) -> BoolArray:
    """Which instants (K,) of [0, 1] are far enough from the ends of the flight for anything to be changed."""
    return np.asarray((s > EXCHANGE.near_end) & (s < 1 - EXCHANGE.near_end))


def watching(nodes: Sampling, constraints: tuple[Constraint, ...], extra: Array) -> Sampling:
    """Return a sampling at nodes, at the ends of the constraints' windows as they are, and at ``extra`` instants."""
    ends = RowTable.of(constraints).window_ends
    return sample_also(nodes, np.union1d(extra, ends)) if extra.size or ends else nodes


@dataclass(frozen=True, eq=False)
class FlightProgram:
    """Minimise an objective subject to (14) and to the constraints, ``back_off`` inside, at instants of a sampling."""

    flight: Any
    variables: DecisionVariables
    sampling: Sampling
    objective: Objective
    constraints: tuple[Constraint, ...] = ()
    back_off: float = EXCHANGE.back_off

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
            changes_at_ends = bool(self.variables.chosen_at_ends & block.depends_at_ends_on)
            watched = (steerable(s) | changes_at_ends) & applies(block, s)
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
        return trajectory(self.flight, self.variables, self.sampling, x)

    def evaluate(self, x: Array) -> Evaluation[Trajectory]:
        """Objective, (14) and constraints; their derivatives by x when asked for."""
        motion = self.trajectory(x)
        inequality = np.empty(self._count)
        for block, target in zip(self.constraints, self._targets, strict=True):
            inequality[target[target >= 0]] = (values_of(block, motion) - self.back_off)[target >= 0]
        equality, differentiate = motion.residual, partial(self._derivatives, motion, x)
        return Evaluation(self.objective.value(motion, x), equality, inequality, differentiate, motion)

    def hessian(self, evaluation: Evaluation[Trajectory]) -> Array:
        """Return a positive definite first guess of the Lagrangian's Hessian at a point."""
        return self.objective.hessian(evaluation.detail)

    def _derivatives(self, motion: Trajectory, x: Array) -> Derivatives:
        jacobian = np.empty((self._count, len(x)))
        for block, target in zip(self.constraints, self._targets, strict=True):
            jacobian[target[target >= 0]] = jacobian_of(block, motion)[target >= 0]
        return Derivatives(self.objective.gradient(motion, x), motion.residual_jacobian, jacobian)
