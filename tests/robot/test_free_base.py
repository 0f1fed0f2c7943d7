"""The joints by which a file lets its own base float are read as the free base that every robot has here."""

import numpy as np
import pinocchio as pin
import pytest
from robot_samples import inertial, joint, robot_text

import floatplan as fp
from floatplan.certificate.planar.inertia import cached_robot
from floatplan.errors import InputError
from floatplan.export.model_names import own_names
from floatplan.plans.reading import robot_record

LIMIT = '<limit lower="-9" upper="9" effort="3" velocity="5"/>'
ROBOT = f'<link name="trunk">{inertial(4.0, "0.05 0 0.02")}</link><link name="leg">{inertial(0.7, "0 0 -0.2")}</link>'
HIP = joint("hip", "trunk", "leg", kind="revolute")


def base_chain(*steps, origin="", more=""):
    """Joints of types and axes, one after the other, from a massless link "world" to the trunk."""
    names = ["world", *(f"v{index}" for index in range(1, len(steps))), "trunk"]
    parts = [f'<link name="{name}"/>' for name in names[:-1]]
    for index, (kind, axis) in enumerate(steps):
        ends = f'<parent link="{names[index]}"/><child link="{names[index + 1]}"/>'
        parts.append(f'<joint name="b{index}" type="{kind}">{ends}{origin}<axis xyz="{axis}"/>{LIMIT}{more}</joint>')
    return "".join(parts)


def slides(axes):
    return [("prismatic", UNIT[letter]) for letter in axes]


def turns(axes):
    return [("continuous", UNIT[letter]) for letter in axes]


UNIT = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
TURNED = '<origin xyz="0.1 -0.2 0.6" rpy="0 0.4 0"/>'
BASES = {
    "floating": base_chain(("floating", "1 0 0")),
    "floating, from elsewhere": base_chain(("floating", "1 0 0"), origin='<origin xyz="0.2 0 0.7"/>'),
    "planar": base_chain(("planar", UNIT["y"])),
    "three slides and three turns": base_chain(*slides("xyz"), *turns("zyx")),
    "turns before slides": base_chain(*turns("xyz"), *slides("zxy")),
    "in any order": base_chain(*slides("x"), *turns("z"), *slides("zy"), *turns("yx")),
    "as Euler angles z, x, z, singular at zero": base_chain(*slides("xyz"), *turns("zxz")),
    "turned frames": base_chain(*slides("xyz"), *turns("zyx"), origin=TURNED),
    "in a plane": base_chain(*slides("xz"), *turns("y")),
    "in a plane, the turn first": base_chain(*turns("y"), *slides("zx")),
    "behind a fixed joint": (
        '<link name="top"/>' + joint("fix", "top", "world", kind="fixed") + base_chain(("floating", "0 0 1"))
    ),
}


def read(folder, text, name="robot.urdf", **choices):
    path = folder / name
    path.write_text(text)
    return fp.Robot.from_urdf(path, **choices)


def constants(robot):
    tree = robot.tree
    return [*tree.mass, *tree.inertia, *tree.coupling.ravel(), *robot.velocity_limits, *robot.torque_limits]


@pytest.mark.parametrize("name", BASES)
def test_it_is_the_robot_without_these_joints(tmp_path, name):
    robot = read(tmp_path, robot_text(ROBOT, HIP, BASES[name]))
    alone = read(tmp_path, robot_text(ROBOT, HIP), "alone.urdf")
    (warning,) = robot.warnings
    assert warning.startswith("read as the free base, and held at zero: b0")
    assert robot.joints == alone.joints == ("hip",)
    assert not robot.locked
    if robot.plane.name == alone.plane.name and "rpy" not in BASES[name]:
        assert constants(robot) == pytest.approx(constants(alone), rel=1e-12)
    assert robot.mass == pytest.approx(alone.mass)
    assert {shape.link for shape in robot.shapes} == {"trunk", "leg"}
    proved = cached_robot(robot.path.read_bytes(), robot.path, robot_record(robot))
    inertia = proved.inertia.re.mid + 1j * proved.inertia.im.mid
    coupling = robot.tree.coupling + np.diag(robot.tree.inertia)
    assert abs(inertia) == pytest.approx(abs(coupling), abs=1e-12)


def test_what_is_written_for_others_is_in_the_order_of_the_free_flyer_s_model(tmp_path):
    """Of the file with these joints fixed; and of the file itself where a floating joint is its root."""
    robot = read(tmp_path, robot_text(ROBOT, HIP, BASES["floating"]))
    plan = fp.plan(fp.Problem(robot, fp.Posture(0.0, [0.1]), fp.Posture(0.2, [0.6]), fp.Flight(duration=0.5)))
    times = np.linspace(0.0, 0.5, 5)
    q = plan.q(times)
    own = pin.buildModelFromUrdf(str(robot.path))
    assert (own.nq, own.nv) == (q.shape[1], plan.v(times).shape[1])
    assert list(own.names)[2:] == ["hip"]
    state = plan.at(times)
    for row, com in zip(q, state.com_position, strict=True):
        place = pin.centerOfMass(own, own.createData(), row)
        assert [place @ robot.plane.horizontal, place @ robot.plane.vertical] == pytest.approx(com, abs=1e-9)
    assert own_names(robot).joints == ("hip",)
    assert own_names(robot).bodies == ("trunk", "leg")


NO_BASES = {
    "floating elsewhere": robot_text(
        ROBOT.replace('"trunk"', '"root"'),
        joint("hip", "root", "leg"),
        f'<link name="trunk">{inertial()}</link>',
        joint("free", "leg", "trunk", kind="floating"),
    ),
    "floating from a link with mass": robot_text(ROBOT, joint("hip", "trunk", "leg", kind="floating")),
    "planar from a link with mass": robot_text(ROBOT, joint("hip", "trunk", "leg", kind="planar")),
    "floating beside another": robot_text(
        ROBOT, '<link name="world"/>', joint("hip", "world", "leg"), joint("free", "world", "trunk", kind="floating")
    ),
    "floating from what has a shape": robot_text(
        ROBOT,
        HIP,
        '<link name="world"><collision><geometry><sphere radius="1"/></geometry></collision></link>',
        joint("free", "world", "trunk", kind="floating"),
    ),
}


@pytest.mark.parametrize("name", NO_BASES)
def test_a_joint_that_floats_elsewhere_is_refused_with_the_reason(tmp_path, name):
    with pytest.raises(
        InputError, match="only a massless root link may carry the whole robot by such a joint"
    ) as caught:
        read(tmp_path, NO_BASES[name])
    assert caught.value.element in ('joint "free"', 'joint "hip"')
    assert "would fly on its own" in str(caught.value)


CHAINS_THAT_DO_NOT_FLOAT = {
    "two slides along one axis": base_chain(*slides("xxz"), *turns("zyx")),
    "two turns about one axis, one after the other": base_chain(*slides("xyz"), *turns("zzx")),
    "a turn in the plane of the slides": base_chain(*slides("xz"), *turns("x")),
    "a turn alone": base_chain(*turns("y")),
    "one that another follows": base_chain(*slides("xz"), *turns("y"))
    + '<link name="w"><inertial><mass value="1"/></inertial></link>'
    + joint("f", "trunk", "w", more='<mimic joint="b2"/>'),
}


@pytest.mark.parametrize("name", CHAINS_THAT_DO_NOT_FLOAT)
def test_other_chains_stay_joints(tmp_path, name):
    """A joint in the plane that turns all that has mass is refused, for the reason that there is; others are locked."""
    text = robot_text(ROBOT, HIP, CHAINS_THAT_DO_NOT_FLOAT[name])
    if any('"continuous"' in part and UNIT["y"] in part for part in text.split("<joint")):
        with pytest.raises(InputError, match="moves the whole robot, as what carries it weighs nothing") as caught:
            read(tmp_path, text, plane="xz")
        assert "give the links before it mass" in str(caught.value)
    else:
        robot = read(tmp_path, text, plane="xz")
        assert {"b0", "b1", "b2"} <= set(robot.locked)
        assert not any("free base" in warning for warning in robot.warnings)


def test_all_of_them_may_be_locked_as_before(tmp_path):
    text = robot_text(ROBOT, HIP, BASES["three slides and three turns"])
    locked = {f"b{index}": 0.0 for index in range(6)}
    robot = read(tmp_path, text, locked=locked | {"b2": 0.4})
    assert dict(robot.locked) == locked | {"b2": 0.4}
    assert robot.file_tree.joint["b2"].type == "prismatic"
    cached_robot(robot.path.read_bytes(), robot.path, robot_record(robot))
    for wrong in ({"b2": 0.4}, dict.fromkeys(list(locked)[:5], 0.0)):
        with pytest.raises(InputError, match="leave them all out, or lock them all"):
            read(tmp_path, text, locked=wrong)
    with pytest.raises(InputError, match="leave them all out"):
        read(tmp_path, text, joints=["hip", "b4"])


def test_a_plan_is_proved_and_a_record_that_names_one_of_them_is_refused(tmp_path):
    robot = read(tmp_path, robot_text(ROBOT, HIP, BASES["turned frames"]))
    problem = fp.Problem(robot, fp.Posture(0.0, [0.1]), fp.Posture(0.2, [0.6]), fp.Flight(duration=0.5))
    plan = fp.plan(problem, prove=True)
    assert plan.certificate.proved
    saved = fp.load_plan(plan.save(tmp_path / "plan.json"))
    assert saved.robot.locked == plan.robot.locked == {}
    text = (tmp_path / "plan.json").read_text().replace('"locked": {}', '"locked": {"b1": 0.0}')
    (tmp_path / "plan.json").write_text(text)
    with pytest.raises(InputError, match="by which the base floats"):
        fp.certify(tmp_path / "plan.json")
