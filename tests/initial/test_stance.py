"""What a robot stands on, and whether it can leave the ground from a posture."""

from __future__ import annotations

import math

import numpy as np
import pytest
from long_cases import cases
from scipy.integrate import simpson
from scipy.interpolate import CubicHermiteSpline

import floatplan as fp
from floatplan.initial.candidates import MOST, Flights, PlainMotions
from floatplan.initial.flight import _flips
from floatplan.initial.robots import chosen_robot, feet, upright
from floatplan.initial.stance import Stance
from floatplan.robot.urdf.example_robots import PREFIX, robots_folder

needs_robots = pytest.mark.skipif(robots_folder() is None, reason="example-robot-data is not installed")

WITH_HANDS = "g1_description/urdf/g1_29dof_with_hand_rev_1_0.urdf"
FEET = {
    "a1_description/urdf/a1.urdf": ("RL_foot", "FL_foot"),
    WITH_HANDS: ("left_ankle_roll_link",),
    "human_description/robots/human.urdf": ("left_foot",),
    "quadruped_description/urdf/quadruped.urdf": ("BL_contact", "FL_contact"),
    "ur_description/urdf/ur5_robot.urdf": (),
    "panda_description/urdf/panda.urdf": (),
    "tiago_description/robots/tiago_dual.urdf": (),
}


@needs_robots
@pytest.mark.parametrize("urdf", cases(FEET, [WITH_HANDS]))
def test_feet(urdf):
    found = chosen_robot(PREFIX + urdf).feet
    sides = {"left": "right", "RL": "RR", "FL": "FR", "BL": "BR"}
    other = tuple(next((f.replace(a, b) for a, b in sides.items() if a in f), f) for f in FEET[urdf])
    assert all(frame in pair for frame, pair in zip(found, zip(FEET[urdf], other, strict=True), strict=True))


@needs_robots
def test_fingers_stay_locked_and_legs_choose_the_plane():
    chosen = chosen_robot(PREFIX + WITH_HANDS)
    assert chosen.robot.plane.name == "xz"
    assert {"left_hip_pitch_joint", "left_knee_joint", "left_ankle_pitch_joint"} <= set(chosen.robot.joints)
    assert not [joint for joint in chosen.robot.joints if "hand" in joint]


def test_a_chain_stands_up(root):
    robot = fp.Robot.from_urdf(root / "urdf" / "gymnast.urdf")
    assert feet(robot) == ("foot",)
    angle = upright(robot, "foot")
    assert angle == pytest.approx(math.pi / 2)
    stance = Stance(robot, "foot")
    assert stance.size > 0.4
    sunk = stance.standing(np.array([angle, angle + math.pi]), np.stack([robot.resting] * 2)).sunk
    assert sunk[0] == 0
    assert sunk[1] > 0.5


@pytest.mark.parametrize("seed", range(3))
def test_candidates_are_what_the_verdicts_say(root, seed):
    """The ratios of a candidate are those of the problem that is made of it."""
    robot = fp.Robot.from_urdf(root / "urdf" / "high_jumper.urdf")
    stance = Stance(robot, "foot")
    found = Flights(stance, 0, (0.2, 0.5), 0.5).search(seed)
    postures = [fp.Posture(o, q) for o, q in zip(found.orientations, found.positions, strict=True)]
    problem = fp.Problem(
        robot,
        *postures,
        fp.Flight(
            float(found.duration),
            float(found.angular_momentum),
            takeoff=fp.Takeoff("foot"),
            horizontal_velocity=float(found.horizontal_velocity),
        ),
        limits=fp.Limits(velocity="urdf"),
        ground=True,
    )
    ratios = [fp.takeoff(problem).ratio, fp.landing(problem).ratio]
    np.testing.assert_allclose(found.ratios, ratios, rtol=1e-9)
    assert found.begins_and_ends == (max(ratios) <= MOST and found.depth == 0)
    assert found.begins_and_ends
    degrees = np.rad2deg([*found.orientations, *found.positions.ravel()])
    np.testing.assert_allclose(degrees, degrees.round(), atol=1e-9)
    again = Flights(stance, 0, (0.2, 0.5), 0.5).search(seed)
    assert again.duration == found.duration
    np.testing.assert_array_equal(again.positions, found.positions)


@needs_robots
def test_what_is_no_stance(root):
    """A tipped sole, a trunk on the ground, a centre of mass far beyond the feet; each alone."""
    chosen = chosen_robot(PREFIX + "g1_description/urdf/g1_29dof_rev_1_0.urdf")
    g1 = Stance(chosen.robot, chosen.feet[0], chosen.feet)
    assert unsteady(g1, 0.0, chosen.robot.resting) == 0
    for tilt in (10, 20, 55):
        ankle = chosen.robot.resting + np.deg2rad(tilt) * (np.array(chosen.robot.joints) == "left_ankle_pitch_joint")
        turned = float(np.deg2rad(tilt)) * float(g1.foot_turns[chosen.robot.joints.index("left_ankle_pitch_joint")])
        assert (unsteady(g1, 0.0, ankle) > 0) == (tilt > 15)
        assert unsteady(g1, -turned, ankle) > 0 or tilt < 30, "upright feet, and the body leans over"
    go2 = chosen_robot(PREFIX + "go2_description/urdf/go2.urdf")
    stance = Stance(go2.robot, go2.feet[0], go2.feet)
    low, high = go2.robot.position_limits.T
    folded = np.where(["calf" in joint for joint in go2.robot.joints], low, go2.robot.resting)
    folded = np.where(["thigh" in joint for joint in go2.robot.joints], np.minimum(high, 1.5), folded)
    assert stance.standing(np.zeros(1), folded[None]).height[0] < 0.4 * stance.size
    assert unsteady(stance, 0.0, folded) > 0
    pole = fp.Robot.from_urdf(root / "urdf" / "gymnast.urdf")
    on_end = Stance(pole, "foot")
    assert [unsteady(on_end, math.pi / 2 + lean, pole.resting) > 0 for lean in (0.0, 0.1, 0.5, 1.2)] == [0, 0, 1, 1]


def unsteady(stance, orientation, positions):
    return stance.standing(np.array([orientation]), positions[None]).unsteady[0]


@needs_robots
def test_flips_backwards_are_from_the_hind_legs():
    chosen = chosen_robot(PREFIX + "go2_description/urdf/go2.urdf")
    group = next(_flips(chosen))
    turns = int(chosen.robot.plane.turn)
    assert {each.stance.frame for each in group if each.turns == turns} == {chosen.feet[0]}
    assert {each.stance.frame for each in group if each.turns == -turns} == {chosen.feet[-1]}
    assert chosen.feet[0].startswith("R")


def test_plain_motions_turn_the_base_as_their_integral_says(root):
    robot = fp.Robot.from_urdf(root / "urdf" / "high_jumper.urdf")
    stance, rng = Stance(robot, "foot"), np.random.default_rng(3)
    ends, rates = rng.uniform(-0.5, 0.5, (4, 2, 3)), rng.uniform(-2, 2, (4, 2, 3))
    durations, momenta = np.array([0.3, 0.5, 0.7, 1.0]), rng.uniform(-9, 9, 4)
    plain = PlainMotions.between(ends, rates, durations)
    for index, duration in enumerate(durations):
        spline = CubicHermiteSpline([0.0, duration], ends[index], rates[index])
        times = np.linspace(0, duration, 4001)
        rows = stance.dynamics.momentum_map(spline(times))
        rate = (momenta[index] - (rows[:, 1:] * spline(times, 1)).sum(axis=1)) / rows[:, 0]
        assert plain.turns(stance, momenta)[index] == pytest.approx(simpson(rate, x=times), abs=1e-4)
        np.testing.assert_allclose(plain.accelerations[index], spline([0.0, duration], 2))


@needs_robots
def test_a_shank_that_ends_at_the_foot_is_not_in_the_ground():
    chosen = chosen_robot(PREFIX + "human_description/robots/human.urdf")
    (foot,) = chosen.feet
    assert Stance(chosen.robot, foot).standing(np.zeros(1), chosen.robot.resting[None]).sunk[0] == 0
