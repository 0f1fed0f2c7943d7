"""Why no jump was found: which limits conflict, by how much and when.

The program is solved once more with elastic limits, a multiple of each kind of limits, whose sum is minimised: motion
and balance hold, and the limits that are exceeded are those that conflict. It is the same program, with multiples of a
few more variables added to its rows.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csc_matrix

from floatplan.arrays import Array, BoolArray, IntArray
from floatplan.jumps.check import FIGURES
from floatplan.jumps.flight import scaled_limits
from floatplan.jumps.model import casadi
from floatplan.jumps.program import JumpProgram
from floatplan.jumps.variables import JumpSolution
from floatplan.problem.jump import JumpRequest
from floatplan.problem.problem import Problem
from floatplan.tables import RANGES


class LimitKind(NamedTuple):
    """How labels of a kind's rows and bounds begin, before " of "; and the figures of a check that show it exceeded."""

    labels: tuple[str, ...]
    figures: tuple[str, ...] = ()


# Of limits that are elastic. One more is "apart", of distances, which are not: a program measures their shortfall.
KINDS = {
    "torque": LimitKind(("torque", "torque-speed curve"), ("torque", "torque_speed")),
    "velocity": LimitKind(("rate",), ("velocity",)),
    "friction": LimitKind(("friction",), ("friction",)),
    "range": LimitKind(("range",)),
    "duration": LimitKind(("duration",)),
    "ground": LimitKind(("clear", "height")),
}


@dataclass(frozen=True)
class ElasticSettings:
    """Numbers of the elastic program.

    Attributes
    ----------
    narrow : of its middle, what half of a range counts as at least
    light : of the weight, what the friction of a cone counts as at least
    smoothness : weight of the program's cost, relative to the sum of multiples
    first, most : share of limits at which the search begins, and the largest
    violation : of limits that are not elastic; and share of limits that does not count
    rounding : of the largest share, what is rounding beside it
    """

    narrow: float = 0.05
    light: float = 0.05
    smoothness: float = 0.1
    first: float = 0.5
    most: float = 20.0
    violation: float = 1e-3
    rounding: float = 0.01


ELASTIC = ElasticSettings()


class Conflict(NamedTuple):
    """A limit that conflicts with others: its row's label, kind, the share beyond it, and what a share of 1 is."""

    label: str
    kind: str
    share: float
    size: float


def kind_of(label: str) -> str:
    """Which of the kinds of limits a row is about; something else where it is none."""
    words = label.partition(" of ")[0]
    return next((name for name, kind in KINDS.items() if words in kind.labels), words)


def conflicting_limits(
    program: JumpProgram, last: JumpSolution, request: JumpRequest, guess: Array | None = None
) -> list[Conflict]:
    """Return the limits that conflict where a program ended without a solution, of each kind the one exceeded most.

    There are none where the elastic program has no solution either.
    """
    violation, label = last.worst
    if last.shortfall < np.inf:  # all but distances holds
        return [Conflict(label, "apart", violation, 1.0)]
    elastic_durations = []
    if request.takeoff.durations:
        elastic_durations.append("duration of (takeoff")
    if "duration" in request.fixed:
        elastic_durations.append("duration of (flight")
    if request.landing.durations:
        elastic_durations.append("duration of (landing")
    return elastic_conflicts(program, last, tuple(elastic_durations), guess)


@dataclass(frozen=True, eq=False)
class _ElasticRows:
    """All rows of a program, then its variables, of which some are elastic.

    Attributes
    ----------
    labels, kinds : (rows,) what each is about
    names : of the kinds that there are
    low, high : (rows,) bounds
    elastic : (rows,) whether its bounds may be exceeded
    sizes : (rows,) by how much a share of 1 exceeds them
    """

    labels: list[str]
    kinds: Any
    names: list[str]
    low: Array
    high: Array
    elastic: BoolArray
    sizes: Array


def elastic_conflicts(
    program: JumpProgram, last: JumpSolution, elastic_durations: tuple[str, ...] = (), guess: Array | None = None
) -> list[Conflict]:
    """Return the limits that are exceeded most, of each kind one, where the sum of all kinds is minimal.

    Parameters
    ----------
    program : without a solution
    last : where it ended
    elastic_durations : how the labels of durations begin that are elastic
    guess : (size,) from which the search begins; the generic one where none is given
    """
    evaluate = program.compiled.evaluate
    start = np.append(program.resampled(last, program.phases), program.separation.start)
    rows = _elastic_rows(program, elastic_durations, np.asarray(evaluate(start)).ravel())
    m = len(program.compiled.rows.labels)
    kind_index = np.array([rows.names.index(kind) if kind in rows.names else 0 for kind in rows.kinds])
    fixed = np.flatnonzero(~rows.elastic[:m])
    below = np.flatnonzero(rows.elastic & np.isfinite(rows.low))
    above = np.flatnonzero(rows.elastic & np.isfinite(rows.high))
    take = np.concatenate((fixed, below, above))
    signs = np.repeat([0, 1, -1], [len(fixed), len(below), len(above)])
    multiples = np.zeros((len(take), len(rows.names)))
    multiples[np.arange(len(take)), kind_index[take]] = signs * rows.sizes[take]
    shortest = np.where(rows.kinds == "duration", rows.low / ELASTIC.most, rows.low - ELASTIC.most * rows.sizes)
    longest = rows.high + ELASTIC.most * rows.sizes
    lower = np.where(rows.elastic, shortest, rows.low)[m:]
    upper = np.where(rows.elastic, longest, rows.high)[m:]
    largest = [1.0 if name == "ground" else ELASTIC.most for name in rows.names]
    if guess is None:
        guess = program.guess()
    for oracle in ("quality-function", "probing"):  # either finds what the other does not
        solver = _elastic_solver(program, take, multiples, oracle)
        result = solver(
            x0=np.concatenate((guess, program.separation.start, np.full(len(rows.names), ELASTIC.first))),
            lbx=np.append(lower, np.zeros(len(rows.names))),
            ubx=np.append(upper, largest),
            lbg=np.where(signs < 0, -np.inf, rows.low[take]),
            ubg=np.where(signs > 0, np.inf, rows.high[take]),
        )
        raw = result["x"][: len(start)]
        values = np.append(np.asarray(evaluate(raw)).ravel(), np.asarray(raw).ravel())
        shares = np.maximum(rows.low - values, values - rows.high) / rows.sizes
        if shares[~rows.elastic].max() < ELASTIC.violation:
            return _largest(rows, kind_index, shares)
    return []


def _largest(rows: _ElasticRows, kind_index: IntArray, shares: Array) -> list[Conflict]:
    """The elastic row of each kind with the largest share, where that is more than rounding; the largest first."""
    least = max(ELASTIC.violation, ELASTIC.rounding * float(shares[rows.elastic].max()))
    conflicts = []
    for kind in range(len(rows.names)):
        at = int(np.where(rows.elastic & (kind_index == kind), shares, 0.0).argmax())
        if shares[at] > least:
            conflicts.append(Conflict(rows.labels[at], str(rows.kinds[at]), float(shares[at]), float(rows.sizes[at])))
    return sorted(conflicts, key=lambda conflict: -conflict.share)


def _elastic_rows(program: JumpProgram, elastic_durations: tuple[str, ...], values: Array) -> _ElasticRows:
    """Rows and variables of a program with their sizes; ``values`` (rows,) are those of rows where it ended."""
    rows = program.compiled.rows
    box_low, box_high = program.box
    low = np.concatenate([*rows.low, box_low])
    high = np.concatenate([*rows.high, box_high])
    labels = [*rows.labels, *program.labels]
    kinds = np.array([kind_of(label) for label in labels])
    for index, label in enumerate(labels):
        if label.startswith("duration") and not label.startswith(elastic_durations):
            kinds[index] = ""
    names = [kind for kind in KINDS if kind in kinds]
    is_limit = np.isin(kinds, names) & (np.isfinite(low) | np.isfinite(high))
    elastic = is_limit & ((low < high) | (kinds == "duration"))
    sizes = np.ones(len(kinds))  # of shares of limits: a share of 1 of the elastic multiple is twice the limit
    m = len(rows.labels)
    variables = m + np.flatnonzero(elastic[m:])
    ground = kinds == "ground"
    touching = ELASTIC.violation * program.node_rows.height  # with a share of 1 it touches
    sizes[ground] = np.maximum(low[ground], touching)
    half_ranges = (high - low)[variables] / 2
    sizes[variables] = np.maximum(half_ranges, ELASTIC.narrow * np.abs(high[variables] + low[variables]))
    for one, two in pairwise(np.flatnonzero(kinds == "friction").tolist()):
        if two == one + 1 and labels[one] == labels[two]:  # the two sides of a cone
            sizes[[one, two]] = max(ELASTIC.light, float(values[[one, two]].mean()))
    return _ElasticRows(labels, kinds, names, low, high, elastic, sizes)


def _elastic_solver(program: JumpProgram, take: IntArray, multiples: Array, oracle: str) -> Any:
    """A solver of a program whose rows, then variables, are taken in an order, plus multiples of more variables."""
    ca = casadi()
    solver = program.compiled.solver
    cost_of, rows_of, jacobian_of, hessian_of = (
        solver.get_function(f"nlp_{name}") for name in ("f", "g", "jac_g", "hess_l")
    )
    n = cost_of.size1_in(0)
    m = rows_of.size1_out(0)
    count, kinds = multiples.shape
    selection = ca.DM(csc_matrix((np.ones(count), (np.arange(count), take)), (count, m + n)))
    added = ca.sparsify(ca.DM(multiples))
    x = ca.MX.sym("x", n + kinds)
    none = ca.MX.sym("p", 0)
    factor = ca.MX.sym("f")
    weights = ca.MX.sym("w", count)
    raw = x[:n]
    values = ca.mtimes(selection, ca.vertcat(rows_of(raw, none), raw)) + ca.mtimes(added, x[n:])
    own_jacobian = ca.vertcat(jacobian_of(raw, none)[1], ca.MX.eye(n))
    jacobian = ca.horzcat(ca.mtimes(selection, own_jacobian), added)
    own_weights = ca.mtimes(selection.T, weights)[:m]
    own_hessian = hessian_of(raw, none, ELASTIC.smoothness * factor, own_weights)
    hessian = ca.diagcat(own_hessian, ca.MX(kinds, kinds))
    options = {
        "jac_g": ca.Function("jac_g", [x, none], [values, jacobian]),
        "hess_lag": ca.Function("hess_lag", [x, none, factor, weights], [hessian]),
        "print_time": False,
        "ipopt": _ipopt_options(oracle),
    }
    cost = ELASTIC.smoothness * cost_of(raw, none) + ca.sum1(x[n:])
    return ca.nlpsol("elastic", "ipopt", {"x": x, "f": cost, "g": values}, options)


def _ipopt_options(oracle: str) -> dict[str, Any]:
    """Options of IPOPT for the elastic program, of which a rough solution is enough."""
    options: dict[str, Any] = {"print_level": 0, "sb": "yes", "tol": 1e-3, "max_iter": 150}
    options |= {"mu_strategy": "adaptive", "mu_oracle": oracle, "mu_min": 1e-4}
    options["adaptive_mu_globalization"] = "never-monotone-mode"
    options["mumps_pivot_order"] = 0
    options["max_hessian_perturbation"] = 1e6  # more takes seconds an iteration
    # It is enough that the objective does not change any more.
    options |= {"acceptable_iter": 10, "acceptable_obj_change_tol": 1e-4, "acceptable_constr_viol_tol": 1e-4}
    options |= {f"acceptable_{name}": 1e20 for name in ("tol", "dual_inf_tol", "compl_inf_tol")}
    return options


def conflict_sentence(conflict: Conflict, problem: Problem) -> str:
    """What a limit would have to be, in the words of a problem's file."""
    label = conflict.label
    request = problem.jump
    assert request is not None
    limit, unit = allowed(label, conflict.kind, problem, request)
    if limit:
        return f"{label}: {(1 + conflict.share) * limit:.3g}{unit} needed, {limit:.3g}{unit} allowed"
    unit = {"range": "rad", "duration": "s"}.get(conflict.kind, "m")
    return f"{label}: {conflict.share * conflict.size:.2g} {unit} missing"


def allowed(label: str, kind: str, problem: Problem, request: JumpRequest) -> tuple[float, str]:
    """What a request allows where a label says so, and its unit; 0 of a kind of which a motor or a foot has no limit.

    Of friction it is the coefficient; of torques and rates the limit of a motor or a joint less its margin.
    """
    robot = problem.robot
    name = label.partition(" (")[0].rpartition(" of ")[2]
    if kind == "friction":
        return request.friction, ""
    if kind == "torque":
        limits = dict(zip(robot.motors, problem.motor_stall, strict=True))
        if label.startswith("torque of "):
            limits = dict(zip(robot.joints, problem.torque_limits, strict=True))
            for motor, most in zip(robot.motors, problem.motor_torque_limits, strict=True):
                if most < np.inf:
                    limits[motor] = most
        return request.margin["torque"] * limits[name], " N m"
    if kind == "velocity":
        return request.margin["velocity"] * problem.velocity_limits[robot.joints.index(name)], " rad/s"
    return 0.0, ""


def violated_kinds(request: JumpRequest, figures: Mapping[str, float]) -> list[Conflict]:
    """Return the kinds of limits that a check finds exceeded between nodes, with a share of 0."""
    violated = []
    for name, kind in KINDS.items():
        if any(figures.get(figure, 0.0) > FIGURES[figure].limit_of(request) for figure in kind.figures):
            violated.append(Conflict(name, name, 0.0, 1.0))
    return violated


def relaxed(problem: Problem, conflicts: Sequence[Conflict], beyond: float) -> tuple[str, Problem]:
    """Return a problem whose conflicting limits are wider than they have to be, with the changes in words.

    Parameters
    ----------
    problem : Problem
    conflicts : of each kind one
    beyond : times the least change; durations and distances are not required at all then
    """
    words = []
    for label, kind, share, size in conflicts:
        request = problem.jump
        limits = problem.limits
        assert request is not None
        factor = math.ceil(20 * beyond * (1 + share)) / 20
        if kind in ("torque", "velocity"):
            words.append(f"{factor:g} times the limits of {kind}")
            limits = scaled_limits(problem, **{kind: factor})
        elif kind == "range":
            words.append(f"joint ranges {factor:g} times as wide")
            ends = np.asarray(problem.position_limits)
            ranges = ends + (factor - 1) / 2 * np.ptp(ends, axis=1)[:, None] * [-1, 1]
            limits = replace(limits, position=ranges.tolist())
        elif kind == "friction":
            most = min(math.ceil(100 * beyond * (1 + share) * request.friction) / 100, RANGES["friction"].high)
            words.append(f"friction {most:g}")
            request = replace(request, friction=most)
        elif kind == "ground":
            least = max(round(request.clearance - beyond * share * size, 3), 0.0)
            words.append(f"clearance {least:g}")
            request = replace(request, clearance=least)
        elif kind == "duration":
            words.append("durations that are not asked for")
            request = replace(
                request,
                fixed=tuple(quantity for quantity in request.fixed if quantity != kind),
                takeoff=replace(request.takeoff, durations=None),
                landing=replace(request.landing, durations=None),
            )
        elif kind == "apart":
            name = label.partition(" (")[0]
            words.append(f"nothing that is {name}")
            problem = _without_distance(problem, name)
        else:
            raise AssertionError(f"no way to relax a limit of the kind {kind!r}")
        problem = replace(problem, jump=request, limits=limits)
    return " and ".join(words), problem


def _without_distance(problem: Problem, name: str) -> Problem:
    """The problem without the obstacle, or the pair of links, that a separating line's name is about."""
    obstacles = []
    for index, obstacle in enumerate(problem.obstacles):
        if not name.endswith(f" obstacle {index}"):
            obstacles.append(obstacle)
    pairs = [pair for pair in problem.self_clearances if name != " clear of ".join(pair.links)]
    return replace(problem, obstacles=tuple(obstacles), self_clearances=tuple(pairs))
