"""Jumps that keep away from obstacles, and whose links keep apart: found, where one without these would not be."""

from dataclasses import replace

import pytest
from jumps import backflip, backflip_on_points, go2_problem, plan_on_fewer_nodes_in_a_plane

import floatplan as fp
from floatplan.errors import InputError

AROUND = {
    "a ceiling": {"obstacles": (fp.HalfPlane(point=(0.0, 0.85), normal=(0.0, -1.0)),)},
    "a post behind": {"obstacles": (fp.Bar(start=(-0.45, 0.0), end=(-0.45, 0.6), radius=0.03),)},
    "calves": {
        "self_clearances": (fp.SelfClearance(("base", "RL_calf"), 0.08), fp.SelfClearance(("FL_calf", "RL_calf"), 0.1))
    },
}


@pytest.mark.long
@pytest.mark.parametrize("case", AROUND)
def test_a_jump_is_found_that_keeps_away(case, monkeypatch):
    problem, known = replace(go2_problem(), **AROUND[case]), backflip()
    figure = "obstacles" if "obstacles" in AROUND[case] else "self_distance"
    assert replace(known, problem=problem).check.figures[figure] < 0
    if case != "a ceiling":  # there the fewer nodes are, the more programs are needed
        plan_on_fewer_nodes_in_a_plane(monkeypatch)
    found = fp.jump(problem, starts=1)
    assert found.ok
    assert found.check.figures[figure] >= 0
    assert fp.certify(found.flight).proved


@pytest.mark.long
def test_the_world_begins_where_the_frame_takes_off():
    """Moved with a ball that flies by it is found too; feet that are points leave where they stood."""
    problem, at = go2_problem(), (1.0, 0.5)
    moved = replace(problem.flight, takeoff=fp.Takeoff("RL_foot", at))
    ball = fp.Circle(center=(1.0 + at[0], 0.8 + at[1]), radius=0.05, velocity=(-3.0, 0.0))
    known = backflip_on_points()
    problem = replace(problem, flight=moved, obstacles=(ball,), jump=known.request)
    found = fp.jump(problem, starts=1, near=known)
    assert found.ok
    assert found.check.figures["obstacles"] >= 0
    assert fp.certify(found.flight).proved
    assert found.before[-1].anchor_position == pytest.approx(complex(*at), abs=1e-9)


REFUSED = {
    "a wall in the way": ({"obstacles": (fp.HalfPlane(point=(0.3, 0.0), normal=(-1.0, 0.0)),)}, r"obstacles\[0\]"),
    "the ground": ({"obstacles": (fp.HalfPlane(point=(0.0, 0.0)),)}, r"obstacles\[0\]"),
    "links": ({"self_clearances": (fp.SelfClearance(("base", "FL_calf"), 0.1),)}, r"self_clearance\[0\]"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_too_near_where_it_stands_is_refused(case):
    given, element = REFUSED[case]
    with pytest.raises(InputError, match=f"{element}: where the robot stands, .* clear of"):
        fp.jump(replace(go2_problem(), **given))


def test_an_obstacle_counts_while_it_is_there():
    """One in the way of the flight, that is gone by then."""
    known, duration = backflip(), backflip().flight.duration
    x, z = known.flight.at(duration / 2).com_position.tolist()
    for window, holds in (((-1.0, 1e-3), True), ((0.0, duration), False)):
        circle = fp.Circle(center=(x - 0.3, z + 0.1), radius=0.05, window=window)
        check = replace(known, problem=replace(known.problem, obstacles=(circle,))).check
        assert (check.figures["obstacles"] > 0) == holds
