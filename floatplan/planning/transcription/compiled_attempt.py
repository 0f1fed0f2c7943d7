"""Starts of a problem, followed to their ends by the kernel: ``starts.hpp``.

What crosses: the nodes of all levels, the class of motions of the start's variables, and the rows that are watched.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.compiled import attempts, tolerances
from floatplan.compiled.attempts import knots
from floatplan.compiled.batch import FINE, SPREADS, STATUS, constrained_settings, is_planar, powers_of_basis
from floatplan.compiled.constraints import CompiledConstraints, Watch
from floatplan.kernel.layout import Filled, Structure, constants
from floatplan.motion.dynamics import FlightDynamics
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.motion.flight import PlanarFlight, central_reach
from floatplan.motion.sine_polynomial import EDGE, basis, powers_map, whitening
from floatplan.planning.transcription import work
from floatplan.planning.transcription.constraints import Constraint, changes_at_ends, window_ends
from floatplan.planning.transcription.minima import Worst, where_to_look
from floatplan.planning.transcription.variables import Boundary, DecisionVariables
from floatplan.problem.problem import Problem
from floatplan.tables import OBJECTIVE_TABLE

REACH = 1.1  # of a row's scale: rows above have no derivatives, unless a step reaches them
LOOKED_AHEAD = 0.2  # the same, of a quadratic program's step: a look along it tells which others it reaches
VALUE_KEPT = 0.5  # of a row's value: where a whole step leaves so much, it does not reach the row
MOST_INSTANTS = 256  # beside the nodes
PROMISING = 1e-3  # sum of squared violations below which a motion is worth following to the objective
NEARLY_PROMISING = 0.1  # the same, below which a motion is watched more closely while it is made feasible
ELASTIC_STALLED = 0.95  # of the violation STALL_ITERATIONS elastic steps before: a hopeless search ends above it
CLOSER = 2  # levels of grids, by which constraints are watched more closely after the plain start
NEAR_MISS = 1e-3  # of violations, below which a motion that is not optimal is followed once more from its end
SAME = 1e-6  # relative difference of objectives, below which two attempts ended at the same motion
ENOUGH_WORK = 1e6  # [instants of one body] of starts that are followed together: about 0.02 s
MOMENTUM_FRACTIONS = (-1.0, 1.0, -0.5, 0.5, -0.25, 0.25, -0.75, 0.75)  # of the reach of h from its middle: plain starts
MOTIONS_PER_VARIABLE = 10  # random ones, of which a start violates least; fewer find worse plans of many joints
LEVEL_OF_DRAWS = 2  # of grids, where they are measured


class Ended(NamedTuple):
    """Where the best of some starts ended: x, its status, and the local minima of its rows, at the nodes of a level.

    Its motions land on a ``branch`` (n,) of the arcsine, against those of the start given. ``violation`` is the largest
    one of (14), rad, or of a row; 0 where everything holds. The attitude at landing lacks ``missed`` (e,), rad.
    ``starts`` were followed, in as many iterations and evaluations, and so much ``work``, instants of one body. Its
    ``coefficients`` (n, k+1) are b of (12), powers of t in seconds; None where accelerations at an end are free. An
    objective that is an ``integral`` has that value, others None. Asked first, the kernel says that rows hold at both
    ends which x does not change there, and that obstacles leave the path of the centre of mass clear.
    """

    x: Array
    branch: IntArray
    status: str
    violation: float
    missed: Array
    worst: Worst
    level: int
    iterations: int
    evaluations: int
    starts: int
    work: float
    coefficients: Array | None
    integral: float | None
    ends_hold: bool
    path_is_clear: bool


@dataclass(frozen=True, eq=False)
class Ready:
    """Starts of a problem, by number, ready to be followed: number 0 is ``plain``, others are drawn.

    ``given`` is what the kernel takes before it is told of the starts, the structures ``attempt`` and ``draws``. Those
    point to ``found``: x, the branch and the minima's row, s and least value; and to ``coefficients``, where b is
    wanted. ``kept`` is what else they point to.
    """

    compiled: CompiledAttempts
    plain: Array
    given: tuple[Any, ...]
    attempt: Any
    draws: Any
    found: tuple[Any, ...]
    coefficients: Array | None
    kept: Any

    def follow(self, numbers: range, most_work: float, seed: int, asks: bool) -> Ended:
        """Follow starts by number to their ends, one after the other, until one holds or has done much work.

        The first ends when it has done the most work, of others those are left out that would do more. Where it
        ``asks`` first whether start and goal, or the path of the centre of mass, leave a chance, and they do not, none
        is followed. Of no numbers, the plain motion is judged as it is.
        """
        attempt, kernel = self.attempt, self.compiled.watch.kernel
        self.found[0][:] = self.plain
        attempt.first, attempt.count, attempt.most_work = numbers.start, len(numbers), most_work
        attempt.reach = self.compiled.reach if asks else 0.0
        self.draws.seed = seed
        if self.compiled.watch.attempt(*self.given, attempt, self.draws, 1, kernel.instructions):
            raise MemoryError("no memory to follow a start")
        return self.ended

    def judge(self) -> Ended:
        """Judge the plain motion as it is."""
        return self.follow(range(0), np.inf, 0, asks=False)

    def values_at_ends(self) -> Array:
        """Values (rows, 2) of all rows at takeoff and at landing, with the attitude that is asked for there."""
        values = np.empty((self.compiled.watch.rows, 2))
        self.attempt.point_to(end_values=values)
        self.follow(range(0), np.inf, 0, asks=True)
        self.attempt.point_to(end_values=self.compiled.end_values)
        return values

    @property
    def ended(self) -> Ended:
        """Where the starts ended that were followed last."""
        attempt, rows = self.attempt, self.compiled.rows
        x, branch, *minima = self.found
        row, s, least = (each[: attempt.minima.found].copy() for each in minima)
        worst = Worst(rows[0][row], rows[1][row], s, least)
        of_end = (
            STATUS[attempt.status],
            attempt.violation,
            np.array(attempt.missed[: self.compiled.tangent]),
            worst,
            attempt.judged_level,
        )
        counts = attempt.iterations, attempt.evaluations, attempt.started, attempt.work
        b = None if self.coefficients is None else self.coefficients.copy()
        integral = attempt.objective if attempt.objective_sums else None
        chance = bool(attempt.ends_hold), bool(attempt.path_is_clear)
        return Ended(x.copy(), branch.copy(), *of_end, *counts, b, integral, *chance)


class CompiledAttempts:
    """A problem with constraints made ready for the kernel."""

    def __init__(self, problem: Problem, constraints: tuple[Constraint, ...], watch: Watch) -> None:
        self.in_plane, self.tangent = is_planar(watch.flight), watch.flight.tangent
        self._problem, self._constraints, self.watch = problem, constraints, watch
        self.rows, self._window_ends = where_to_look(constraints), window_ends(constraints)
        self._thickness = min((each.thickness for each in problem.obstacles), default=np.inf)
        self._look = self.rows[2]
        self._tolerance = np.array([block.tolerance for block in constraints])[self.rows[0]]
        self.minima, self._found = self.room(1)
        self.end_values = np.empty((watch.rows, 2))

    def room(self, count: int) -> tuple[Filled, list[Any]]:
        """Return room for the minima of so many problems, the first one's filled in: their row, s and least value."""
        look, most = self._look, len(self._look.grid) * self.watch.rows
        found = [np.empty((count, most), kind) for kind in (np.int64, np.float64, np.float64)]
        arrays = dict(zip(("row", "s", "least"), found, strict=True))
        return Filled("Minima", look, instants=len(look.grid), near=look.near, span=look.span, **arrays), found

    def ready(self, variables: DecisionVariables, x: Array, at_once: bool) -> Ready:
        """Make starts ready, of which x is number 0, followed ``at_once`` straight to the objective or not."""
        ended_at, branch = x.copy(), np.zeros(len(variables.polynomials.free), np.int64)
        given, attempt, motions = self.prepared(variables, ended_at, at_once)
        powers = powers_of_basis(variables.polynomials.form.bubbles)
        draws, coefficients = draws_of(variables, bool(self._constraints), branch), None
        if not variables.polynomials.free_ends:
            coefficients = np.empty((len(branch), CONDITIONS + variables.polynomials.width))
            attempt.point_to(coefficients=coefficients)
        found = ended_at, branch, *(each[0] for each in self._found)
        given, kept = (*given, powers.structure), (attempt, motions, powers, draws)
        return Ready(self, x, given, attempt.structure, draws.structure, found, coefficients, kept)

    def prepared(self, variables: DecisionVariables, x: Array, at_once: bool) -> tuple[tuple[Any, ...], Filled, Filled]:
        """Return what the kernel is given of a start, the start itself, which ends at x (size,), and its class."""
        watch = self.watch
        changes = [changes_at_ends(variables, block) for block in self._constraints]
        instants = sorted({*((0.0, 1.0) if any(changes) else ()), *self._window_ends})
        counts = {
            "bodies": watch.flight.bodies * (1.0 if self.in_plane else work.IN_KERNEL),
            "rows": watch.rows,
            "at_once": at_once,
        }
        counts |= {"fixed": len(instants), "entries": sum(watch.differentiated)}
        if watch.also is not None:
            counts |= {"objective_sum": watch.first_also, "objective_sums": len(watch.also)}
        arrays = {"at_ends": np.array(changes)[self.rows[0]], "instants": instants, "tolerance": self._tolerance}
        arrays |= {"x": x, "plain": variables.plain_motion, "coefficients": None, "end_values": self.end_values}
        attempt = Filled("Attempt", self._look, minima=self.minima, thickness=self._thickness, **counts, **arrays)
        motions = class_of_motions(watch.flight, variables, watch.also is None)
        rules = _rules(watch.flight.node_counts, watch.flight.bodies, self.in_plane)
        settings = constrained_settings(len(watch.flight.node_counts)), rules
        nodes, given = watch.nodes(variables.polynomials.form), watch.given(variables.momentum)
        return (*given, motions.structure, nodes, *settings), attempt, motions

    @cached_property
    def reach(self) -> float:
        """How far the point of the robot that stays nearest to the centre of mass is from it at most, m."""
        return central_reach(self._problem.robot) if self.in_plane else np.inf


def compiled_attempts(
    problem: Problem, flight: FlightDynamics, constraints: tuple[Constraint, ...]
) -> CompiledAttempts:
    """Make a problem ready."""
    quantity = OBJECTIVE_TABLE[problem.motion.objective].quantity or ""
    blocks = [constraint.compiled(flight) for constraint in constraints]
    if is_planar(flight):
        return CompiledAttempts(problem, constraints, CompiledConstraints(flight, blocks, quantity))
    from floatplan.compiled.in_space import SpatialConstraints  # here, since most problems do without

    return CompiledAttempts(problem, constraints, SpatialConstraints(flight, blocks, quantity))


def draws_of(variables: DecisionVariables, constrained: bool, branch: IntArray) -> Filled:
    """How starts are drawn, and where the branch goes; where nothing is constrained, h is not tried first."""
    numbers = {"level": LEVEL_OF_DRAWS, "random": MOTIONS_PER_VARIABLE * variables.size, "spreads": SPREADS}
    fraction = MOMENTUM_FRACTIONS if constrained else ()
    return Filled("Draws", variables, fractions=len(fraction), fraction=fraction, branch=branch, **numbers)


@lru_cache(maxsize=32)
def cheap_level(node_counts: tuple[int, ...], bodies: int) -> int:
    """Level of grids up to which fewer nodes would hardly be faster."""
    return max((level for level, count in enumerate(node_counts) if count * bodies <= tolerances.CHEAP), default=0)


@lru_cache(maxsize=8)
def _rules(node_counts: tuple[int, ...], bodies: int, in_plane: bool) -> Structure:
    """Every number of the search with constraints: the constant of its name."""
    modules = attempts, tolerances, work
    others: dict[str, Any] = {"cheap_level": cheap_level(node_counts, bodies), "longest_free_step": FINE.longest_step}
    if not in_plane:
        others |= {"solving": work.SOLVING_IN_SPACE, "entry": work.IN_KERNEL * work.ENTRY}
        others |= {"closer": 0, "watched_at_most": len(node_counts) - 1}
    return constants("Exchange", *map(vars, modules), globals(), **others)


@lru_cache(maxsize=64)
def class_of_motions(flight: FlightDynamics, variables: DecisionVariables, of_coefficients: bool) -> Filled:
    """The class of motions of the variables; where h moves conditions (13), with the map to (17) if that is wanted."""
    polynomials, momentum, following = variables.polynomials, variables.momentum, variables.following
    form, series = polynomials.form, basis(polynomials.form).series
    given = form.given
    condition = [given.index(each) if each in given else -1 for each in range(CONDITIONS)]
    map_ = None
    if of_coefficients and following is not None:
        map_ = powers_map(form, polynomials.duration) / whitening(form, (polynomials.duration,))[3]
    ends = [_end(following, end, momentum.centre) if following else _GIVEN for end in (0, 1)]
    of_base = {
        "orientation": 0.0,
        "change": 0.0,
        "momentum": 0.0,
        "axis": np.zeros(momentum.free),
    }  # in space: the body's
    if isinstance(flight, PlanarFlight):
        h = {"momentum": float(momentum.centre[0]), "axis": momentum.axes.ravel()}
        of_base = {"orientation": flight.initial_orientation, "change": flight.change, **h}
    return Filled(
        "Motions",
        variables,
        polynomials,
        size=variables.size,
        axes=momentum.free,
        columns=series.shape[2],
        given=len(given),
        terms=series.shape[1],
        duration=polynomials.duration,
        **of_base,
        first=list(accumulate(polynomials.free, initial=0)),
        condition=condition,
        boundary=polynomials.given_boundary,
        series=series,
        map=map_,
        start=ends[0],
        goal=ends[1],
    )


_GIVEN = Filled("End", knots=0, momenta=None, rates=None, curvature=None, bend=None)


def _end(following: Boundary, end: int, middle: Array) -> Filled:
    """How the conditions (13) at one end follow h."""
    momenta = knots(following.rates, end)
    if not len(momenta):
        return _GIVEN
    p, _, curvature = following(middle)[:, 3 * end : 3 * end + 3].T
    rates = np.array([following(np.array([h]))[:, 3 * end + 1] for h in momenta.tolist()])
    at_middle = following(middle)[:, 3 * end + 1]
    movable = (np.abs(np.cos(p)) > EDGE) & ~following.free[end]
    bend = np.where(movable, np.tan(p), 0.0)
    curvature = curvature - bend * at_middle**2
    return Filled("End", knots=len(rates), momenta=momenta, rates=rates, curvature=curvature, bend=bend)
