"""A problem as the kernel takes it, for a class of motions; ``starts.hpp`` solves it from many starts.

What crosses: the nodes of all levels, the class of motions of the start's variables, and the rows of inequalities.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache, lru_cache
from itertools import accumulate
from typing import Any, TypeAlias

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.kernel.library import kernel
from floatplan.kernel.structs import Struct, StructArray, doubles, enumeration, integers
from floatplan.kernel.tolerances import Exchange, Settings, near_recorded
from floatplan.motion.exact_polynomials import CONDITIONS, basis_columns, compensations
from floatplan.motion.flight import EndRates
from floatplan.motion.sine_polynomial import EDGE, basis, powers_map
from floatplan.planning.constraints import RowTable
from floatplan.planning.kernel_input.rows import KernelRows
from floatplan.planning.result import AttemptResult, Worst
from floatplan.planning.spec import FlightSpec
from floatplan.planning.variables import Boundary, DecisionVariables, Start, scale
from floatplan.problem.problem import Problem
from floatplan.tables import ORIENTATION

Status = enumeration("Status")
# Of the reach of h from its middle: nominal starts.
MOMENTUM_FRACTIONS = (-1.0, 1.0, -0.5, 0.5, -0.25, 0.25, -0.75, 0.75)
AnyStruct: TypeAlias = Any  # a Struct, StructArray, or one of these: what has a pointer


@dataclass(frozen=True, eq=False)
class KernelProblem:
    """A problem as the kernel takes it, for the class of motions of a start, which is number 0; others are random.

    Attributes
    ----------
    rows : KernelRows
        With the kernel's functions.
    table : RowTable
    start : Start
    constraints, motions, search, sampling : structs of the problem
    levels, settings, rules, powers : structs that other problems share
    x, branch, coefficients : (size,), (n,), (n, k+1)
        Where the kernel writes the best motion, with b of (12); that is None where accelerations at an end are free.
    minima : three arrays (most,)
        Where it writes the local minima of rows: number of the row, s, and value; ``minima_struct`` points to them.
    end_values : (rows, 2)
        Where it writes the values of rows at takeoff and landing, on request.
    """

    rows: KernelRows
    table: RowTable
    start: Start
    constraints: AnyStruct
    motions: AnyStruct
    search: AnyStruct
    sampling: AnyStruct
    levels: StructArray
    settings: Struct
    rules: Struct
    powers: Struct
    x: Array
    branch: IntArray
    coefficients: Array | None
    minima: tuple[IntArray, Array, Array]
    minima_struct: Struct
    end_values: Array

    @classmethod
    def of(cls, spec: FlightSpec, start: Start) -> KernelProblem:
        """Fill the structs."""
        rows = spec.rows
        table = RowTable.of(spec.constraints)
        variables = start.variables
        polynomials = variables.polynomials
        x = start.x.copy()
        branch = np.zeros(len(polynomials.free), np.int64)
        coefficients = None
        if not polynomials.free_ends:
            coefficients = np.empty((len(branch), CONDITIONS + polynomials.width))
        most = len(table.grid) * rows.rows
        minima = np.empty(most, np.int64), np.empty(most), np.empty(most)
        end_values = np.empty((rows.rows, 2))
        minima_struct = Struct(
            "Minima",
            instants=len(table.grid),
            near=table.near,
            span=table.span,
            grid=doubles(table.grid),
            low=doubles(table.low),
            high=doubles(table.high),
            row=minima[0],
            s=minima[1],
            value=minima[2],
        )
        # Where nothing is constrained, other h are not tried first.
        fractions = MOMENTUM_FRACTIONS if spec.constraints else ()
        sampling = Struct(
            "SamplingOptions",
            level=2,  # of grids, where random motions are measured
            # Of so many random motions a start violates least; fewer find worse plans of many joints.
            random=10 * variables.size,
            spreads=(0.1, 0.2, 0.4, 0.8, 1.6, 3.2),  # [rad] standard deviations of these, cyclically
            fractions=len(fractions),
            fraction=doubles(fractions),
            offset_map=None if variables.offset_map is None else doubles(variables.offset_map),
            branch=branch,
        )
        of_rows = near_recorded(rows.rules) if variables.has_reference else rows.rules
        settings, rules = _numbers_of_search(rows.settings, of_rows, rows.node_counts, rows.bodies)
        of_coefficients = spec.problem.motion.objective == "coefficients"
        return cls(
            rows=rows,
            table=table,
            start=start,
            constraints=rows.struct,
            motions=motions_struct(spec.problem, variables, of_coefficients),
            search=_search_problem(
                spec, table, start, minima_struct, end_values=end_values, x=x, coefficients=coefficients
            ),
            sampling=sampling,
            levels=rows.nodes(polynomials.form),
            settings=settings,
            rules=rules,
            powers=powers_of_basis(basis(polynomials.form).bubbles),
            x=x,
            branch=branch,
            coefficients=coefficients,
            minima=minima,
            minima_struct=minima_struct,
            end_values=end_values,
        )

    def call(self, count: int = 1) -> None:
        """Have the kernel follow starts as the structs say, of so many problems that lie one after the other."""
        no_memory = self.rows.follow_starts(
            *self.rows.flying(self.start.variables.momentum),
            self.constraints.pointer,
            self.motions.pointer,
            self.levels.pointer,
            self.settings.pointer,
            self.rules.pointer,
            self.powers.pointer,
            self.search.pointer,
            self.sampling.pointer,
            count,
            kernel().instructions,
        )
        if no_memory:
            raise MemoryError("no memory to follow a start")

    def follow(self, numbers: range, most_work: float, seed: int, *, reach: float = 0.0, expired: bool = False) -> None:
        """Follow starts by number to their ends, one after the other, until one holds or has done much work.

        Parameters
        ----------
        numbers : of the starts
        most_work : instants of one body
            The first start ends when it has done it, of others those are left out that would do more.
        seed : of the random starts
        reach : m, of the point that stays nearest to the centre of mass
            Above 0, start and goal, and the path of the centre of mass, are examined first. Where they leave no
            chance, no start is followed.
        expired : whether there is no time left: the first start is judged as it is
        """
        search = self.search.pointer
        self.x[:] = self.start.x
        search.first = numbers.start
        search.count = len(numbers)
        search.wanted = 0
        search.most_work = -1.0 if expired else most_work  # without any work, the start is judged as it is
        search.reach = reach
        self.sampling.pointer.seed = seed
        self.call()

    def result(self, spec: FlightSpec) -> AttemptResult:
        """Return the best of the starts of the last call."""
        search = self.search.pointer
        table = self.table
        count = search.minima.found
        row = self.minima[0][:count]
        s = self.minima[1][:count]
        least = self.minima[2][:count]
        # Without rows, the coefficients of what is no plan are of another x.
        knows_coefficients = self.coefficients is not None and (search.rows > 0 or search.violation <= 0)
        return AttemptResult(
            spec=spec,
            start_variables=self.start.variables,
            x=self.x.copy(),
            status=Status(search.status).name,
            iterations=search.iterations,
            evaluations=search.evaluations,
            level=search.judged_level,
            violation=search.violation,
            worst=Worst(block=table.block[row], row=table.row[row], s=s.copy(), value=least.copy()),
            residual=np.array(list(search.missed)[: len(self.start.variables.momentum.centre)]),
            work=search.work,
            starts=search.started,
            solved=max(search.solved, 1),
            coefficients=self.coefficients.copy() if self.coefficients is not None and knows_coefficients else None,
            integral=search.objective if search.objective_sums else None,
            branch=self.branch.copy() if self.branch.any() else None,
        )


def _search_problem(spec: FlightSpec, table: RowTable, start: Start, minima: Struct, **written: Array | None) -> Struct:
    """Return the search from a start as the kernel takes it, with the arrays in which it writes its result."""
    rows = spec.rows
    chosen = start.variables.chosen_at_ends
    changes = [bool(chosen and chosen & block.depends_at_ends_on) for block in spec.constraints]
    instants = sorted({*((0.0, 1.0) if any(changes) else ()), *table.window_ends})
    return Struct(
        "SearchProblem",
        rows=rows.rows,
        at_once=start.at_once,
        objective_sum=0 if rows.also is None else rows.first_also,
        objective_sums=0 if rows.also is None else len(rows.also),
        compares=rows.rows > 0 and spec.problem.is_standard and not start.variables.has_reference,
        bodies=rows.bodies * rows.work_of_body,
        entries=sum(rows.differentiated),
        thickness=min((obstacle.thickness for obstacle in spec.problem.obstacles), default=np.inf),
        plain=doubles(start.variables.nominal_motion),
        low=doubles(table.low),
        high=doubles(table.high),
        tolerance=doubles(table.tolerance),
        at_ends=integers(np.array(changes)[table.block]),
        instants=doubles(instants),
        fixed=len(instants),
        minima=minima,
        **written,
    )


@lru_cache(maxsize=8)
def _numbers_of_search(
    settings: Settings, exchange: Exchange, node_counts: tuple[int, ...], bodies: int
) -> tuple[Struct, Struct]:
    """Return every number of a search: settings, and the rules of exchange."""
    cheap = 0
    for level, count in enumerate(node_counts):
        if count * bodies <= 192:  # [-] below that the time of an evaluation hardly depends on nodes and bodies
            cheap = level
    return (
        Struct.of_numbers(replace(settings, tolerance=ORIENTATION, levels=len(node_counts))),
        Struct.of_numbers(replace(exchange, cheap_level=cheap)),
    )


@cache
def powers_of_basis(width: int) -> Struct:
    """Return what b is written with, of motions with so many free polynomials."""
    arrays = {}
    for name, fractions in (("columns", basis_columns(width)), ("lost", compensations(CONDITIONS + width))):
        high = fractions.astype(np.float64)
        exact = np.array(list(map(Fraction, high.ravel().tolist())), dtype=object).reshape(high.shape)
        arrays[name] = high
        arrays[f"{name}_low"] = (fractions - exact).astype(np.float64)  # as sums of two doubles
    return Struct("Powers", **arrays)


@lru_cache(maxsize=64)
def motions_struct(problem: Problem, variables: DecisionVariables, of_coefficients: bool) -> Struct:
    """The class of motions of the variables; where h moves conditions (13), with the map to (17) on request."""
    polynomials = variables.polynomials
    momentum = variables.momentum
    following = variables.following
    form = polynomials.form
    series = basis(form).series
    fixed = basis(form).fixed
    columns = [fixed.index(condition) if condition in fixed else -1 for condition in range(CONDITIONS)]
    coefficient_map = None
    if of_coefficients and following is not None:
        _, _, unit = scale(form, polynomials.free, (polynomials.duration,))
        coefficient_map = doubles(powers_map(form, polynomials.duration) / unit)
    # In space the attitudes at both ends and the angular momentum are the body's.
    orientation = change = middle = 0.0
    axis = np.zeros(momentum.axes.shape[1])
    if problem.robot.in_plane:
        orientation = problem.initial.orientation
        change = problem.final.orientation - orientation
        middle = float(momentum.centre[0])
        axis = doubles(momentum.axes.ravel())
    return Struct(
        "Motions",
        size=variables.size,
        axes=momentum.axes.shape[1],
        columns=series.shape[2],
        fixed_columns=len(fixed),
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
        boundary=doubles(polynomials.fixed_boundary),
        offset=doubles(variables.offset),
        scaling=doubles(variables.scaling),
        series=doubles(series),
        map=coefficient_map,
        start=_end(following, 0, momentum.centre) if following else None,
        goal=_end(following, 1, momentum.centre) if following else None,
    )


def _end(following: Boundary, end: int, middle: Array) -> Struct | None:
    """How the conditions (13) at one end follow h; None where they do not."""
    of_ends = following.rates
    if not isinstance(of_ends, EndRates) or end not in of_ends.curves:
        return None
    momenta = of_ends.curves[end].momenta  # kg m^2/s, between which the rates are straight
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
