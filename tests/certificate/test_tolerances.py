"""What the search accepts the certificate proves, and what it refuses the certificate refutes: one tolerance each.

A plan is kept as it is, and what is asked is moved until the plan lacks a fraction of the tolerance, or more than it.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from places import PROBLEMS

import floatplan as fp
from floatplan.certificate.certificate import certify
from floatplan.planning.options import SearchOptions
from floatplan.planning.planner import planned
from floatplan.planning.search import Search
from floatplan.planning.variables import Start
from floatplan.tables import BOUNDARY, CLEARANCE, ORIENTATION, RELATIVE

FRACTIONS = (-0.5, 0.25, 0.75, 1.25, 4.0)  # of the tolerance, by which a plan fails


@cache
def answer(name):
    problem = fp.load_problem(PROBLEMS / f"{name}.toml")
    return planned(problem, SearchOptions(budget=60.0))


def obstacle(plan, lacking):
    problem = plan.problem
    (pole,) = problem.obstacles
    return replace(problem, obstacles=(replace(pole, margin=plan.peaks.clearance + CLEARANCE * lacking),))


def limits(plan, **asked):
    return replace(plan.problem, limits=replace(plan.problem.limits, **asked))


def below(peak, lacking):
    return peak / (1 + RELATIVE * lacking)


def orientation(plan, lacking):
    goal = replace(
        plan.problem.goal, orientation=float(plan.at([plan.duration]).orientation[0]) + ORIENTATION * lacking
    )
    return replace(plan.problem, goal=goal)


MOVED = {
    "clearance": ("obstacle", obstacle),
    "torque": ("handstand", lambda plan, lacking: limits(plan, torque=below(plan.peaks.torque, lacking))),
    "velocity": ("handstand", lambda plan, lacking: limits(plan, velocity=below(plan.peaks.velocity, lacking))),
    "orientation": ("handstand", orientation),
}


@pytest.mark.parametrize("lacking", FRACTIONS)
@pytest.mark.parametrize("what", MOVED)
def test_search_and_certificate_agree(what, lacking):
    name, moved = MOVED[what]
    found = answer(name)
    problem = moved(found.plan, lacking)
    prepared = Search(problem)
    judged = prepared.judge(Start(found.best.variables, found.best.x), found.best.status)
    certificate = certify(replace(found.plan, problem=problem))
    assert judged.holds == (lacking < 1)
    failed = {finding.verdict for finding in certificate.findings if finding.kind != "recorded"}
    assert failed == ({"proved"} if lacking < 1 else {"proved", "refuted"})


def test_a_plan_that_is_kept_but_not_as_well_inside_as_the_search_aims_is_feasible():
    found = answer("obstacle")
    problem = obstacle(found.plan, 0.5)
    prepared = Search(problem)
    start = Start(found.best.variables, found.best.x, at_once=True)
    judged = prepared.follow(start, lambda: True)
    assert judged.holds
    assert judged.status == "feasible"


EDGES = {"q1": (-0.7311, 2.5), "q2": (-2.0, 2.0)}  # rad
OFF = dict(zip(("positions", "velocities", "accelerations"), BOUNDARY, strict=True))  # rad, rad/s, rad/s^2


def at_the_edge(quantity, share, side, end):
    """A flight that begins or ends with q1 on an edge of its range, but for a share of the tolerance, outwards."""
    robot = fp.Robot.from_urdf(PROBLEMS.parent / "urdf" / "gymnast.urdf")
    outwards = (-1.0, 1.0)[side]
    values = {"positions": np.array([EDGES["q1"][side], 0.2]), "velocities": np.zeros(2), "accelerations": np.zeros(2)}
    values[quantity][0] += outwards * share * OFF[quantity]
    edge, inside = fp.Posture(0.0, **values), fp.Posture(0.5, [0.3, 0.0])
    start, goal = (edge, inside) if end == "start" else (inside, edge)
    return fp.Problem(robot, start, goal, fp.Flight(1.0), limits=fp.Limits(position=EDGES, torque=20.0))


@pytest.mark.parametrize("quantity", OFF)
@pytest.mark.parametrize(("side", "end"), [(0, "start"), (1, "goal")])
def test_rounding_on_the_edge_of_a_range_is_met_within_the_tolerance_and_proved(quantity, side, end):
    for share in (1e-20, 0.95):
        plan = fp.plan(at_the_edge(quantity, share, side, end), prove=True)
        assert plan.ok
        assert plan.certificate.proved
    with pytest.raises(fp.InputError, match=r"outside the joint's range|on the edge") as raised:
        at_the_edge(quantity, 1.2, side, end)
    assert raised.value.element == f"{end}.{quantity}.q1"


@pytest.mark.parametrize(("side", "end"), [(0, "start"), (1, "goal")])
def test_from_the_edge_of_a_range_a_joint_accelerates_inwards(side, end):
    plan = fp.plan(at_the_edge("accelerations", -2.5 / OFF["accelerations"], side, end), prove=True)
    assert plan.ok, plan.explanation
    assert plan.certificate.proved
