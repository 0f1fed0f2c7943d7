"""Starts of a problem, followed to their ends by the kernel: ``starts.hpp``.

What crosses: the nodes of all levels, the class of motions of the start's variables, and the rows that are watched.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import accumulate
from typing import Any

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.compiled.attempts import STATUS, is_planar, knots, powers_of_basis, search_settings
from floatplan.compiled.constraints import CompiledConstraints, Watch
from floatplan.kernel.structs import Pointer, Struct, doubles, integers
from floatplan.kernel.tolerances import EXCHANGE, EXCHANGE_IN_SPACE, WORK_IN_SPACE
from floatplan.motion.dynamics import FlightDynamics
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.flight import PlanarFlight, central_reach
from floatplan.motion.sine_polynomial import EDGE, basis, powers_map, whitening
from floatplan.planning.transcription.constraints import Constraint, changes_at_ends, window_ends
from floatplan.planning.transcription.minima import Worst, where_to_look
from floatplan.planning.transcription.result import AttemptResult
from floatplan.planning.transcription.variables import Boundary, DecisionVariables
from floatplan.planning.transcription.work import FlightModel
from floatplan.problem.problem import Problem
from floatplan.tables import OBJECTIVE_TABLE

MOMENTUM_FRACTIONS = (-1.0, 1.0, -0.5, 0.5, -0.25, 0.25, -0.75, 0.75)  # of the reach of h from its middle: plain starts
MOTIONS_PER_VARIABLE = 10  # [-] random ones, of which a start violates least; fewer find worse plans of many joints
LEVEL_OF_DRAWS = 2  # of grids, where they are measured
SPREADS = (0.1, 0.2, 0.4, 0.8, 1.6, 3.2)  # [rad] standard deviations of random motions, in turn
CHEAP = 192  # [-] bodies times nodes, below which the time of an evaluation hardly depends on them
EXPIRED = -1.0  # [instants of one body] of work that may be done: the start is judged as it is, and not followed


@dataclass(frozen=True, eq=False)
class MinimaArrays:
    """Where the kernel writes the local minima of rows: number of the row, s, and value, (most,) or (count, most)."""

    row: IntArray
    s: Array
    least: Array

    @classmethod
    def empty(cls, *shape: int) -> MinimaArrays:
        """Return room for so many."""
        return cls(row=np.empty(shape, np.int64), s=np.empty(shape), least=np.empty(shape))

    def __getitem__(self, problem: int) -> MinimaArrays:
        """Those of one of the problems."""
        return MinimaArrays(row=self.row[problem], s=self.s[problem], least=self.least[problem])


@dataclass(frozen=True, eq=False)
class Inputs:
    """What the kernel reads of a problem, as pointers to structs.

    Attributes
    ----------
    flying : the robot; in space the body, with its angular momentum, and the cells of all levels
    constraints, motions, levels, settings, rules
    """

    flying: tuple[Pointer, ...]
    constraints: Pointer
    motions: Pointer
    levels: Pointer
    settings: Pointer
    rules: Pointer


@dataclass(frozen=True, eq=False)
class PreparedStarts:
    """Starts of a problem, by number, as the kernel follows them: number 0 is ``plain``, others are drawn.

    Attributes
    ----------
    compiled : CompiledProblem
    variables : DecisionVariables
    plain : (size,)
        The x of start number 0.
    inputs : Inputs
    powers, attempt, draws : pointers to structs
    x, branch, minima, coefficients : arrays
        Where the kernel writes the best motion; no coefficients where accelerations at an end are free.
    kept : whatever else must live as long
    """

    compiled: CompiledProblem
    variables: DecisionVariables
    plain: Array
    inputs: Inputs
    powers: Pointer
    attempt: Pointer
    draws: Pointer
    x: Array
    branch: IntArray
    minima: MinimaArrays
    coefficients: Array | None
    kept: Any

    def follow(self, numbers: range, most_work: float, seed: int, *, asks: bool = False, expired: bool = False) -> None:
        """Follow starts by number to their ends, one after the other, until one holds or has done much work.

        Parameters
        ----------
        numbers : of the starts
        most_work : instants of one body
            The first start ends when it has done it, of others those are left out that would do more.
        seed : of the starts that are drawn
        asks : whether to look first if start and goal, and the path of the centre of mass, leave a chance
            Where they do not, none is followed.
        expired : whether there is no time left: the first start is judged as it is
        """
        attempt, inputs, watch = self.attempt, self.inputs, self.compiled.watch
        self.x[:] = self.plain
        attempt.first = numbers.start
        attempt.count = len(numbers)
        attempt.wanted = 0
        attempt.most_work = EXPIRED if expired else most_work
        attempt.reach = self.compiled.reach if asks else 0.0
        self.draws.seed = seed
        no_memory = watch.attempt(
            *inputs.flying,
            inputs.constraints,
            inputs.motions,
            inputs.levels,
            inputs.settings,
            inputs.rules,
            self.powers,
            attempt,
            self.draws,
            1,
            watch.kernel.instructions,
        )
        if no_memory:
            raise MemoryError("no memory to follow a start")

    def judge(self) -> None:
        """Judge the plain motion as it is."""
        self.follow(range(0), np.inf, 0)

    def values_at_ends(self) -> Array:
        """Values (rows, 2) of all rows at takeoff and landing, with the attitudes that are asked for there."""
        self.follow(range(0), np.inf, 0, asks=True)
        return self.compiled.end_values.copy()

    @property
    def ends_hold(self) -> bool:
        """Whether the kernel was asked, and rows that x does not change at the ends hold there."""
        return bool(self.attempt.ends_hold)

    @property
    def path_is_clear(self) -> bool:
        """Whether the kernel was asked, and obstacles leave the path of the centre of mass clear."""
        return bool(self.attempt.path_is_clear)

    @property
    def _known_coefficients(self) -> Array | None:
        """Coefficients b of the best start; None where they may be of another x: without rows, of what is no plan."""
        is_known = self.attempt.rows > 0 or self.attempt.violation <= 0
        return self.coefficients.copy() if self.coefficients is not None and is_known else None

    def result(self, problem: Problem, model: FlightModel) -> AttemptResult:
        """Return the best of the starts that were followed last."""
        attempt, minima = self.attempt, self.minima
        blocks, rows, _ = self.compiled.rows
        found = attempt.minima.found
        row = minima.row[:found]
        missed = list(attempt.missed)[: model.flight.tangent]
        worst = Worst(block=blocks[row], row=rows[row], s=minima.s[:found].copy(), value=minima.least[:found].copy())
        return AttemptResult(
            problem=problem,
            start_variables=self.variables,
            model=model,
            x=self.x.copy(),
            status=STATUS[attempt.status],
            iterations=attempt.iterations,
            evaluations=attempt.evaluations,
            level=attempt.judged_level,
            violation=attempt.violation,
            worst=worst,
            missed=np.array(missed),
            work=attempt.work,
            starts=attempt.started,
            solved=max(attempt.solved, 1),
            coefficients=self._known_coefficients,
            integral=attempt.objective if attempt.objective_sums else None,
            branch=self.branch.copy() if any(self.branch.tolist()) else None,
        )


class CompiledProblem:
    """A problem as the kernel takes it, whatever the class of motions."""

    def __init__(self, problem: Problem, constraints: tuple[Constraint, ...], watch: Watch) -> None:
        self._problem = problem
        self._is_planar = is_planar(watch.flight)
        self._constraints = constraints
        self.watch = watch
        self.rows = where_to_look(constraints)
        self._window_ends = window_ends(constraints)
        self._thickness = min((obstacle.thickness for obstacle in problem.obstacles), default=np.inf)
        blocks, _, look = self.rows
        self._look = look
        self._low = doubles(look.low)
        self._high = doubles(look.high)
        self._tolerance = doubles(np.array([block.tolerance for block in constraints])[blocks])
        self.most_minima = len(look.grid) * watch.rows
        self._arrays = MinimaArrays.empty(self.most_minima)
        self.minima = self.minima_struct(self._arrays)
        self.end_values = np.empty((watch.rows, 2))  # written by whichever start asks first

    def minima_struct(self, arrays: MinimaArrays) -> Struct:
        """Return where the kernel looks for minima of rows, and writes those of one problem."""
        look = self._look
        return Struct(
            "Minima",
            instants=len(look.grid),
            near=look.near,
            span=look.span,
            grid=doubles(look.grid),
            low=self._low,
            high=self._high,
            row=arrays.row,
            s=arrays.s,
            least=arrays.least,
        )

    def starts(self, variables: DecisionVariables, x: Array, at_once: bool) -> PreparedStarts:
        """Prepare starts of which x is number 0, followed ``at_once`` straight to the objective or not."""
        best = x.copy()
        branch = np.zeros(len(variables.polynomials.free), np.int64)
        attempt = self.attempt_struct(variables, best, at_once)
        inputs, motions = self.inputs(variables)
        powers = powers_of_basis(basis(variables.polynomials.form).bubbles)
        draws = self.draws_struct(variables, branch)
        coefficients = None
        if not variables.polynomials.free_ends:
            coefficients = np.empty((len(branch), CONDITIONS + variables.polynomials.width))
            attempt.point_to(coefficients=coefficients)
        return PreparedStarts(
            compiled=self,
            variables=variables,
            plain=x,
            inputs=inputs,
            powers=powers.pointer,
            attempt=attempt.pointer,
            draws=draws.pointer,
            x=best,
            branch=branch,
            minima=self._arrays,
            coefficients=coefficients,
            kept=(attempt, motions, powers, draws),
        )

    def attempt_struct(self, variables: DecisionVariables, x: Array, at_once: bool) -> Struct:
        """Return a start as the kernel takes it: it begins at x (size,), and writes the best end there."""
        watch = self.watch
        changes = [changes_at_ends(variables, block) for block in self._constraints]
        instants = sorted({*((0.0, 1.0) if any(changes) else ()), *self._window_ends})
        blocks, _, _ = self.rows
        return Struct(
            "Attempt",
            rows=watch.rows,
            at_once=at_once,
            objective_sum=0 if watch.also is None else watch.first_also,
            objective_sums=0 if watch.also is None else len(watch.also),
            bodies=watch.flight.bodies * (1.0 if self._is_planar else WORK_IN_SPACE),
            entries=sum(watch.differentiated),
            thickness=self._thickness,
            plain=doubles(variables.plain_motion),
            end_values=self.end_values,
            low=self._low,
            high=self._high,
            tolerance=self._tolerance,
            at_ends=integers(np.array(changes)[blocks]),
            instants=doubles(instants),
            fixed=len(instants),
            minima=self.minima,
            x=x,
            coefficients=None,
        )

    def draws_struct(self, variables: DecisionVariables, branch: IntArray) -> Struct:
        """How starts are drawn, and where the branch goes; where nothing is constrained, h is not tried first."""
        fraction = MOMENTUM_FRACTIONS if self._constraints else ()
        offset_map = variables.offset_map
        return Struct(
            "Draws",
            level=LEVEL_OF_DRAWS,
            random=MOTIONS_PER_VARIABLE * variables.size,
            spreads=SPREADS,
            fractions=len(fraction),
            fraction=doubles(fraction),
            offset_map=None if offset_map is None else doubles(offset_map),
            branch=branch,
        )

    def inputs(self, variables: DecisionVariables) -> tuple[Inputs, Struct]:
        """Return what the kernel reads of a class of motions, and that class, which must live as long."""
        watch = self.watch
        flight = watch.flight
        motions = motions_struct(flight, variables, watch.also is None)
        inputs = Inputs(
            flying=watch.flying(variables.momentum),
            constraints=watch.struct.pointer,
            motions=motions.pointer,
            levels=watch.nodes(variables.polynomials.form).pointer,
            settings=search_settings(bool(self._constraints) or not self._is_planar, len(flight.node_counts)).pointer,
            rules=_rules(flight.node_counts, flight.bodies, self._is_planar).pointer,
        )
        return inputs, motions

    @cached_property
    def reach(self) -> float:
        """How far the point of the robot that stays nearest to the centre of mass is from it at most, m."""
        return central_reach(self._problem.robot) if self._is_planar else np.inf


def compiled_problem(problem: Problem, flight: FlightDynamics, constraints: tuple[Constraint, ...]) -> CompiledProblem:
    """Return a problem as the kernel takes it."""
    quantity = OBJECTIVE_TABLE[problem.motion.objective].quantity or ""
    blocks = [constraint.compiled(flight) for constraint in constraints]
    if is_planar(flight):
        return CompiledProblem(problem, constraints, CompiledConstraints(flight, blocks, quantity))
    from floatplan.compiled.in_space import SpatialConstraints  # here, since most problems do without

    return CompiledProblem(problem, constraints, SpatialConstraints(flight, blocks, quantity))


@lru_cache(maxsize=32)
def cheap_level(node_counts: tuple[int, ...], bodies: int) -> int:
    """Level of grids up to which fewer nodes would hardly be faster."""
    return max((level for level, count in enumerate(node_counts) if count * bodies <= CHEAP), default=0)


@lru_cache(maxsize=8)
def _rules(node_counts: tuple[int, ...], bodies: int, in_plane: bool) -> Struct:
    """Return every number of the search with constraints."""
    cheap = cheap_level(node_counts, bodies)
    if in_plane:
        return Struct.of_numbers(replace(EXCHANGE, cheap_level=cheap))
    finest = len(node_counts) - 1
    return Struct.of_numbers(replace(EXCHANGE_IN_SPACE, cheap_level=cheap, watched_at_most=finest))


@lru_cache(maxsize=64)
def motions_struct(flight: FlightDynamics, variables: DecisionVariables, of_coefficients: bool) -> Struct:
    """The class of motions of the variables; where h moves conditions (13), with the map to (17) if that is wanted."""
    polynomials, momentum, following = variables.polynomials, variables.momentum, variables.following
    form = polynomials.form
    series = basis(form).series
    given = basis(form).given
    columns = [given.index(condition) if condition in given else -1 for condition in range(CONDITIONS)]
    coefficient_map = None
    if of_coefficients and following is not None:
        unit = whitening(form, (polynomials.duration,))[3]
        coefficient_map = doubles(powers_map(form, polynomials.duration) / unit)
    # In space the attitudes at both ends and the angular momentum are the body's.
    orientation = change = middle = 0.0
    axis = np.zeros(momentum.free)
    if isinstance(flight, PlanarFlight):
        orientation = flight.initial_orientation
        change = flight.change
        middle = float(momentum.centre[0])
        axis = doubles(momentum.axes.ravel())
    return Struct(
        "Motions",
        size=variables.size,
        axes=momentum.free,
        columns=series.shape[2],
        given=len(given),
        terms=series.shape[1],
        duration=polynomials.duration,
        orientation=orientation,
        change=change,
        momentum=middle,
        axis=axis,
        centre=doubles(polynomials.centre),
        amplitude=doubles(polynomials.amplitude),
        first=integers(list(accumulate(polynomials.free, initial=0))),
        condition=integers(columns),
        boundary=doubles(polynomials.given_boundary),
        offset=doubles(variables.offset),
        scaling=doubles(variables.scaling),
        series=doubles(series),
        map=coefficient_map,
        start=_end(following, 0, momentum.centre),
        goal=_end(following, 1, momentum.centre),
    )


def _end(following: Boundary | None, end: int, middle: Array) -> Struct | None:
    """How the conditions (13) at one end follow h; None where they do not."""
    if following is None:
        return None
    momenta = knots(following.rates, end)
    if not len(momenta):
        return None
    p, _, curvature = following(middle)[:, 3 * end : 3 * end + 3].T
    rates = np.array([following(np.array([h]))[:, 3 * end + 1] for h in momenta.tolist()])
    at_middle = following(middle)[:, 3 * end + 1]
    movable = (np.abs(np.cos(p)) > EDGE) & ~following.free[end]
    bend = np.where(movable, np.tan(p), 0.0)
    curvature = curvature - bend * at_middle**2
    return Struct(
        "End",
        knots=len(rates),
        momenta=doubles(momenta),
        rates=doubles(rates),
        curvature=doubles(curvature),
        bend=doubles(bend),
    )
