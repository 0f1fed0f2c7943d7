"""The certificate's reader of MJCF, against MuJoCo's compiler on random models, and what it does not read, by name."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import ClassVar
from xml.etree.ElementTree import Element, tostring

import flint
import numpy as np
import pytest
from mjcf_samples import RandomModel, spoil

from floatplan.certificate.enclosure import PRECISION
from floatplan.certificate.planar.inertia import planar_robot
from floatplan.certificate.planar.mjcf import NotReadError, read_mjcf, whole_mjcf
from floatplan.certificate.planar.urdf import Placement, Urdf
from floatplan.errors import InputError
from floatplan.plans.record import RobotRecord
from floatplan.robot.mjcf.compiled import import_mujoco

FILE = Path("robot.xml")
ROUNDING = 3e-9  # [-] MuJoCo's, of the shell of an ellipsoid, which is a small difference of large numbers


def doubles(matrix) -> np.ndarray:
    return np.array([[float(each) for each in row] for row in matrix.tolist()])


def read(text: str) -> Urdf:
    return read_mjcf(whole_mjcf(text.encode(), FILE, {}), FILE)


def bodies(model, urdf: Urdf) -> list[str]:
    """Names of the links that are bodies, not anchors: all but those that the base does not carry."""
    names = [model.body(index).name for index in range(1, model.nbody)]
    return [name for name in names if name in urdf.links]


def compare(root: Element, seed: int) -> bool:
    """Compare what both readers make of a model; False where one of them refuses it."""
    mujoco = import_mujoco()
    try:
        urdf = read_mjcf(root, FILE)
        model = mujoco.MjModel.from_xml_string(tostring(root, encoding="unicode"))
    except (InputError, NotReadError, ValueError):  # MuJoCo's are of the last kind
        return False
    moving = {joint.name: joint for joint in urdf.joints if joint.kind != "fixed"}
    for name in bodies(model, urdf):
        link, body = urdf.links[name], model.body(name)
        turned, axes = doubles(link.center.rotation), np.zeros(9)
        mujoco.mju_quat2Mat(axes, body.iquat)
        axes = axes.reshape(3, 3)
        assert float(link.mass) == pytest.approx(body.mass[0], rel=1e-12)
        inertia = turned @ doubles(link.inertia) @ turned.T
        assert inertia == pytest.approx(axes @ np.diag(body.inertia) @ axes.T, rel=ROUNDING, abs=ROUNDING)
        if body.mass[0]:
            assert doubles(link.center.translation)[:, 0] == pytest.approx(body.ipos, abs=1e-12)
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    named = [model.joint(number).name for number in range(model.njnt)]
    positions = {name: rng.uniform(-2, 2) if name in named else 0.0 for name in moving}
    for name in moving.keys() & set(named):
        data.joint(name).qpos = positions[name]
        assert moving[name].armature == model.dof_armature[model.joint(name).dofadr[0]]
    mujoco.mj_kinematics(model, data)
    with flint.ctx.workprec(PRECISION):
        placed = {urdf.root: Placement()}
        for joint in urdf.joints:
            moved = joint.motion(positions[joint.name]) if joint.kind != "fixed" else Placement()
            placed[joint.child] = placed[joint.parent] * joint.origin * moved
    if len(moving.keys() - set(named)) or urdf.root not in bodies(model, urdf):
        return True  # of some joint or body that has no name, MuJoCo cannot be asked
    base = data.body(urdf.root)
    axes = base.xmat.reshape(3, 3)
    for name in bodies(model, urdf):
        seen = data.body(name)
        assert axes @ doubles(placed[name].rotation) == pytest.approx(seen.xmat.reshape(3, 3), abs=1e-9)
        place = base.xpos + axes @ doubles(placed[name].translation)[:, 0]
        assert place == pytest.approx(seen.xpos, rel=1e-9, abs=1e-9)
    return True


@pytest.mark.parametrize("seed", range(3))
def test_masses_inertias_and_frames_are_those_that_mujoco_compiles(seed):
    assert compare(RandomModel(seed, planar=seed % 2 == 1).root, seed)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3, 300))
def test_masses_inertias_and_frames_of_many(seed):
    assert compare(RandomModel(seed, planar=seed % 2 == 1).root, seed)


@pytest.mark.parametrize("seeds", [range(16, 32), pytest.param(range(32, 2000), marks=pytest.mark.long)])
def test_a_spoiled_model_is_refused_or_is_what_mujoco_makes_of_it(seeds):
    both = 0
    for seed in seeds:
        root = RandomModel(seed % 200, planar=seed % 3 == 0).root
        spoil(root, np.random.default_rng(seed))
        both += compare(root, seed)
    assert both >= len(seeds) // 8


@pytest.mark.parametrize("seed", [1, pytest.param(5, marks=pytest.mark.long)])
def test_momentum_is_that_of_mujoco(seed):
    sample = RandomModel(seed, planar=True)
    mujoco = import_mujoco()
    model = mujoco.MjModel.from_xml_string(sample.xml.decode())
    urdf = read_mjcf(sample.root, FILE)
    joints = tuple(joint.name for joint in urdf.joints if joint.kind != "fixed")
    robot = planar_robot(urdf, RobotRecord(mjcf="", sha256="", joints=joints, plane="xz"))
    rng = np.random.default_rng(seed)
    positions, rates = rng.uniform(-2, 2, (2, len(joints)))
    data = mujoco.MjData(model)
    for name, position, rate in zip(joints, positions, rates, strict=True):
        data.joint(name).qpos, data.joint(name).qvel = position, rate
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    mujoco.mj_subtreeVel(model, data)
    turns = robot.turns.mid
    inertia = robot.inertia.re.mid + 1j * robot.inertia.im.mid
    turned = np.exp(1j * turns @ positions)
    momentum = np.real(turned[:, None] * np.conj(inertia) * np.conj(turned)) @ (turns @ rates)
    base = model.body(urdf.root).id
    axis = data.xmat[base].reshape(3, 3)[:, 1] * -robot.sigma  # x turns towards z about minus y
    assert momentum.sum() == pytest.approx(axis @ data.subtree_angmom[base], rel=1e-9, abs=1e-9)


def test_what_has_no_name_is_called_as_the_planner_calls_it():
    text = """<mujoco><worldbody><body><geom size="1"/></body><body><freejoint/><geom size="1"/>
    <body name="body3"><joint/><joint name="body3_joint"/><geom size="1"/><body><joint/><joint/><geom size="1"/></body>
    </body></body></worldbody></mujoco>"""
    joints = [joint.name for joint in read(text).joints if joint.kind != "fixed"]
    assert joints == ["body3_joint_", "body3_joint", "body4_joint", "body4_joint_"]
    assert list(read(text).links) == ["body2", "body3", "body3/body3_joint_", "body4", "body4/body4_joint"]


ROBOT = """<mujoco>{sections}<worldbody><body name="torso"{torso}><freejoint/>{in_torso}<geom size="0.2"/>
<body name="leg"><joint name="hip" axis="0 1 0"{joint}/><geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.05"{geom}/>
</body></body></worldbody></mujoco>"""


def robot(**parts: str) -> str:
    return ROBOT.format(**{**dict.fromkeys(("sections", "torso", "in_torso", "joint", "geom"), ""), **parts})


class TestIncludes:
    """Files that are read with an MJCF, each by the hash that a plan recorded of it."""

    PARTS: ClassVar = {
        "legs.xml": '<mujocoinclude><include file="deep/leg.xml"/></mujocoinclude>',
        "deep/leg.xml": '<mujoco><body name="foot"><joint name="ankle"/><geom size="0.1"/></body></mujoco>',
    }

    @pytest.fixture
    def file(self, tmp_path):
        (tmp_path / "deep").mkdir()
        for name, text in self.PARTS.items():
            (tmp_path / name).write_text(text)
        return tmp_path / "robot.xml"

    def read(self, file, hashes):
        text = robot(in_torso='<include file="legs.xml"/>')
        return read_mjcf(whole_mjcf(text.encode(), file, hashes), file)

    def test_are_read_where_their_hashes_are_recorded(self, file):
        hashes = {name: hashlib.sha256(text.encode()).hexdigest() for name, text in self.PARTS.items()}
        assert {"foot", "leg", "torso"} <= set(self.read(file, hashes).links)
        for name, text in self.PARTS.items():
            with pytest.raises(NotReadError, match=name):
                self.read(file, {other: digest for other, digest in hashes.items() if other != name})
            (file.parent / name).write_text(text + " ")
            with pytest.raises(InputError, match=f"{name}.*SHA-256 differs"):
                self.read(file, hashes)
            (file.parent / name).write_text(text)

    @pytest.mark.parametrize("included", ["legs.xml", "./legs.xml", "deep/../legs.xml"])
    def test_that_go_in_circles_end(self, file, included):
        text = f'<mujocoinclude><include file="{included}"/></mujocoinclude>'
        (file.parent / "legs.xml").write_text(text)
        hashes = dict.fromkeys(("legs.xml", included), hashlib.sha256(text.encode()).hexdigest())
        with pytest.raises(NotReadError, match="hash of its own"):
            self.read(file, hashes)


@pytest.mark.parametrize(
    ("parts", "named"),
    [
        ({"geom": ' mesh="foot"'}, "leg.*mesh"),
        ({"sections": '<tendon><fixed stiffness="1"/></tendon>'}, "<fixed>: stiffness"),
        ({"sections": '<tendon><spatial range="0 1"/></tendon>'}, "<spatial>: range"),
        ({"sections": '<default><tendon damping="1"/></default>'}, "<tendon>: damping"),
        ({"sections": '<actuator><motor name="pull" tendon="rope"/></actuator>'}, "motor.*pull"),
        ({"sections": '<actuator><motor name="drive" joint="hip" armature="1"/></actuator>'}, "motor.*drive"),
        ({"sections": '<default><position armature="1"/></default>'}, "position.*armature"),
        ({"sections": '<equality><weld name="held"/></equality>'}, "weld.*held"),
        ({"sections": '<equality><joint joint1="hip" active="true"/></equality>'}, "<joint>"),
        ({"sections": '<deformable><flex name="cloth"/></deformable>'}, "flex.*cloth"),
        ({"sections": "<extension/>"}, "<extension>"),
        ({"sections": '<compiler passthrough="true"/>'}, "passthrough"),
        ({"sections": '<compiler coordinate="global"/>'}, "coordinate"),
        ({"joint": ' type="ball"'}, "hip.*ball"),
        ({"joint": ' type="free"'}, "hip.*free"),
        ({"joint": ' inertia="1"'}, "inertia"),
        ({"torso": ' mocap="true"'}, "mocap"),
        *[({"in_torso": f"<{tag}/>"}, tag) for tag in ("replicate", "attach", "composite", "flexcomp", "plugin")],
        ({"in_torso": '<frame><inertial pos="0 0 0" mass="1"/></frame>'}, "inertial"),
    ],
)
def test_what_is_not_read_is_named(parts, named):
    read(robot())
    read(robot(in_torso='<inertial pos="0 0 0" mass="1"/><geom type="mesh" mesh="trunk"/>'))
    read(robot(in_torso='<geom type="mesh" mesh="trunk" mass="0"/>'))
    inert = "<tendon><fixed/></tendon><deformable><skin/></deformable>"
    read(robot(sections=f'{inert}<equality><joint joint1="hip" active="false"/></equality>', torso=' gravcomp="1"'))
    with pytest.raises(NotReadError, match=named):
        read(robot(**parts))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("<robot/>", "not <mujoco>"),
        ("<mujoco>", "not well-formed"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><mujoco/>', "document type"),
        ("<mujoco/>", "has 0 bodies"),
        (robot(joint=' pos="0 0"'), "not 3 numbers"),
        (robot(joint=' pos="0 0 nan"'), "finite"),
        (robot().replace("0 1 0", "0 0 0"), "no length"),
        (robot(joint=' class="none"'), "no such class"),
        (robot(torso=' quat="0 0 0 0"'), "no length"),
        (robot(torso=' euler="0 0 a"'), "a"),
        (robot().replace('"leg"', '"torso"'), "two of this name"),
        (robot(sections="<worldbody><body><freejoint/></body></worldbody>"), "has 2 bodies"),
    ],
)
def test_what_is_wrong_is_one_error(text, reason):
    with pytest.raises(InputError, match=reason) as caught:
        read(text)
    assert str(FILE) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "joints",
    [
        ("slide 1 0 0", "slide 0 0 1", "hinge 0 1 0"),
        ("hinge 0 -3 0", "slide 1 0 1", "slide 0 0 1"),
        ("slide 1 0 0", "slide 0 1 0", "slide 0 0 1", "ball 0 0 1"),
        ("hinge 0 1 0",),
        (),
    ],
)
def test_a_base_floats_however_the_world_holds_it(joints):
    words = [each.partition(" ") for each in joints]
    text = "".join(f'<joint name="{k}" type="{kind}" axis="{axis}"/>' for k, (kind, _, axis) in enumerate(words))
    free, held = read(robot()), read(robot().replace("<freejoint/>", text))
    assert free.root == held.root == "torso"
    assert [joint.name for joint in held.joints] == [joint.name for joint in free.joints] == ["hip"]


def test_the_robot_is_the_one_body_of_the_world_that_floats():
    table = '<worldbody><body name="table"><geom size="1"/></body></worldbody>'
    assert set(read(robot(sections=table)).links) == {"torso", "leg"}
    moving = table.replace("<geom", "<joint/><geom")
    with pytest.raises(InputError, match="2 that move"):
        read(robot(sections=moving))
