"""Plans without inequalities for many problems of one robot: arrays in, arrays out; see ``numbers.py``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache, lru_cache
from typing import Any

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.compiled.bodies import Bodies, grid_struct, robot_struct
from floatplan.kernel.library import Kernel, kernel
from floatplan.kernel.structs import FFI, Struct, StructArray, doubles, enumeration
from floatplan.motion.dynamics import FlightDynamics
from floatplan.motion.exact_polynomials import CONDITIONS, basis_columns, compensations
from floatplan.motion.planar.flight import PlanarFlight
from floatplan.motion.quadrature import NODE_COUNTS
from floatplan.optimization.programs import Settings
from floatplan.problem.problem import Problem
from floatplan.robot.planar.tree import PlanarTree
from floatplan.robot.robot import Robot
from floatplan.tolerances import COARSE as COARSE_STAGE
from floatplan.tolerances import CONSTRAINED_SETTINGS, NEARLY_RESOLVED, SETTINGS, Stage
from floatplan.tolerances import FINE as FINE_STAGE
from floatplan.tolerances import ROUGH as ROUGH_STAGE


def solver_settings(stage: Stage, *, longest_step: float = SETTINGS.longest_step, polish: bool = True) -> Settings:
    """Return the settings of the solver in Python for a stage of a search."""
    return Settings(stage.feasibility, stage.optimality, stage.iterations, longest_step, polish)


COARSE = solver_settings(COARSE_STAGE, polish=False)
ROUGH = solver_settings(ROUGH_STAGE, polish=False)
FINE = solver_settings(FINE_STAGE)
CAUTIOUS = solver_settings(FINE_STAGE, longest_step=CONSTRAINED_SETTINGS.longest_step)
USUAL_NODES = 128  # [-] grids of more are made where they are needed
NODES_OF_LEVELS = np.array(NODE_COUNTS, dtype=np.int64)
INFEASIBLE, FEASIBLE, OPTIMAL, NEEDS_GRID = enumeration("Status")
STATUS: dict[int, str] = {INFEASIBLE: "infeasible", FEASIBLE: "feasible", OPTIMAL: "optimal"}


def nearly_resolved(settings: Settings) -> Settings:
    """Return the settings of the stage before the last."""
    return replace(settings, feasibility=NEARLY_RESOLVED, polish=False)


@dataclass(frozen=True)
class Search:
    """How many starts to follow, and how.

    Attributes
    ----------
    starts : solved starts to choose the best from
    most_starts : starts tried, those before ``first_start`` included
    seed : of the random ones
    longest_step : of the solver, see :class:`floatplan.optimization.programs.Settings`
    first_start : number of the first that is followed
    """

    starts: int = 1
    most_starts: int = 1
    seed: int = 0
    longest_step: float = FINE.longest_step
    first_start: int = 0


@dataclass(frozen=True, eq=False)
class Rows:
    """Problems: ``duration`` (N,) s, ``momentum`` (N,) kg m^2/s, ``change`` (N,) of the orientation, rad.

    ``boundary`` (N, n, 6) of :class:`~floatplan.motion.sine_polynomial.SinePolynomials`; ``start`` (N, n, width), the z
    to begin from, None for zeros.
    """

    duration: Array
    momentum: Array
    change: Array
    boundary: Array
    start: Array | None = None

    def __getitem__(self, rows: Any) -> Rows:
        """Some of the problems."""
        start = None if self.start is None else self.start[rows]
        return Rows(self.duration[rows], self.momentum[rows], self.change[rows], self.boundary[rows], start)


@dataclass(frozen=True, eq=False)
class Answers:
    """Of N problems, each the best start's, or the nearest motion found.

    Attributes
    ----------
    status : (N,) INFEASIBLE, FEASIBLE or OPTIMAL
    iterations, evaluations, instants, starts, solved : (N,) int
        Of all starts together; ``instants`` are the nodes of all evaluations.
    branch : (N, n) int
        Of the arcsine at landing, against that of the boundary given.
    objective : (N,) |b|
    residual : (N,) rad, of (14) with twice the nodes; infinite where these do not resolve the motion
    z : (N, n, width), coefficients : (N, n, 6+width)
    """

    status: IntArray
    iterations: IntArray
    evaluations: IntArray
    instants: IntArray
    starts: IntArray
    solved: IntArray
    branch: IntArray
    objective: Array
    residual: Array
    z: Array
    coefficients: Array

    @classmethod
    def empty(cls, count: int, joints: int, width: int) -> Answers:
        """Return room for so many problems."""
        return cls(
            status=np.zeros(count, np.int64),
            iterations=np.zeros(count, np.int64),
            evaluations=np.zeros(count, np.int64),
            instants=np.zeros(count, np.int64),
            starts=np.zeros(count, np.int64),
            solved=np.zeros(count, np.int64),
            branch=np.zeros((count, joints), np.int64),
            objective=np.zeros(count),
            residual=np.zeros(count),
            z=np.zeros((count, joints, width)),
            coefficients=np.zeros((count, joints, CONDITIONS + width)),
        )


class Solver:
    """The compiled solver for a tree, joint ranges and degrees."""

    def __init__(self, kernel: Kernel, tree: PlanarTree, position_limits: Array, free: Sequence[int]) -> None:
        self._kernel = kernel
        self._n, self._width = len(free), max(free)
        self.bodies = len(tree.mass)
        self._most_nodes = USUAL_NODES
        low, high = position_limits.T
        self._robot = robot_struct(Bodies(tree, (low + high) / 2, (high - low) / 2), free)

    def plan(self, rows: Rows, search: Search) -> Answers:
        """Plan a batch; the answer to a row depends on that row and on the search alone."""
        answers = self._plan(rows, search, self._most_nodes)
        again = np.flatnonzero(answers.status == NEEDS_GRID)
        if again.size:
            self._most_nodes = NODE_COUNTS[-1]
            better = self._plan(rows[again], search, NODE_COUNTS[-1])
            for name, values in vars(answers).items():
                values[again] = getattr(better, name)
        return answers

    def _plan(self, rows: Rows, search: Search, most_nodes: int) -> Answers:
        count = len(rows.duration)
        answers = Answers.empty(count, self._n, self._width)
        batch = Struct(
            "Batch",
            count=count,
            duration=doubles(rows.duration),
            momentum=doubles(rows.momentum),
            change=doubles(rows.change),
            boundary=doubles(rows.boundary),
            start=None if rows.start is None else doubles(rows.start),
            **vars(answers),
        )
        compiled = self._kernel
        no_memory = compiled.plan(
            self._robot.pointer,
            _grids(self._width, most_nodes).pointer,
            FFI.from_buffer("Index[]", NODES_OF_LEVELS),
            powers_of_basis(self._width).pointer,
            _settings(search).pointer,
            batch.pointer,
            compiled.instructions,
        )
        if no_memory:
            raise MemoryError("no memory for a batch of plans")
        return answers


@lru_cache(maxsize=32)
def _grids(width: int, most_nodes: int) -> StructArray:
    """Grids of all levels, those of too many nodes left out."""
    return StructArray("Grid", [grid_struct(width, count) if count <= most_nodes else None for count in NODE_COUNTS])


@cache
def powers_of_basis(width: int) -> Struct:
    """Return what b is written with, of motions with so many free polynomials."""
    columns, columns_low = _doubles(basis_columns(width))
    lost, lost_low = _doubles(compensations(CONDITIONS + width))
    return Struct("Powers", columns=columns, columns_low=columns_low, lost=lost, lost_low=lost_low)


def _doubles(fractions: Any) -> tuple[Array, Array]:
    """Fractions as sums of two doubles."""
    high = fractions.astype(np.float64)
    exact = np.array([Fraction(value) for value in high.ravel().tolist()], dtype=object).reshape(high.shape)
    return high, (fractions - exact).astype(np.float64)


@lru_cache(maxsize=32)
def _settings(search: Search) -> Struct:
    """Return every number of a search without inequalities."""
    return Struct.of_numbers(replace(SETTINGS, **vars(search), levels=len(NODE_COUNTS)))


@cache
def search_settings(constrained: bool) -> Struct:
    """Return every number of a search, with inequalities or without."""
    return Struct.of_numbers(replace(CONSTRAINED_SETTINGS if constrained else SETTINGS, levels=len(NODE_COUNTS)))


def is_planar(flight: FlightDynamics) -> bool:
    """Whether a flight is one in a plane, as the kernel's are."""
    return isinstance(flight, PlanarFlight)


def solver(problem: Problem, degrees: tuple[int, ...]) -> Solver:
    """Return the compiled solver for a problem's robot and joint ranges."""
    return _solver(problem.robot, tuple(map(tuple, problem.position_limits.tolist())), degrees)


@lru_cache(maxsize=32)
def _solver(robot: Robot, ranges: tuple[tuple[float, float], ...], degrees: tuple[int, ...]) -> Solver:
    return Solver(kernel(), robot.tree, np.array(ranges), [degree - 5 for degree in degrees])
