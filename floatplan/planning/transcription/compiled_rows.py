"""The rows of a program by the compiled kernel, where it knows them all; the constraints themselves do the same."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from floatplan.arrays import Array, BoolArray, IntArray
from floatplan.kernel.constraints import (
    Block,
    ByX,
    CompiledConstraints,
    Look,
    MotionRows,
    ObstacleRows,
    PairRows,
    RowTargets,
    SumRows,
    compiled_constraints,
    minima,
)
from floatplan.motion.dynamics import FlightDynamics
from floatplan.optimization.nonlinear_program import Derivatives
from floatplan.planning.transcription.constraints import (
    LENGTH_SCALE,
    Constraint,
    LinkClearance,
    MagnitudeLimit,
    MotorLimit,
    ObstacleClearance,
    window_ends,
)
from floatplan.planning.transcription.objectives import IntegralOfSquares, Objective
from floatplan.planning.transcription.quantities import QUANTITIES, Quantity
from floatplan.planning.transcription.trajectory import FlightModel, Sampling, Trajectory
from floatplan.planning.transcription.variables import DecisionVariables


def block_of(constraint: Constraint) -> Block | None:
    """A constraint as the kernel takes it; None for one that it does not know."""
    if isinstance(constraint, ObstacleClearance):
        return ObstacleRows(constraint.obstacle, constraint.least, LENGTH_SCALE)
    if isinstance(constraint, LinkClearance):
        return PairRows(constraint.first, constraint.second, constraint.least, LENGTH_SCALE)
    if isinstance(constraint, MagnitudeLimit):
        weights = constraint.combinations / constraint.limit[:, None]
        return SumRows(np.ones(2 * len(weights)), {_name(constraint.quantity): np.concatenate((-weights, weights))})
    if isinstance(constraint, MotorLimit):
        motors = len(constraint.motors)
        torque = np.zeros((motors, max(constraint.motors) + 1))
        torque[np.arange(motors), list(constraint.motors)] = 1 / constraint.stall
        drag = (constraint.slope / constraint.stall)[:, None] * constraint.ratios
        return SumRows(
            np.ones(4 * motors),
            {
                "motor_torques": np.concatenate((-torque, -torque, torque, torque)),
                "velocities": np.concatenate((-drag, drag, -drag, drag)),
            },
        )
    return None


def _name(quantity: Quantity) -> str:
    return next(name for name, known in QUANTITIES.items() if known is quantity)


@lru_cache(maxsize=16)
def watch_of(flight: FlightDynamics, constraints: tuple[Constraint, ...], also: str) -> CompiledConstraints | None:
    """Return what watches the constraints' rows, and the quantity ``also``; None where the kernel does not know one."""
    blocks = [block_of(constraint) for constraint in constraints]
    known = [block for block in blocks if block is not None]
    return compiled_constraints(flight, known, also) if len(known) == len(blocks) else None


@dataclass(frozen=True, eq=False)
class CompiledRows:
    """A program's rows, each where it is watched: ``watched`` (K,) of each constraint."""

    watch: CompiledConstraints
    variables: DecisionVariables
    sampling: Sampling
    constraints: tuple[Constraint, ...]
    watched: tuple[BoolArray, ...]
    objective: Objective
    back_off: float

    @cached_property
    def _instants(self) -> RowTargets:
        """Rows of each constraint together, instant by instant, those of the next after them."""
        wanted = np.full((len(self.sampling.s), self.watch.rows), -1)
        column = count = 0
        for constraint, watched in zip(self.constraints, self.watched, strict=True):
            rows, instants = len(constraint.labels), int(watched.sum())
            wanted[watched, column : column + rows] = count + np.arange(instants * rows).reshape(instants, rows)
            column += rows
            count += instants * rows
        return RowTargets(self.watch, self.sampling.s, wanted, count, self.back_off)

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
        """The quantity of the objective as the kernel's sums (r, terms)."""
        assert isinstance(self.objective, IntegralOfSquares), "the others have none"
        name = _name(self.objective.quantity)
        width = self.watch.widths[name]
        return self.watch.sums(SumRows(np.zeros(width), {name: np.eye(width)}))

    @cached_property
    def _entries(self) -> list[int]:
        """Entries of each constraint's Jacobian, but for rows that are only the opposite of others."""
        instants, size = len(self.sampling.s), self.variables.size
        lengths = [len(block.labels) for block in self.constraints]
        own = np.split(self.watch.differentiated, np.cumsum(lengths)[:-1])
        return [instants * int(rows.sum()) * size for rows in own]

    def see(self, motion: Trajectory) -> MotionRows:
        """Look at a motion: its rate is known afterwards."""
        return MotionRows(self._instants, motion.flown)

    def derivatives(self, motion: Trajectory, seen: MotionRows, x: Array) -> Derivatives:
        """Gradient, (14) and rows by x, after the values."""
        sampling, duration = self.sampling, motion.duration
        drift = seen.drift(self._by_x, sampling.nodes)
        motion.__dict__["residual_jacobian"] = duration * (sampling.weights @ drift)[None]
        slopes = motion.flown.transport(drift[:, None, :]) if self.watch.needs_places else drift[:, None, :]
        jacobian = seen.jacobian(slopes)
        for entries in self._entries:
            motion.model.work.differentiated(entries)
        if isinstance(self.objective, IntegralOfSquares):
            gradient = seen.gradient(self.objective.weights(motion) @ self._sums)
            motion.model.work.differentiated(len(sampling.s) * len(x))
        else:
            gradient = self.objective.gradient(motion, x)
        return Derivatives(gradient, motion.residual_jacobian, jacobian)


def compiled_rows(
    model: FlightModel,
    variables: DecisionVariables,
    sampling: Sampling,
    constraints: tuple[Constraint, ...],
    watched: tuple[BoolArray, ...],
    objective: Objective,
    back_off: float,
) -> CompiledRows | None:
    """Return a program's rows by the kernel; None where it cannot."""
    also = _name(objective.quantity) if isinstance(objective, IntegralOfSquares) else ""
    found = None if variables.following else watch_of(model.flight, constraints, also)
    if found is None:
        return None
    return CompiledRows(found, variables, sampling, constraints, watched, objective, back_off)


def first_instants(count: int, ends: tuple[float, ...]) -> Array:
    """Instants of a first look: a grid, and the ends of windows."""
    return np.union1d(np.linspace(0, 1, count), ends)


@lru_cache(maxsize=16)
def _look(constraints: tuple[Constraint, ...], count: int) -> tuple[IntArray, IntArray, Look]:
    """Block and row (rows,) of each of the kernel's rows, and where to look."""
    lengths = [len(block.labels) for block in constraints]
    block = np.repeat(np.arange(len(lengths)), lengths)
    low, high = np.array([each.window for each in constraints])[block].T
    look = Look(first_instants(count, window_ends(constraints)), np.ascontiguousarray(low), np.ascontiguousarray(high))
    return block, np.concatenate([np.arange(length) for length in lengths]), look


def compiled_minima(
    motion: Trajectory, constraints: tuple[Constraint, ...], count: int, near: float
) -> tuple[IntArray, IntArray, Array, Array]:
    """Find the local minima below ``near`` of the constraints' rows, from a first look at so many instants.

    Returned are block, row, s and value (L,).
    """
    found = watch_of(motion.model.flight, constraints, "")
    assert found is not None, "there is a kernel for them"
    block, rows, look = _look(constraints, count)
    row, s, value, looked = minima(found, motion.flown, motion.variables.polynomials, look, near, 1 / (count - 1))
    bodies, work = motion.model.flight.bodies, motion.model.work
    work.evaluated(motion.sampling.nodes + len(look.grid), bodies)
    work.evaluated(looked, bodies, len(row))
    return block[row], rows[row], s, value
