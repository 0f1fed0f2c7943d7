"""Why no jump was found: which limits stand in the way, by how much and when; and what gives as much.

The program is solved once more with room for each kind of limits, whose sum is least: motion and balance hold, and what
has to give stands in the way. It is the same program, with multiples of a few more variables added to its rows.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csc_matrix

from floatplan.arrays import Array, IntArray
from floatplan.problem.problem import Problem
from floatplan.stance.model import casadi
from floatplan.stance.program import SMOOTH, JumpProgram, Solution

KINDS = {"rate": "velocity", "torque-speed curve": "torque"}  # of limits, where labels say it otherwise
NAMED = ("torque", "velocity", "friction", "range", "duration", "ground", "apart")
LENGTH = 0.25  # [-] of the standing height, by which lengths give where their share is 1
NARROW = 0.05  # [-] of its middle is half of a range at least
LIGHT = 0.05  # [-] of the weight is the friction that gives at least
FIRST, MOST = 0.5, 20.0  # [-] shares with which the search begins, and at most
NEARLY = 1e-3  # [-] what is off without counting
IPOPT = {"print_level": 0, "sb": "yes", "mu_strategy": "adaptive", "tol": 1e-3, "max_iter": 150, "max_cpu_time": 40.0}


class Given(NamedTuple):
    """A limit that has to give: its row's label, its kind, the share by which it does, and what a share of 1 is."""

    label: str
    kind: str
    share: float
    size: float


def kind_of(label: str) -> str:
    """Which of the kinds of limits a row is about; something else where it is none."""
    words = label.partition(" of ")[0]
    return (
        "ground"
        if " the ground (" in label and "meets" not in label
        else "apart"
        if words.endswith("clear")
        else KINDS.get(words, words)
    )


def giving(program: JumpProgram, ended: Solution, timed: bool) -> list[Given]:
    """Return the limits that give, the most of each kind, where the sum of what kinds give is least; none if not found.

    Parameters
    ----------
    program : without a solution
    ended : where it ended
    timed : whether durations may give
    """
    (_, evaluate, rows), m = program.stated, len(program.stated[2].labels)
    low, high = (np.concatenate([*part, box]) for part, box in zip((rows.low, rows.high), program.box, strict=True))
    labels = [*rows.labels, *program.labels]
    kinds = np.array([kind_of(label) for label in labels])
    given = (low < high) | (kinds == "duration")
    names = [kind for kind in NAMED if kind in kinds and (timed or kind != "duration")]
    index = np.array(
        [names.index(kind) if kind in names and own else -1 for kind, own in zip(kinds, given, strict=True)]
    )
    loose, raw = index >= 0, np.append(program.resampled(ended, program.phases), program.separation.angles)
    sizes = _sizes(program, np.asarray(evaluate(raw)).ravel(), labels, kinds, (low, high))
    kept, below, above = (
        np.flatnonzero(~loose[:m]),
        *(np.flatnonzero(loose & np.isfinite(part)) for part in (low, high)),
    )
    take, signs = np.concatenate((kept, below, above)), np.repeat([0, 1, -1], [len(kept), len(below), len(above)])
    room = np.zeros((len(take), len(names)))
    room[np.arange(len(take)), index[take]] = signs * sizes[take]
    least = np.where(kinds == "duration", low / MOST, low - MOST * sizes)
    box = np.where(loose, (least, high + MOST * sizes), (low, high))[:, m:]
    answer = _relaxed(program, take, room)(
        x0=np.concatenate((program.guess(), program.separation.angles, np.full(len(names), FIRST))),
        lbx=np.append(box[0], np.zeros(len(names))),
        ubx=np.append(box[1], np.full(len(names), MOST)),
        lbg=np.where(signs < 0, -np.inf, low[take]),
        ubg=np.where(signs > 0, np.inf, high[take]),
    )
    found = np.asarray(answer["x"]).ravel()[: len(raw)]
    values = np.append(np.asarray(evaluate(found)).ravel(), found)
    shares = np.maximum(low - values, values - high) / sizes
    worst = [int(np.where(index == row, shares, 0.0).argmax()) for row in range(len(names))]
    gives = [
        Given(labels[at], str(kinds[at]), float(shares[at]), float(sizes[at])) for at in worst if shares[at] > NEARLY
    ]
    return sorted(gives, key=lambda each: -each.share) if shares[~loose].max() < NEARLY else []


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


def _sizes(program: JumpProgram, values: Array, labels: list[str], kinds: Array, bounds: tuple[Array, Array]) -> Array:
    """What a share of 1 is, of all rows, then variables: of friction that of its cone, as values of rows are."""
    sizes, (low, high) = np.ones(len(kinds)), bounds
    sizes[np.isin(kinds, ("ground", "apart"))] = LENGTH * program.node.height
    own = len(values) + np.flatnonzero(np.isin(kinds[len(values) :], NAMED))
    sizes[own] = np.maximum((high - low)[own] / 2, NARROW * np.abs(high + low)[own])
    for one, two in pairwise(np.flatnonzero(kinds == "friction").tolist()):
        if two == one + 1 and labels[one] == labels[two]:
            sizes[[one, two]] = max(LIGHT, float(values[[one, two]].mean()))
    return sizes


def sentence(given: Given, problem: Problem) -> str:
    """What a limit would have to be, in the words of a problem's file."""
    request, robot, name, unit = problem.jump, problem.robot, given.label.partition(" (")[0].rpartition(" of ")[2], ""
    assert request is not None
    limit = request.friction if given.kind == "friction" else 0.0
    if given.kind == "torque":
        of = problem.motor_torque_limits if given.label.startswith("torque of ") else problem.motor_stall
        limit, unit = request.margin["torque"] * of[robot.motors.index(name)], " N m"
    elif given.kind == "velocity":
        limit, unit = request.margin["velocity"] * problem.velocity_limits[robot.joints.index(name)], " rad/s"
    if limit:
        return f"{given.label}: {(1 + given.share) * limit:.3g}{unit} needed, {limit:.3g}{unit} allowed"
    unit = {"range": "rad", "duration": "s"}.get(given.kind, "m")
    return f"{given.label}: {given.share * given.size:.2g} {unit} missing"


def changed(problem: Problem, given: Given, beyond: float) -> tuple[str, Problem]:
    """Return a problem that gives ``beyond`` times what has to be of a kind of limits, with the change in words."""
    request, limits, motors, kind = problem.jump, problem.limits, problem.robot.motors, given.kind
    assert request is not None
    factor = math.ceil(100 * (1 + beyond * given.share)) / 100
    if kind == "torque":
        torques = zip(motors, problem.motor_torque_limits.tolist(), strict=True)
        curves = {name: replace(curve, stall=factor * curve.stall) for name, curve in limits.motor.items()}
        own = {name: factor * most for name, most in torques if math.isfinite(most)} or limits.torque
        return f"{factor:g} times the torque limits", replace(problem, limits=replace(limits, torque=own, motor=curves))
    if kind == "velocity":
        rates = (factor * problem.velocity_limits).tolist()
        return f"{factor:g} times the rate limits", replace(problem, limits=replace(limits, velocity=rates))
    if kind == "range":
        ranges = problem.position_limits + (factor - 1) / 2 * np.ptp(problem.position_limits, axis=1)[:, None] * [-1, 1]
        return f"joint ranges {factor:g} times as wide", replace(problem, limits=replace(limits, position=ranges))
    if kind == "apart":
        obstacles = [each for at, each in enumerate(problem.obstacles) if f"obstacle {at} " not in given.label]
        pairs = [each for each in problem.self_clearances if " clear of ".join(each.links) not in given.label]
        less = replace(problem, obstacles=tuple(obstacles), self_clearances=tuple(pairs))
        return f"no need for {given.label.partition(' (')[0]}", less
    if kind == "duration":
        sides = {name: replace(getattr(request, name), durations=None) for name in ("takeoff", "landing")}
        fixed = tuple(each for each in request.fixed if each != kind)
        return "durations left out", replace(problem, jump=replace(request, **sides, fixed=fixed))
    if kind == "ground":
        least = max(0.0, math.floor(1e3 * (request.clearance - (factor - 1) * given.size)) / 1e3)
        return f"clearance {least:g}", replace(problem, jump=replace(request, clearance=least))
    friction = math.ceil(100 * factor * request.friction) / 100
    return f"friction {friction:g}", replace(problem, jump=replace(request, friction=friction))
