"""Starts that the kernel follows: by number, alone or together, and what it says of them before and after."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sampled_flight import nodes_of, trajectory, values_of

import floatplan as fp
from floatplan.kernel.tolerances import EXCHANGE
from floatplan.motion.flight import flight_of
from floatplan.planning import kernel_problem
from floatplan.planning.constraints import applies
from floatplan.planning.explanation import impossible_ends
from floatplan.planning.kernel_input import rows
from floatplan.planning.kernel_problem import LEVEL_OF_DRAWS, KernelProblem
from floatplan.planning.options import SearchOptions
from floatplan.planning.result import AttemptResult
from floatplan.planning.search import Search
from floatplan.planning.variables import Start
from floatplan.robot.urdf.tree import PREFIX, robots_folder

NAMES = ("obstacle", "torque_limited", "moving_hoop", "handstand_ground", "gallery/solo", "gallery/bolt")
DRAWN_ALONE = 40  # starts, the first of them plain ones at other h where that is free


@pytest.fixture(params=NAMES)
def ready(request, root) -> Search:
    """Obstacles, some that move or are the ground, torques, rates, clearances of links, a free h, other objectives."""
    path = root / "problems" / f"{request.param}.toml"
    if PREFIX in path.read_text() and robots_folder() is None:
        pytest.skip("example-robot-data is not installed")
    return Search(fp.load_problem(path))


def begun(ready: Search, number: int) -> AttemptResult:
    """Where a start begins: no work may be done."""
    return ready.follow_numbered(ready.spec.problem.degrees, [], range(number, number + 1), lambda: True)


def ends_fail(ready: Search) -> list[str]:
    start = ready.plain_start
    asked = KernelProblem.of(ready.spec, start)
    asked.follow(range(0), np.inf, 0, reach=ready.spec.flight.central_reach)
    return list(impossible_ends(ready.spec, start, asked.end_values))


@pytest.mark.parametrize("reach", [0.5, 1.1, 1.6])
def test_where_a_start_ends_hangs_little_on_which_rows_are_differentiated(reach, root, monkeypatch):
    """A G1 whose rows contradict one another at first; it leads elsewhere where such steps are not solved exactly."""
    if robots_folder() is None:
        pytest.skip("example-robot-data is not installed")
    monkeypatch.setattr(rows, "EXCHANGE", replace(EXCHANGE, reach=reach, looked_ahead=reach / 2))
    g1 = Search(fp.load_problem(root / "problems" / "gallery" / "g1.toml"))
    ended = g1.follow(g1.plain_start)
    assert ended.is_optimal
    assert ended.objective_value == pytest.approx(428.7169660, rel=1e-8)


def test_of_what_does_not_hold_it_says_the_same_again(ready):
    """The plain motion as it is: no work may be done."""
    ended = ready.follow(ready.plain_start, most_work=0)
    judged = ready.judge(Start(ended.variables, ended.x), ended.status)
    assert judged.violation == pytest.approx(ended.violation, abs=1e-9)
    assert len(judged.worst.s) == len(ended.worst.s)
    assert np.sort(judged.worst.value) == pytest.approx(np.sort(ended.worst.value), abs=1e-7)


@pytest.mark.parametrize("number", [17, 18])
def test_of_more_motions_a_start_violates_less(ready, number, monkeypatch):
    """By evaluations in NumPy, on plain branches and on others."""
    flight, kept, violated = ready.spec.flight, ready.spec.constraints, []
    for motions in (1, 3, 10):
        monkeypatch.setattr(kernel_problem, "MOTIONS_PER_VARIABLE", motions)
        start = begun(Search(ready.spec.problem), number)
        nodes = nodes_of(LEVEL_OF_DRAWS, start.variables.polynomials.form)
        at = trajectory(flight, start.variables, nodes, start.x)
        squares = [
            (np.minimum(values_of(block, at), 0) ** 2)[applies(block, at.sampling.grid.s)].sum() for block in kept
        ]
        violated.append(at.residual.item() ** 2 + sum(squares))
    assert violated == sorted(violated, reverse=True)
    assert violated[-1] < violated[0]


def test_starts_are_drawn_on_all_branches_and_not_twice(ready):
    found = [begun(ready, number) for number in range(DRAWN_ALONE)]
    again = begun(ready, DRAWN_ALONE - 1)
    assert np.array_equal(found[-1].x, again.x)
    assert len({start.x.tobytes() for start in found}) == DRAWN_ALONE
    branches = {tuple(np.round(start.variables.polynomials.boundary[:, 3], 9)) for start in found}
    assert len(branches) > 2


@pytest.mark.parametrize("number", [2, 4])
def test_of_where_a_start_on_other_branches_ends_it_says_the_same_again(ready, number):
    ended = ready.follow_numbered(ready.spec.problem.degrees, [], range(number, number + 1), lambda: False)
    judged = ready.judge(Start(ended.variables, ended.x), ended.status)
    assert judged.violation == pytest.approx(ended.violation, rel=1e-3)  # far from a plan, minima are not all found
    assert judged.objective_value == pytest.approx(ended.objective_value, rel=1e-9)
    start = begun(ready, number)
    alone = ready.follow(Start(start.variables, start.x))
    assert (alone.holds, alone.status) == (ended.holds, ended.status)


def test_the_plain_start_ends_where_it_did_before_others(ready):
    numbers, degrees = (range(each, each + 1) for each in (0, 2, 0)), ready.spec.problem.degrees
    first, _, again = (ready.follow_numbered(degrees, [], each, lambda: False) for each in numbers)
    assert np.array_equal(first.x, again.x)
    assert again.evaluations == first.evaluations


def test_starts_that_are_followed_together_end_as_alone(root):
    """None of them leads to a plan; of those before the first that does, it alone counts."""
    problem = fp.load_problem(root / "problems" / "obstacle.toml")
    blocked = replace(problem, obstacles=(fp.Circle(center=(1.1, 2.0), radius=0.6, margin=0.02),))
    ready, none = Search(blocked, SearchOptions(5)), ()
    together = ready.follow_numbered(blocked.degrees, none, range(6), lambda: False)
    alone = [
        ready.follow_numbered(blocked.degrees, none, range(number, number + 1), lambda: False) for number in range(6)
    ]
    assert [each.starts for each in (together, *alone)] == [6, *6 * [1]]
    nearest = min(alone, key=lambda each: each.violation)
    assert together.violation == nearest.violation > 0
    assert np.array_equal(together.x, nearest.x)
    assert together.work == pytest.approx(sum(each.work for each in alone))
    assert together.evaluations == sum(each.evaluations for each in alone)
    least = alone[0].work + alone[1].work
    cut = ready.follow_numbered(blocked.degrees, none, range(6), lambda: False, least + 1)
    assert (cut.starts, cut.work) == (2, pytest.approx(least))


@pytest.mark.parametrize(
    ("center", "radius", "is_followed"),
    [((0.0, 0.6), 0.6, False), ((1.4, 3.4), 0.6, False), ((1.165, 3.07), 0.2, True)],
)
def test_it_is_asked_first_whether_any_motion_may_hold(root, center, radius, is_followed):
    """A pole in the start posture, one on the way of the centre of mass; and one of which nothing is known."""
    problem = fp.load_problem(root / "problems" / "obstacle.toml")
    blocked = replace(problem, obstacles=(fp.Circle(center=center, radius=radius, margin=0.02),))
    ready = Search(blocked, SearchOptions(5))
    alone = ready.follow_numbered(blocked.degrees, (), range(1), lambda: False)
    asked = ready.follow_numbered(blocked.degrees, (), range(1), lambda: False, asks=True)
    assert alone.starts == 1
    assert asked.starts == is_followed == (not ready.impossible)
    nearest = alone.x if is_followed else ready.plain_start.x
    assert np.array_equal(asked.x, nearest)
    assert asked.violation > 0


def test_what_is_told_before_a_search_is_so(root):
    """Circles and walls anywhere, moving or not, against what is computed with ends and path themselves."""
    problem, rng = fp.load_problem(root / "problems" / "obstacle.toml"), np.random.default_rng(4)
    told = []
    for _ in range(120):
        place, velocity = rng.uniform((-1, -1), (4, 5)), tuple(rng.normal(0, 1, 2))
        circle = fp.Circle(center=tuple(place), radius=rng.uniform(0.2, 1.2), velocity=velocity)
        wall = fp.HalfPlane(point=tuple(place), normal=(0.3, 1.0), margin=0.1)
        blocked = replace(problem, obstacles=(circle if rng.random() < 0.7 else wall,))
        ready = Search(blocked, SearchOptions(5))
        outcome = ready.follow_numbered(blocked.degrees, (), range(1), lambda: False, asks=True)
        told.append((ready._ends_hold, ready._path_is_clear, outcome.starts))
        assert ready._ends_hold == (not ends_fail(ready))
        assert not (ready._path_is_clear and flight_of(blocked).impossibilities())
        assert ready.impossible == [*ends_fail(ready), *flight_of(blocked).impossibilities()]
    assert len(set(told)) == 5
