"""The posture from which a robot jumps: its file's where that stands, else one that is looked for, or what is asked."""

import math

import numpy as np
import pytest
from legged_samples import biped, quadruped
from long_cases import cases

import floatplan as fp
from floatplan.initial.flight import jump_problem
from floatplan.initial.legs import Leg
from floatplan.initial.options import InitOptions
from floatplan.initial.robots import chosen_robot
from floatplan.jumps.contacts import BENT, contact_at
from floatplan.robot.standing import positions_from_com, undersides

FLAT = math.pi / 2
ROBOTS = {  # whose zero postures do not stand, or not so that legs could push
    "straight": quadruped(),
    "folded flat": quadruped(turned=(FLAT, -math.pi), knee=(0.0, 2.9)),
    "a knee from zero on": quadruped(knee=(0.0, 2.4)),
    "a knee to zero": biped(knee=(-2.4, 0.0)),
    "lying": quadruped(turned=(FLAT, 0.0)),
    "straight on soles": biped(foot="sole", knee=(0.0, 2.4)),
}


@pytest.fixture
def chosen(tmp_path):
    def chosen(text, **options):
        path = tmp_path / "robot.urdf"
        path.write_text(text)
        return chosen_robot(path, **options)

    return chosen


def check_stands(chosen):
    """Feet level and lowest, soles flat, the mass over them, legs neither straight nor folded, ranges kept."""
    robot, y = chosen.robot, np.append(0.0, chosen.posture)
    contacts = [contact for foot in chosen.feet for contact in contact_at(robot, foot, y)]
    places = positions_from_com(robot, [contact.spots[0] for contact in contacts], y)
    grounds = places.imag - [contact.depth for contact in contacts]
    assert np.ptp(grounds) < 1e-3
    assert places.real.min() < 1e-3
    assert places.real.max() > -1e-3
    for foot in chosen.feet:
        leg = Leg(robot, foot, robot.resting)
        assert abs(math.sin(leg.bend(y))) > BENT
        lowest = undersides(robot, leg.corners, y).min()
        assert lowest == pytest.approx(grounds.min(), abs=1e-3)
    low, high = robot.position_limits.T
    assert (chosen.posture > low + 0.05).all()
    assert (chosen.posture < high - 0.05).all()


@pytest.mark.parametrize("name", cases(ROBOTS, {"lying", "folded flat", "a knee from zero on"}))
def test_where_the_zero_posture_does_not_stand_one_that_does_is_found(chosen, name):
    robot = chosen(ROBOTS[name])
    assert robot.feet
    assert robot.stance.fault
    check_stands(robot)


def test_a_posture_that_stands_is_kept(chosen):
    """Bent as in the zero of its joints, which are those that the search finds for it, or any other."""
    stands = chosen(quadruped(turned=(-0.5, 1.05)))
    assert not stands.stance.own
    np.testing.assert_array_equal(stands.posture, stands.robot.resting)
    assert jump_problem(stands, 0, InitOptions()).jump == fp.JumpRequest()


def test_what_is_asked_of_the_posture_is_kept_and_the_rest_is_found(chosen):
    robot = chosen(quadruped(), posture={"fl_knee": -0.8})
    assert robot.posture[robot.robot.joints.index("fl_knee")] == pytest.approx(-0.8, abs=1e-4)
    check_stands(robot)
    followed = chosen(quadruped(), posture={"fr_knee": -0.8})
    np.testing.assert_allclose(followed.posture, robot.posture)


def test_a_posture_of_the_srdf_is_taken_whatever_its_name(chosen, tmp_path):
    """Where the likely one does not stand, another that does."""
    joints = {"hip": -0.5, "knee": 1.05}
    states = {
        "standing": dict.fromkeys(joints, 0.0),
        "ready to jump": joints,
    }
    text = "".join(
        f'<group_state name="{name}" group="all">'
        + "".join(
            f'<joint name="{leg}_{key}" value="{at}"/>' for leg in ("fl", "fr", "hl", "hr") for key, at in of.items()
        )
        + "</group_state>"
        for name, of in states.items()
    )
    (tmp_path / "robot.srdf").write_text(f'<robot name="legged">{text}</robot>')
    robot = chosen(quadruped())
    assert robot.choices["reference"] == "ready to jump"
    assert robot.stance is None or not robot.stance.own
    check_stands(robot)
    asked = chosen(quadruped(), options={"reference": "standing"})
    assert asked.choices["reference"] == "standing"
    assert asked.stance.own
    check_stands(asked)


def test_a_keyframe_is_the_posture(tmp_path):
    """Of an MJCF; one that stands before one that lies, whatever the order."""
    legs = "".join(
        f'''<body name="{name}_thigh" pos="{x} {y} 0"><joint name="{name}_hip" axis="0 1 0" range="-140 140"/>
        <geom type="capsule" fromto="0 0 -.04 0 0 -.16" size=".02" mass=".6"/>
        <body name="{name}_shank" pos="0 0 -.2"><joint name="{name}_knee" axis="0 1 0" range="-140 140"/>
        <geom type="capsule" fromto="0 0 -.04 0 0 -.15" size=".015" mass=".3"/>
        <geom type="sphere" pos="0 0 -.19" size=".02" mass=".05"/></body></body>'''
        for name, x, y in (("fl", 0.2, 0.1), ("fr", 0.2, -0.1), ("hl", -0.2, 0.1), ("hr", -0.2, -0.1))
    )
    keys = "".join(
        f'<key name="{name}" qpos="0 0 .4 1 0 0 0 {" ".join([f"{hip} {knee}"] * 4)}"/>'
        for name, hip, knee in (("home", 0.0, 0.0), ("push", 0.6, -1.1))
    )
    path = tmp_path / "robot.xml"
    path.write_text(
        f"""<mujoco model="keyed"><worldbody><body name="trunk" pos="0 0 .4"><freejoint/>
        <geom type="box" size=".2 .07 .04" pos="0 0 .04" mass="7"/>{legs}</body></worldbody>
        <keyframe>{keys}</keyframe></mujoco>"""
    )
    robot = chosen_robot(path)
    assert robot.choices["reference"] == "push"
    np.testing.assert_allclose(robot.posture, [0.6, -1.1] * 2)
    check_stands(robot)
