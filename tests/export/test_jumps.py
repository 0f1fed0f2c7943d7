"""Exports of whole jumps: each file is read back by its consumer, and is the jump to the last bit."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import jumps
import numpy as np
import pinocchio as pin
import pytest
import yaml
from robot_samples import PAIR, inertial, robot_text

import floatplan as fp
from floatplan.export.formats import UNITREE_JOINTS, export
from floatplan.export.motion import exported

pytestmark = pytest.mark.skipif(not jumps.INSTALLED, reason="CasADi or example-robot-data is not installed")

EXACT = 1e-12
RATE = 500.0
FLOATS = (6, 7)  # of a free flyer's velocity and configuration


@pytest.fixture(scope="module")
def jump() -> fp.Jump:
    return jumps.backflip()


@pytest.fixture(scope="module")
def jump_file(jump: fp.Jump, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return jump.save(tmp_path_factory.mktemp("jump") / "jump.json")


@pytest.fixture
def read_once(jump_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands are given the jump of the file as it was read, and checked, before."""
    jump = as_read(jump_file)
    monkeypatch.setattr(fp, "load_jump", lambda *_: jump)


@cache
def as_read(path: Path) -> fp.Jump:
    return fp.load_jump(path)


def near(found: Any, wanted: Any, rounding: float = EXACT) -> None:
    wanted = np.asarray(wanted)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=rounding * max(1.0, np.abs(wanted).max(initial=0.0)))


def model_of(jump: fp.Jump) -> Any:
    return pin.buildModelFromUrdf(str(jump.problem.robot.path), pin.JointModelFreeFlyer())


def rows_of(path: Path) -> dict[str, np.ndarray]:
    """Columns of a CSV file, as the module csv reads it."""
    with path.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def standing(jump: fp.Jump, times: np.ndarray) -> dict[str, np.ndarray]:
    """Whether each point stands, from its phases; at a change as before it."""
    within = [(times > phase.begin) & (times <= phase.end) for phase in jump.phases]
    within[0] |= times == 0.0
    names = {name for phase in jump.phases for name in phase.contacts}
    return {
        name: np.any([now for now, phase in zip(within, jump.phases, strict=True) if name in phase.contacts], axis=0)
        for name in names
    }


def check_contacts(jump: fp.Jump, columns: dict[str, np.ndarray]) -> None:
    times = columns["time"]
    for name, stands in standing(jump, times).items():
        assert (columns[f"{name}_contact"] == stands).all()
        forces = np.stack([columns[f"{name}_f{letter}"] for letter in "xyz"], axis=1)
        near(forces, jump.forces(times)[name])
        assert not forces[~stands].any()
    assert not any(columns[f"{name}_contact"][columns["phase"] == 2].any() for name in standing(jump, times))
    ends = [phase.end for phase in jump.phases]
    assert (columns["phase"] == [sum(time > end for end in ends) for time in times]).all()


def check_table(jump: fp.Jump, columns: dict[str, np.ndarray]) -> None:
    """Base and joints put into Pinocchio's model are the jump's q, v, a and tau; held joints are there."""
    model, times = model_of(jump), columns["time"]
    assert times[0] == 0.0
    assert times[-1] == jump.duration
    near(np.diff(times)[:-1], 1 / RATE)
    q, v, a, tau = (quantity(times) for quantity in (jump.q, jump.v, jump.a, jump.tau))
    near(np.stack([columns[f"base_{name}"] for name in ("x", "y", "z", "qx", "qy", "qz", "qw")], axis=1), q[:, :7])
    for row in range(0, len(times), 50):
        turn = pin.Quaternion(q[row, 3:7]).matrix()
        near([columns[f"base_v{letter}"][row] for letter in "xyz"], turn @ v[row, :3])
        near([columns[f"base_w{letter}"][row] for letter in "xyz"], turn @ v[row, 3:6])
    assert len(jump.problem.robot.locked) == 4
    for name in list(model.names)[2:]:
        joint = model.joints[model.getJointId(name)]
        near(columns[f"{name}_position"], q[:, joint.idx_q])
        near(columns[f"{name}_velocity"], v[:, joint.idx_v])
        near(columns[f"{name}_acceleration"], a[:, joint.idx_v])
        near(columns[f"{name}_torque"], tau[:, joint.idx_v])
    held = [columns[f"{name}_torque"] for name in jump.problem.robot.locked]
    assert np.abs(held).max() > 0.1
    check_contacts(jump, columns)


@pytest.mark.parametrize("form", ["csv", "csv-full"])
def test_csv(jump: fp.Jump, tmp_path: Path, form: str) -> None:
    columns = rows_of(export(jump, form, tmp_path / "file.csv", RATE, kp=40, kd={"FL_calf_joint": 0.5}))
    check_table(jump, columns)
    assert {columns[f"{name}_kp"][0] for name in UNITREE_JOINTS} == {40.0}
    assert (columns["FL_calf_joint_kd"] == 0.5).all()
    near(columns["FR_calf_joint_kd"], np.full(len(columns["time"]), gains_of(jump)[1]), 0.02)


def gains_of(jump: fp.Jump) -> tuple[float, float]:
    """Stiffness and damping by the lightest joint in flight, in the file's own model."""
    model, flight = model_of(jump), jump.flight
    assert flight is not None
    least = []
    for q in jump.q(jump.takeoff_time + np.linspace(0.0, flight.duration, 50)):
        mass = pin.crba(model, model.createData(), q)
        least.append((1.0 / np.diagonal(np.linalg.inv(np.triu(mass) + np.triu(mass, 1).T))[6:]).min())
    stiffness = 125.0**2 * float(np.mean(least))
    return stiffness, 0.017 * stiffness


def test_parquet(jump: fp.Jump, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    table = parquet.read_table(export(jump, "parquet", tmp_path / "file.parquet", RATE))
    check_table(jump, {name: table[name].to_numpy() for name in table.column_names})
    about = {key.decode(): value.decode() for key, value in table.schema.metadata.items()}
    assert float(about["duration"]) == jump.duration
    assert [each["end"] for each in json.loads(about["phases"])] == [phase.end for phase in jump.phases]
    assert [tuple(each["contacts"]) for each in json.loads(about["phases"])] == [each.contacts for each in jump.phases]
    units = {field.name: field.metadata[b"unit"].decode() for field in table.schema}
    assert (units["RL_foot_fz"], units["FL_hip_joint_kp"], units["FL_hip_joint_kd"]) == ("N", "N m/rad", "N m s/rad")
    near(table["FL_hip_joint_kp"][0].as_py(), gains_of(jump)[0], 0.02)


def read_archive(path: Path) -> dict[str, np.ndarray]:
    with np.load(path, allow_pickle=False) as archive:
        return dict(archive)


def check_controlled(jump: fp.Jump, content: dict[str, np.ndarray]) -> None:
    times, stands, forces = content["time"], standing(jump, content["time"]), jump.forces(content["time"])
    assert set(content["contact_names"].tolist()) == set(stands)
    for index, name in enumerate(content["contact_names"].tolist()):
        assert (content["contacts"][:, index] == stands[name]).all()
        near(content["forces"][:, index], forces[name])
        assert (np.isnan(content["contact_points"][:, index]).all(axis=1) == ~stands[name]).all()
    assert (np.diff(content["phase"]) >= 0).all()
    assert content["phase_begin"].tolist() == [phase.begin for phase in jump.phases]
    for number, phase in enumerate(jump.phases):
        assert times[content["phase"] == number][-1] <= phase.end
    near(content["kp"], np.full(12, gains_of(jump)[0]), 0.02)
    near(content["kd"], np.full(12, gains_of(jump)[1]), 0.02)


@pytest.mark.parametrize("form", ["npz", "pinocchio"])
def test_numpy(jump: fp.Jump, tmp_path: Path, form: str) -> None:
    content = read_archive(export(jump, form, tmp_path / "file.npz", RATE))
    for name in ("q", "v", "a", "tau"):
        assert (content[name] == getattr(jump, name)(content["time"])).all()
    assert content["joint_names"].tolist() == list(model_of(jump).names)[2:]
    check_controlled(jump, content)


def test_inverse_dynamics_of_the_file_give_its_torques(jump: fp.Jump, tmp_path: Path) -> None:
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


def test_mujoco(jump: fp.Jump, tmp_path: Path) -> None:
    content = read_archive(export(jump, "mujoco", tmp_path / "file.npz", RATE))
    q, v, tau = (quantity(content["time"]) for quantity in (jump.q, jump.v, jump.tau))
    near(content["qpos"], np.concatenate((q[:, :3], np.roll(q[:, 3:7], 1, axis=1), q[:, 7:]), axis=1))
    near(content["qvel"][:, 3:], v[:, 3:])
    near(content["ctrl"], tau[:, 6:])
    check_controlled(jump, content)


def test_mujoco_s_inverse_dynamics_of_the_file_give_its_ctrl(jump: fp.Jump, tmp_path: Path) -> None:
    """MuJoCo's reading of the URDF in the file's states, pushed by its forces where they act, needs its torques."""
    mujoco = pytest.importorskip("mujoco")
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


def test_mujoco_s_ctrl_is_what_the_motors_of_a_model_take(jump: fp.Jump, tmp_path: Path) -> None:
    """Of a jump, too: motors in another order than the joints, with gears, give the joints its torques."""
    mujoco = pytest.importorskip("mujoco")
    robot = jump.problem.robot
    urdf = ElementTree.fromstring(robot.xml)
    for element in list(urdf.iter()):
        for part in [*element.findall("visual"), *element.findall("collision"), *element.findall("dynamics")]:
            element.remove(part)
    ElementTree.SubElement(ElementTree.SubElement(urdf, "mujoco"), "compiler", fusestatic="false")
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(urdf, encoding="unicode"))
    spec.body(robot.layout.tree.root).add_freejoint()
    for number, joint in enumerate(reversed([each for each in spec.joints if each.name in robot.model_joints])):
        motor = spec.add_actuator(name=f"motor of {joint.name}", trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint.name)
        motor.gear[0] = (-1) ** number * (number + 2)
    model = spec.compile()
    (tmp_path / "model.xml").write_text(spec.to_xml())
    content = read_archive(export(jump, "mujoco", tmp_path / "file.npz", RATE, model=tmp_path / "model.xml"))
    joints = {name: column for column, name in enumerate(content["joint_names"].tolist())}
    assert content["qpos"].shape[1] == model.nq
    data = mujoco.MjData(model)
    for row in range(0, len(content["time"]), 40):
        data.qpos[:], data.qvel[:], data.ctrl[:] = (content[key][row] for key in ("qpos", "qvel", "ctrl"))
        mujoco.mj_forward(model, data)
        for name, column in joints.items():
            torque = data.qfrc_actuator[model.joint(name).dofadr[0]]
            limits = model.jnt_actfrcrange[model.joint(name).id]
            planned = content["torque"][row, column]
            if model.jnt_actfrclimited[model.joint(name).id]:
                planned = np.clip(planned, *limits)
            near(torque, planned, 1e-9)
    order = [jump.problem.robot.model_joints.index(name) for name in joints]
    near(content["torque"], jump.tau(content["time"])[:, 6:][:, order])
    assert set(content["contact_names"].tolist()) == set(jump.forces(np.zeros(1)))


def through_ros(content: dict[str, Any]) -> None:
    """A trajectory is one by ROS 2's definitions, no field more or less, and the same from bytes again."""
    systems = pytest.importorskip("rosbags.typesys")
    store, kind = systems.get_typestore(systems.Stores.ROS2_JAZZY), "trajectory_msgs/msg/JointTrajectory"
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


def test_ros_trajectory(jump: fp.Jump, tmp_path: Path) -> None:
    message = yaml.safe_load(export(jump, "ros", tmp_path / "file.yaml", 125.0).read_text())
    through_ros(message)
    points, velocity = message["points"], FLOATS[0]
    times = [point["time_from_start"]["sec"] + 1e-9 * point["time_from_start"]["nanosec"] for point in points]
    assert times[-1] == pytest.approx(jump.duration, abs=2e-9)
    assert message["joint_names"] == list(model_of(jump).names)[2:]
    near([point["positions"] for point in points], jump.q(times)[:, FLOATS[1] :])
    for key, quantity in (("velocities", jump.v), ("accelerations", jump.a), ("effort", jump.tau)):
        near([point[key] for point in points], quantity(times)[:, velocity:])


def test_bag(jump: fp.Jump, tmp_path: Path) -> None:
    reader = pytest.importorskip("mcap_ros2.reader")
    path = export(jump, "mcap", tmp_path / "jump.mcap", 100.0, kp=60.0, kd=2.0)
    found: dict[str, list[Any]] = {}
    for message in reader.read_ros2_messages(str(path)):
        found.setdefault(message.channel.topic, []).append(message)
    times = np.minimum([message.log_time_ns / 1e9 for message in found["/joint_states"]], jump.duration)
    states = [message.ros_msg for message in found["/joint_states"]]
    near([state.position for state in states], jump.q(times)[:, 7:])
    near([state.velocity for state in states], jump.v(times)[:, 6:])
    near([state.effort for state in states], jump.tau(times)[:, 6:])
    forces = jump.forces(times)
    for name, stands in standing(jump, times).items():
        assert [message.ros_msg.data for message in found[f"/contacts/{name}/stands"]] == stands.tolist()
        vectors = [message.ros_msg.vector for message in found[f"/contacts/{name}/force"]]
        near([[vector.x, vector.y, vector.z] for vector in vectors], forces[name])
    assert found["/contacts/FL_foot/force"][0].ros_msg.header.frame_id == "world"
    assert {message.ros_msg.data for message in found["/phase"]} == set(range(len(jump.phases)))
    (gains,) = found["/gains"]
    assert [each.size for each in gains.ros_msg.layout.dim] == [2, 12]
    assert list(gains.ros_msg.data) == [60.0] * 12 + [2.0] * 12
    placed = found["/tf"][30].ros_msg.transforms[0].transform
    q = jump.q(times[30])
    near([placed.translation.x, placed.translation.y, placed.translation.z], q[:3])
    near([placed.rotation.x, placed.rotation.y, placed.rotation.z, placed.rotation.w], q[3:7])
    with pytest.importorskip("rosbags.highlevel").AnyReader([path]) as bag:  # a second reader of bags
        assert {each.topic: each.msgcount for each in bag.connections} == {
            name: len(each) for name, each in found.items()
        }
        (wanted,) = (each for each in bag.connections if each.topic == "/joint_states")
        efforts = [bag.deserialize(raw, each.msgtype).effort for each, _, raw in bag.messages([wanted])]
    near(efforts, jump.tau(times)[:, 6:])


def test_unitree_s_order(jump: fp.Jump, tmp_path: Path) -> None:
    """``motor_cmd`` of the SDK: FR_0, FR_1, FR_2, FL_0, ..."""
    path = export(jump, "unitree-sdk", tmp_path / "file.csv", kp=40, kd=1)
    columns, header = rows_of(path), path.read_text().partition("\n")[0].split(",")
    legs = [(leg, part) for leg in ("FR", "FL", "RR", "RL") for part in ("hip", "thigh", "calf")]
    for block, name in enumerate(("q", "dq", "tau", "kp", "kd")):
        begin = 1 + 12 * block
        assert header[begin : begin + 12] == [f"{name}_{leg}_{part}_joint" for leg, part in legs]
    model, times = model_of(jump), columns["time"]
    near(np.diff(times)[:-1], 0.002)
    q, v, tau = jump.q(times), jump.v(times), jump.tau(times)
    for leg, part in legs:
        joint = f"{leg}_{part}_joint"
        row = model.joints[model.getJointId(joint)]
        near(columns[f"q_{joint}"], q[:, row.idx_q])
        near(columns[f"dq_{joint}"], v[:, row.idx_v])
        near(columns[f"tau_{joint}"], tau[:, row.idx_v])
        assert (columns[f"kp_{joint}"][0], columns[f"kd_{joint}"][-1]) == (40.0, 1.0)
    check_contacts(jump, columns)


def test_unitree_s_players(jump: fp.Jump, tmp_path: Path) -> None:
    rows = np.loadtxt(export(jump, "unitree", tmp_path / "file.csv"), delimiter=",")
    near(rows, jump.q(np.minimum(np.arange(len(rows)) / 50, jump.duration)))


@pytest.mark.parametrize("name", ["a1", "go1", "b1", "go2"])
def test_robots_of_unitree_s_order(name: str) -> None:
    robot = fp.Robot.from_urdf(
        {"go2": jumps.GO2}.get(name, f"example-robot-data:{name}_description/urdf/{name}.urdf"), coupled="mirror"
    )
    assert set(UNITREE_JOINTS) == set(list(robot.model.names)[4:])


def test_other_robots_are_refused_by_name(root: Path, tmp_path: Path) -> None:
    plan = fp.plan(fp.load_problem(root / "problems" / "handstand.toml"))
    with pytest.raises(fp.InputError, match=r'robot "gymnast": is none of Unitree\'s .*\(A1, Go1, Go2, B1\)'):
        export(plan, "unitree-sdk", tmp_path / "file.csv")
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("read_once")
@pytest.mark.parametrize("form", ["csv", "npz", "mcap"])
def test_the_command_takes_a_jump(floatplan: Callable[..., Any], jump_file: Path, tmp_path: Path, form: str) -> None:
    told = tmp_path / "elsewhere" / "file"
    run = floatplan("export", jump_file, "-f", form, "-o", told, "--rate", "20")
    assert (run.code, run.stdout.strip(), run.stderr) == (0, str(told), "")
    assert sorted(path.name for path in told.parent.iterdir()) == ["file"]


def test_the_command_s_gains(floatplan: Callable[..., Any], jump_file: Path, tmp_path: Path) -> None:
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
def test_wrong_numbers_leave_no_file(
    floatplan: Callable[..., Any], jump_file: Path, tmp_path: Path, words: list[str], said: str
) -> None:
    run = floatplan("export", jump_file, *words, "-o", tmp_path / "out" / "file")
    assert (run.code, run.stdout, said in run.stderr) == (2, "", True), run
    assert not (tmp_path / "out").exists()


def test_no_jump_no_file(floatplan: Callable[..., Any], jump: fp.Jump, tmp_path: Path) -> None:
    lost = replace(jump, status="not_found", flight=None, before=(), after=())
    lost.save(tmp_path / "jump.json")
    run = floatplan("export", tmp_path / "jump.json", "-f", "npz")
    assert (run.code, "no jump was found" in run.stderr, "jump.json" in run.stderr) == (2, True, True), run
    assert floatplan("export", tmp_path / "nowhere.json", "-f", "npz").code == 2
    (tmp_path / "half.json").write_text((tmp_path / "jump.json").read_text()[:200])
    assert floatplan("export", tmp_path / "half.json", "-f", "npz").code == 2
    assert sorted(path.name for path in tmp_path.iterdir() if path.is_file()) == ["half.json", "jump.json"]


@pytest.mark.parametrize("form", ["csv", "npz", "mcap"])
def test_what_is_no_number_is_no_motion(jump: fp.Jump, tmp_path: Path, form: str) -> None:
    (first, *others), grid = jump.before, jump.before[0].grid
    broken = replace(
        jump, before=(replace(first, grid=replace(grid, v=np.where(grid.times > 0.1, np.nan, grid.v))), *others)
    )
    with pytest.raises(fp.InputError, match=r"a jump that does not hold is none to export: .*(nan|inf)"):
        export(broken, form, tmp_path / "file")
    assert not list(tmp_path.iterdir())


def test_a_plan_has_gains_where_they_are_asked_for(jump: fp.Jump, tmp_path: Path) -> None:
    plan = jump.flight
    assert plan is not None
    assert (plan.phases, plan.forces(0.1), plan.contact_points(0.1)) == ((), {}, {})
    assert exported(plan).gains is None
    plain, stiff = (read_archive(export(plan, "pinocchio", tmp_path / "file.npz", kp=kp)) for kp in (None, 40))
    assert set(stiff) - set(plain) == {"kp", "kd"}
    for form in ("csv", "npz"):
        with pytest.raises(fp.InputError, match="no room for gains"):
            export(plan, form, tmp_path / "other", kp=40)


@dataclass(frozen=True)
class Bare:
    """What is asked of a motion, and no more: a plan's."""

    plan: fp.Plan
    phases: tuple[Any, ...] = ()

    def __getattr__(self, name: str) -> Any:
        assert name in ("problem", "duration", "full_motion", "forces", "contact_points")
        return getattr(self.plan, name)


def test_any_motion_is_read_as_a_plan_is(tmp_path: Path) -> None:
    """Joints that turn more than once, without limits, and a motor that carries another joint by a gear."""
    text = robot_text(f'<link name="body">{inertial(2.0, "0 0 0")}</link>', PAIR)
    text = re.sub(r'(<joint name="(left|right)_hip" type=")revolute', r"\1continuous", text)
    gear = '<mimic joint="left_knee" multiplier="1" offset="0"/>'
    text = re.sub(r'(<joint name="right_knee".*?)(</joint>)', rf"\1{gear}\2", text)
    (tmp_path / "pair.urdf").write_text(text)
    robot = fp.Robot.from_urdf(tmp_path / "pair.urdf", coupled={"right_hip": "left_hip"})
    assert robot.motors == ("left_hip", "left_knee", "right_hip")
    goal = fp.Posture(-2.0, [7.5, -0.4])
    limits = fp.Limits(position={"left_hip": (-9.0, 9.0)})
    flight = fp.Flight(1.2, angular_momentum="free")
    plan = fp.plan(fp.Problem(robot, fp.Posture(0.2, 0.3), goal, flight, limits=limits))
    assert plan.ok, plan.explanation
    times = np.linspace(0.0, plan.duration, 60)
    found, wanted = exported(Bare(plan)).at(times), plan.full_motion(times)
    assert np.ptp(found.positions[:, 0]) > 6
    written = exported(Bare(plan)).sample(times)
    near(np.hypot(*written.q[:, 7:9].T), np.ones(len(times)), 1e-11)
    near(np.unwrap(np.arctan2(*written.q[:, 8:6:-1].T)), found.positions[:, 0], 1e-11)
    near(written.v[:, 6:], wanted.velocities, 1e-11)
    assert exported(Bare(plan)).joints == wanted.joints
