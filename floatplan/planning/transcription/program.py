"""Transcription: a flight with its constraints as a nonlinear program in a few well-scaled numbers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from floatplan.arrays import Array, BoolArray, IntArray
from floatplan.kernel.constraints import CompiledConstraints, MotionRows, RowTargets, compiled_constraints
from floatplan.motion.dynamics import FlightDynamics
from floatplan.optimization.nonlinear_program import Derivatives, Evaluation
from floatplan.planning.transcription.constraints import Constraint, applies, window_ends
from floatplan.planning.transcription.objectives import IntegralOfSquares, Objective
from floatplan.planning.transcription.trajectory import FlightModel, Sampling, Trajectory, sample_also, trajectory
from floatplan.planning.transcription.variables import DecisionVariables
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
        compiled = MotionRows(self._instants, motion.flown) if self._watch else None
        inequality = compiled.values() if compiled else np.empty(self._count)
        for block, target in self._others:
            inequality[target[target >= 0]] = (block.values(motion) - self.back_off)[target >= 0]

        def differentiate() -> Derivatives:
            return self._compiled_derivatives(motion, compiled, x) if compiled else self._derivatives(motion, x)

        equality = self._combined(motion.residual[0])
        return Evaluation(self.objective.value(motion, x), equality, inequality, differentiate, motion)

    def hessian(self, evaluation: Evaluation[Trajectory]) -> Array:
        """Return a positive definite first guess of the Lagrangian's Hessian at a point."""
        return self.objective.hessian(evaluation.detail)

    def _combined(self, residual: Array) -> Array:
        """Equalities (r, ...) of residuals (e, ...)."""
        return residual if self.combinations is None else self.combinations @ residual

    @cached_property
    def _watch(self) -> CompiledConstraints | None:
        """What computes rows, and the quantity of the objective, in the kernel; None in space."""
        quantity = self.objective.quantity if isinstance(self.objective, IntegralOfSquares) else ""
        return watch_of(self.model.flight, self.constraints, quantity)

    @cached_property
    def _others(self) -> list[tuple[Constraint, IntArray]]:
        """Constraints that the kernel does not know, and which rows are theirs."""
        known = self._watch.known if self._watch else (False,) * len(self.constraints)
        each = zip(self.constraints, self._targets, known, strict=True)
        return [(block, target) for block, target, is_known in each if not is_known]

    @cached_property
    def _instants(self) -> RowTargets:
        """Where the kernel puts the rows that it knows."""
        assert self._watch, "there is a kernel for them"
        known = [target for target, is_known in zip(self._targets, self._watch.known, strict=True) if is_known]
        nothing = np.empty((len(self.sampling.grid.s), 0), dtype=np.int64)
        target = np.concatenate((nothing, *known), axis=1)
        return RowTargets(self._watch, self.sampling.grid.s, target, self._count, self.back_off)

    def _with_others(self, motion: Trajectory, jacobian: Array) -> Array:
        """Put those derivatives (k, size) of all rows that the kernel does not know among the others."""
        for block, target in self._others:
            jacobian[target[target >= 0]] = block.jacobian(motion)[target >= 0]
        return jacobian

    def _derivatives(self, motion: Trajectory, x: Array) -> Derivatives:
        gradient, equality = self.objective.gradient(motion, x), self._combined(motion.residual_jacobian)
        return Derivatives(gradient, equality, self._with_others(motion, np.empty((self._count, len(x)))))

    def _compiled_derivatives(self, motion: Trajectory, compiled: MotionRows, x: Array) -> Derivatives:
        """Gradient, (14) and rows by x, after the values."""
        assert self._watch, "there is a kernel for them"
        drift = compiled.drift(motion.by_x, self.sampling.grid.nodes)
        slopes = drift[:, None, :]
        jacobian = compiled.jacobian(motion.flown.transport(slopes) if self._watch.needs_places else slopes)
        of_row = len(self.sampling.grid.s) * len(x)
        for rows in self._watch.differentiated:
            self.model.differentiated(of_row * rows)
        if isinstance(self.objective, IntegralOfSquares) and self._watch.also is not None:
            gradient = compiled.gradient(self.objective.weights(motion) @ self._watch.also)
            self.model.differentiated(of_row)
        else:
            gradient = self.objective.gradient(motion, x)
        equality = motion.duration * (self.sampling.grid.weights @ drift)[None]
        return Derivatives(gradient, equality, self._with_others(motion, jacobian))


@lru_cache(maxsize=16)
def watch_of(flight: FlightDynamics, constraints: tuple[Constraint, ...], also: str) -> CompiledConstraints | None:
    """Return what watches the constraints' rows, and the quantity ``also``; None in space."""
    return compiled_constraints(flight, [constraint.compiled() for constraint in constraints], also)


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
