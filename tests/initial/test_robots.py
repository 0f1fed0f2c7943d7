"""What a robot stands on, and which of its joints a first flight takes."""

from __future__ import annotations

import math

import legged_samples
import numpy as np
import pytest
from long_cases import cases

import floatplan as fp
from floatplan.initial.afloat import problems_afloat
from floatplan.initial.feet import feet, standing_height, upright
from floatplan.initial.flight import jump_problem
from floatplan.initial.options import InitOptions
from floatplan.initial.robots import chosen_robot
from floatplan.jumps.contacts import contact_at, ground_below
from floatplan.jumps.setup import jump_setup
from floatplan.robot.standing import corners, undersides
from floatplan.robot.urdf.tree import PREFIX, robots_folder
from floatplan.robot.wheels import PLANNED, explain_wheels, wheels

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
    first = next(problems_afloat(chosen))
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


def test_a_foot_is_the_child_with_the_shape(tmp_path):
    """Shanks without geometry are lines to the feet's frames, which are below the feet: these touch nothing."""
    thigh, shank = legged_samples.inertial(1.5, "0 0 -0.15"), legged_samples.inertial(0.8, "0 0 -0.15")
    parts = []
    for side, way in (("left", 0.1), ("right", -0.1)):
        parts += [
            legged_samples.hinge(f"{side}_hip", "body", f"{side}_thigh", f"0 {way} 0"),
            f'<link name="{side}_thigh">{thigh}</link>',
            legged_samples.hinge(f"{side}_knee", f"{side}_thigh", f"{side}_shank", "0 0 -0.3", (-2.4, -0.1)),
            f'<link name="{side}_shank">{shank}</link>',
            legged_samples.fixed(f"{side}_end", f"{side}_shank", f"{side}_foot", "0 0 -0.35"),
            legged_samples.link(f"{side}_foot", 0.3, legged_samples.ball(0.05, "0 0 0.09")),
        ]
    path = tmp_path / "robot.urdf"
    path.write_text(legged_samples.legged(*parts))
    chosen = chosen_robot(path)
    (foot,) = chosen.feet
    assert foot in ("left_foot", "right_foot")
    assert not [link for link in chosen.robot.touching_links if "shank" in link]
    (contact,) = contact_at(chosen.robot, foot, np.append(0.0, chosen.posture))
    assert contact.depth == pytest.approx(0.05), "it stands on the middle of its ball"
    hulls = chosen.robot.hulls([foot])
    lowest = undersides(chosen.robot, corners(hulls), np.append(0.0, chosen.posture)).min()
    ground = ground_below(chosen.robot, contact, np.append(0.0, chosen.posture))
    assert lowest == pytest.approx(ground, abs=1e-3)


def humanoid(*, sideways: int) -> str:
    """A biped on soles of whose joints more turn sideways than ahead."""
    legs = []
    for side, way in (("left", 0.1), ("right", -0.1)):
        leg = legged_samples.leg(side, (0.0, 0.0), foot="sole", knee=(0.0, 2.4))
        roll = {"limits": (-0.6, 0.6), "axis": "1 0 0"}
        legs += [
            legged_samples.hinge(f"{side}_hip_roll", "body", f"{side}_base", f"0 {way} 0", **roll),
            legged_samples.link(f"{side}_base", 0.3),
            leg.replace('link="body"', f'link="{side}_base"'),
            legged_samples.hinge(f"{side}_ankle_roll", f"{side}_foot", f"{side}_plate", "0 0 -0.05", **roll),
            legged_samples.link(f"{side}_plate", 0.1, legged_samples.box("0.22 0.07 0.01", "0.03 0 -0.01")),
        ]
    arms = []
    for number in range(sideways):
        arms += [
            legged_samples.hinge(
                f"arm{number}", "body", f"hand{number}", f"0 0 {0.2 + 0.1 * number}", (-1, 1), "1 0 0"
            ),
            legged_samples.link(f"hand{number}", 0.8, center="0 0 0.1"),
        ]
    return legged_samples.legged(*legs, more=arms)


@pytest.mark.parametrize("sideways", [1, 4])
def test_the_plane_is_the_one_in_which_legs_step(tmp_path, sideways):
    """Whichever most joints turn in; it is said which joints bend the legs there."""
    path = tmp_path / "robot.urdf"
    path.write_text(humanoid(sideways=sideways))
    most = fp.Robot.from_urdf(path).plane.name if sideways > 1 else "xz"
    assert most == ("yz" if sideways > 1 else "xz")
    chosen = chosen_robot(path)
    assert chosen.robot.plane.name == "xz"
    assert {joint.split("_")[1] for joint in chosen.stepping} == {"hip", "knee", "ankle"}
    asked = chosen_robot(path, {"plane": "yz"})
    assert asked.robot.plane.name == "yz"
    assert asked.stepping == []


@pytest.mark.parametrize(("make", "count"), [(legged_samples.biped, 1), (legged_samples.quadruped, 2)])
def test_legs_on_wheels_stand_on_them(tmp_path, make, count):
    """Their joints hold the wheels, which roll as round feet."""
    path = tmp_path / "robot.urdf"
    path.write_text(make(foot="wheel"))
    chosen = chosen_robot(path)
    assert chosen.on_wheels
    assert len(chosen.feet) == count
    assert all(foot.endswith("wheel") for foot in chosen.feet)
    rolls = {name for name in chosen.robot.joint_tree.joint if name.endswith("roll")}
    assert rolls <= set(chosen.robot.locked)
    assert dict(chosen.choices["locked"]) == dict.fromkeys(rolls, 0.0)
    problem = jump_problem(chosen, 0, InitOptions())
    assert problem.jump is not None
    assert problem.jump.feet == "rolling"
    setup = jump_setup(problem, problem.jump)
    assert all(contact.radius == pytest.approx(0.06, abs=1e-3) for contact in setup.phases[0].contacts)


def steered(radius: float) -> str:
    """A biped whose wheels are steered about the vertical, with a light whip that turns in the plane of its legs."""
    text = legged_samples.biped(foot="wheel").replace('radius="0.06"', f'radius="{radius}"')
    more = [
        legged_samples.hinge("whip", "body", "whip_link", "0 0 0.1"),
        legged_samples.link("whip_link", 0.02, center="0 0 0.05"),
    ]
    for side in ("left", "right"):
        text = text.replace(
            f'<parent link="{side}_shank"/><child link="{side}_wheel"/>',
            f'<parent link="{side}_fork"/><child link="{side}_wheel"/>',
        )
        text = text.replace('xyz="0 0 -0.2" rpy="0 0.0 0"', 'xyz="0 0 0" rpy="0 0.0 0"')
        more += [
            legged_samples.hinge(f"{side}_steer", f"{side}_shank", f"{side}_fork", "0 0 -0.2", (-1.5, 1.5), "0 0 1"),
            legged_samples.link(f"{side}_fork", 0.1),
            legged_samples.fixed(f"{side}_end", f"{side}_fork", f"{side}_contact", f"0 0 -{radius}"),
            f'<link name="{side}_contact"/>',
        ]
    return text.replace("</robot>", "".join(more) + "</robot>")


@pytest.mark.parametrize("radius", [0.05, 0.17])
def test_steered_wheels_of_any_size_are_held_upright(tmp_path, radius):
    """The file's posture would steer them out of the plane, and something else is left locked for being light."""
    (tmp_path / "robot.urdf").write_text(steered(radius))
    bent = {"hip": -0.5, "knee": 1.0, "steer": 0.6}
    states = "".join(
        f'<joint name="{side}_{key}" value="{at}"/>' for side in ("left", "right") for key, at in bent.items()
    )
    (tmp_path / "robot.srdf").write_text(
        f'<robot name="legged"><group_state name="standing" group="all">{states}</group_state></robot>'
    )
    chosen = chosen_robot(tmp_path / "robot.urdf")
    assert chosen.on_wheels
    assert len(chosen.feet) == 1
    assert "joints" in chosen.choices
    assert {chosen.robot.locked[name] for name in ("left_roll", "right_roll", "left_steer", "right_steer")} == {0.0}
    problem = jump_problem(chosen, 0, InitOptions())
    assert problem.jump is not None
    setup = jump_setup(problem, problem.jump)
    assert [contact.radius for contact in setup.phases[0].contacts] == pytest.approx([radius], abs=1e-3)
    untouched = chosen_robot(tmp_path / "robot.urdf", {"joints": ["left_hip", "left_knee", "left_roll"]})
    assert not untouched.on_wheels


def test_a_cart_on_wheels_has_no_feet(tmp_path):
    body, wheels_of_cart = legged_samples.legged(), []
    for number, at in enumerate((-0.1, 0.1)):
        wheels_of_cart += [
            legged_samples.hinge(f"roll{number}", "body", f"wheel{number}", f"{at} 0 -0.05", None),
            legged_samples.link(f"wheel{number}", 0.3, legged_samples.wheel(0.06, 0.03)),
        ]
    path = tmp_path / "robot.urdf"
    path.write_text(body.replace("</robot>", "".join(wheels_of_cart) + "</robot>"))
    assert chosen_robot(path).feet == ()
