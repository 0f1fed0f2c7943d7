"""What a robot stands on, and which of its joints a first flight takes."""

import math

import legged_samples
import pytest
from long_cases import cases

import floatplan as fp
from floatplan.initial.feet import feet, standing_height, upright
from floatplan.initial.flight import jump_problem
from floatplan.initial.options import InitOptions
from floatplan.initial.robots import chosen_robot
from floatplan.jumps.setup import jump_setup
from floatplan.robot.urdf.tree import PREFIX

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


@pytest.mark.parametrize("urdf", cases(FEET, [WITH_HANDS, TWO_ARMS]))
def test_feet(urdf):
    found = chosen_robot(PREFIX + urdf).feet
    sides = {"left": "right", "RL": "RR", "FL": "FR", "BL": "BR"}
    other = tuple(next((f.replace(a, b) for a, b in sides.items() if a in f), f) for f in FEET[urdf])
    assert all(frame in pair for frame, pair in zip(found, zip(FEET[urdf], other, strict=True), strict=True))


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


def test_legs_side_by_side_are_coupled(tmp_path):
    trunk, legs = link("trunk", 30, 0.3, 0.1, 0.6), [link(each, 9, -0.4, 0.02, 0.8) for each in ("one", "two")]
    chosen = chosen_robot(written(tmp_path, trunk, *legs, joint("one", 0), joint("two", 0)))
    assert {name: each.leader for name, each in chosen.robot.coupled.items()} == {"two_joint": "one_joint"}
    heavier = legs[1].replace('"9"', '"8"')
    assert not chosen_robot(written(tmp_path, trunk, legs[0], heavier, joint("one", 0), joint("two", 0))).robot.coupled


def humanoid(*, sideways):
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
    assert problem.jump.feet == "rolling"
    setup = jump_setup(problem, problem.jump)
    assert all(contact.radius == pytest.approx(0.06, abs=1e-3) for contact in setup.phases[0].contacts)
