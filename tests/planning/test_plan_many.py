"""Many plans at once, by the compiled kernel."""

import dataclasses
import math
import re
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from plain_problems import plain_problems

import floatplan as fp
from floatplan.kernel.tolerances import MOST_STARTS, SETTINGS
from floatplan.planning import many
from floatplan.tables import BOUNDARY, ORIENTATION


@pytest.fixture(scope="module")
def gymnast_problem(root):
    return fp.load_problem(root / "problems" / "somersault.toml")


def judge(plan):
    """Boundary conditions and orientation at landing, by Pinocchio's dynamics and quadrature of the plan's own."""
    times = np.array([0.0, plan.duration])
    for end, state in enumerate((plan.problem.initial, plan.problem.final)):
        found = [values[end] for values in plan.joint_motion(times)]
        wanted = (state.positions, state.velocities, state.accelerations)
        for value, right, tolerance in zip(found, wanted, BOUNDARY, strict=True):
            assert np.abs(value - right).max() < tolerance
    assert abs(plan.final_orientation - plan.problem.final.orientation) < ORIENTATION


def test_plans_hold_by_independent_dynamics():
    plans = fp.plan_many(plain_problems(48))
    assert plans.ok.mean() > 0.8  # the others have one joint, which cannot turn the base as it is asked to
    for index in np.flatnonzero(plans.ok):
        plan = plans[int(index)]
        judge(plan)
        assert plan.ok
        assert plan.objective_value == pytest.approx(plans.objective[index], rel=1e-12)
        assert plans.residual[index] < ORIENTATION
        assert not np.isnan(plans.evaluations[index])


def test_a_family_is_planned_as_its_problems_are(gymnast_problem):
    rng = np.random.default_rng(2)
    values = {
        "flight.duration": rng.uniform(0.9, 1.3, 6),
        "goal.orientation": gymnast_problem.goal.orientation + rng.uniform(-0.2, 0.2, 6),
        "start.positions.q1": rng.uniform(-0.5, 0.5, 6),
        "goal.velocities.q2": rng.uniform(-0.5, 0.5, 6),
        "goal.accelerations.q1": rng.uniform(-0.5, 0.5, 6),
        "flight.gravity": rng.uniform(1, 20, 6),
    }
    family = fp.Family(gymnast_problem, values)
    assert len(family) == 6
    together = fp.plan_many(family)
    one_by_one = fp.plan_many(list(family))
    assert together.status.tolist() == one_by_one.status.tolist()
    np.testing.assert_array_equal(together.objective, one_by_one.objective)
    assert family[3].flight.gravity == values["flight.gravity"][3]
    for index, plan in enumerate(together):
        assert plan.problem.flight.duration == values["flight.duration"][index]
        assert plan.problem.final.velocities[1] == values["goal.velocities.q2"][index]
        if plan.ok:
            judge(plan)
            expected = fp.plan(family[index]).objective_value
            assert plan.objective_value <= expected * (1 + 1e-6)


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        ("flight.duration", math.nan, "not a finite number"),
        ("flight.duration", -1.0, "not positive"),
        ("flight.duration", 1e9, "outside 0.001 to 1000 s"),
        ("flight.angular_momentum", math.inf, "not a finite number"),
        ("start.orientation", 1e300, "outside"),
        ("goal.positions.q1", 4.0, "outside the joint's range"),
        ("goal.positions.q1", -math.pi - 2e-8, "outside the joint's range"),
        ("start.velocities.q2", 1e9, "outside"),
        ("start.accelerations.q2", math.nan, "not a finite number"),
        ("flight.gravity", -1.0, "negative"),
        ("flight.takeoff.position.1", math.nan, "not a finite number"),
    ],
)
def test_a_row_that_is_wrong_has_its_message_and_the_others_their_plans(path, value, said, gymnast_problem):
    good = {"start.orientation": gymnast_problem.start.orientation}.get(path, 1.0 if "flight.d" in path else 0.3)
    family = fp.Family(gymnast_problem, {path: [good, value, good]})
    plans = fp.plan_many(family)
    assert plans.status[1] == "error"
    assert said in plans.messages[1]
    assert path.rpartition(".")[0] in plans.messages[1]
    assert np.isnan(plans.coefficients[1]).all()
    assert "error" not in plans.status[[0, 2]]
    with pytest.raises(fp.InputError, match=re.escape(said)):
        plans[1]


def test_the_answer_does_not_depend_on_jobs_or_neighbours(monkeypatch):
    monkeypatch.setattr(many, "CHUNK", 7)
    problems = plain_problems(96)[::4]
    one, two = fp.plan_many(problems), fp.plan_many(problems[::-1], jobs=2)
    assert one.status.tolist() == two.status[::-1].tolist()
    np.testing.assert_array_equal(one.coefficients, two.coefficients[::-1])
    np.testing.assert_array_equal(one.evaluations, two.evaluations[::-1])


def test_a_plan_is_that_of_a_batch_and_is_proved_as_it_is(root):
    """Bit for bit: by one start, by several, and where the plain motion does not lead to the best, as the cat's."""
    for name in ("somersault", "handstand", "new_configuration", "falling_cat"):
        problem = fp.load_problem(root / "problems" / f"{name}.toml")
        for starts, seed in ((1, 0), (3, 5)):
            row = fp.plan_many([problem], starts=starts, seed=seed)[0]
            alone, proved = (fp.plan(problem, starts=starts, seed=seed, prove=prove) for prove in (False, True))
            assert (row.status, row.explanation) == (alone.status, alone.explanation)
            assert row.angular_momentum == alone.angular_momentum == proved.angular_momentum
            np.testing.assert_array_equal(row.coefficients, alone.coefficients)
            np.testing.assert_array_equal(proved.coefficients, alone.coefficients)
            took = [{**plan.solver, "seconds": 0.0} for plan in (row, alone, proved)]
            assert took[0] == took[1] == took[2]
            assert proved.certificate.proved


def test_constraints_have_the_whole_search_and_stay_in_their_place(gymnast_problem, root):
    hard = fp.load_problem(root / "problems" / "obstacle.toml")
    touching = replace(hard, obstacles=(fp.Circle(center=(0.0, 0.0), radius=0.2),))
    plans = fp.plan_many([gymnast_problem, hard, touching, gymnast_problem])
    assert plans.status.tolist() == ["optimal", "optimal", "impossible", "optimal"]
    assert plans.objective[1] == pytest.approx(fp.plan(hard).objective_value, rel=1e-9)
    assert not plans[2].ok
    assert "impossible" in plans[2].explanation
    assert plans.starts[2] == 0, "nothing is tried"
    assert "tried" not in plans[2].explanation
    family = fp.plan_many(fp.Family(hard, {"obstacles.0.center.0": [hard.obstacles[0].center[0], 50.0]}))
    far = replace(hard, obstacles=(dataclasses.replace(hard.obstacles[0], center=(50.0, 3.342)),))
    expected = [fp.plan(problem).objective_value for problem in (hard, far)]
    np.testing.assert_allclose(family.objective, expected, rtol=1e-9)


def test_constrained_problems_are_given_up_sooner_unless_searched_for(root, monkeypatch):
    high_jump = fp.load_problem(root / "problems" / "high_jump.toml")
    monkeypatch.setattr(many, "PATIENCE", 1 / 600)
    brief = fp.plan_many([high_jump])
    assert brief.status.tolist() == ["not_found"]
    assert brief.messages[0].startswith(f"The search ended at {brief.evaluations[0]} evaluations; search=True")
    assert not brief[0].ok
    whole = fp.plan_many([high_jump], search=True)
    assert whole.status.tolist() == ["optimal"]
    assert whole.evaluations[0] > brief.evaluations[0]


def test_what_is_not_found_is_searched_for(gymnast_problem):
    """With h far from (9) no motion turns the base so little; the search says so, and what came nearest."""
    family = fp.Family(gymnast_problem, {"flight.angular_momentum": [400.0, 4.0]})
    quick = fp.plan_many(family)
    assert quick.status.tolist() == ["not_found", "optimal"]
    assert quick.residual[0] > 1
    assert np.isnan(quick.objective[0])
    assert "search=True" in quick.messages[0]
    assert quick[0].status == "infeasible"


def somersaults(problem, turns):
    """Flights by their h T, kg m^2: what can be reached depends on this product alone."""
    duration = np.linspace(0.9, 1.4, 40)
    return fp.Family(problem, {"flight.duration": duration, "flight.angular_momentum": turns / duration})


def test_flights_at_the_edge_of_what_can_be_reached_are_found(gymnast_problem):
    """Motions down to h T = 2.31 are known; with few starts, or ones soon given up, most of these are not found."""
    plans = fp.plan_many(somersaults(gymnast_problem, 2.6))
    assert plans.ok.mean() > 0.8
    judge(plans[int(np.flatnonzero(plans.ok)[0])])


def test_what_is_out_of_reach_is_seen_before_all_starts_are_tried(gymnast_problem):
    """No motion turns the base so little: the most is h T = 5.3992, by hundreds of local searches."""
    plans = fp.plan_many(somersaults(gymnast_problem, 5.6))
    assert set(plans.status) == {"not_found"}
    assert (plans.starts < MOST_STARTS).mean() > 0.9
    assert (plans.starts > SETTINGS.starts_to_agree).all()
    assert f"from {plans.starts[0]} starts" in plans.messages[0]


def test_nothing_to_plan(gymnast_problem):
    assert len(fp.plan_many([])) == 0
    for path in ("flight.duration", "limits.torque.q1", "limits.velocity.q2", "goal.orientation", "start.positions.q1"):
        plans = fp.plan_many(fp.Family(gymnast_problem, {path: np.empty(0)}))
        assert (len(plans), plans.status.shape) == (0, (0,))


@pytest.mark.long
def test_memory_of_a_large_family_is_bounded(gymnast_problem):
    """Beside the answers, 328 bytes a problem here, there is room for a chunk alone: a million take below 2 GB."""
    count = 100_000
    family = fp.Family(gymnast_problem, {"flight.duration": np.linspace(1.0, 1.01, count)})
    fp.plan_many(family[:10])
    tracemalloc.start()
    try:
        plans = fp.plan_many(family)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert (plans.status == "optimal").all()
    kept = sum(array.nbytes for array in vars(plans).values() if isinstance(array, np.ndarray))
    assert kept < 400 * count
    assert most - kept < 60e6
