"""What a robot stands on, and which of its joints a first flight takes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from long_cases import cases

import floatplan as fp
from floatplan.initial.afloat import turns_afloat
from floatplan.initial.feet import feet, standing_height, upright
from floatplan.initial.robots import chosen_robot
from floatplan.robot.urdf.tree import PREFIX, robots_folder
from floatplan.robot.wheels import PLANNED, explain_wheels, wheels
from floatplan.stance.contacts import contact_at

needs_robots = pytest.mark.skipif(robots_folder() is None, reason="example-robot-data is not installed")

WITH_HANDS = "g1_description/urdf/g1_29dof_with_hand_rev_1_0.urdf"
TWO_ARMS = "tiago_description/robots/tiago_dual.urdf"
FEET = {
    "a1_description/urdf/a1.urdf": ("RL_foot", "FL_foot"),
    WITH_HANDS: ("left_ankle_roll_link",),
    "human_description/robots/human.urdf": ("left_foot",),
    "quadruped_description/urdf/quadruped.urdf": ("BL_contact", "FL_contact"),
    "ur_description/urdf/ur5_robot.urdf": (),
    "panda_description/urdf/panda.urdf": (),
    TWO_ARMS: (),
}


@needs_robots
@pytest.mark.parametrize("urdf", cases(FEET, [WITH_HANDS, TWO_ARMS]))
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


INERTIAL = """<inertial><origin xyz="0 0 {1}"/><mass value="{0}"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>"""
SHAPE = '<collision><origin xyz="0 0 {0}"/><geometry><cylinder radius="{1}" length="{2}"/></geometry></collision>'


def link(name, mass, middle, radius, length):
    return f'<link name="{name}">{INERTIAL.format(mass, middle)}{SHAPE.format(middle, radius, length)}</link>'


def joint(child, place, kind="revolute"):
    return f"""<joint name="{child}_joint" type="{kind}"><parent link="trunk"/><child link="{child}"/>
    <origin xyz="0 0 {place}"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="9" velocity="9"/></joint>"""


def written(folder, *parts):
    path = folder / "robot.urdf"
    path.write_text(f'<robot name="robot">{"".join(parts)}</robot>')
    return path


def test_legs_without_names_are_where_the_robot_would_stand(tmp_path):
    """A diver's legs; of an arm that reaches as low, but beside the mass, nothing stands."""
    trunk, arms = link("trunk", 30, 0.3, 0.1, 0.6), link("arms", 8, 0.3, 0.04, 0.6)
    legs = link("legs", 20, -0.45, 0.02, 0.9)
    diver = chosen_robot(written(tmp_path, trunk, arms, legs, joint("arms", 0.55), joint("legs", 0)))
    assert diver.feet == ("legs",)
    (tip,) = contact_at(diver.robot, "legs", np.zeros(3))
    assert (tip.name, tip.depth) == ("legs.tip", pytest.approx(0.0))
    assert tip.spots[0].place == pytest.approx(-0.9j)
    aside = legs.replace("0 0 -0.45", "0.7 0 -0.45")
    assert chosen_robot(written(tmp_path, trunk, arms, aside, joint("arms", 0.55), joint("legs", 0))).feet == ()


def test_a_wheel_is_no_foot_and_may_turn_on(tmp_path):
    trunk, wheel = link("trunk", 10, 0, 0.3, 0.2), link("wheel", 2, 0, 0.1, 0.02)
    chosen = chosen_robot(written(tmp_path, trunk, wheel, joint("wheel", -0.1, "continuous")))
    assert wheels(chosen.robot) == {"wheel_joint": "wheel"}
    assert chosen.feet == ()
    first = next(turns_afloat(chosen))
    assert abs(first.final.positions[0]) > 4 * math.pi
    (told,) = explain_wheels(chosen.robot)
    assert told.endswith(PLANNED)
    ranged = written(tmp_path, trunk, wheel, joint("wheel", -0.1))
    assert wheels(chosen_robot(ranged).robot) == {}


def test_legs_side_by_side_are_coupled(tmp_path):
    trunk, legs = link("trunk", 30, 0.3, 0.1, 0.6), [link(each, 9, -0.4, 0.02, 0.8) for each in ("one", "two")]
    chosen = chosen_robot(written(tmp_path, trunk, *legs, joint("one", 0), joint("two", 0)))
    assert {name: each.leader for name, each in chosen.robot.coupled.items()} == {"two_joint": "one_joint"}
    heavier = legs[1].replace('"9"', '"8"')
    assert not chosen_robot(written(tmp_path, trunk, legs[0], heavier, joint("one", 0), joint("two", 0))).robot.coupled
