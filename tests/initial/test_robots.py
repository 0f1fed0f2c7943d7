"""What a robot stands on, and which of its joints a first flight takes."""

from __future__ import annotations

import math

import pytest
from long_cases import cases

import floatplan as fp
from floatplan.initial.feet import feet, standing_height, upright
from floatplan.initial.robots import chosen_robot
from floatplan.robot.urdf.tree import PREFIX, robots_folder

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


@pytest.mark.long
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
    assert standing_height(robot, "foot") > 0.4
