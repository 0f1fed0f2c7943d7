"""Plans without inequalities for many problems of one robot: arrays in, arrays out; see ``numbers.py``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache, lru_cache
from typing import Any, TypeAlias

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.compiled import tolerances
from floatplan.compiled.bodies import Bodies, filled_grid, filled_robot
from floatplan.compiled.tolerances import Settings
from floatplan.kernel.layout import (
    ENUMERATIONS,
    STRUCTURES,
    Filled,
    Kernel,
    Structure,
    address,
    constants,
    kernel,
    structure_array,
)
from floatplan.motion.dynamics import FlightDynamics
from floatplan.motion.exact_polynomials import CONDITIONS, basis_columns, compensations
from floatplan.motion.planar import flight
from floatplan.motion.planar.flight import PlanarFlight
from floatplan.motion.quadrature import NODE_COUNTS
from floatplan.problem.problem import Problem
from floatplan.robot.planar.tree import PlanarTree
from floatplan.robot.robot import Robot
from floatplan.tables import ORIENTATION

# Of every search, compiled or not.
QUADRATURE_ERROR = 1e-13  # rad, of the attitude at landing, at which the nodes are enough
NEARLY_RESOLVED = 1e-6  # rad, error of the attitude at landing that nodes may leave before the last stage
COARSELY_RESOLVED = 0.02  # what the nodes may miss of the motion, relative to its size
UNRESOLVED = 1e-6  # the same of a plan: its square is lost
MOST_ROUNDS = 24
MOST_ITERATIONS = 240  # in all rounds together
HOPELESS = 0.1  # of violation after the coarse search: then the fine one would be wasted
COARSE = Settings(feasibility=1e-6, optimality=1e-5, iterations=50)
ROUGH = replace(COARSE, feasibility=1e-2, optimality=1e-1)
FINE = Settings(feasibility=1e-9, optimality=1e-9, iterations=80)
CAUTIOUS = replace(FINE, longest_step=0.2)  # with obstacles a long step lands beyond them
EASY_ITERATIONS = 40  # [-] of a plain start: with fewer of them other starts promise little
WANTED_AFTER_FAILURE = 4  # [-] solutions to choose from where the plain start did not converge quickly
SPREADS = (0.1, 0.2, 0.4, 0.8, 1.6, 3.2)  # of random motions
# Of the compiled one alone.
FINER = 2  # levels of grids, from one to the next with twice the nodes
USUAL_NODES = 128  # grids of more are made where they are needed
FIRST_LEVEL = 2  # of grids: with fewer nodes the search is hardly faster, and ends elsewhere more often
LEVEL_OF_STARTS = 1  # of grids
MOST_STARTS = 65  # [-] the plain one, and random ones
CANDIDATES = 12  # for starts, from which those are followed that promise most
FOLLOWED = 6
SPREADS_OF_STARTS = (0.2, 0.4, 0.8, 1.6, 0.8, 1.6)  # of random motions; beyond, few of them lead anywhere
RANKED_ROUNDS = 2  # where all of these fail, what promises little is followed too
STEP_TO_RANK = 1.0  # rad, root mean square of p
STEPS_TO_RANK = 3
CHANGED_BRANCHES = 0.8  # [-] of the joints of a candidate, where not all branches are candidates
HOPELESS_WAY = 30.0  # rad, root mean square of p: a start from which (14), were it linear, is farther away is left
STARTS_TO_AGREE = 16  # [-] after so many a problem is given up, where
AGREEING = 4  # [-] of them came equally near to (14), and none nearer:
AGREEMENT = 0.003  # [-] relative difference of what is left of it
TOO_WILD = 0.3  # what these nodes may miss of a random motion, relative to its size
NODES_OF_LEVELS = np.array(NODE_COUNTS, dtype=np.int64)
INFEASIBLE, FEASIBLE, OPTIMAL, NEEDS_GRID = ENUMERATIONS["Status"]
STATUS: dict[int, str] = {INFEASIBLE: "infeasible", FEASIBLE: "feasible", OPTIMAL: "optimal"}


def nearly_resolved(settings: Settings) -> Settings:
    """Return the settings of the stage before the last."""
    return replace(settings, feasibility=NEARLY_RESOLVED)


@dataclass(frozen=True)
class Search:
    """How many starts to follow, and how.

    Attributes
    ----------
    starts : solved starts to choose the best from
    most_starts : starts tried, those before ``first_start`` included
    seed : of the random ones
    longest_step : of the solver, see :class:`floatplan.compiled.tolerances.Settings`
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


class Solver:
    """The compiled solver for a tree, joint ranges and degrees."""

    def __init__(self, kernel: Kernel, tree: PlanarTree, position_limits: Array, free: Sequence[int]) -> None:
        self._kernel = kernel
        self._n, self._width = len(free), max(free)
        self.bodies = len(tree.mass)
        self._most_nodes = USUAL_NODES
        low, high = position_limits.T
        self._robot = filled_robot(Bodies(tree, (low + high) / 2, (high - low) / 2), free)

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
        count, n, width = len(rows.duration), self._n, self._width
        shapes = {"branch": (n,), "z": (n, width), "coefficients": (n, CONDITIONS + width)}
        kinds = {name: STRUCTURES["Batch"].arrays[name][0] for name in Answers.__annotations__}
        made: Any = {name: np.zeros((count, *shapes.get(name, ())), kind) for name, kind in kinds.items()}
        answers = Answers(**made)
        batch, powers, compiled = Filled("Batch", rows, answers, count=count), powers_of_basis(width), self._kernel
        given = self._robot.structure, *_grids(width, most_nodes), powers.structure, _settings(search), batch.structure
        if compiled.plan(*given, compiled.instructions):
            raise MemoryError("no memory for a batch of plans")
        return answers


@lru_cache(maxsize=32)
def _grids(width: int, most_nodes: int) -> tuple[Any, int]:
    """Grids of all levels, those of too many nodes left out; and where their numbers of nodes are."""
    grids = [filled_grid(width, count) if count <= most_nodes else None for count in NODE_COUNTS]
    return structure_array("Grid", grids), address(NODES_OF_LEVELS)


@cache
def powers_of_basis(width: int) -> Filled:
    """Return what b is written with, of motions with so many free polynomials."""
    columns, columns_low = _doubles(basis_columns(width))
    lost, lost_low = _doubles(compensations(CONDITIONS + width))
    return Filled("Powers", columns=columns, columns_low=columns_low, lost=lost, lost_low=lost_low)


def _doubles(fractions: Any) -> tuple[Array, Array]:
    """Fractions as sums of two doubles."""
    high = fractions.astype(np.float64)
    exact = np.array([Fraction(value) for value in high.ravel().tolist()], dtype=object).reshape(high.shape)
    return high, (fractions - exact).astype(np.float64)


Steps: TypeAlias = tuple[tuple[Settings, float], ...]  # and the error of the attitude that their nodes may leave, rad


@lru_cache(maxsize=32)
def _settings(search: Search) -> Structure:
    """Every number of the search: the constant of its name here, or in the solver of programs with constraints."""
    fine = replace(FINE, longest_step=search.longest_step)
    steps: Steps = ((ROUGH, NEARLY_RESOLVED), (nearly_resolved(fine), NEARLY_RESOLVED), (fine, QUADRATURE_ERROR))
    return _numbers(search, steps)


@cache
def constrained_settings(levels: int = len(NODE_COUNTS)) -> Structure:
    """Return those of a search with constraints on so many levels of grids; first and last stages are these."""
    coarse, fine = (COARSE, QUADRATURE_ERROR), (CAUTIOUS, QUADRATURE_ERROR)
    return _numbers(Search(longest_step=CAUTIOUS.longest_step), (coarse, fine, fine), levels)


def _numbers(search: Search, steps: Steps, levels: int = len(NODE_COUNTS)) -> Structure:
    stages = tuple((each.feasibility, each.optimality, error, each.iterations) for each, error in steps)
    others = {**vars(search), "tolerance": ORIENTATION, "levels": levels, "stages": stages}
    return constants("Settings", vars(tolerances), vars(flight), globals(), **others)


def is_planar(flight: FlightDynamics) -> bool:
    """Whether a flight is one in a plane, as the kernel's are."""
    return isinstance(flight, PlanarFlight)


def solver(problem: Problem, degrees: tuple[int, ...]) -> Solver:
    """Return the compiled solver for a problem's robot and joint ranges."""
    return _solver(problem.robot, tuple(map(tuple, problem.position_limits.tolist())), degrees)


@lru_cache(maxsize=32)
def _solver(robot: Robot, ranges: tuple[tuple[float, float], ...], degrees: tuple[int, ...]) -> Solver:
    return Solver(kernel(), robot.tree, np.array(ranges), [degree - 5 for degree in degrees])
