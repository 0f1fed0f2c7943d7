"""Why no jump was found: which limits stand in the way, by how much and when; and what gives as much.

The program is solved once more with room for each kind of limits, whose sum is least: motion and balance hold, and what
has to give stands in the way. It is the same program, with multiples of a few more variables added to its rows.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.sparse import csc_matrix

from floatplan.arrays import Array, IntArray
from floatplan.problem.problem import Problem
from floatplan.stance.model import casadi
from floatplan.stance.program import SMOOTH, JumpProgram, Solution
from floatplan.stance.rows import CLEAR

KINDS = {  # of limits, by what the labels of their rows say
    "torque of ": "torque",
    "torque-speed curve of ": "torque",
    "rate of ": "velocity",
    "friction of ": "friction",
    "range of ": "range",
    "duration of ": "duration",
    CLEAR: "ground",
    "above the ground": "ground",
    "clear of ": "apart",
}
ALL = tuple(dict.fromkeys(KINDS.values()))
LENGTH = 0.25  # [-] of the standing height, by which lengths give where their share is 1
NARROW = 0.05  # [-] of its middle is half of a range at least
LIGHT = 0.05  # [-] of the weight is the friction that gives at least
MOST, WIDEST = 20.0, 4.0  # [-] shares; of variables' bounds
BEYOND = 1.03  # [-] times what has to give is tried
FIRST = 0.5  # [-] share with which the search begins
GIVES, NEARLY = 1e-3, 1e-3  # [-] what counts; what constraints may be off
IPOPT = {"print_level": 0, "sb": "yes", "mu_strategy": "adaptive", "tol": 1e-3, "acceptable_tol": 1e-2}
IPOPT |= {"acceptable_iter": 4, "acceptable_dual_inf_tol": 1.0, "acceptable_constr_viol_tol": 1e-4}
IPOPT |= {"acceptable_compl_inf_tol": 0.01, "max_iter": 150, "max_cpu_time": 40.0}


@dataclass(frozen=True)
class Given:
    """A limit that has to give: its row's label, its kind, the share by which it does, and what a share of 1 is."""

    label: str
    kind: str
    share: float
    size: float

    @property
    def factor(self) -> float:
        """What is tried, times the limit."""
        return math.ceil(100 * (1 + BEYOND * self.share)) / 100


def kind_of(label: str) -> str:
    """Which of :data:`KINDS` a row is about; "" where it is no limit."""
    return next((kind for words, kind in KINDS.items() if words in label), "")


def giving(program: JumpProgram, ended: Solution, free: Collection[str]) -> list[Given]:
    """Return the limits that give, the most of each kind, where the sum of what kinds give is least; none if not found.

    Parameters
    ----------
    program : without a solution
    ended : where it ended
    free : kinds that may give
    """
    (_, evaluate, rows), m = program.stated, len(program.stated[2].labels)
    low, high = (np.concatenate([*part, box]) for part, box in zip((rows.low, rows.high), program.box, strict=True))
    labels = [*rows.labels, *program.labels]
    kinds = np.array([kind_of(label) for label in labels])
    kinds[m:][low[m:] == high[m:]] = np.where(kinds[m:] == "duration", "duration", "")[low[m:] == high[m:]]
    names = [kind for kind in ALL if kind in free and kind in kinds]
    raw = np.append(program.resampled(ended, program.phases), program.separation.angles)
    sizes = _sizes(program, np.asarray(evaluate(raw)).ravel(), labels, kinds, low, high)
    loose = np.isin(kinds, names)
    kept = np.flatnonzero(~loose[:m])
    below, above = (np.flatnonzero(loose & np.isfinite(each)) for each in (low, high))
    take = np.concatenate((kept, below, above))
    room = np.zeros((len(take), len(names)))
    signs = np.repeat([0.0, 1.0, -1.0], [len(kept), len(below), len(above)])
    index = np.array([names.index(kind) if kind in names else 0 for kind in kinds])
    room[np.arange(len(take)), index[take]] = signs * sizes[take]
    wide = sizes * loose * np.where(kinds == "velocity", MOST, WIDEST)
    least = np.where(loose & (kinds == "duration"), np.maximum(low - wide, low / MOST), low - wide)[m:]
    answer = _relaxed(program, take, room)(
        x0=np.concatenate((program.guess(), program.separation.angles, np.full(len(names), FIRST))),
        lbx=np.append(least, np.zeros(len(names))),
        ubx=np.append((high + wide)[m:], np.full(len(names), MOST)),
        lbg=np.where(signs < 0, -np.inf, low[take]),
        ubg=np.where(signs > 0, np.inf, high[take]),
    )
    found = np.asarray(answer["x"]).ravel()[: len(raw)]
    values = np.append(np.asarray(evaluate(found)).ravel(), found)
    excess = np.maximum(low - values, values - high)
    if excess[~loose].max() > NEARLY:
        return []
    shares = np.where(loose, excess / sizes, 0.0)
    worst = [int(np.where(kinds == kind, shares, 0.0).argmax()) for kind in names]
    given = [
        Given(labels[at], str(kinds[at]), float(shares[at]), float(sizes[at])) for at in worst if shares[at] > GIVES
    ]
    return sorted(given, key=lambda each: -each.share)


def _relaxed(program: JumpProgram, take: IntArray, room: Array) -> Any:
    """A solver of a program whose rows, then variables, are taken in an order, with multiples of more variables."""
    ca, solver = casadi(), program.stated[0]
    goal, rows, slopes, bends = (solver.get_function(f"nlp_{name}") for name in ("f", "g", "jac_g", "hess_l"))
    n, m, (count, kinds) = goal.size1_in(0), rows.size1_out(0), room.shape
    pick = ca.DM(csc_matrix((np.ones(count), (np.arange(count), take)), (count, m + n)))
    more, both, none = ca.sparsify(ca.DM(room)), ca.MX.sym("x", n + kinds), ca.MX.sym("p", 0)
    factor, weights, raw = ca.MX.sym("f"), ca.MX.sym("w", count), both[:n]
    values = ca.mtimes(pick, ca.vertcat(rows(raw, none), raw)) + ca.mtimes(more, both[n:])
    slope = ca.horzcat(ca.mtimes(pick, ca.vertcat(slopes(raw, none)[1], ca.MX.eye(n))), more)
    bend = ca.diagcat(bends(raw, none, SMOOTH * factor, ca.mtimes(pick.T, weights)[:m]), ca.MX(kinds, kinds))
    options = {
        "jac_g": ca.Function("jac_g", [both, none], [values, slope]),
        "hess_lag": ca.Function("hess_lag", [both, none, factor, weights], [bend]),
        "print_time": False,
        "ipopt": IPOPT,
    }
    cost = SMOOTH * goal(raw, none) + ca.sum1(both[n:])
    return ca.nlpsol("relief", "ipopt", {"x": both, "f": cost, "g": values}, options)


def _sizes(program: JumpProgram, values: Array, labels: Sequence[str], kinds: Array, low: Array, high: Array) -> Array:
    """What a share of 1 is, of all rows, then variables: of friction that of its cone, as values of rows are."""
    sizes, m = np.ones(len(kinds)), len(values)
    sizes[np.isin(kinds, ("ground", "apart"))] = LENGTH * program.node.height
    own = m + np.flatnonzero(kinds[m:] != "")
    sizes[own] = np.maximum((high - low)[own] / 2, NARROW * np.abs(high + low)[own])
    cones = np.flatnonzero(kinds == "friction").tolist()
    sizes[cones] = LIGHT
    for one, two in pairwise(cones):
        if two == one + 1 and labels[one] == labels[two]:
            sizes[[one, two]] = max(LIGHT, float(values[[one, two]].mean()))
    return sizes


def sentence(given: Given, problem: Problem) -> str:
    """What a limit would have to be, in the words of a problem's file."""
    request, robot = problem.jump, problem.robot
    what, _, phase = given.label.removesuffix(")").partition(" (")
    name, limit, unit = what.rpartition(" of ")[2], 0.0, ""
    assert request is not None
    if given.kind == "torque":
        of = problem.motor_torque_limits if what.startswith("torque of ") else problem.motor_stall
        limit, unit = request.margin["torque"] * of[robot.motors.index(name)], " N m"
    elif given.kind == "velocity":
        limit, unit = request.margin["velocity"] * problem.velocity_limits[robot.joints.index(name)], " rad/s"
    elif given.kind == "friction":
        limit = request.friction
    if limit:
        return f"{what}, {phase}: {(1 + given.share) * limit:.3g}{unit} needed, {limit:.3g}{unit} allowed"
    more, unit = given.share * given.size, {"range": "rad", "duration": "s"}.get(given.kind, "m")
    return f"{what}, {phase}: {more:.2g} {unit} missing"


def changed(problem: Problem, given: Given) -> tuple[str, Problem]:
    """Return a problem that gives a little more of a kind of limits than has to be, with the change in words."""
    request, limits, robot, kind, factor = problem.jump, problem.limits, problem.robot, given.kind, given.factor
    assert request is not None
    if kind in ("torque", "velocity"):
        own = dict(zip(robot.motors, getattr(robot, f"motor_{kind}_limits").tolist(), strict=True))
        wider: dict[str, Any] = {kind: _scaled(getattr(limits, kind), own, factor)}
        if kind == "torque":
            wider["motor"] = {name: replace(curve, stall=factor * curve.stall) for name, curve in limits.motor.items()}
        return f"{factor:g} times the {kind} limits", replace(problem, limits=replace(limits, **wider))
    if kind == "range":
        ranges = problem.position_limits + (factor - 1) / 2 * np.ptp(problem.position_limits, axis=1)[:, None] * [-1, 1]
        return f"joint ranges {factor:g} times as wide", replace(problem, limits=replace(limits, position=ranges))
    if kind == "apart":
        obstacles = [each for at, each in enumerate(problem.obstacles) if f"obstacle {at} " not in given.label]
        pairs = [each for each in problem.self_clearances if " clear of ".join(each.links) not in given.label]
        less = replace(problem, obstacles=tuple(obstacles), self_clearances=tuple(pairs))
        return f"no limit that {given.label.partition(' (')[0]}", less
    if kind == "duration":
        sides = {name: replace(getattr(request, name), durations=None) for name in ("takeoff", "landing")}
        fixed = tuple(each for each in request.fixed if each != kind)
        return "durations left out", replace(problem, jump=replace(request, **sides, fixed=fixed))
    if kind == "ground":
        least = max(0.0, math.floor(1e3 * (request.clearance - (factor - 1) * given.size)) / 1e3)
        return f"clearance {least:g}", replace(problem, jump=replace(request, clearance=least))
    friction = math.ceil(100 * factor * request.friction) / 100
    return f"friction {friction:g}", replace(problem, jump=replace(request, friction=friction))


def _scaled(given: Any, own: Mapping[str, float], factor: float) -> Any:
    """Limits, as a problem gives them, times a factor; ``own`` are those of the URDF."""
    if isinstance(given, str):
        given = {name: most for name, most in own.items() if given == "urdf" and math.isfinite(most)}
    if isinstance(given, Mapping):
        return {name: factor * most for name, most in given.items()} or "none"
    return (factor * np.asarray(given)).tolist()
