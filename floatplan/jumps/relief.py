"""Why no jump was found: which limits stand in the way, by how much and when.

The program is solved once more with room for each kind of limits, whose sum is least: motion and balance hold, and what
has to give stands in the way. It is the same program, with multiples of a few more variables added to its rows.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csc_matrix

from floatplan.arrays import Array, IntArray
from floatplan.jumps.check import FIGURES
from floatplan.jumps.limits import scaled_limits
from floatplan.jumps.model import casadi
from floatplan.jumps.program import JumpProgram, Solution
from floatplan.jumps.rows import CLEAR
from floatplan.problem.jump import STEEPEST, JumpRequest
from floatplan.problem.problem import Problem

KINDS = ("torque", "velocity", "friction", "range", "duration", "ground")
NARROW = 0.05  # [-] of its middle is half of a range at least
LIGHT = 0.05  # [-] of the weight is the friction that gives at least
SMOOTH = 0.1  # [-] of the program's cost, beside what gives
FIRST = 0.5  # [-] share with which the search begins
MOST = 20.0  # [-] largest share
NEARLY = 1e-3  # [-] what is off without counting
SLIGHT = 0.01  # [-] of the largest share is what is rounding beside it
IPOPT = {"print_level": 0, "sb": "yes", "mu_strategy": "adaptive", "tol": 1e-3, "max_iter": 150}
ORACLES = ("quality-function", "probing")  # of which the second finds what the first does not, and the other way about
IPOPT |= {"mu_min": 1e-4, "adaptive_mu_globalization": "never-monotone-mode", "mumps_pivot_order": 0}
IPOPT["max_hessian_perturbation"] = 1e6  # more takes seconds an iteration
IPOPT |= {"acceptable_iter": 10, "acceptable_obj_change_tol": 1e-4, "acceptable_constr_viol_tol": 1e-4}  # the sum stays
IPOPT |= {f"acceptable_{name}": 1e20 for name in ("tol", "dual_inf_tol", "compl_inf_tol")}


class Given(NamedTuple):
    """A limit that has to give: its row's label, its kind, the share by which it does, and what a share of 1 is."""

    label: str
    kind: str
    share: float
    size: float


def kind_of(label: str) -> str:
    """Which of the kinds of limits a row is about; something else where it is none."""
    words = label.partition(" of ")[0]
    if label.startswith(CLEAR):
        return "ground"
    return {"rate": "velocity", "torque-speed curve": "torque"}.get(words, words)


def in_the_way(program: JumpProgram, ended: Solution, request: JumpRequest, guess: Array | None = None) -> list[Given]:
    """Return what has to give where a program ended without a solution, of each kind the most; none if not found."""
    missed, row = ended.worst
    if ended.missing < np.inf:  # all but distances holds
        return [Given(row, "apart", missed, 1.0)]
    asks = [request.takeoff.durations, "duration" in request.fixed, request.landing.durations]
    sides = ("takeoff", "flight", "landing")
    timed = tuple(f"duration of ({side}" for side, given in zip(sides, asks, strict=True) if given)
    return giving(program, ended, timed, guess)


def giving(
    program: JumpProgram, ended: Solution, timed: tuple[str, ...] = (), guess: Array | None = None
) -> list[Given]:
    """Return the limits that give, the most of each kind, where the sum of what kinds give is least; none if not found.

    Parameters
    ----------
    program : without a solution
    ended : where it ended
    timed : how the labels of durations begin that may give
    guess : (size,) from which it is searched; the generic one where none is given
    """
    _, evaluate, rows = program.stated
    m = len(program.stated[2].labels)
    low, high = (np.concatenate([*part, box]) for part, box in zip((rows.low, rows.high), program.box, strict=True))
    labels = [*rows.labels, *program.labels]
    kinds = np.array([kind_of(label) for label in labels])
    kinds[[label.startswith("duration") and not label.startswith(timed) for label in labels]] = ""
    names = [kind for kind in KINDS if kind in kinds]
    loose = np.isin(kinds, names) & ((low < high) | (kinds == "duration")) & (np.isfinite(low) | np.isfinite(high))
    index = np.array([names.index(kind) if kind in names else 0 for kind in kinds])
    raw = np.append(program.resampled(ended, program.phases), program.separation.start)
    values = np.asarray(evaluate(raw)).ravel()
    sizes = np.ones(len(kinds))
    own = m + np.flatnonzero(loose[m:])
    ground = kinds == "ground"
    sizes[ground] = np.maximum(low[ground], NEARLY * program.node.height)  # with 1 it touches
    sizes[own] = np.maximum((high - low)[own] / 2, NARROW * np.abs(high[own] + low[own]))
    for one, two in pairwise(np.flatnonzero(kinds == "friction").tolist()):
        if two == one + 1 and labels[one] == labels[two]:  # the two sides of a cone
            sizes[[one, two]] = max(LIGHT, float(values[[one, two]].mean()))
    kept = np.flatnonzero(~loose[:m])
    below = np.flatnonzero(loose & np.isfinite(low))
    above = np.flatnonzero(loose & np.isfinite(high))
    take = np.concatenate((kept, below, above))
    signs = np.repeat([0, 1, -1], [len(kept), len(below), len(above)])
    room = np.zeros((len(take), len(names)))
    room[np.arange(len(take)), index[take]] = signs * sizes[take]
    least = np.where(kinds == "duration", low / MOST, low - MOST * sizes)
    box = np.where(loose, (least, high + MOST * sizes), (low, high))[:, m:]
    start = program.guess() if guess is None else guess
    for oracle in ORACLES:
        found = _relaxed(program, take, room, oracle)(
            x0=np.concatenate((start, program.separation.start, np.full(len(names), FIRST))),
            lbx=np.append(box[0], np.zeros(len(names))),
            ubx=np.append(box[1], [1.0 if name == "ground" else MOST for name in names]),
            lbg=np.where(signs < 0, -np.inf, low[take]),
            ubg=np.where(signs > 0, np.inf, high[take]),
        )["x"][: len(raw)]
        values = np.append(np.asarray(evaluate(found)).ravel(), np.asarray(found).ravel())
        shares = np.maximum(low - values, values - high) / sizes
        if shares[~loose].max() < NEARLY:
            worst = [int(np.where(loose & (index == row), shares, 0.0).argmax()) for row in range(len(names))]
            gives = (Given(labels[at], str(kinds[at]), float(shares[at]), float(sizes[at])) for at in worst)
            off = max(NEARLY, SLIGHT * float(shares[loose].max()))
            return sorted((each for each in gives if each.share > off), key=lambda each: -each.share)
    return []


def _relaxed(program: JumpProgram, take: IntArray, room: Array, oracle: str) -> Any:
    """A solver of a program whose rows, then variables, are taken in an order, with multiples of more variables."""
    ca = casadi()
    solver = program.stated[0]
    goal, rows, slopes, bends = (solver.get_function(f"nlp_{name}") for name in ("f", "g", "jac_g", "hess_l"))
    n = goal.size1_in(0)
    m = rows.size1_out(0)
    count, kinds = room.shape
    pick = ca.DM(csc_matrix((np.ones(count), (np.arange(count), take)), (count, m + n)))
    more = ca.sparsify(ca.DM(room))
    both = ca.MX.sym("x", n + kinds)
    none = ca.MX.sym("p", 0)
    factor = ca.MX.sym("f")
    weights = ca.MX.sym("w", count)
    raw = both[:n]
    values = ca.mtimes(pick, ca.vertcat(rows(raw, none), raw)) + ca.mtimes(more, both[n:])
    slope = ca.horzcat(ca.mtimes(pick, ca.vertcat(slopes(raw, none)[1], ca.MX.eye(n))), more)
    bend = ca.diagcat(bends(raw, none, SMOOTH * factor, ca.mtimes(pick.T, weights)[:m]), ca.MX(kinds, kinds))
    options = {
        "jac_g": ca.Function("jac_g", [both, none], [values, slope]),
        "hess_lag": ca.Function("hess_lag", [both, none, factor, weights], [bend]),
        "print_time": False,
        "ipopt": IPOPT | {"mu_oracle": oracle},
    }
    cost = SMOOTH * goal(raw, none) + ca.sum1(both[n:])
    return ca.nlpsol("relief", "ipopt", {"x": both, "f": cost, "g": values}, options)


def sentence(given: Given, problem: Problem) -> str:
    """What a limit would have to be, in the words of a problem's file."""
    request = problem.jump
    robot = problem.robot
    name = given.label.partition(" (")[0].rpartition(" of ")[2]
    unit = ""
    assert request is not None
    limit = request.friction if given.kind == "friction" else 0.0
    if given.kind == "torque":
        own = dict(zip(robot.joints, problem.torque_limits, strict=True))
        own |= {key: most for key, most in zip(robot.motors, problem.motor_torque_limits, strict=True) if most < np.inf}
        own = own if given.label.startswith("torque of ") else dict(zip(robot.motors, problem.motor_stall, strict=True))
        limit = request.margin["torque"] * own[name]
        unit = " N m"
    elif given.kind == "velocity":
        limit = request.margin["velocity"] * problem.velocity_limits[robot.joints.index(name)]
        unit = " rad/s"
    if limit:
        return f"{given.label}: {(1 + given.share) * limit:.3g}{unit} needed, {limit:.3g}{unit} allowed"
    unit = {"range": "rad", "duration": "s"}.get(given.kind, "m")
    return f"{given.label}: {given.share * given.size:.2g} {unit} missing"


def broken(request: JumpRequest, figures: Mapping[str, float]) -> list[Given]:
    """Return the kinds of limits that a check finds broken between nodes, each with what a share of 0 is."""
    kinds = {"torque": "torque", "torque_speed": "torque", "velocity": "velocity", "friction": "friction"}
    found = [kind for name, kind in kinds.items() if figures.get(name, 0.0) > FIGURES[name].most(request)]
    return [Given(kind, kind, 0.0, 1.0) for kind in dict.fromkeys(found)]


def eased(problem: Problem, gives: Sequence[Given], beyond: float) -> tuple[str, Problem]:
    """Return a problem in which limits give more than they have to, with the changes in words.

    Parameters
    ----------
    problem : Problem
    gives : what has to give, of each kind one
    beyond : times that, less durations and what stays apart, which is not asked for then
    """
    words = []
    for label, kind, share, size in gives:
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
            most = min(math.ceil(100 * beyond * (1 + share) * request.friction) / 100, STEEPEST)
            words.append(f"friction {most:g}")
            request = replace(request, friction=most)
        elif kind == "ground":
            least = max(round(request.clearance - beyond * share * size, 3), 0.0)
            words.append(f"clearance {least:g}")
            request = replace(request, clearance=least)
        elif kind == "duration":
            words.append("durations that are not asked for")
            sides = {side: replace(getattr(request, side), durations=None) for side in ("takeoff", "landing")}
            request = replace(request, fixed=tuple(each for each in request.fixed if each != kind), **sides)
        else:
            name = label.partition(" (")[0]
            words.append(f"nothing that is {name}")
            obstacles = [each for at, each in enumerate(problem.obstacles) if not name.endswith(f" obstacle {at}")]
            pairs = [each for each in problem.self_clearances if name != " clear of ".join(each.links)]
            problem = replace(problem, obstacles=tuple(obstacles), self_clearances=tuple(pairs))
        problem = replace(problem, jump=request, limits=limits)
    return " and ".join(words), problem
