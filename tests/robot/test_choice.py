"""The plane, and which joints are planned, coupled and locked."""

import math

import numpy as np
import pytest
from robot_samples import TWO_LINKS, joint, robot_text

import floatplan as fp
from floatplan.errors import InputError
from floatplan.plans.presentation import result_rows
from floatplan.robot import Coupling, Robot


@pytest.fixture
def load(tmp_path):
    def load(text, **options):
        path = tmp_path / "robot.urdf"
        path.write_text(text)
        return Robot.from_urdf(path, **options)

    return load


CHAIN = robot_text(joint("j", "a", "b"), joint("k", "b", "c"), joint("l", "c", "d", kind="revolute"), links="abcd")


@pytest.mark.parametrize(
    ("axis", "name", "normal", "turn"),
    [
        ("0 -1 0", "xz", (0, -1, 0), 1.0),
        ("0 2 0", "xz", (0, 1, 0), -1.0),
        ("1 0 0", "yz", (1, 0, 0), 1.0),
        ("-1 0 0", "yz", (-1, 0, 0), -1.0),
        ("0 0 1", "xy", (0, 0, 1), 1.0),
    ],
)
def test_plane_is_found_from_the_axes(load, axis, name, normal, turn):
    plane = load(robot_text(joint("j", "a", "b", axis), links="ab")).plane
    assert (plane.name, tuple(plane.normal), plane.turn) == (name, normal, turn)
    assert np.array_equal(np.cross(plane.horizontal, plane.vertical), turn * plane.normal)


@pytest.mark.parametrize(("name", "turn"), [("xz", 1.0), ("zx", -1.0)])
def test_plane_may_be_given_and_keeps_the_normal(load, name, turn):
    plane = load(TWO_LINKS, plane=name).plane
    assert (plane.name, tuple(plane.normal), plane.turn) == (name, (0, -1, 0), turn)


def test_majority_gives_plane_and_sign(load):
    links = [joint("j", "a", "b", "0 -1 0"), joint("k", "b", "c", "0 1 0"), joint("l", "c", "d", "0 -1 0")]
    robot = load(robot_text(*links, joint("m", "d", "e", "0 0 1"), links="abcde"))
    assert tuple(robot.plane.normal) == (0, -1, 0)
    assert robot.joints == ("j", "k", "l")
    assert robot.locked == {"m": 0.0}
    assert "do not turn about the plane's normal: m = 0" in robot.warnings[0]
    assert robot.tree.turns[-1] == pytest.approx([1, -1, 1])


def test_joints_that_slide_are_held_and_named_where_a_user_looks(load):
    text = robot_text(joint("j", "a", "b"), joint("p", "b", "c", kind="prismatic"), links="abc")
    for chosen in ({}, {"joints": ["j"]}):
        robot = load(text, **chosen)
        assert robot.locked == {"p": 0.0}
        assert robot.warnings == ("locked, because joints that slide are not planned: p = 0 m",)
    plan = fp.plan(fp.Problem(robot, fp.Posture(0.0, 0.3), fp.Posture(0.2, -0.3), fp.Flight(0.6)))
    (held,) = (row for row in result_rows(plan) if row.name == "held")
    assert held.text == "p at 0 m, as joints that slide are not planned"
    assert load(text, locked={"p": 0.5}).warnings == ()


def test_equal_votes_ask_for_the_plane(load):
    text = robot_text(joint("j", "a", "b", "0 1 0"), joint("k", "b", "c", "0 0 1"), links="abc")
    with pytest.raises(
        InputError, match=r"as many joints turn about y and z \(1 each\); give plane=\"xz\" or plane=\"xy\""
    ):
        load(text)
    assert load(text, plane="xy").joints == ("k",)
    assert load(text, joints=["j"]).plane.name == "xz"
    assert load(text, locked={"k": 0.5}).plane.name == "xz"
    with pytest.raises(InputError, match="no joint that could be planned turns about the x, y or z axis"):
        load(text, locked={"j": 0.5})


@pytest.mark.parametrize("name", ["", "x", "xx", "xyz", "XZ", "ab"])
def test_names_that_are_no_plane_are_refused(load, name):
    with pytest.raises(InputError, match="not two different letters") as caught:
        load(TWO_LINKS, plane=name)
    assert caught.value.element == "plane"


def test_axes_nearly_along_the_normal_are_taken_to_be(load):
    tilted = joint("k", "b", "c", "0.0005 1 0")
    robot = load(robot_text(joint("j", "a", "b"), tilted, links="abc"))
    assert robot.joints == ("j", "k")
    assert "k (0.0005 rad)" in robot.warnings[0]
    assert np.array_equal(robot.model.joints[5].shortname(), "JointModelRY")


def test_axes_off_the_plane_are_locked_and_not_planned(load):
    text = robot_text(joint("j", "a", "b"), joint("k", "b", "c", "0.1 1 0"), links="abc")
    assert load(text).joints == ("j",)
    with pytest.raises(InputError, match=r"5\.71 deg off the normal") as caught:
        load(text, joints=["j", "k"])
    assert caught.value.element == 'joint "k"'


def test_order_of_joints_is_the_tree_s_or_the_user_s(load):
    assert load(CHAIN).joints == ("j", "k", "l")
    robot = load(CHAIN, joints=["l", "j"])
    assert robot.joints == ("l", "j")
    assert robot.locked == {"k": 0.0}
    assert robot.position_limits.tolist() == [[-1, 1], [-math.inf, math.inf]]
    assert robot.tree.turns.tolist() == [[0, 0], [0, 1], [1, 1]]
    names = list(robot.model.names)[1:]
    assert robot.selection[names.index("l")].tolist() == [1, 0]


def test_coupled_joints_follow_their_leader(load):
    robot = load(CHAIN, coupled={"l": Coupling("j", -0.5, 0.2)})
    assert robot.joints == ("j", "k")
    assert robot.position_limits[0] == pytest.approx([-1.6, 2.4])  # -1 <= -q/2 + 0.2 <= 1
    assert robot.velocity_limits.tolist() == [14.0, math.inf]
    assert robot.torque_limits.tolist() == [math.inf, math.inf]
    assert robot.tree.turns[-1] == pytest.approx([0.5, 1.0])
    assert robot.tree.offsets[-1] == pytest.approx(0.2, abs=1e-15)
    row = list(robot.model.names)[1:].index("l")
    assert robot.reference[row] == pytest.approx(0.2, abs=1e-15)
    assert robot.selection[row].tolist() == [-0.5, 0.0]


def test_a_name_couples_with_ratio_one_and_after_a_minus_sign_with_minus_one(load):
    assert load(CHAIN, coupled={"k": "j"}).coupled == {"k": Coupling("j")}
    assert load(CHAIN, coupled={"k": "-j"}).coupled == {"k": Coupling("j", -1.0)}


def test_torque_limits_of_coupled_joints_add_up(load):
    pair = [joint("j", "a", "b", kind="revolute"), joint("k", "a", "c", kind="revolute")]
    robot = load(robot_text(*pair, links="abc"), coupled={"k": Coupling("j", -2.0)})
    assert robot.torque_limits.tolist() == [15.0]
    assert robot.position_limits.tolist() == [[-0.5, 0.5]]


def test_mimic_is_a_coupling_unless_the_user_says_otherwise(load):
    links = [joint("j", "a", "b"), joint("k", "b", "c", more='<mimic joint="j" multiplier="2" offset="0.1"/>')]
    text = robot_text(
        *links, joint("l", "c", "d", more='<mimic joint="k" multiplier="-1" offset="0.3"/>'), links="abcd"
    )
    robot = load(text)
    assert robot.joints == ("j",)
    assert robot.coupled["k"] == Coupling("j", 2.0, 0.1)
    assert robot.coupled["l"].ratio == -2.0
    assert robot.coupled["l"].offset == pytest.approx(0.2)
    assert load(text, joints=["j", "k"]).coupled == {"l": Coupling("k", -1.0, 0.3)}
    assert load(text, locked={"k": 0.4}).locked == pytest.approx({"k": 0.4, "l": -0.1})
    assert load(text, joints=["l"]).locked == pytest.approx({"j": 0.0, "k": 0.1})


def test_mimics_in_a_circle_are_refused(load):
    links = [joint("j", "a", "b", more='<mimic joint="k"/>'), joint("k", "b", "c", more='<mimic joint="j"/>')]
    with pytest.raises(InputError, match="mimics itself through others"):
        load(robot_text(*links, joint("l", "c", "d"), links="abcd"))


def test_a_joint_that_its_limits_hold_fast_is_locked(load):
    fast = joint("k", "b", "c", kind="revolute").replace('lower="-1" upper="1"', 'lower="0.5" upper="0.5"')
    text = robot_text(joint("j", "a", "b"), fast, links="abc")
    assert load(text).locked == {"k": 0.5}
    with pytest.raises(InputError, match=r"cannot move: its limits are both 0\.5"):
        load(text, joints=["k"])


WRONG_CHOICES = {
    "unknown joint": ({"joints": ["j", "z"]}, 'joints "z"', 'no joint is called "z"'),
    "unknown follower": ({"coupled": {"z": "j"}}, 'coupled "z"', 'no joint is called "z"'),
    "unknown leader": ({"coupled": {"k": "z"}}, 'coupled "k"', 'no joint is called "z"'),
    "unknown locked": ({"locked": {"z": 0.0}}, 'locked "z"', 'no joint is called "z"'),
    "text for joints": ({"joints": "j"}, "joints", "is not a sequence of names"),
    "no joints": ({"joints": []}, "joints", "no joint is left"),
    "named twice": ({"joints": ["j", "j"]}, 'joints "j"', "named twice"),
    "planned and locked": ({"joints": ["j"], "locked": {"j": 0.0}}, 'joints "j"', "also locked"),
    "planned and coupled": ({"joints": ["j", "k"], "coupled": {"k": "j"}}, 'joints "k"', "also coupled"),
    "coupled and locked": ({"coupled": {"k": "j"}, "locked": {"k": 0.0}}, 'coupled "k"', "also locked"),
    "leader locked": ({"coupled": {"k": "j"}, "locked": {"j": 0.0}}, 'coupled "k"', 'leader "j" is locked'),
    "leader not planned": ({"joints": ["l"], "coupled": {"k": "j"}}, 'coupled "k"', "not a planned joint"),
    "coupled to itself": ({"coupled": {"k": "k"}}, 'coupled "k"', "cannot follow itself"),
    "chain of couplings": ({"coupled": {"k": "j", "l": "k"}}, 'coupled "l"', 'follows "j" in turn'),
    "ratio zero": ({"coupled": {"k": Coupling("j", 0.0)}}, 'coupled "k"', "must not be zero"),
    "no common range": ({"coupled": {"l": Coupling("m", 1.0, 5.0)}}, 'coupled "l"', "no range to move in"),
    "locked outside": ({"locked": {"l": 1.5}}, 'locked "l"', "outside its limits [-1, 1]"),
    "locked NaN": ({"locked": {"j": math.nan}}, "locked.j", "not a finite number"),
    "all locked": ({"locked": dict.fromkeys("jklm", 0.0)}, "joints", "no joint that turns is left"),
    "none in the plane": ({"plane": "xy"}, "plane", 'no joint is left to plan in the plane "xy"'),
}
CHAIN_OF_FOUR = CHAIN.replace("</robot>", robot_text(joint("m", "d", "e", kind="revolute"), links="e")[21:])


@pytest.mark.parametrize("name", WRONG_CHOICES)
def test_wrong_choices_are_refused(load, name):
    options, element, reason = WRONG_CHOICES[name]
    with pytest.raises(InputError) as caught:
        load(CHAIN_OF_FOUR, **options)
    assert caught.value.element == element
    assert reason in caught.value.reason
    assert caught.value.source.endswith("robot.urdf")
