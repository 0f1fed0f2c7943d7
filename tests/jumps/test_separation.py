"""Jumps that keep away from obstacles, and whose links keep apart: found, where one without these would not be."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from jumps import INSTALLED, backflip, go2_problem
from needed import skip_or_fail

import floatplan as fp
from floatplan.errors import InputError
from floatplan.jumps.planner import MARGINS
from floatplan.jumps.separation import INSTANTS, _around
from floatplan.jumps.setup import jump_setup

if not INSTALLED:
    skip_or_fail("CasADi or example-robot-data is not installed")

AROUND: dict[str, dict[str, Any]] = {
    "a bar overhead": {"obstacles": (fp.Circle(center=(0.2, 0.75), radius=0.05),)},
    "a ceiling": {"obstacles": (fp.HalfPlane(point=(0.0, 0.85), normal=(0.0, -1.0)),)},
    "a post behind": {"obstacles": (fp.Bar(start=(-0.45, 0.0), end=(-0.45, 0.6), radius=0.03),)},
    "a ball that flies by": {"obstacles": (fp.Circle(center=(1.0, 0.8), radius=0.05, velocity=(-3.0, 0.0)),)},
    "calves": {
        "self_clearances": (fp.SelfClearance(("base", "RL_calf"), 0.08), fp.SelfClearance(("FL_calf", "RL_calf"), 0.1))
    },
}
ROBOTS = {
    "go2": ("go2_description/urdf/go2.urdf", "RL_foot", ("base", "RL_calf")),
    "talos": ("talos_data/robots/talos_reduced.urdf", "leg_left_6_link", ("torso_2_link", "leg_left_4_link")),
}
REFERENCES = {"go2": "standing", "talos": "half_sitting"}


@pytest.mark.long
@pytest.mark.parametrize("case", AROUND)
def test_a_jump_is_found_that_keeps_away(case: str) -> None:
    problem, known = replace(go2_problem(), **AROUND[case]), backflip()
    figure = "obstacles" if "obstacles" in AROUND[case] else "self_distance"
    assert replace(known, problem=problem).check.figures[figure] < 0
    found = fp.jump(problem, starts=1)
    assert found.ok
    assert found.check.figures[figure] >= 0
    assert fp.certify(found.flight).proved


@pytest.mark.long
def test_the_world_begins_where_the_frame_takes_off() -> None:
    """Moved with its obstacle, the jump is the same but for rounding; feet that are points leave where they stood."""
    problem, at = go2_problem(), (1.0, 0.5)
    moved = replace(problem.flight, takeoff=fp.Takeoff("RL_foot", at))
    ball = fp.Circle(center=(1.0 + at[0], 0.8 + at[1]), radius=0.05, velocity=(-3.0, 0.0))
    points = fp.JumpRequest(feet="points")
    found = fp.jump(replace(problem, flight=moved, obstacles=(ball,), jump=points), starts=1)
    assert found.ok
    assert found.before[-1].anchor_position == pytest.approx(complex(*at), abs=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("name", ROBOTS)
def test_rows_are_what_is_measured(name: str) -> None:
    """Until landing, where a guess is not yet on the ground: of point feet and soles, at nodes."""
    source, frame, links = ROBOTS[name]
    robot = fp.Robot.from_urdf(f"example-robot-data:{source}", coupled="mirror", reference=REFERENCES[name], plane="xz")
    flight = fp.Flight(0.4, angular_momentum="free", takeoff=fp.Takeoff(frame, (0.2, 0.1)))
    circle = fp.Circle(center=(1.5, 0.6), radius=0.05, margin=0.01, velocity=(0.4, -0.2))
    bar = fp.Bar(start=(-1.8, 0.3), end=(-1.5, 0.5), radius=0.03)
    posture = fp.Posture(0.0, np.array(robot.resting))
    apart = (fp.SelfClearance(links),)
    problem = fp.Problem(robot, posture, posture, flight, obstacles=(circle, bar), self_clearances=apart)
    program = jump_setup(problem, fp.JumpRequest()).program(MARGINS)
    guess = program.guess(np.random.default_rng(3))
    chosen = {line.name: line for line in program.separation._candidates if links[0] in line.name}
    program = program.extended(
        replace(program.separation, lines=tuple(chosen.values())).at(program.node, program.motion(guess))
    )
    _, evaluate, rows, _ = program.compiled
    values = np.asarray(evaluate(np.append(guess, program.separation.start))).ravel()
    _, segments = program.separation._measured(program.node, program.motion(guess))
    landing = program.starts[program.flight + 1]
    assert len(program.separation.lines) == 3
    for line in program.separation.lines:
        own, other = (np.stack((segments.start[:, k], segments.end[:, k])) for k in (line.first, line.other))
        least = np.inf
        for interval, angle, reach in zip(line.intervals, line.angles, line.reach, strict=True):
            for node in (interval, interval + 1) if interval < landing else ():
                apart = own[:, None, INSTANTS * node] - other[None, :, INSTANTS * node]
                least = min(least, (apart * np.exp(-1j * angle)).real.min() - reach)
        at = [
            row for row, label in enumerate(rows.labels) if label in (f"{line.name} (takeoff)", f"{line.name} (flight)")
        ]
        assert values[at].min() == pytest.approx(least, abs=1e-9)


def test_ways_lead_around_on_either_side() -> None:
    angles, gaps = np.array([3.0, 3.0, 1.0, 1.5, 0.1, 0.0]), np.array([0.1, 0.1, -0.1, -0.2, -0.1, 0.1])
    over, under = (_around(angles, gaps, swapped) for swapped in (False, True))
    np.testing.assert_allclose(over[2:5], [2.25, 1.5, 0.75])
    assert math.sin(under[3]) == pytest.approx(-math.sin(1.5))
    np.testing.assert_array_equal(under[[0, 1, 5]], angles[[0, 1, 5]])


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "a wall in the way": ({"obstacles": (fp.HalfPlane(point=(0.3, 0.0), normal=(-1.0, 0.0)),)}, r"obstacles\[0\]"),
    "the ground": ({"obstacles": (fp.HalfPlane(point=(0.0, 0.0)),)}, r"obstacles\[0\]"),
    "links": ({"self_clearances": (fp.SelfClearance(("base", "FL_calf"), 0.1),)}, r"self_clearance\[0\]"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_too_near_where_it_stands_is_refused(case: str) -> None:
    given, element = REFUSED[case]
    with pytest.raises(InputError, match=f"{element}: where the robot stands, .* clear of"):
        fp.jump(replace(go2_problem(), **given))


def test_an_obstacle_counts_while_it_is_there() -> None:
    """One in the way of the flight, that is gone by then."""
    known, duration = backflip(), backflip().flight.duration
    x, z = known.flight.at(duration / 2).com_position.tolist()
    for window, holds in (((-1.0, 1e-3), True), ((0.0, duration), False)):
        circle = fp.Circle(center=(x - 0.3, z + 0.1), radius=0.05, window=window)
        check = replace(known, problem=replace(known.problem, obstacles=(circle,))).check
        assert (check.figures["obstacles"] > 0) == holds
