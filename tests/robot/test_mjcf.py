"""Robots from MJCF: what MuJoCo compiles is what is planned with; what cannot be planned is refused by name."""

import math
import sys

import numpy as np
import pytest
import trimesh
from mjcf_judge import Judge
from mjcf_samples import RandomModel
from places import URDF

import floatplan as fp
from floatplan.errors import InputError

KANGAROO = URDF / "kangaroo.xml"
EXACT = 1e-9  # [-] what a robot agrees with MuJoCo to


def mjcf(tmp_path, inside, before="", after="", name="robot.xml"):
    """A robot whose base is free, with more in it, in a file."""
    path = tmp_path / name
    path.write_text(
        f'<mujoco model="test">{before}<worldbody><geom type="plane" size="1 1 1"/><body name="base"><freejoint/>'
        f'<geom size="0.1"/>{inside}</body></worldbody>{after}</mujoco>'
    )
    return path


ARM = '<body name="arm" pos="0 0 0.3"><joint name="arm" axis="0 1 0" {}/><geom type="capsule" size="0.05 0.1"/></body>'

LEG = """
<body pos="0.1 0 -0.2" euler="0 20 0">
  <joint name="hip" axis="0 1 0" pos="0.05 0 0.1" ref="15" range="-60 90"/>
  <joint axis="0 -1 0" pos="-0.05 0 0.2" range="-1 80"/>
  <inertial pos="0.01 0.02 -0.1" mass="2" fullinertia="0.02 0.03 0.04 0.001 -0.002 0.003"/>
  <geom type="box" size="0.1 0.2 0.3"/>
  <frame pos="0 0 -0.3" axisangle="0 1 0 30">
    <body name="hip_joint"><joint name="slider" type="slide" axis="1 0 0" pos="9 9 9" ref="0.1" range="0 0.2"/>
      <joint name="foot" axis="0 1 0" pos="0 0 0.05"/><geom type="ellipsoid" size="0.1 0.05 0.02" fitscale="1"/></body>
  </frame>
</body>"""


@pytest.mark.parametrize("source", ["kangaroo", "leg", "planar", "total"])
def test_masses_kinematics_and_momentum_are_mujocos(tmp_path, source):
    before = '<compiler angle="degree" settotalmass="7"/>' if source == "total" else ""
    path = KANGAROO if source == "kangaroo" else mjcf(tmp_path, LEG, before)
    if source == "planar":
        slides = '<joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1" ref="2"/>'
        planar = path.read_text().replace("<freejoint/>", f'{slides}<joint name="turn" axis="0 -1 0" pos="0.1 0 0"/>')
        path.write_text(planar)
    robot = fp.Robot.from_mjcf(path)
    judge = Judge(path, robot)
    assert judge.mass() < EXACT
    assert max(judge.kinematics() for _ in range(5)) < EXACT
    errors, offs = zip(*(judge.momentum() for _ in range(5)), strict=True)
    assert max(errors) < EXACT
    assert max(offs) < EXACT


def random_case(tmp_path, seed):
    """A random model is refused with a reason, or is MuJoCo's."""
    path = tmp_path / "random.xml"
    path.write_bytes(RandomModel(seed, planar=seed % 2 == 1).xml)
    try:
        robot = fp.Robot.from_mjcf(path, **({"plane": "xz"} if seed % 2 else {"base": "free-flyer"}))
    except InputError as error:
        if error.element != "joints" and "singular" not in error.reason:  # no joint, or two about one axis
            raise
        return
    judge = Judge(path, robot, seed)
    assert judge.mass() < EXACT
    assert judge.kinematics() < EXACT
    if seed % 2:
        assert max(judge.momentum()) < EXACT


@pytest.mark.parametrize("seed", range(6))
def test_random_models_are_mujocos(tmp_path, seed):
    random_case(tmp_path, seed)


def test_limits_and_losses_are_the_files(tmp_path):
    given = 'range="-30 40" armature="0.3" damping="0.4" frictionloss="0.5"'
    actuator = '<actuator><motor joint="arm" gear="-20" ctrlrange="-1 1"/></actuator>'
    robot = fp.Robot.from_mjcf(mjcf(tmp_path, ARM.format(given), after=actuator))
    assert robot.position_limits[0] == pytest.approx(np.radians([-30, 40]))
    assert robot.torque_limits == pytest.approx([20])
    assert [robot.armature, robot.damping, robot.friction] == [{"arm": 0.3}, {"arm": 0.4}, {"arm": 0.5}]
    assert np.isinf(robot.velocity_limits).all()
    assert fp.Robot.from_mjcf(robot.path, armature=0.7).armature == {"arm": 0.7}


TORQUES = {
    "two motors": ("", '<motor joint="arm" gear="3" ctrlrange="-2 2"/><motor joint="arm" ctrlrange="-1 1"/>', 7),
    "of a joint": ('actuatorfrcrange="-4 4"', '<motor joint="arm" gear="9" ctrlrange="-2 2"/>', 4),
    "of forces": ("", '<position joint="arm" kp="50" gear="2" ctrlrange="-1 1" forcerange="-8 8"/>', 16),
    "servo": ("", '<position joint="arm" kp="50" ctrlrange="-1 1"/>', math.inf),
    "uneven": ("", '<motor joint="arm" ctrlrange="-2 5"/>', 2),
    "muscle": ("", '<motor joint="arm" ctrlrange="0 5"/>', math.inf),
    "none": ("", "", math.inf),
}


@pytest.mark.parametrize("case", TORQUES)
def test_torque_limits_are_the_actuators(tmp_path, case):
    given, actuators, torque = TORQUES[case]
    robot = fp.Robot.from_mjcf(mjcf(tmp_path, ARM.format(given), after=f"<actuator>{actuators}</actuator>"))
    assert robot.torque_limits == pytest.approx([torque])
    assert ("differ by direction" in " ".join(robot.warnings)) == (case in ("uneven", "muscle"))


SHAPES = {
    "sphere": 'size="0.1"',
    "capsule": 'size="0.05 0.2"',
    "cylinder": 'size="0.1 0.15"',
    "box": 'size="0.1 0.2 0.3"',
    "ellipsoid": 'size="0.1 0.2 0.05"',
    "mesh": 'mesh="part"',
}


def surface(kind, rng):
    """Points of a shape as ``SHAPES`` has it, in its own frame, the farthest in all directions among them."""
    directions = rng.normal(size=(20_000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    ends = np.sign(directions[:, 2:]) * [0, 0, 1]
    rim = directions * [1, 1, 0] / np.linalg.norm(directions[:, :2], axis=1)[:, None]
    points = {
        "sphere": 0.1 * directions,
        "capsule": 0.05 * directions + 0.2 * ends,
        "cylinder": 0.1 * rim + 0.15 * ends,
        "box": np.sign(directions) * [0.1, 0.2, 0.3],
        "ellipsoid": directions * [0.1, 0.2, 0.05],
        "mesh": (np.sign(directions) * [0.1, 0.2, 0.3] + [0.3, -0.1, 0.2]) * [1, 2, 0.5],
    }
    return points[kind]


@pytest.mark.parametrize("kind", SHAPES)
def test_geoms_are_shapes_where_mujoco_has_them(tmp_path, kind):
    part = trimesh.creation.box((0.2, 0.4, 0.6)).apply_translation([0.3, -0.1, 0.2])
    (tmp_path / "meshes").mkdir()
    part.export(tmp_path / "meshes" / "part.stl")
    assets = '<compiler meshdir="meshes"/><asset><mesh file="part.stl" scale="1 2 0.5"/></asset>'
    place = 'pos="0.1 -0.2 0.3" axisangle="1 2 3 40"'
    geom = f'<geom type="{kind}" {SHAPES[kind]} {place}/><geom size="5" contype="0" conaffinity="0" mass="0"/>'
    path = mjcf(tmp_path, f'<body name="part"><joint axis="0 1 0"/>{geom}</body>', assets if kind == "mesh" else "")
    robot = fp.Robot.from_mjcf(path)
    angle, axis = math.radians(40), np.array([1, 2, 3]) / math.sqrt(14)
    points = surface(kind, np.random.default_rng(0)) @ trimesh.transformations.rotation_matrix(angle, axis)[:3, :3].T
    seen = (points + np.array([0.1, -0.2, 0.3])) @ (robot.plane.horizontal + 1j * robot.plane.vertical)
    outline = next(outline for body, outline in robot.outlines if body == 1)
    for direction in np.exp(1j * np.linspace(0, 6, 25)):
        farthest = (seen * direction.conj()).real.max()
        reach = (outline.points * direction.conj()).real.max() + outline.radius
        assert -2e-4 < reach - farthest < 3e-3  # the polygon around a disc or an ellipse is 0.5 % larger
    assert (list(robot.meshes) == ["meshes/part.stl"]) == (kind == "mesh")


REFUSED = {
    "ball": (ARM.format("").replace('axis="0 1 0"', 'type="ball"'), "", r'joint "arm": is a ball joint'),
    "equality": (ARM.format(""), '<equality><weld body1="base" body2="arm"/></equality>', "equality number 1"),
    "tendon": (
        ARM.format(""),
        '<tendon><fixed name="t" range="0 1" limited="true"><joint joint="arm" coef="1"/></fixed></tendon>',
        r'tendon "t": is a tendon that pulls',
    ),
    "actuated tendon": (
        ARM.format(""),
        '<tendon><fixed name="t"><joint joint="arm" coef="1"/></fixed></tendon>'
        '<actuator><motor joint="arm"/><motor tendon="t"/></actuator>',
        r'tendon "t": is a tendon that pulls',
    ),
    "flex": ('<flexcomp name="f" type="grid" count="2 2 2" spacing="1 1 1"/>', "", "a body that bends"),
    "replicate": ('<replicate count="1000000"><geom size="1"/></replicate>', "", r"<replicate>: makes many bodies"),
    "plugin": ("", '<extension><plugin plugin="x"/></extension>', r"<extension>: calls code"),
    "two robots": ("", '<worldbody><body name="b"><freejoint/><geom size="1"/></body></worldbody>', "2 bodies of"),
    "bodies": (2000 * "<body/>", "", r"<body>: has 2001 elements, more than the 1000"),
    "deep": (200 * "<body>" + 200 * "</body>", "", r"nested too deeply"),
    "elements": (30_000 * "<site/>", "", r"elements, more than the 20000"),
    "NaN": ('<geom size="nan"/>', "", r"MuJoCo refuses it: .*nan"),
    "huge": (ARM.format("").replace("0.3", "1e300"), "", r"is larger than any robot's"),
    "unknown": ("<wheel/>", "", r"MuJoCo refuses it: .*wheel"),
    "no mass": ('<body><joint name="j"/></body>', "", r"MuJoCo refuses it: .*mass"),
    "no mesh": (
        '<geom type="mesh" mesh="m"/>',
        '<compiler meshdir="here"/><asset><mesh name="m" file="no.stl"/></asset>',
        r'robot\.xml: <mesh> "m": here/no\.stl: no such file; .* and of the <compiler>\'s meshdir',
    ),
    "a mesh that is none": (
        '<geom type="mesh" mesh="m"/>',
        '<asset><mesh name="m" file="robot.xml" content_type="model/stl"/></asset>',
        r"MuJoCo refuses it",
    ),
    "vertices": ("", '<asset><mesh name="m" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset>', "is written here"),
    "two places": (2 * '<include file="robot.xml"/>', "", "is included twice"),
    "out of the folder": ('<include file="../robot.xml"/>', "", r"lies outside the folder"),
    "absolute": ('<include file="/etc/passwd"/>', "", r"lies outside the folder"),
    "empty include": ("<include/>", "", r"robot\.xml: <include>: names no file; write one"),
    "a directory": ('<include file="./"/>', "", r'robot\.xml: <include> "\./": is a directory, .*; its path is from'),
    "no include": (
        '<include file="no.xml"/>',
        "",
        r'robot\.xml: <include> "no\.xml": no such file; its path is from the',
    ),
    "held": ("", "", r'body "base": is held to the world by turn'),
    "entities": ("", "", r"declares a document type"),
    "no URDF": ("", "", r"is not an MJCF: its root element is <robot>; read it as one: .*from_urdf"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_planned_is_refused_by_name(tmp_path, monkeypatch, capfd, case):
    monkeypatch.chdir(tmp_path)
    inside, after, reason = REFUSED[case]
    path = mjcf(tmp_path, inside, after=after)
    if case == "held":
        path.write_text(path.read_text().replace("<freejoint/>", '<joint name="turn"/>'))
    if case == "entities":
        path.write_text('<!DOCTYPE a [<!ENTITY b "c">]>' + path.read_text())
    if case == "no URDF":
        path.write_text('<robot name="r"><link name="l"/></robot>')
    with pytest.raises(InputError, match=reason) as refused:
        fp.Robot.from_mjcf(path)
    assert refused.value.source is not None
    assert "\n" not in str(refused.value)
    assert [each.name for each in tmp_path.iterdir()] == ["robot.xml"]  # and no log of MuJoCo's
    assert capfd.readouterr() == ("", "")


def test_what_is_left_out_is_said(tmp_path):
    path = mjcf(
        tmp_path,
        ARM.format('stiffness="3"'),
        '<option density="1.2"/>',
        '<worldbody><body name="step"><geom size="1"/></body></worldbody>',
    )
    robot = fp.Robot.from_mjcf(path)
    assert "left out: the springs of arm; the forces of a medium; bodies of the world (step)" in robot.warnings
    path.write_text(path.read_text().replace("<freejoint/>", ""))
    assert "base is fixed to the world in the file; here it flies" in fp.Robot.from_mjcf(path).warnings


def test_files_included_count_and_so_do_their_hashes(tmp_path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "arm.xml").write_text(f"<mujocoinclude>{ARM.format('')}</mujocoinclude>")
    whole = fp.Robot.from_mjcf(mjcf(tmp_path, ARM.format(""), name="whole.xml"))
    robot = fp.Robot.from_mjcf(mjcf(tmp_path, '<include file="parts/arm.xml"/>'))
    assert robot.xml == whole.xml
    assert list(robot.meshes) == ["parts/arm.xml"]
    (tmp_path / "parts" / "arm.xml").write_text("<robot/>")
    with pytest.raises(InputError, match=r"arm\.xml: is not an MJCF: its root element is <robot>"):
        fp.Robot.from_mjcf(robot.path)


def test_what_an_included_file_asks_for_names_that_file(tmp_path):
    (tmp_path / "parts").mkdir()
    asks = {
        "include": '<include file="parts/none.xml"/>',
        "mesh": '<asset><mesh name="shell" file="none.stl"/></asset>',
        "inline": '<asset><mesh name="shell" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset>',
    }
    for tag, text in asks.items():
        (tmp_path / "parts" / f"{tag}.xml").write_text(f"<mujocoinclude>{text}</mujocoinclude>")
        path = mjcf(tmp_path, "", f'<include file="parts/{tag}.xml"/>')
        with pytest.raises(InputError, match=r"no such file|is written here") as refused:
            fp.Robot.from_mjcf(path)
        assert refused.value.source == str(tmp_path / "parts" / f"{tag}.xml")


def test_without_mujoco_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(InputError, match=r'MuJoCo is not installed: it comes with the extra "mjcf"'):
        fp.Robot.from_mjcf(KANGAROO)
