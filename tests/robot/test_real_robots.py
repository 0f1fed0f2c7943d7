"""Robots of example-robot-data: each loads, or is refused for a true reason; mirror couplings and SRDF postures."""

from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
from long_cases import cases
from robot_free_flyer import FreeFlyer, random_states, relative_error
from robot_samples import TWO_LINKS, inertial, joint, robot_text
from straight_axes import axes_turned_in_file

from floatplan.errors import InputError
from floatplan.motion.planar.closed_form import Dynamics
from floatplan.robot import Coupling, Robot
from floatplan.robot.leak import MEANINGLESS, WORTH_A_WARNING, explain_leak, out_of_plane_leak
from floatplan.robot.urdf import tree as urdf
from floatplan.robot.urdf.tree import PREFIX, example_urdfs, robots_folder, urdf_path
from floatplan.robot.wheels import explain_wheels, wheels

REFUSED = {  # file: a part of the reason, each looked up in the file
    "alex_description/urdf/alex_psyonic_hands.urdf": 'names joint "index_q1", which does not exist',
    "hector_description/robots/quadrotor_base.urdf": "no joint that turns is left to plan",
    "iris_description/robots/iris_simple.urdf": "no joint that turns is left to plan",
    "romeo_description/urdf/romeo_laas_small.urdf": "breaks the triangle inequality",
    "romeo_description/urdf/romeo_small.urdf": "breaks the triangle inequality",
    "simple_humanoid_description/urdf/simple_humanoid.urdf": "as many joints turn about x and y (9 each)",
    "simple_humanoid_description/urdf/simple_humanoid_classical.urdf": "as many joints turn about x and y (9 each)",
    "ur_description/urdf/ur3.urdf": "has no <link>",
}


EXACT = 1e-10


@pytest.mark.parametrize("name", cases(example_urdfs(), {*example_urdfs()} - {*example_urdfs()[::4], *REFUSED}))
def test_real_robots_load_or_are_refused_for_a_true_reason(name, capfd):
    """D and torques are those of Pinocchio's free-flyer model of the robot whose axes were turned onto the normal.

    Some files write axes up to 2e-4 rad off. Such a robot leaves the plane to first order in the tilt, so what its
    restriction to the plane is depends on what is dropped; turning the axes, and nothing else, makes a robot that has
    one. Its distance from the file as it stands is of the tilt's order.
    """
    if name in REFUSED:
        with pytest.raises(InputError) as caught:
            Robot.from_urdf(PREFIX + name)
        assert REFUSED[name] in caught.value.reason
        return
    robot = Robot.from_urdf(PREFIX + name, armature=0.0)  # Pinocchio reads no SRDF by itself
    assert capfd.readouterr() == ("", "")
    assert out_of_plane_leak(robot) >= 0.0
    text, tilt = axes_turned_in_file(robot)
    assert robot.tilt == pytest.approx(tilt, rel=1e-6, abs=1e-11)
    planar, raw, data = FreeFlyer(robot, text), FreeFlyer(robot), robot.model.createData()
    closed = Dynamics(robot.tree)
    for full, velocity, acceleration in random_states(robot, 3):
        row = robot.plane.normal @ pin.computeCentroidalMap(robot.model, data, full)[3:]
        row = np.r_[row[2], row @ robot.selection]
        positions = np.linalg.lstsq(robot.selection, full - robot.reference, rcond=None)[0]
        torques = robot.selection.T @ pin.rnea(robot.model, data, full, velocity, acceleration)
        state = full, velocity, acceleration
        assert relative_error(row, planar.momentum_row(full)) < EXACT
        assert relative_error(closed.momentum_map(positions[None])[0], planar.momentum_row(full)) < EXACT
        assert relative_error(torques, planar.torques(*state)) < EXACT
        assert relative_error(row, raw.momentum_row(full)) < EXACT + 10.0 * tilt
        assert relative_error(torques, raw.torques(*state)) < EXACT + 10.0 * tilt


def test_unknown_robots_are_refused_with_advice():
    with pytest.raises(InputError, match=r"has no file 'go2\.urdf'") as caught:
        Robot.from_urdf(PREFIX + "go2.urdf")
    assert "go2_description/urdf/go2.urdf" in caught.value.advice


def test_without_the_package_the_error_names_the_command(monkeypatch):
    monkeypatch.setattr(urdf, "_candidates", lambda: iter(()))
    with pytest.raises(InputError, match="example-robot-data is not installed") as caught:
        Robot.from_urdf(PREFIX + "go2_description/urdf/go2.urdf")
    assert "[robots]'" in caught.value.advice
    assert example_urdfs() == ()


def test_environment_variable_and_share_folders_come_into_question(tmp_path, monkeypatch):
    monkeypatch.setattr(urdf, "_of_distribution", lambda: None)
    monkeypatch.setattr(urdf.sys, "prefix", str(tmp_path / "nowhere"))
    monkeypatch.setattr(urdf, "INSTALL_PREFIXES", ())
    assert robots_folder() is None
    ros = tmp_path / "ros" / "share" / "example-robot-data" / "robots"
    own = tmp_path / "own"
    for folder in (ros, own):
        folder.mkdir(parents=True)
        (folder / "two.urdf").write_text(TWO_LINKS)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "ros"))
    assert urdf_path(PREFIX + "two.urdf") == ros / "two.urdf"
    monkeypatch.setenv("EXAMPLE_ROBOT_DATA_MODEL_DIR", str(own))
    robot = Robot.from_urdf(PREFIX + "two.urdf")
    assert (robot.path, robot.source) == (own / "two.urdf", PREFIX + "two.urdf")


QUADRUPEDS = {
    "a1_description/urdf/a1.urdf": ("FL_thigh_joint", "FL_calf_joint", "RL_thigh_joint", "RL_calf_joint"),
    "b1_description/urdf/b1.urdf": ("FL_thigh_joint", "FL_calf_joint", "RL_thigh_joint", "RL_calf_joint"),
    "go2_description/urdf/go2.urdf": ("FL_thigh_joint", "FL_calf_joint", "RL_thigh_joint", "RL_calf_joint"),
    "solo_description/robots/solo12.urdf": ("FL_HFE", "FL_KFE", "HL_HFE", "HL_KFE"),
    "anymal_b_simple_description/robots/anymal.urdf": ("LF_HFE", "LF_KFE", "LH_HFE", "LH_KFE"),
}


@pytest.mark.parametrize("name", QUADRUPEDS)
def test_mirror_couples_left_and_right_legs_and_stops_the_leak(name):
    apart = Robot.from_urdf(PREFIX + name)
    together = Robot.from_urdf(PREFIX + name, coupled="mirror", reference="standing")
    assert together.joints == QUADRUPEDS[name]
    assert len(together.coupled) == 4
    for follower, coupling in together.coupled.items():
        side = follower[:2]
        assert coupling == Coupling({"FR": "FL", "RR": "RL", "HR": "HL", "RF": "LF", "RH": "LH"}[side] + follower[2:])
    assert out_of_plane_leak(apart) > MEANINGLESS
    assert out_of_plane_leak(together) < WORTH_A_WARNING
    assert (abs(together.resting) > 0.4).all()
    advice = explain_leak(apart, out_of_plane_leak(apart))
    assert "meaningless" in advice
    assert f"{next(iter(together.coupled))} with {together.joints[0]}" in advice
    assert explain_leak(together, out_of_plane_leak(together)) is None


def pair(left_axis="0 1 0", right_axis="0 1 0", right_side=-0.2, right_x=0.0):
    left = joint("left", "a", "b", left_axis).replace("0.3 0 0", "0 0.2 0")
    right = joint("right", "a", "c", right_axis).replace("0.3 0 0", f"{right_x} {right_side} 0")
    knees = joint("left_knee", "b", "d", left_axis), joint("right_knee", "c", "e", right_axis)
    return robot_text(left, right, *knees, joint("tail", "a", "f"), links="abcdef")


@pytest.fixture
def load(tmp_path):
    def load(text, **options):
        (tmp_path / "robot.urdf").write_text(text)
        return Robot.from_urdf(tmp_path / "robot.urdf", **options)

    return load


def test_mirror_finds_pairs_by_place_and_ratio_by_axis(load):
    robot = load(pair(), coupled="mirror")
    assert robot.joints == ("left", "left_knee", "tail")
    assert robot.coupled == {"right": Coupling("left"), "right_knee": Coupling("left_knee")}
    opposed = load(pair(right_axis="0 -1 0"), coupled="mirror")
    assert opposed.coupled == {"right": Coupling("left", -1.0), "right_knee": Coupling("left_knee", -1.0)}
    assert out_of_plane_leak(opposed) < 1e-14
    chosen = load(pair(), coupled="mirror", joints=["right_knee", "right"])
    assert chosen.joints == ("right_knee", "right")
    assert chosen.coupled == {"left": Coupling("right"), "left_knee": Coupling("right_knee")}


@pytest.mark.parametrize("along", [-0.3, 4.0])
@pytest.mark.parametrize("name", ["right", "right_knee"])
def test_mirror_minds_not_where_on_its_axis_an_origin_is(load, name, along):
    """The same mechanism, written with another origin: what the joint carries is where it was."""
    child = {"right": "c", "right_knee": "e"}[name]
    text = ElementTree.fromstring(pair())
    place = text.find(f"joint[@name='{name}']/origin")
    carried = [text.find(f"link[@name='{child}']/inertial/origin")]
    carried += [joint.find("origin") for joint in text.iterfind("joint") if joint.find("parent").get("link") == child]
    for origin, shift in ((place, along), *((each, -along) for each in carried)):
        x, y, z = map(float, origin.get("xyz").split())
        origin.set("xyz", f"{x} {y + shift} {z}")
    robot = load(ElementTree.tostring(text, encoding="unicode"), coupled="mirror")
    assert robot.coupled == {"right": Coupling("left"), "right_knee": Coupling("left_knee")}
    assert out_of_plane_leak(robot) == pytest.approx(out_of_plane_leak(load(pair(), coupled="mirror")), abs=1e-12)


@pytest.mark.parametrize("elsewhere", [{"right_side": -0.4}, {"right_x": 0.1}, {"right_side": 0.2}])
def test_mirror_refuses_what_is_no_mirror_image(load, elsewhere):
    with pytest.raises(InputError, match="mirror image") as caught:
        load(pair(**elsewhere), coupled="mirror")
    assert caught.value.element == 'coupled "mirror"'


def test_coupled_by_another_word_is_refused(load):
    with pytest.raises(InputError, match='"mirror", not "both"') as caught:
        load(pair(), coupled="both")
    assert caught.value.element == "coupled"


def srdf(states, name="sample"):
    groups = "".join(
        f'<group_state name="{state}" group="all">'
        + "".join(f'<joint name="{key}" value="{value}"/>' for key, value in values.items())
        + "</group_state>"
        for state, values in states.items()
    )
    return f'<robot name="{name}">{groups}</robot>'


def test_reference_posture_comes_from_the_srdf_beside(tmp_path, load):
    bent = joint("k", "b", "c", "0 0 1", kind="revolute")
    text = robot_text(
        joint("j", "a", "b", kind="revolute"),
        bent,
        joint("roll", "a", "d", "1 0 0"),
        joint("l", "d", "e"),
        links="abcde",
    )
    states = {
        "crouch": {"j": 0.5, "k": 0.25, "roll": 0.3, "l": -0.2, "root_joint": "0 0 0 0 0 0 1"},
        "flat": {"j": "0"},
    }
    (tmp_path / "srdf").mkdir()
    (tmp_path / "x.srdf").write_text(srdf({"crouch": {"other1": 1, "other2": 2, "j": 3}}))
    (tmp_path / "robot.srdf").write_text(srdf(states))
    robot = load(text, reference="crouch", plane="xz")
    assert robot.joints == ("j", "l")
    assert robot.resting.tolist() == [0.5, -0.2]
    assert robot.locked == {"k": 0.25, "roll": 0.0}
    assert "not taken to the reference posture, as they would tilt planned joints: roll" in robot.warnings
    assert load(text, reference="crouch", plane="xz", locked={"k": -0.5}).locked["k"] == -0.5
    assert load(text, reference="crouch", plane="xz", joints=["j"]).locked == {"k": 0.25, "roll": 0.3, "l": -0.2}
    with pytest.raises(InputError, match='no posture "stand" is known') as caught:
        load(text, reference="stand", plane="xz")
    assert caught.value.advice == "known are crouch, flat"


def test_reference_postures_that_are_not_there_or_wrong_are_refused(tmp_path, load):
    with pytest.raises(InputError, match="put an SRDF file"):
        load(TWO_LINKS, reference="standing")
    (tmp_path / "robot.srdf").write_text(srdf({"standing": {"j": "bent"}}))
    with pytest.raises(InputError, match="must be a number") as caught:
        load(TWO_LINKS, reference="standing")
    assert caught.value.element == 'robot.srdf: state "standing": joint "j": value'
    (tmp_path / "robot.srdf").write_text("<robot")
    with pytest.raises(InputError, match="not well-formed XML") as caught:
        load(TWO_LINKS, reference="standing")
    assert caught.value.source.endswith("robot.srdf")


ZEROS = '<limit lower="0" upper="0" effort="0" velocity="0"/>'
LIMIT = '<limit lower="-1" upper="1" effort="5" velocity="7"/>'
ALL_ZERO = [f"limits of {kind} that are zero, taken as not given: j" for kind in ("position", "velocity", "effort")]


@pytest.mark.parametrize(
    ("limit", "warnings"),
    [
        (ZEROS, ALL_ZERO),
        ("<limit/>", ALL_ZERO),
        (ZEROS.replace('effort="0"', 'effort="3"'), ALL_ZERO[:2]),
        (ZEROS.replace('lower="0"', 'lower="-0.5"'), []),  # a range: the usual way to say that only it is limited
        ("", []),
    ],
)
@pytest.mark.parametrize("kind", ["revolute"])
def test_limits_of_zero_are_said_to_count_as_not_given(load, limit, warnings, kind):
    text = robot_text(joint("j", "a", "b", kind=kind).replace(LIMIT, limit), joint("k", "b", "c"), links="abc")
    robot = load(text)
    assert [warning for warning in robot.warnings if warning.startswith("limits of")] == warnings
    if warnings:
        assert np.isinf([robot.file_tree.joint["j"].lower, robot.file_tree.joint["j"].upper]).all()


def test_a_wheel_that_follows_another_joint_is_not_said_to_be_planned(load):
    """Nor to be held: it turns as its leader does, whether the file or the user couples it."""
    at_its_center = f'<link name="w">{inertial(1.0, "0 0 0")}</link>'
    geared = joint("w", "b", "w", more='<mimic joint="j" multiplier="-0.5"/>')
    text = robot_text(at_its_center, geared, joint("j", "a", "b", kind="revolute"), links="ab")
    assert load(text).coupled["w"].leader == "j"
    assert explain_wheels(load(text)) == []
    assert list(wheels(load(text))) == ["w"]
    free = text.replace('<mimic joint="j" multiplier="-0.5"/>', "")
    (planned,) = explain_wheels(load(free))
    assert "w: planned in the range" in planned
    assert explain_wheels(load(free, coupled={"w": "j"})) == []
