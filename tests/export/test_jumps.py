"""Exports of whole jumps: each file is read back by its consumer, and is the jump to the last bit."""

import csv
from dataclasses import replace
from functools import cache
from xml.etree import ElementTree

import jumps
import mujoco
import numpy as np
import pinocchio as pin
import pytest
import yaml
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

import floatplan as fp
from floatplan.export.formats import UNITREE_JOINTS, export
from floatplan.export.motion import exported

EXACT = 1e-12
RATE = 500.0


@pytest.fixture(scope="module")
def jump_file(jump, tmp_path_factory):
    return jump.save(tmp_path_factory.mktemp("jump") / "jump.json")


@pytest.fixture
def read_once(jump_file, monkeypatch):
    """Commands are given the jump of the file as it was read, and checked, before."""
    jump = as_read(jump_file)
    monkeypatch.setattr(fp, "load_jump", lambda *_: jump)


@cache
def as_read(path):
    return fp.load_jump(path)


def near(found, wanted, rounding=EXACT):
    wanted = np.asarray(wanted)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=rounding * max(1.0, np.abs(wanted).max(initial=0.0)))


def model_of(jump):
    return pin.buildModelFromUrdf(str(jump.problem.robot.path), pin.JointModelFreeFlyer())


def rows_of(path):
    """Columns of a CSV file, as the module csv reads it."""
    with path.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def read_archive(path):
    with np.load(path, allow_pickle=False) as archive:
        return dict(archive)


def test_inverse_dynamics_of_the_file_give_its_torques(jump, tmp_path):
    """Pinocchio's model, the file's q, v, a and forces where they act: what is left are the file's torques."""
    content, model = read_archive(export(jump, "npz", tmp_path / "file.npz", RATE)), model_of(jump)
    data, plane, left = model.createData(), jump.problem.robot.plane, jump.at(content["time"]).torques
    for row in range(3, len(content["time"]), 40):
        q, v, a = (content[name][row] for name in ("q", "v", "a"))
        wrench = pin.rnea(model, data, q, v, a)
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        for index, name in enumerate(content["contact_names"].tolist()):
            force, point = content["forces"][row, index], content["contact_points"][row, index]
            if content["contacts"][row, index]:
                frame = model.getFrameId(name)
                moment = np.cross(point - data.oMf[frame].translation, force)
                jacobian = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
                wrench -= jacobian.T @ np.concatenate((force, moment))
        near(wrench[6:], content["tau"][row, 6:], 1e-9)
        near([wrench[:3] @ plane.horizontal, wrench[:3] @ plane.vertical], [0.0, 0.0], 1e-9)
        near(wrench[3:6] @ plane.normal, left[row, 2], 1e-9)


def test_a_trajectory_goes_through_ros_and_back(jump, tmp_path):
    """By ROS 2's definitions, no field more or less, and the same from bytes again."""
    content = yaml.safe_load(export(jump, "ros", tmp_path / "file.yaml", 25.0).read_text())
    store, kind = get_typestore(Stores.ROS2_JAZZY), "trajectory_msgs/msg/JointTrajectory"
    point, duration, head, stamp = (
        store.types[name]
        for name in (
            f"{kind}Point",
            "builtin_interfaces/msg/Duration",
            "std_msgs/msg/Header",
            "builtin_interfaces/msg/Time",
        )
    )
    points = [
        point(
            **{
                name: duration(**value) if name == "time_from_start" else np.array(value, dtype=np.float64)
                for name, value in each.items()
            }
        )
        for each in content["points"]
    ]
    header = head(**content["header"] | {"stamp": stamp(**content["header"]["stamp"])})
    message = store.types[kind](**content | {"header": header, "points": points})
    again = store.deserialize_cdr(store.serialize_cdr(message, kind), kind)
    assert again.joint_names == content["joint_names"]
    for one, other in zip(again.points, content["points"], strict=True):
        assert vars(one.time_from_start)["nanosec"] == other["time_from_start"]["nanosec"]
        assert all((getattr(one, name) == other[name]).all() for name in ("positions", "velocities", "effort"))


def test_a_second_reader_finds_the_same_bag_and_its_gains(jump, tmp_path):
    path = export(jump, "mcap", tmp_path / "jump.mcap", 100.0, kp=60.0, kd=2.0)
    with AnyReader([path]) as bag:
        found = {
            each.topic: [bag.deserialize(raw, each.msgtype) for _, _, raw in bag.messages([each])]
            for each in bag.connections
        }
    stamps = [state.header.stamp for state in found["/joint_states"]]
    times = np.minimum([each.sec + 1e-9 * each.nanosec for each in stamps], jump.duration)
    near([state.effort for state in found["/joint_states"]], jump.tau(times)[:, 6:])
    assert {message.data for message in found["/phase"]} == set(range(len(jump.phases)))
    (gains,) = found["/gains"]
    assert [each.size for each in gains.layout.dim] == [2, 12]
    assert list(gains.data) == [60.0] * 12 + [2.0] * 12
    assert found["/contacts/FL_foot/force"][0].header.frame_id == "world"


def test_mujoco_s_inverse_dynamics_of_the_file_give_its_ctrl(jump, tmp_path):
    """MuJoCo's reading of the URDF in the file's states, pushed by its forces where they act, needs its torques."""
    content, robot = read_archive(export(jump, "mujoco", tmp_path / "file.npz", 8 * RATE)), jump.problem.robot
    urdf = ElementTree.fromstring(robot.xml)
    for link in urdf.iter("link"):
        for shape in link.findall("visual") + link.findall("collision"):
            link.remove(shape)
    ElementTree.SubElement(ElementTree.SubElement(urdf, "mujoco"), "compiler", fusestatic="false")
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(urdf, encoding="unicode"))
    spec.body(robot.layout.tree.root).add_freejoint()
    spec.option.gravity = content["gravity"]
    model = spec.compile()
    data, names = mujoco.MjData(model), content["joint_names"].tolist()
    places, rates = ([getattr(model.joint(name), key)[0] for name in names] for key in ("qposadr", "dofadr"))
    acceleration = np.gradient(content["qvel"], content["time"], axis=0, edge_order=2)
    for row in range(160, len(content["time"]), 320):
        data.qpos[[*range(7), *places]], data.qvel[[*range(6), *rates]] = content["qpos"][row], content["qvel"][row]
        data.qacc[[*range(6), *rates]] = acceleration[row]
        mujoco.mj_inverse(model, data)
        left = data.qfrc_inverse.copy()
        for index, foot in enumerate(content["contact_names"].tolist()):
            if content["contacts"][row, index]:
                jacobian = np.zeros((3, model.nv))
                mujoco.mj_jac(model, data, jacobian, None, content["contact_points"][row, index], model.body(foot).id)
                left -= jacobian.T @ content["forces"][row, index]
        np.testing.assert_allclose(left[rates], content["ctrl"][row], atol=0.02)  # accelerations are differences
        np.testing.assert_allclose(left[[0, 2]], 0.0, atol=0.2)


@pytest.mark.parametrize("name", ["a1", "go1", "b1", "go2"])
def test_robots_of_unitree_s_order(name):
    robot = fp.Robot.from_urdf(
        {"go2": jumps.GO2}.get(name, f"example-robot-data:{name}_description/urdf/{name}.urdf"), coupled="mirror"
    )
    assert set(UNITREE_JOINTS) == set(list(robot.model.names)[4:])


@pytest.mark.usefixtures("read_once")
@pytest.mark.parametrize("form", ["csv", "npz", "mcap"])
def test_the_command_takes_a_jump(floatplan, jump_file, tmp_path, form):
    told = tmp_path / "elsewhere" / "file"
    run = floatplan("export", jump_file, "-f", form, "-o", told, "--rate", "20")
    assert (run.code, run.stdout.strip(), run.stderr) == (0, str(told), "")
    assert sorted(path.name for path in told.parent.iterdir()) == ["file"]


@pytest.mark.usefixtures("read_once")
def test_the_command_s_gains(floatplan, jump_file, tmp_path):
    words = ["--kp", "FR_calf_joint=30,FL_calf_joint=20", "--kd", "1.5", "--rate", "20", "-o", tmp_path / "file.csv"]
    assert floatplan("export", jump_file, "-f", "unitree-sdk", *words).code == 0
    columns = rows_of(tmp_path / "file.csv")
    assert (columns["kp_FR_calf_joint"][0], columns["kp_FL_calf_joint"][0]) == (30.0, 20.0)
    assert columns["kp_RR_calf_joint"][0] == pytest.approx(columns["kp_RL_calf_joint"][0])
    assert {columns[f"kd_{name}"][0] for name in UNITREE_JOINTS} == {1.5}


@pytest.mark.usefixtures("read_once")
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["-f", "csv", "--rate", "0"], "--rate: 0.0 Hz is not positive"),
        (["-f", "csv", "--rate", "nan"], "--rate: nan is not a finite number"),
        (["-f", "mcap", "--rate", "1e9"], "--rate: "),
        (["-f", "ros", "--kp", "40"], 'format: a file "ros" has no room for gains'),
        (["-f", "unitree", "--kd", "1"], 'format: a file "unitree" has no room for gains'),
        (["-f", "npz", "--kp", "stiff"], "--kp: 'stiff' is not a number"),
        (["-f", "npz", "--kp", "nan"], "--kp: "),
        (["-f", "npz", "--kp", "-1"], "--kp: "),
        (["-f", "npz", "--kd", "FL_calf=1"], "--kd: the robot has no such joint that moves: FL_calf"),
        (["-f", "npz", "--kd", "FL_calf_joint=1,FL_calf_joint=2"], "is given twice"),
        (["-f", "npz", "--kd", "FL_calf_joint=inf"], "FL_calf_joint"),
    ],
)
def test_wrong_numbers_leave_no_file(floatplan, jump_file, tmp_path, words, said):
    run = floatplan("export", jump_file, *words, "-o", tmp_path / "out" / "file")
    assert (run.code, run.stdout, said in run.stderr) == (2, "", True), run
    assert not (tmp_path / "out").exists()


def test_no_jump_no_file(floatplan, jump, tmp_path):
    lost = replace(jump, status="not_found", flight=None, before=(), after=())
    lost.save(tmp_path / "jump.json")
    run = floatplan("export", tmp_path / "jump.json", "-f", "npz")
    assert (run.code, "no jump was found" in run.stderr, "jump.json" in run.stderr) == (2, True, True), run
    assert floatplan("export", tmp_path / "nowhere.json", "-f", "npz").code == 2
    (tmp_path / "half.json").write_text((tmp_path / "jump.json").read_text()[:200])
    assert floatplan("export", tmp_path / "half.json", "-f", "npz").code == 2
    assert sorted(path.name for path in tmp_path.iterdir() if path.is_file()) == ["half.json", "jump.json"]


def test_a_plan_has_gains_where_they_are_asked_for(jump, tmp_path):
    plan = jump.flight
    assert (plan.phases, plan.forces(0.1), plan.contact_points(0.1)) == ((), {}, {})
    assert exported(plan).gains is None
    plain, stiff = (read_archive(export(plan, "pinocchio", tmp_path / "file.npz", kp=kp)) for kp in (None, 40))
    assert set(stiff) - set(plain) == {"kp", "kd"}
    for form in ("csv", "npz"):
        with pytest.raises(fp.InputError, match="no room for gains"):
            export(plan, form, tmp_path / "other", kp=40)


def gains_of(jump):
    """Stiffness and damping by the lightest joint in flight, in the file's own model."""
    model, flight = model_of(jump), jump.flight
    least = []
    for q in jump.q(jump.takeoff_time + np.linspace(0.0, flight.duration, 50)):
        mass = pin.crba(model, model.createData(), q)
        least.append((1.0 / np.diagonal(np.linalg.inv(np.triu(mass) + np.triu(mass, 1).T))[6:]).min())
    stiffness = 125.0**2 * float(np.mean(least))
    return stiffness, 0.017 * stiffness


def test_gains_are_those_of_the_lightest_joint_unless_given(jump, tmp_path):
    columns = rows_of(export(jump, "csv-full", tmp_path / "file.csv", 50.0, kp=40, kd={"FL_calf_joint": 0.5}))
    assert {columns[f"{name}_kp"][0] for name in UNITREE_JOINTS} == {40.0}
    assert (columns["FL_calf_joint_kd"] == 0.5).all()
    near(columns["FR_calf_joint_kd"], np.full(len(columns["time"]), gains_of(jump)[1]), 0.02)
    content = read_archive(export(jump, "npz", tmp_path / "file.npz", 50.0))
    near(content["kp"], np.full(12, gains_of(jump)[0]), 0.02)
