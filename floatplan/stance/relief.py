"""Why no jump was found: which limits stand in the way, by how much and when.

The program is solved once more with room for each kind of limits, whose sum is least: motion and balance hold, and what
has to give stands in the way. It is the same program, with multiples of a few more variables added to its rows.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csc_matrix

from floatplan.arrays import Array, IntArray
from floatplan.problem.problem import Problem
from floatplan.stance.model import casadi
from floatplan.stance.program import SMOOTH, JumpProgram, Solution

KINDS = ("torque", "velocity", "friction", "range", "duration", "ground")
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
    if " the ground (" in label:
        return "meets" if "meets" in label else "ground"
    return {"rate": "velocity", "torque-speed curve": "torque"}.get(words, words)


def giving(program: JumpProgram, ended: Solution, timed: tuple[str, ...] = ()) -> list[Given]:
    """Return the limits that give, the most of each kind, where the sum of what kinds give is least; none if not found.

    Parameters
    ----------
    program : without a solution
    ended : where it ended
    timed : how the labels of durations begin that may give
    """
    (_, evaluate, rows), m = program.stated, len(program.stated[2].labels)
    low, high = (np.concatenate([*part, box]) for part, box in zip((rows.low, rows.high), program.box, strict=True))
    labels = [*rows.labels, *program.labels]
    kinds = np.array([kind_of(label) for label in labels])
    kinds[[label.startswith("duration") and not label.startswith(timed) for label in labels]] = ""
    names = [kind for kind in KINDS if kind in kinds]
    loose = np.isin(kinds, names) & ((low < high) | (kinds == "duration")) & (np.isfinite(low) | np.isfinite(high))
    index = np.array([names.index(kind) if kind in names else 0 for kind in kinds])
    raw = np.append(program.resampled(ended, program.phases), program.separation.start)
    values, sizes, own = np.asarray(evaluate(raw)).ravel(), np.ones(len(kinds)), m + np.flatnonzero(loose[m:])
    sizes[kinds == "ground"] = LENGTH * program.node.height
    sizes[own] = np.maximum((high - low)[own] / 2, NARROW * np.abs(high[own] + low[own]))
    for one, two in pairwise(np.flatnonzero(kinds == "friction").tolist()):
        if two == one + 1 and labels[one] == labels[two]:  # the two sides of a cone
            sizes[[one, two]] = max(LIGHT, float(values[[one, two]].mean()))
    kept, below, above = np.flatnonzero(~loose[:m]), *(np.flatnonzero(loose & np.isfinite(at)) for at in (low, high))
    take, signs = np.concatenate((kept, below, above)), np.repeat([0, 1, -1], [len(kept), len(below), len(above)])
    room = np.zeros((len(take), len(names)))
    room[np.arange(len(take)), index[take]] = signs * sizes[take]
    least = np.where(kinds == "duration", low / MOST, low - MOST * sizes)
    box = np.where(loose, (least, high + MOST * sizes), (low, high))[:, m:]
    found = _relaxed(program, take, room)(
        x0=np.concatenate((program.guess(), program.separation.start, np.full(len(names), FIRST))),
        lbx=np.append(box[0], np.zeros(len(names))),
        ubx=np.append(box[1], np.full(len(names), MOST)),
        lbg=np.where(signs < 0, -np.inf, low[take]),
        ubg=np.where(signs > 0, np.inf, high[take]),
    )["x"][: len(raw)]
    values = np.append(np.asarray(evaluate(found)).ravel(), np.asarray(found).ravel())
    shares = np.maximum(low - values, values - high) / sizes
    worst = [int(np.where(loose & (index == row), shares, 0.0).argmax()) for row in range(len(names))]
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
