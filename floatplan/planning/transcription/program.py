"""Transcription: a flight with its constraints as a nonlinear program in a few well-scaled numbers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from floatplan.arrays import Array, BoolArray
from floatplan.kernel.constraints import ByX, CompiledConstraints, MotionRows, RowTargets, SumRows, compiled_constraints
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
    def _watched(self) -> tuple[BoolArray, ...]:
        """Of each constraint, at which instants (K,) it applies; at the ends only where it changes."""
        inside = steerable(self.sampling.s)
        return tuple(
            np.asarray((inside | changes_at_ends(self.variables, block)) & applies(block, self.sampling.s))
            for block in self.constraints
        )

    def trajectory(self, x: Array) -> Trajectory:
        """Motion of x at the instants of the sampling."""
        return trajectory(self.model, self.variables, self.sampling, x)

    def evaluate(self, x: Array) -> Evaluation[Trajectory]:
        """Objective, (14) and constraints; their derivatives by x when asked for."""
        motion = self.trajectory(x)
        compiled = MotionRows(self._instants, motion.flown) if self._watch else None

        def differentiate() -> Derivatives:
            return self._compiled_derivatives(motion, compiled, x) if compiled else self._derivatives(motion, x)

        inequality = compiled.values() if compiled else self._inequality(motion)
        equality = self._combined(motion.residual[0])
        return Evaluation(self.objective.value(motion, x), equality, inequality, differentiate, motion)

    def hessian(self, evaluation: Evaluation[Trajectory]) -> Array:
        """Return a positive definite first guess of the Lagrangian's Hessian at a point."""
        return self.objective.hessian(evaluation.detail)

    def _combined(self, residual: Array) -> Array:
        """Equalities (r, ...) of residuals (e, ...)."""
        return residual if self.combinations is None else self.combinations @ residual

    def _inequality(self, motion: Trajectory) -> Array:
        """The constraints at the instants that are watched."""
        watched = zip(self.constraints, self._watched, strict=True)
        rows = [(block.values(motion) - self.back_off)[instants].ravel() for block, instants in watched]
        return np.concatenate([np.empty(0), *rows])

    def _derivatives(self, motion: Trajectory, x: Array) -> Derivatives:
        watched = zip(self.constraints, self._watched, strict=True)
        rows = [block.jacobian(motion)[instants].reshape(-1, len(x)) for block, instants in watched]
        gradient, equality = self.objective.gradient(motion, x), self._combined(motion.residual_jacobian)
        return Derivatives(gradient, equality, np.concatenate([np.empty((0, len(x))), *rows]))

    @cached_property
    def _watch(self) -> CompiledConstraints | None:
        """What computes rows, and the quantity of the objective, in the kernel; None where it does not know them."""
        quantity = self.objective.quantity if isinstance(self.objective, IntegralOfSquares) else ""
        return None if self.variables.following else watch_of(self.model.flight, self.constraints, quantity)

    @cached_property
    def _instants(self) -> RowTargets:
        """Rows of each constraint together, instant by instant, those of the next after them."""
        assert self._watch, "there is a kernel for them"
        wanted = np.full((len(self.sampling.s), self._watch.rows), -1)
        column = count = 0
        for constraint, watched in zip(self.constraints, self._watched, strict=True):
            rows, instants = len(constraint.labels), int(watched.sum())
            wanted[watched, column : column + rows] = count + np.arange(instants * rows).reshape(instants, rows)
            column += rows
            count += instants * rows
        return RowTargets(self._watch, self.sampling.s, wanted, count, self.back_off)

    @cached_property
    def _by_x(self) -> ByX:
        """The basis of p combined as x combines it, joint by joint."""
        variables, sampling = self.variables, self.sampling
        free, scaling = variables.polynomials.free, variables.scaling
        columns = np.cumsum([0, *free])
        basis = np.zeros((3, len(sampling.s), variables.size))
        for derivative, values in enumerate(sampling.values):
            for joint, width in enumerate(free):
                own = slice(columns[joint], columns[joint + 1])
                first = sampling.given
                np.matmul(values[:, first : first + width], scaling[own, own], out=basis[derivative, :, own])
        return ByX(basis, columns, np.ascontiguousarray(variables.momentum.axes.ravel()))

    @cached_property
    def _sums(self) -> Array:
        """The quantity of an integral as the kernel's sums (r, terms)."""
        assert self._watch, "there is a kernel for them"
        assert isinstance(self.objective, IntegralOfSquares), "the others have none"
        width = self._watch.widths[self.objective.quantity]
        return self._watch.sums(SumRows(np.zeros(width), {self.objective.quantity: np.eye(width)}))

    def _compiled_derivatives(self, motion: Trajectory, compiled: MotionRows, x: Array) -> Derivatives:
        """Gradient, (14) and rows by x, after the values."""
        assert self._watch, "there is a kernel for them"
        drift = compiled.drift(self._by_x, self.sampling.nodes)
        slopes = drift[:, None, :]
        jacobian = compiled.jacobian(motion.flown.transport(slopes) if self._watch.needs_places else slopes)
        of_row = len(self.sampling.s) * len(x)
        for rows in self._watch.differentiated:
            self.model.differentiated(of_row * rows)
        if isinstance(self.objective, IntegralOfSquares):
            gradient = compiled.gradient(self.objective.weights(motion) @ self._sums)
            self.model.differentiated(of_row)
        else:
            gradient = self.objective.gradient(motion, x)
        return Derivatives(gradient, motion.duration * (self.sampling.weights @ drift)[None], jacobian)


@lru_cache(maxsize=16)
def watch_of(flight: FlightDynamics, constraints: tuple[Constraint, ...], also: str) -> CompiledConstraints | None:
    """Return what watches the constraints' rows, and the quantity ``also``; None where the kernel does not know one."""
    blocks = [block for constraint in constraints if (block := constraint.compiled())]
    return compiled_constraints(flight, blocks, also) if len(blocks) == len(constraints) else None


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
