"""Every fault that a URDF can have is refused with its file, its element and its reason, before Pinocchio sees it."""

from unittest.mock import patch

import pytest
from robot_samples import TWO_LINKS, inertial, joint, robot_text

from floatplan.errors import InputError
from floatplan.motion.flight import free_flyer
from floatplan.robot import Robot


def refused(tmp_path, content, **options):
    path = tmp_path / "robot.urdf"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError) as caught:
        Robot.from_urdf(path, **options)
    assert caught.value.source == str(path)
    assert str(caught.value).startswith(str(path))
    return caught.value


BOMB = '<!DOCTYPE robot [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]><robot name="&b;"><link name="a"/></robot>'

NOT_A_URDF = {
    "empty": (b"", "empty"),
    "blank": (b" \n ", "empty"),
    "binary": (b"\x7fELF\x02\x01\x01\x00\x00\xff\xfe", "not well-formed XML"),
    "text": (b"hello", "not well-formed XML"),
    "truncated": (TWO_LINKS[: len(TWO_LINKS) // 2].encode(), "not well-formed XML"),
    "bad bytes": (TWO_LINKS.replace('"two"', '"\xe9"').encode("latin-1"), "not well-formed XML"),
    "unknown encoding": (b'<?xml version="1.0" encoding="klingon"?><robot/>', "not well-formed XML"),
    "entity bomb": (BOMB.encode(), "document type"),
    "external entity": (b'<!DOCTYPE robot SYSTEM "file:///etc/passwd"><robot/>', "document type"),
    "another root": (b"<mujoco><worldbody/></mujoco>", "root element is <mujoco>"),
    "nested too deeply": (f"<robot>{'<a>' * 2000}{'</a>' * 2000}</robot>".encode("utf-16"), "nested too deeply"),
    "no links": (b'<robot name="r"/>', "has no <link>"),
}
XACRO = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
WITHOUT_LINKS = {  # content, and what there is to do about it
    "nothing": ('<robot name="r"/>', "a URDF has one for each part of the robot"),
    "xacro": (f'<robot name="r" {XACRO}><xacro:include filename="x"/></robot>', "let its name end in .xacro"),
    "SRDF": ('<robot name="r"><group_state name="up" group="all"/></robot>', "it is an SRDF"),
}


@pytest.mark.parametrize("name", WITHOUT_LINKS)
def test_a_file_without_links_is_told_by_what_it_is(tmp_path, name):
    content, advice = WITHOUT_LINKS[name]
    error = refused(tmp_path, content)
    assert error.reason == "has no <link>"
    assert advice in error.advice


@pytest.mark.parametrize("name", NOT_A_URDF)
def test_what_is_not_a_urdf_is_refused(tmp_path, name):
    content, reason = NOT_A_URDF[name]
    assert reason in refused(tmp_path, content).reason


def test_missing_file_and_directory_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.urdf: no such file"):
        Robot.from_urdf(tmp_path / "nowhere.urdf")
    with pytest.raises(InputError, match="is a directory"):
        Robot.from_urdf(tmp_path)
    with pytest.raises(InputError, match="cannot be read"):
        Robot.from_urdf("robot\0.urdf")
    with pytest.raises(InputError, match="not a regular file"):
        Robot.from_urdf("/dev/null")


def replaced(old, new):
    assert TWO_LINKS.count(old) >= 1, old
    return TWO_LINKS.replace(old, new, 1)


def moments(xx, yy, zz):
    return f'ixx="{xx}" ixy="0" ixz="0" iyy="{yy}" iyz="0" izz="{zz}"'


INERTIA_B = moments(0.01, 0.02, 0.02)
WRONG_VALUES = {
    "mass NaN": (replaced('value="1"', 'value="nan"'), 'link "b": mass: value', "must be a number"),
    "mass infinite": (replaced('value="1"', 'value="inf"'), 'link "b": mass: value', "finite"),
    "mass huge": (replaced('value="1"', 'value="1e300"'), 'link "b": mass: value', "larger than any robot's"),
    "mass negative": (replaced('value="1"', 'value="-1"'), 'link "b": mass', "is negative"),
    "mass missing": (replaced('<mass value="1"/>', ""), 'link "b": inertial', "has no <mass>"),
    "all missing": (robot_text('<link name="c"><inertial/></link>'), 'link "c": inertial', "has no <mass>"),
    "axis without numbers": (replaced('<axis xyz="0 -1 0"/>', "<axis/>"), 'joint "j": axis', "has no xyz"),
    "mass left out": (replaced('<mass value="1"/>', "<mass/>"), 'link "b": mass', "has no value"),
    "inertia negative": (replaced('iyy="0.02"', 'iyy="-0.02"'), 'link "b": inertia', "not positive definite"),
    "inertia indefinite": (replaced('ixy="0"', 'ixy="0.2"'), 'link "a": inertia', "not positive definite"),
    "triangle inequality": (
        replaced('iyy="0.02"', 'iyy="0.05"'),
        'link "b": inertia',
        "breaks the triangle inequality",
    ),
    "origin infinite": (replaced('xyz="0.4 0 0"', 'xyz="inf 0 0"'), 'joint "j": origin xyz', "finite"),
    "origin text": (replaced('rpy="0 0 0"/><axis', 'rpy="0 up 0"/><axis'), 'joint "j": origin rpy', "must be a number"),
    "origin short": (replaced('xyz="0.4 0 0"', 'xyz="0.4 0"'), 'joint "j": origin xyz', "three numbers"),
    "axis zero": (replaced('"0 -1 0"', '"0 0 0"'), 'joint "j": axis', "zero length"),
    "limits crossed": (replaced('lower="-2"', 'lower="2"'), 'joint "j": limit', "lower 2 exceeds upper 1.5"),
    "effort negative": (replaced('effort="10"', 'effort="-10"'), 'joint "j": limit', "effort -10 is negative"),
    "joint type": (replaced('"revolute"', '"hinge"'), 'joint "j"', 'has type "hinge"'),
    "joint without type": (replaced(' type="revolute"', ""), 'joint "j"', "has no type"),
    "robot without name": (replaced(' name="two"', ""), "<robot>", "has no name"),
    "link without name": (replaced('<link name="a">', "<link>"), "<link> number 1", "has no name"),
    "joint without name": (replaced(' name="j"', ""), "<joint> number 1", "has no name"),
    "no parent": (replaced('<parent link="a"/>', ""), 'joint "j"', "has no parent link"),
    "no child": (replaced('<child link="b"/>', "<child/>"), 'joint "j"', "has no child link"),
    "two origins": (replaced("<axis", "<origin/><axis"), 'joint "j"', "2 <origin> elements"),
    "two inertias": (replaced("</inertial>", f"</inertial>{inertial()}"), 'link "a"', "2 <inertial> elements"),
    "world's name": (replaced('name="j"', 'name="universe"'), 'joint "universe"', "Pinocchio keeps this name"),
    "mimic of nobody": (replaced("<axis", '<mimic joint="k"/><axis'), 'joint "j": mimic', 'names joint "k"'),
    "mimic of itself": (replaced("<axis", '<mimic joint="j"/><axis'), 'joint "j": mimic', "cannot mimic itself"),
    "mimic unnamed": (replaced("<axis", "<mimic/><axis"), 'joint "j": mimic', "names no joint"),
}


J, K, L = joint("j", "a", "b"), joint("k", "b", "c"), joint("l", "c", "a")
WRONG_TREES = {
    "two roots": (robot_text(J, links="abc"), None, 'has 2 root links ("a", "c")'),
    "detached part": (robot_text(J, joint("k", "c", "d"), links="abcd"), None, "detached"),
    "loop of all": (robot_text(J, K, L, links="abc"), None, "form a loop"),
    "loop beside a tree": (robot_text(J, joint("k", "c", "d"), joint("l", "d", "c"), links="abcd"), None, "d - c - d"),
    "two parents": (robot_text(J, joint("k", "a", "b"), links="ab"), 'link "b"', 'joints "j" and "k" both carry it'),
    "itself": (robot_text(J, joint("k", "b", "b"), links="ab"), 'joint "k"', 'joins link "b" to itself'),
    "unknown parent": (robot_text(joint("j", "z", "b"), links="ab"), 'joint "j"', 'parent link "z" does not exist'),
    "unknown child": (robot_text(joint("j", "a", "z"), links="ab"), 'joint "j"', 'child link "z" does not exist'),
    "two links": (robot_text(J, links="aab"), 'link "a"', "two links have this name"),
    "two joints": (robot_text(J, joint("j", "b", "c"), links="abc"), 'joint "j"', "two joints have this name"),
}


def chain_of(count):
    links = "".join(f'<link name="l{i}">{inertial()}</link>' for i in range(count + 1))
    return robot_text(links, *(joint(f"j{i}", f"l{i}", f"l{i + 1}") for i in range(count)))


@pytest.mark.parametrize("count", [151, 3000])
def test_more_joints_than_can_be_handled_are_refused_before_a_model_is_built(tmp_path, count):
    with patch("pinocchio.buildModelFromXML") as build:
        assert f"has {count} joints that move, more than the 150" in refused(tmp_path, chain_of(count)).reason
    build.assert_not_called()


def with_fixed(count, in_a_row):
    """Two links and a joint, and frames that are fixed: to the first one, or each to the one before."""
    parents = [f"f{i - 1}" if in_a_row and i else "a" for i in range(count)]
    frames = "".join(f'<link name="f{i}"/>' for i in range(count))
    return robot_text(
        J, frames, *(joint(f"x{i}", parent, f"f{i}", kind="fixed") for i, parent in enumerate(parents)), links="ab"
    )


@pytest.mark.parametrize("in_a_row", [pytest.param(False, marks=pytest.mark.long), True])
def test_fixed_joints_do_not_count_as_joints_that_move(tmp_path, in_a_row):
    path = tmp_path / "frames.urdf"
    path.write_text(with_fixed(2000, in_a_row))
    robot = Robot.from_urdf(path)
    assert (robot.joints, robot.warnings) == (("j",), ())
    assert robot.frames["f1999"].local == pytest.approx(600 if in_a_row else 0.3)
    assert free_flyer(robot).nv == 7
    assert "has 2001 fixed joints, more than the 2000" in refused(tmp_path, with_fixed(2001, in_a_row)).reason


MASSLESS = '<link name="m"/>'
SINGULAR = {
    "no mass at all": ('<robot name="r"><link name="a"/><link name="b"/>' + J + "</robot>", None, "has no mass"),
    "massless end": (robot_text(MASSLESS, J, joint("k", "b", "m"), links="ab"), 'joint "k"', "moves no inertia"),
    "point mass on its axis": (
        robot_text(J, '<link name="b"><inertial><mass value="1"/></inertial></link>', links="a"),
        'joint "j"',
        "moves no inertia",
    ),
    "two joints at one place": (
        robot_text(
            MASSLESS, joint("k", "a", "m"), joint("j", "m", "b").replace('xyz="0.3 0 0"', 'xyz="0 0 0"'), links="ab"
        ),
        'joint "j"',
        "moves no inertia",
    ),
}


WRONG = WRONG_VALUES | WRONG_TREES | SINGULAR


@pytest.mark.parametrize("name", WRONG)
def test_what_no_robot_can_be_is_refused(tmp_path, name):
    text, element, reason = WRONG[name]
    error = refused(tmp_path, text)
    assert error.element == element
    assert reason in error.reason


SOUND = {
    "massless link between": robot_text(MASSLESS, joint("j", "a", "m"), joint("k", "m", "b"), links="ab"),
    "point mass on an arm": robot_text(
        J, '<link name="b"><inertial><origin xyz="0.2 0 0"/><mass value="1"/></inertial></link>', links="a"
    ),
    "inertial all zero": robot_text(
        J, K, f'<link name="b"><inertial><mass value="0"/><inertia {moments(0, 0, 0)}/></inertial></link>', links="ac"
    ),
    "plate rounded to three digits": replaced(INERTIA_B, moments(0.01, 0.0201, 0.0101)),
    "joint and link of one name": robot_text(joint("b", "a", "b"), links="ab"),
    "joints named like a root's": robot_text(
        joint("root_joint", "a", "b"), joint("base_orientation", "b", "c"), joint("base_world", "c", "d"), links="abcd"
    ),
    "link named like a root's": TWO_LINKS.replace('"a"', '"base_world"'),
    "names that XML must escape": TWO_LINKS.replace('"j"', '"a &lt; &quot;b&quot; &amp; c"'),
    "names of other scripts": TWO_LINKS.replace('"j"', '"관절"'),
    "another encoding": TWO_LINKS.encode("utf-16"),
    "byte order mark": b"\xef\xbb\xbf" + TWO_LINKS.encode(),
    "comments, gazebo, transmissions": replaced(
        "</robot>", '<!-- x --><gazebo reference="a"/><transmission><joint name="j"/></transmission></robot>'
    ),
    "links without limits": replaced('<limit lower="-2" upper="1.5" effort="10" velocity="20"/>', ""),
    "fixed joint of the least kind": replaced(
        "</robot>", '<link name="c"/><joint name="k" type="fixed"><parent link="b"/><child link="c"/></joint></robot>'
    ),
}


@pytest.mark.parametrize("name", SOUND)
def test_what_is_unusual_but_sound_loads_without_a_word(tmp_path, capfd, name):
    path = tmp_path / "robot.urdf"
    content = SOUND[name]
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    robot = Robot.from_urdf(path)
    assert robot.joints
    assert robot.warnings == ()
    assert len(set(robot.model.names)) == robot.model.njoints
    assert capfd.readouterr() == ("", "")


def test_impossible_inertia_of_a_link_fixed_to_a_sound_body_is_only_reported(tmp_path):
    flat = (
        '<inertial><mass value="0.01"/><inertia ixx="1e-5" ixy="0" ixz="0" iyy="9e-5" iyz="0" izz="1e-5"/></inertial>'
    )
    camera = f'<link name="camera">{flat}</link>' + joint("mount", "a", "camera", kind="fixed")
    path = tmp_path / "robot.urdf"
    path.write_text(replaced("</robot>", f"{camera}</robot>"))
    robot = Robot.from_urdf(path)
    (warning,) = robot.warnings
    assert "an inertia that no body can have: camera;" in warning
    assert robot.tree.inertia[0] == pytest.approx(0.03 + 9e-5 + 0.01 * 2 / 2.01 * 0.1**2, rel=1e-12)
