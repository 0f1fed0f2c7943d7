"""Reference motions: each file is read as its readers read it, and is the plan's motion in MuJoCo's world."""

import math
import pickle
import pickletools
import re
from dataclasses import replace

import jumps
import mujoco
import numpy as np
import pytest
from flown_plans import forward_plan
from robot_samples import PAIR, RandomTree, inertial, robot_text

import floatplan as fp
from floatplan.clips import writing as clips_writing
from floatplan.errors import InputError
from floatplan.export.formats import export

EXACT = 1e-9
RATE = 60.0
KEYS_OF_LOCO_MUJOCO = {"joint_names", "frequency", "njnt", "jnt_type", "qpos", "qvel", "split_points"}
# normal and name of a plane, and where z is up: the plan's axes there, as columns
PLANES = {
    "xz": ("y", np.eye(3)),
    "xy": ("z", np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])),
    "zx": ("y", np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]])),
}


@pytest.fixture(scope="module", params=PLANES)
def plan(request, tmp_path_factory):
    """Turned frames, fixed, locked, continuous and sliding joints, a turn and a half."""
    drawn = RandomTree(1260, PLANES[request.param][0], joints=7)
    path = tmp_path_factory.mktemp("robot") / "tree.urdf"
    path.write_text(drawn.text)
    robot = fp.Robot.from_urdf(path, plane=request.param, locked=drawn.locked)
    assert drawn.locked
    return turning(robot, 15.0)


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """Coupled legs; the joints in the file are not in Pinocchio's order, nor its links in that of its joints."""
    path = tmp_path_factory.mktemp("robot") / "pair.urdf"
    links, moving = re.findall(r"<link.*?</link>", PAIR), re.findall(r"<joint.*?</joint>", PAIR)
    path.write_text(robot_text(f'<link name="body">{inertial(2.0, "0 0 0")}</link>', *links, *reversed(moving)))
    return turning(fp.Robot.from_urdf(path, coupled={"right_hip": "left_hip", "right_knee": "left_knee"}), 6.0)


def turning(robot, momentum):
    posture = np.linspace(-0.5, 0.4, len(robot.joints))
    rest = fp.Posture(0.2, posture, 0.0, 0.0), fp.Posture(9.0, -posture, 0.0, 0.0)
    return forward_plan(fp.Problem(robot, *rest, fp.Flight(0.8, angular_momentum=momentum, horizontal_velocity=0.4)))


def near(found, wanted, most=EXACT):
    np.testing.assert_allclose(found, wanted, rtol=0, atol=most)


def read(path):
    with np.load(path, allow_pickle=False) as archive:
        return dict(archive)


def frame_times(motion, rate):
    return np.arange(math.floor(motion.duration * rate) + 1) / rate


def in_mujoco(robot):
    """The robot's file in MuJoCo, on a free joint, with every link as a body."""
    compiler = '<mujoco><compiler fusestatic="false" balanceinertia="true" discardvisual="true"/></mujoco>'
    ends = f'<parent link="world"/><child link="{robot.file_tree.root}"/>'
    text = re.sub(r"<(visual|collision)\b.*?</\1>|<!--.*?-->", "", robot.xml, flags=re.DOTALL)
    head, _, rest = text.partition("<link")
    free = f'<link name="world"/><joint name="root" type="floating">{ends}</joint>'
    return mujoco.MjModel.from_xml_string(f"{head}{compiler}{free}<link{rest}")


def state_in_mujoco(model, motion, to_world, time):
    """MuJoCo's data of a plan's own coordinates at a time, in a world whose z axis is up."""
    data, whole = mujoco.MjData(model), motion.full_motion([time])
    x, y, z, w = whole.base_quaternion[0]
    turn = np.zeros(4)
    mujoco.mju_mat2Quat(turn, to_world.ravel())
    data.qpos[:3] = to_world @ whole.base_position[0]
    mujoco.mju_mulQuat(data.qpos[3:7], turn, np.array([w, x, y, z]))
    data.qvel[:3] = to_world @ whole.base_velocity[0]
    data.qvel[3:6] = motion.v(time)[3:6]
    for index, name in enumerate(whole.joints):
        data.qpos[model.joint(name).qposadr] = whole.positions[0, index]
        data.qvel[model.joint(name).dofadr] = whole.velocities[0, index]
    mujoco.mj_forward(model, data)
    return data


def check_bodies(motion, content, to_world, every=7):
    """Places, orientations and velocities of all links are MuJoCo's."""
    model = in_mujoco(motion.problem.robot)
    names = content["body_names"].tolist()
    assert sorted(names) == sorted(model.body(index).name for index in range(1, model.nbody))
    for frame in range(0, len(content["dof_positions"]), every):
        data, twist = state_in_mujoco(model, motion, to_world, frame / RATE), np.zeros(6)
        for index, name in enumerate(names):
            near(content["body_positions"][frame, index], data.body(name).xpos)
            near(abs(content["body_rotations"][frame, index] @ data.body(name).xquat), 1.0)
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, data.body(name).id, twist, 0)
            near(content["body_angular_velocities"][frame, index], twist[:3])
            near(content["body_linear_velocities"][frame, index], twist[3:])


def check_joints(motion, content):
    """Joints by their names are the plan's, to the last bit."""
    whole = motion.full_motion(frame_times(motion, RATE))
    names = content["dof_names"].tolist()
    assert sorted(names) == sorted(whole.joints)
    order = [whole.joints.index(name) for name in names]
    np.testing.assert_array_equal(content["dof_positions"], whole.positions[:, order])
    np.testing.assert_array_equal(content["dof_velocities"], whole.velocities[:, order])
    np.testing.assert_array_equal(content["dof_torques"], whole.motor_torques[:, order])


def to_world(plan):
    plane = plan.robot.plane
    name = "".join("xyz"[int(np.argmax(np.abs(axis)))] for axis in (plane.horizontal, plane.vertical))
    return PLANES[name][1]


def test_isaac_lab_reads_every_link_and_joint(plan, tmp_path):
    """What its loader takes: the keys, their shapes, ``1 / fps``, and lists of names to look in."""
    content = read(export(plan, "isaac-amp", tmp_path / "file", rate=RATE))
    assert content["fps"].dtype == np.int64
    assert 1.0 / content["fps"] == 1 / RATE
    frames, joints, bodies = len(frame_times(plan, RATE)), len(content["dof_names"]), len(content["body_names"])
    assert content["dof_positions"].shape == content["dof_velocities"].shape == (frames, joints)
    for key in ("body_positions", "body_linear_velocities", "body_angular_velocities"):
        assert content[key].shape == (frames, bodies, 3)
        assert content[key].dtype == np.float64
    assert content["body_rotations"].shape == (frames, bodies, 4)
    assert not {key for key in content if key.startswith("contact")}
    check_joints(plan, content)
    check_bodies(plan, content, to_world(plan))


def test_quaternions_do_not_jump_and_velocities_are_derivatives(plan, tmp_path):
    content = read(export(plan, "isaac-amp", tmp_path / "file", rate=2000))
    rotations, step = content["body_rotations"], 5e-4
    near(np.linalg.norm(rotations, axis=2), 1.0, 1e-15)
    assert (np.einsum("kbi,kbi->kb", rotations[1:], rotations[:-1]) > 0.99).all()
    assert rotations[:, 0, 0].min() < -0.1  # it turned far enough for another sign
    for quantity, rate in (("dof_positions", "dof_velocities"), ("body_positions", "body_linear_velocities")):
        near((content[quantity][2:] - content[quantity][:-2]) / (2 * step), content[rate][1:-1], 5e-4)
    w, vector = rotations[..., :1], rotations[..., 1:]
    dw, dvector = ((each[2:] - each[:-2]) / (2 * step) for each in (w, vector))
    turning = 2 * (w[1:-1] * dvector - dw * vector[1:-1] - np.cross(dvector, vector[1:-1]))
    near(turning, content["body_angular_velocities"][1:-1], 5e-4)


@pytest.fixture
def motion(root, little_work):
    """A base that tumbles: a flight in space, whatever its end."""
    robot = fp.Robot.from_urdf(root / "urdf" / "space_arm.urdf", base="free-flyer")
    start = fp.Posture(fp.Attitude(quaternion_xyzw=[0.1, 0.2, 0.3, 0.9]), 0.1)
    goal = fp.Posture(fp.Attitude(angles=[1.1, 0.5, 3.2], axes="yxz"), 0.4)
    return fp.plan(fp.Problem(robot, start, goal, fp.Flight(4.0, angular_momentum=[5.0, -9.0, 30.0])), starts=1)


def test_a_base_that_tumbles(motion, tmp_path):
    """Velocities in the world and in the body are no longer the same."""
    content = read(export(motion, "isaac-amp", tmp_path / "amp", rate=RATE))
    check_joints(motion, content)
    check_bodies(motion, content, np.eye(3), every=20)
    rows = read(export(motion, "loco-mujoco", tmp_path / "loco", rate=RATE))
    model = in_mujoco(motion.robot)
    spin = np.array([state_in_mujoco(model, motion, np.eye(3), k / RATE).qvel[:6] for k in range(0, 240, 20)])
    near(rows["qvel"][:240:20, :6], spin)
    assert abs(spin[:, 3:] - content["body_angular_velocities"][:240:20, 0]).max() > 0.1


def test_csv_is_what_csv_to_npz_reads(plan, pair, tmp_path):
    """Nothing but numbers: place, quaternion with w last, and joints in the file's order."""
    for motion in (plan, pair):
        text = export(motion, "motion-csv", tmp_path / "file", rate=RATE).read_text()
        assert not set(text) - set("0123456789.,-e\n")
        table = np.loadtxt(tmp_path / "file", delimiter=",")
        content = read(export(motion, "isaac-amp", tmp_path / "npz", rate=RATE))
        root = content["body_names"].tolist().index(motion.robot.file_tree.root)
        np.testing.assert_array_equal(table[:, :3], content["body_positions"][:, root])
        np.testing.assert_array_equal(table[:, [6, 3, 4, 5]], content["body_rotations"][:, root])
        np.testing.assert_array_equal(table[:, 7:], content["dof_positions"])


def test_loco_mujoco_takes_each_key_and_integrates_qvel(plan, tmp_path):
    """Its loader knows seven of these keys and no others; its handler finds joints by name, and rows by type."""
    content = read(export(plan, "loco-mujoco", tmp_path / "file", rate=RATE))
    assert set(content) == KEYS_OF_LOCO_MUJOCO
    model, names = in_mujoco(plan.robot), content["joint_names"].tolist()
    assert content["frequency"].tolist() == RATE
    assert content["split_points"].tolist() == [0, len(content["qpos"])]
    assert content["njnt"] == len(names) == model.njnt
    assert content["jnt_type"].tolist() == [int(model.jnt_type[model.joint(name).id]) for name in names]
    qpos, qvel = np.zeros((2, len(content["qpos"]), model.nq))
    at_q = at_v = 0
    for name in names:  # as the handler does
        joint = model.joint(name)
        size = len(joint.qpos0)
        width = 6 if size == 7 else size
        qpos[:, joint.qposadr[0] : joint.qposadr[0] + size] = content["qpos"][:, at_q : at_q + size]
        qvel[:, joint.dofadr[0] : joint.dofadr[0] + width] = content["qvel"][:, at_v : at_v + width]
        at_q, at_v = at_q + size, at_v + width
    for frame in range(0, len(qpos), 7):
        data = state_in_mujoco(model, plan, to_world(plan), frame / RATE)
        near(qpos[frame, :3], data.qpos[:3])
        near(abs(qpos[frame, 3:7] @ data.qpos[3:7]), 1.0)
        near(qpos[frame, 7:], data.qpos[7:])
        near(qvel[frame, :-1], data.qvel)


@pytest.mark.long
def test_a_jump_has_its_contacts_and_forces(tmp_path):
    jump = jumps.backflip()
    content, times = read(export(jump, "isaac-amp", tmp_path / "file", rate=RATE)), frame_times(jump, RATE)
    check_joints(jump, content)
    check_bodies(jump, content, np.eye(3), every=20)
    names = content["contact_names"].tolist()
    assert content["contacts"].shape == (len(times), len(names))
    forces = jump.forces(times)
    for index, name in enumerate(names):
        np.testing.assert_array_equal(content["contact_forces"][:, index], forces[name])
        stands = [any(name in phase.contacts for phase in jump.phases if phase.begin <= t <= phase.end) for t in times]
        assert (content["contacts"][:, index] <= np.array(stands)).all()
    flight = next(phase for phase in jump.phases if phase.kind == "flight")
    standing = content["contacts"].any(axis=1)
    assert (standing == ~((times > flight.begin) & (times <= flight.end))).all()
    assert {path.name for path in tmp_path.iterdir()} == {"file"}


MODEL = """<mujoco><worldbody><geom type="plane" size="1 1 1"/>
<body name="body"><freejoint name="floating_base"/><geom size=".1"/>
<body name="right_hip_link"><joint name="right_hip"/><geom size=".1"/>
<body name="right_knee_link"><joint name="right_knee"/><geom size=".1"/></body></body>
<body name="left_hip_link"><joint name="left_hip"/><geom size=".1"/>
<body name="left_knee_link"><joint name="left_knee"/><geom size=".1"/></body></body>
</body><body name="box"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""
IN_ITS_ORDER = ["right_hip", "right_knee", "left_hip", "left_knee"]


@pytest.fixture
def model(tmp_path):
    path = tmp_path / "model.xml"
    path.write_text(MODEL)
    return path


def test_files_are_in_the_order_of_the_model_that_reads_them(pair, model, tmp_path):
    own = read(export(pair, "isaac-amp", tmp_path / "own", rate=RATE))
    amp = read(export(pair, "isaac-amp", tmp_path / "amp", rate=RATE, model=model))
    assert amp["dof_names"].tolist() == IN_ITS_ORDER
    assert amp["body_names"].tolist() == ["body", *(f"{name}_link" for name in IN_ITS_ORDER)]
    order = [own["dof_names"].tolist().index(name) for name in IN_ITS_ORDER]
    np.testing.assert_array_equal(amp["dof_velocities"], own["dof_velocities"][:, order])
    check_bodies(pair, amp, np.eye(3), every=20)
    table = np.loadtxt(export(pair, "motion-csv", tmp_path / "csv", rate=RATE, model=model), delimiter=",")
    np.testing.assert_array_equal(table[:, 7:], own["dof_positions"][:, order])
    loco = read(export(pair, "loco-mujoco", tmp_path / "loco", rate=RATE, model=model))
    assert loco["joint_names"].tolist() == ["floating_base", *IN_ITS_ORDER]
    np.testing.assert_array_equal(loco["qvel"][:, 6:], own["dof_velocities"][:, order])


def test_a_urdf_is_a_model_too_and_may_lack_fixed_links(plan, pair, tmp_path):
    """Links on fixed joints are often fused with what they are on: the file leaves them out."""
    own = read(export(plan, "isaac-amp", tmp_path / "own", rate=RATE))
    fixed = [joint.child for joint in plan.robot.file_tree.joints if not joint.moves]
    assert fixed
    text = plan.robot.xml
    for name in fixed:
        text = re.sub(rf'<link name="{name}">.*?</link>', "", text)
    path = tmp_path / "fused.urdf"
    path.write_text(text)
    fused = read(export(plan, "isaac-amp", tmp_path / "fused", rate=RATE, model=path))
    assert fused["body_names"].tolist() == [name for name in own["body_names"].tolist() if name not in fixed]
    kept = [own["body_names"].tolist().index(name) for name in fused["body_names"].tolist()]
    np.testing.assert_array_equal(fused["body_positions"], own["body_positions"][:, kept])


@pytest.mark.parametrize(
    ("form", "old", "new", "message"),
    [
        (
            "isaac-amp",
            'name="left_knee"',
            'name="knee"',
            "the motion has no joint knee; the model has no joint left_knee; give",
        ),
        ("isaac-amp", "left_knee_link", "shank", "the motion has no body shank;"),
        ("mjlab-npz", "left_knee_link", "shank", "the motion has no body shank;"),
        ("mjlab-npz", ' name="left_knee_link"', "", "has a body without a name"),
        ("gmr", '<joint name="left_knee"/>', "", "the model has no joint left_knee;"),
        ("mimickit", '<joint name="left_knee"/>', "", "the model has no joint left_knee;"),
        (
            "mimickit",
            '<joint name="left_hip"/><geom size=".1"/>\n<body name="left_knee_link"><joint name="left_knee"/>',
            '<joint name="left_hip"/><joint name="left_knee"/><geom size=".1"/>\n<body name="left_knee_link">',
            "has several joints in one body: left_hip, left_knee",
        ),
        ("motion-csv", '<joint name="left_knee"/>', "", "the model has no joint left_knee;"),
        (
            "motion-csv",
            '</body><body name="box">',
            '<body name="tail_link"><joint name="tail"/><geom size=".1"/></body></body><body name="box">',
            "the motion has no joint tail;",
        ),
        ("loco-mujoco", ' name="floating_base"', "", "has no free joint with a name"),
        ("loco-mujoco", '<freejoint name="floating_base"/>', "", "has no free joint with a name"),
        ("isaac-amp", "mujoco>", "sdf>", "is neither a URDF nor an MJCF"),
        ("isaac-amp", "</worldbody>", "", "is not well-formed"),
        ("isaac-amp", "<worldbody>", "<worldbody><nonsense/>", "MuJoCo refuses it"),
    ],
)
def test_a_model_that_does_not_fit_is_told(floatplan, pair, model, tmp_path, form, old, new, message):
    model.write_text(MODEL.replace(old, new))
    run = floatplan("export", pair.save(tmp_path / "run" / "plan.json"), "-f", form, "--model", model)
    assert run.code == 2
    assert message in run.stderr
    assert str(model) in run.stderr or "--model: " in run.stderr
    assert run.stderr.count("error: ") == 1
    assert [path.name for path in (tmp_path / "run").iterdir()] == ["plan.json"]


def test_the_command_tells_of_another_order(floatplan, pair, model, tmp_path):
    plan_file = pair.save(tmp_path / "run" / "plan.json")
    run = floatplan("export", plan_file, "-f", "motion-csv", "--model", model)
    assert run.code == 0
    assert "joints and bodies are in another order" in run.stderr
    run = floatplan("export", plan_file, "-f", "motion-csv", "--model", pair.robot.path)
    assert "in the same order as in the robot's file" in run.stderr
    run = floatplan("export", plan_file, "-f", "ros", "--model", model)
    assert run.code == 2
    assert "no room for the order of a model; take one of mujoco, isaac-amp, motion-csv, loco-mujoco" in run.stderr


def test_rates_that_no_reader_can_use(pair, tmp_path, monkeypatch):
    with pytest.raises(InputError, match="no whole number"):
        export(pair, "isaac-amp", tmp_path / "file", rate=29.97)
    for wrong in (np.inf, np.nan, -50.0):
        with pytest.raises(InputError, match="Hz"):
            export(pair, "isaac-amp", tmp_path / "file", rate=wrong)
    for form in ("isaac-amp", "motion-csv", "loco-mujoco", "unitree-csv", "mjlab-npz", "gmr", "mimickit"):
        for wrong in (0.0, -50.0, np.nan):
            with pytest.raises(InputError, match="Hz"):
                export(pair, form, tmp_path / "file", rate=wrong)
        with pytest.raises(InputError, match="one frame"):
            export(pair, form, tmp_path / "file", rate=1)
        with pytest.raises(InputError, match="no room for gains"):
            export(pair, form, tmp_path / "file", kp=1.0)
    monkeypatch.setattr("floatplan.export.table.MOST_PLACES", 100)
    with pytest.raises(InputError, match="more than 100 places"):
        export(pair, "isaac-amp", tmp_path / "file")
    assert list(tmp_path.iterdir()) == []


def test_the_last_frame_is_the_end_where_it_is_a_whole_number_of_steps(pair, tmp_path):
    """0.8 s are 40 steps of 50 Hz, and 23 and a bit of 29 Hz; 0.7 s are 49 of 70 Hz, though 0.7 * 70 rounds below."""
    for duration, rate, frames in ((0.8, 50.0, 41), (0.8, 29.0, 24), (0.7, 70.0, 50), (1.1, 30.0, 34)):
        flight = replace(pair.problem.flight, duration=duration)
        motion = forward_plan(replace(pair.problem, flight=flight))
        assert len(np.loadtxt(export(motion, "motion-csv", tmp_path / "file", rate=rate), delimiter=",")) == frames


PLANAR = """<mujoco model="planar"><worldbody><body name="torso"><joint name="rootx" type="slide" axis="1 0 0"/>
<joint name="rootz" type="slide" axis="0 0 1"/><joint name="rooty" axis="0 1 0"/><geom type="capsule" size=".05 .3"/>
<body name="shin" pos="0 0 -.3"><joint name="b_knee" axis="0 -1 0" pos="0 0 .1"/><geom size=".2"/></body>
<body name="arm" pos="0 0 .3"><joint name="a_arm" axis="0 -1 0" range="-99 99"/><geom size=".1"/></body>
</body></worldbody></mujoco>"""


def test_a_robot_of_an_mjcf_is_its_own_model(tmp_path):
    """Bodies and joints are those of the file, in its order; what floatplan adds for a joint's anchor is no body."""
    path = tmp_path / "planar.xml"
    path.write_text(PLANAR)
    motion = turning(fp.Robot.from_mjcf(path), 1.0)
    content = read(export(motion, "isaac-amp", tmp_path / "amp", rate=RATE))
    assert content["body_names"].tolist() == ["torso", "shin", "arm"]
    assert content["dof_names"].tolist() == ["b_knee", "a_arm"]
    check_joints(motion, content)
    free = PLANAR.replace('<joint name="rootx" type="slide" axis="1 0 0"/>', '<freejoint name="root"/>')
    model = mujoco.MjModel.from_xml_string(re.sub(r'<joint name="root[yz]"[^>]*>', "", free))
    for frame in range(0, len(content["dof_positions"]), 7):
        data = state_in_mujoco(model, motion, np.eye(3), frame / RATE)
        near(content["body_positions"][frame], data.xpos[1:])
    same = export(motion, "isaac-amp", tmp_path / "same", rate=RATE, model=path)
    assert same.read_bytes() == (tmp_path / "amp").read_bytes()
    mjlab = export(motion, "mjlab-npz", tmp_path / "mjlab", rate=RATE)
    check_by_numbers(by_mjlab(mjlab, model), model)
    same = export(motion, "mjlab-npz", tmp_path / "same", rate=RATE, model=path)
    assert same.read_bytes() == mjlab.read_bytes()
    loco = read(export(motion, "loco-mujoco", tmp_path / "loco", rate=RATE, model=path))
    own = mujoco.MjModel.from_xml_path(str(path))
    assert loco["joint_names"].tolist() == [own.joint(number).name for number in range(own.njnt)]
    assert loco["qpos"].shape[1] == own.nq


def by_mjlab(path, model):
    """What mjlab's loader makes of a file: bodies and joints by their numbers in its model, the world left out."""
    content = read(path)
    assert model.nbody - 1 == content["body_pos_w"].shape[1]
    assert [model.body(number + 1).name for number in range(model.nbody - 1)] == content["body_names"].tolist()
    assert [model.joint(number + 1).name for number in range(model.njnt - 1)] == content["joint_names"].tolist()
    assert content["fps"].tolist() == [RATE]
    return content


def check_by_numbers(content, model, every=7):
    """Bodies are where MuJoCo's kinematics put them from the base and the joints of the same frame, and as fast."""
    for frame in range(0, len(content["joint_pos"]), every):
        data, twist = mujoco.MjData(model), np.zeros(6)
        axes = np.zeros(9)
        mujoco.mju_quat2Mat(axes, content["body_quat_w"][frame, 0])
        spin = axes.reshape(3, 3).T @ content["body_ang_vel_w"][frame, 0]
        data.qpos[:] = np.concatenate(
            (content["body_pos_w"][frame, 0], content["body_quat_w"][frame, 0], content["joint_pos"][frame])
        )
        data.qvel[:] = np.concatenate((content["body_lin_vel_w"][frame, 0], spin, content["joint_vel"][frame]))
        mujoco.mj_forward(model, data)
        near(content["body_pos_w"][frame], data.xpos[1:])
        near(abs(np.einsum("bi,bi->b", content["body_quat_w"][frame], data.xquat[1:])), 1.0)
        for body in range(1, model.nbody):
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, body, twist, 0)
            near(content["body_ang_vel_w"][frame, body - 1], twist[:3])
            near(content["body_lin_vel_w"][frame, body - 1], twist[3:])


def test_mjlab_finds_bodies_by_their_numbers_in_mujoco(plan, tmp_path):
    """Links of a URDF limb by limb, in whatever order its file has them; numbers are those of the other formats."""
    content = by_mjlab(export(plan, "mjlab-npz", tmp_path / "file", rate=RATE), in_mujoco(plan.robot))
    check_by_numbers(content, in_mujoco(plan.robot))
    amp = read(export(plan, "isaac-amp", tmp_path / "amp", rate=RATE))
    columns = [amp["body_names"].tolist().index(name) for name in content["body_names"].tolist()]
    np.testing.assert_array_equal(content["body_lin_vel_w"], amp["body_linear_velocities"][:, columns])
    columns = [amp["dof_names"].tolist().index(name) for name in content["joint_names"].tolist()]
    np.testing.assert_array_equal(content["joint_vel"], amp["dof_velocities"][:, columns])


def test_mjlab_has_the_order_of_its_mjcf(pair, model, tmp_path):
    content = read(export(pair, "mjlab-npz", tmp_path / "file", rate=RATE, model=model))
    assert content["joint_names"].tolist() == IN_ITS_ORDER
    assert content["body_names"].tolist() == ["body", *(f"{name}_link" for name in IN_ITS_ORDER)]
    own = by_mjlab(export(pair, "mjlab-npz", tmp_path / "own", rate=RATE), in_mujoco(pair.robot))
    check_by_numbers(own, in_mujoco(pair.robot))
    columns = [own["body_names"].tolist().index(name) for name in content["body_names"].tolist()]
    np.testing.assert_array_equal(content["body_ang_vel_w"], own["body_ang_vel_w"][:, columns])


def names_in(path):
    """What a pickle imports when it is read."""
    texts, imported = [], set()
    for opcode, argument, _ in pickletools.genops(path.read_bytes()):
        if opcode.name in ("SHORT_BINUNICODE", "BINUNICODE"):
            texts.append(argument)
        elif opcode.name == "STACK_GLOBAL":
            imported.add(tuple(texts[-2:]))
        assert opcode.name != "GLOBAL"
    return imported


def test_mimickit_reads_lists_alone(pair, model, tmp_path):
    """As its ``load_motion`` and ``extract_pose_data``: position, rotation vector, joints, depth first."""
    path = export(pair, "mimickit", tmp_path / "file", rate=RATE, model=model)
    assert not names_in(path)
    data = pickle.loads(path.read_bytes())
    assert (data["loop_mode"], data["fps"]) == (0, RATE)
    frames = np.array(data["frames"])
    table = np.loadtxt(export(pair, "motion-csv", tmp_path / "csv", rate=RATE, model=model), delimiter=",")
    np.testing.assert_array_equal(frames[:, :3], table[:, :3])
    np.testing.assert_array_equal(frames[:, 6:], table[:, 7:])
    assert np.linalg.norm(frames[:, 3:6], axis=1).max() > np.pi  # it turned far enough
    assert abs(np.diff(frames[:, 3:6], axis=0)).max() < 1.0
    quaternion = np.zeros(4)
    for vector, row in zip(frames[:, 3:6], table, strict=True):
        angle = np.linalg.norm(vector)
        mujoco.mju_axisAngle2Quat(quaternion, vector / angle if angle else np.array([1.0, 0, 0]), angle)
        near(abs(quaternion @ row[[6, 3, 4, 5]]), 1.0)


def test_mimickit_has_no_joints_that_slide(plan, tmp_path):
    with pytest.raises(InputError, match="slides: MimicKit has hinges only"):
        export(plan, "mimickit", tmp_path / "file", rate=RATE)
    assert not list(tmp_path.iterdir())


def test_gmr_s_loader_finds_its_arrays(plan, tmp_path):
    """As its ``load_robot_motion``: arrays that it indexes, and bodies from the base, in its axes."""
    path = export(plan, "gmr", tmp_path / "file", rate=RATE)
    assert {name for _, name in names_in(path)} <= {"_reconstruct", "ndarray", "dtype"}
    data = pickle.loads(path.read_bytes())
    assert data["fps"] == RATE
    wxyz = data["root_rot"][:, [3, 0, 1, 2]]
    model = in_mujoco(plan.robot)
    assert data["link_body_list"] == [model.body(number).name for number in range(1, model.nbody)]
    for frame in range(0, len(wxyz), 7):
        simulated = state_in_mujoco(model, plan, to_world(plan), frame / RATE)
        near(data["root_pos"][frame], simulated.qpos[:3])
        near(abs(wxyz[frame] @ simulated.qpos[3:7]), 1.0)
        near(data["dof_pos"][frame], simulated.qpos[7:])
        in_base = (simulated.xpos[1:] - simulated.xpos[1]) @ simulated.xmat[1].reshape(3, 3)
        near(data["local_body_pos"][frame], in_base)


def test_unitree_s_csv_is_numbers_alone(pair, model, tmp_path):
    own = export(pair, "unitree-csv", tmp_path / "own", rate=RATE)
    assert own.read_text() == export(pair, "motion-csv", tmp_path / "other", rate=RATE).read_text()
    table = np.loadtxt(export(pair, "unitree-csv", tmp_path / "file", rate=RATE, model=model), delimiter=",")
    assert table.shape[1] == 7 + len(IN_ITS_ORDER)
    near(np.linalg.norm(table[:, 3:7], axis=1), 1.0, 1e-15)


LEARNED = ("isaac-amp", "motion-csv", "loco-mujoco", "unitree-csv", "mjlab-npz", "gmr", "mimickit")


def check_read_back(motion, form, folder):
    """A clip of the file is the motion, whatever the order of its joints, with its contacts or those next to it."""
    suffix = {"isaac-amp": "npz", "loco-mujoco": "npz", "mjlab-npz": "npz", "gmr": "pkl", "mimickit": "pkl"}
    path = export(motion, form, folder / f"{form}.{suffix.get(form, 'csv')}", rate=RATE)
    clip = fp.load_clip(path, model=motion.problem.robot.path, fps=RATE)
    whole = motion.full_motion(clip.times)
    order = [whole.joints.index(name) for name in clip.joints]
    near(clip.positions, whole.positions[:, order], 0 if form != "mimickit" else 1e-15)
    near(clip.base_position, whole.base_position)
    near(abs(np.einsum("ki,ki->k", clip.base_quaternion, whole.base_quaternion)), 1.0)
    again = fp.load_clip(clips_writing.write_clip(clip, folder / f"again{path.suffix}"), model=clip.robot, fps=RATE)
    np.testing.assert_array_equal(again.positions, clip.positions)
    near(again.base_quaternion, clip.base_quaternion)
    return path, clip, again


@pytest.mark.parametrize("form", LEARNED)
def test_what_is_written_is_read_as_a_clip(pair, form, tmp_path):
    path, clip, _ = check_read_back(pair, form, tmp_path)
    assert clip.contacts is None
    extras = path.with_name(f"{form}.extras.npz")
    assert extras.exists() == (form in ("motion-csv", "unitree-csv"))
    if extras.exists():
        content = read(extras)
        amp = read(export(pair, "isaac-amp", tmp_path / "amp", rate=RATE))
        assert content["joint_names"].tolist() == amp["dof_names"].tolist()
        np.testing.assert_array_equal(content["joint_velocities"], amp["dof_velocities"])
        root = amp["body_names"].tolist().index("body")
        np.testing.assert_array_equal(content["base_linear_velocity"], amp["body_linear_velocities"][:, root])
        np.testing.assert_array_equal(content["base_angular_velocity"], amp["body_angular_velocities"][:, root])


@pytest.mark.long
def test_a_jump_has_its_contacts_in_every_file_or_next_to_it(tmp_path):
    jump = jumps.backflip()
    amp = read(export(jump, "isaac-amp", tmp_path / "amp", rate=RATE))
    for form in LEARNED:
        path, clip, again = check_read_back(jump, form, tmp_path)
        if form in ("motion-csv", "unitree-csv", "loco-mujoco"):
            content = read(path.with_name(f"{form}.extras.npz"))
            for name in ("contact_names", "contacts", "contact_forces"):
                np.testing.assert_array_equal(content[name], amp[name])
            continue
        assert list(clip.contact_names) == amp["contact_names"].tolist()
        np.testing.assert_array_equal(clip.contacts, amp["contacts"])
        np.testing.assert_array_equal(again.contacts, amp["contacts"])


def test_a_flight_in_space_is_read_by_numbers_too(motion, tmp_path):
    model = in_mujoco(motion.robot)
    check_by_numbers(by_mjlab(export(motion, "mjlab-npz", tmp_path / "file", rate=RATE), model), model, every=40)
    for form in ("gmr", "mimickit", "mjlab-npz"):
        check_read_back(motion, form, tmp_path)


def test_the_command_tells_of_the_second_file(floatplan, pair, tmp_path):
    plan_file = pair.save(tmp_path / "run" / "plan.json")
    run = floatplan("export", plan_file, "-f", "unitree-csv")
    assert "unitree_motion.extras.npz, next to it, has what unitree-csv cannot hold" in run.stderr
    assert run.stdout.strip() == str(plan_file.parent / "unitree_motion.csv")
    assert read(plan_file.parent / "unitree_motion.extras.npz")["fps"] == 30.0
    assert "extras" not in floatplan("export", plan_file, "-f", "gmr").stderr
    older = plan_file.parent / "loco_mujoco.extras.npz"
    older.write_bytes(b"of another motion")
    assert "extras" not in floatplan("export", plan_file, "-f", "loco-mujoco").stderr
    assert not older.exists()


def test_where_no_file_can_be_there_is_no_second_one(floatplan, pair, tmp_path):
    plan_file = pair.save(tmp_path / "run" / "plan.json")
    for output in (tmp_path, ".", ""):
        run = floatplan("export", plan_file, "-f", "motion-csv", "-o", output)
        assert run.code == 2
        assert run.stderr.count("error: ") == 1
    assert not list(tmp_path.rglob("*.npz"))


WRONG = {
    "joint_names": ([["left_hip"], []], [1, 2], {"a": 1}),
    "contact_names": ([["a"], []], [3.0], ["one", "two"]),
    "contacts": ([[True], []], "all", [[True]]),
}


@pytest.mark.parametrize("form", ["gmr", "mimickit"])
@pytest.mark.parametrize("key", WRONG)
def test_names_and_contacts_that_are_none_are_refused_by_their_key(pair, form, key, tmp_path):
    path = export(pair, form, tmp_path / "motion.pkl", rate=RATE)
    data = pickle.loads(path.read_bytes())
    stands = [[True]] * len(frame_times(pair, RATE))
    for wrong in WRONG[key]:
        path.write_bytes(pickle.dumps(data | {"contact_names": ["foot"], "contacts": stands} | {key: wrong}))
        with pytest.raises(InputError) as refused:
            fp.load_clip(path, model=pair.robot.path)
        assert "contacts" in str(refused.value) or key in str(refused.value)
    path.write_bytes(pickle.dumps(data | dict.fromkeys(WRONG)))  # None: as without
    assert fp.load_clip(path, model=pair.robot.path).contacts is None
