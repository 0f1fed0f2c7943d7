"""Exports: each is read back by a reader that knows nothing of the plan, and gives the motion to 1e-9."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
import pytest
import yaml
from robot_samples import PAIR, inertial, robot_text
from scipy.interpolate import CubicSpline

import floatplan as fp
from floatplan.errors import InputError
from floatplan.export.formats import FORMATS, export

EXACT = 1e-9
HEADER = '<mujoco><compiler fusestatic="true" balanceinertia="false"/></mujoco>'


@pytest.fixture(scope="module")
def coupled(tmp_path_factory: pytest.TempPathFactory) -> fp.Plan:
    """Two legs that move together, the right one with its own names: what a quadruped's are."""
    path = tmp_path_factory.mktemp("robot") / "pair.urdf"
    path.write_text(robot_text(f'<link name="body">{inertial(2.0, "0 0 0")}</link>', PAIR))
    robot = fp.Robot.from_urdf(path, coupled={"right_hip": "left_hip", "right_knee": "left_knee"})
    problem = fp.Problem(
        robot, fp.Posture(0.2, 0.3), fp.Posture(1.0, [0.8, -0.5]), fp.Flight(0.8, angular_momentum="free")
    )
    plan = fp.plan(problem)
    assert plan.ok, plan.explanation
    return plan


@pytest.fixture(params=["handstand", "coupled"])
def plan(request: pytest.FixtureRequest) -> fp.Plan:
    return request.getfixturevalue(request.param)


def near(found: Any, wanted: Any) -> None:
    np.testing.assert_allclose(found, wanted, rtol=0, atol=EXACT)


def every_joint(plan: fp.Plan, quantity: np.ndarray) -> dict[str, np.ndarray]:
    """Columns of planned joints, and of those coupled to them with ratio 1, by name."""
    columns = dict(zip(plan.robot.joints, quantity.T, strict=True))
    return columns | {name: columns[coupling.leader] for name, coupling in plan.robot.coupled.items()}


def group_of(plan: fp.Plan, joint: str) -> list[str]:
    """A planned joint and those coupled to it: the plan's torque is the sum of theirs."""
    return [joint, *(name for name, coupling in plan.robot.coupled.items() if coupling.leader == joint)]


def angle_about(normal: np.ndarray, xyzw: np.ndarray) -> np.ndarray:
    """Unwrapped rotation angles (N,) about a unit vector, of quaternions (N, 4) that turn about nothing else."""
    sine = xyzw[:, :3] @ normal
    near(np.linalg.norm(xyzw, axis=1), 1.0)
    near(np.outer(sine, normal), xyzw[:, :3])
    return 2 * np.unwrap(np.arctan2(sine, xyzw[:, 3]))


def test_csv(plan: fp.Plan, tmp_path: Path) -> None:
    with export(plan, "csv", tmp_path / "file", rate=200).open() as stream:
        rows = list(csv.DictReader(stream))
    times = np.array([float(row["time"]) for row in rows])
    state = plan.at(times)
    wanted = {"time": times, "orientation": state.orientation, "orientation_rate": state.orientation_rate}
    wanted |= {"com_x": state.com_position[:, 0], "com_y": state.com_position[:, 1]}
    for quantity, key in (("positions", "position"), ("velocities", "velocity"), ("accelerations", "acceleration")):
        for joint, column in every_joint(plan, getattr(state, quantity)).items():
            wanted[f"{joint}_{key}"] = column
    for index, joint in enumerate(plan.robot.motors):
        wanted[f"{joint}_torque"] = state.motor_torques[:, index]
    if plan.robot.coupled:
        for index, joint in enumerate(plan.robot.joints):
            wanted[f"{joint}_generalized_torque"] = state.torques[:, index]
    assert set(rows[0]) == set(wanted)
    for name, column in wanted.items():
        near([float(row[name]) for row in rows], column)


def test_npz(plan: fp.Plan, tmp_path: Path) -> None:
    with np.load(export(plan, "npz", tmp_path / "file", rate=200)) as archive:
        assert archive["joints"].tolist() == list(plan.robot.joints)
        assert archive["motors"].tolist() == list(plan.robot.motors)
        state = plan.at(archive["times"])
        for name in set(archive.files) - {"joints", "motors"}:
            near(archive[name], getattr(state, name))
        assert archive["times"][-1] == plan.duration


def test_ros(plan: fp.Plan, tmp_path: Path) -> None:
    message = yaml.safe_load(export(plan, "ros", tmp_path / "file", rate=70).read_text())
    points, names = message["points"], message["joint_names"]
    times = [point["time_from_start"]["sec"] + 1e-9 * point["time_from_start"]["nanosec"] for point in points]
    assert abs(times[-1] - plan.duration) < 2e-9
    state = plan.at(times)
    for key, quantity in (("positions", "positions"), ("velocities", "velocities"), ("accelerations", "accelerations")):
        for name, column in every_joint(plan, getattr(state, quantity)).items():
            near([point[key][names.index(name)] for point in points], column)
    effort = np.array([point["effort"] for point in points])
    near(effort[:, [names.index(name) for name in plan.robot.motors]], state.motor_torques)


def test_yaml_takes_small_numbers_for_numbers(handstand: fp.Plan, tmp_path: Path) -> None:
    message = yaml.safe_load(export(handstand, "ros", tmp_path / "file").read_text())
    values = [value for point in message["points"] for key in point if key != "time_from_start" for value in point[key]]
    assert all(isinstance(value, float) for value in values)


def unitree_columns(path: Path) -> list[str]:
    """Names in the comments before the rows."""
    comments = [line for line in path.read_text().splitlines() if line.startswith("#")]
    return [comment.partition(": ")[2] for comment in comments]


def test_unitree(plan: fp.Plan, tmp_path: Path) -> None:
    path = export(plan, "unitree", tmp_path / "file", rate=50)
    names, rows = unitree_columns(path), np.loadtxt(path, delimiter=",")
    times = np.minimum(np.arange(len(rows)) / 50, plan.duration)
    state, robot = plan.at(times), plan.robot
    assert names[:7] == ["base_x", "base_y", "base_z", "base_qx", "base_qy", "base_qz", "base_qw"]
    near(rows[:, :3] @ robot.plane.horizontal, state.base_position[:, 0])
    near(rows[:, :3] @ robot.plane.vertical, state.base_position[:, 1])
    near(angle_about(robot.plane.normal, rows[:, 3:7]), state.orientation)
    assert set(names[7:]) == {*robot.joints, *robot.coupled, *robot.locked}
    for name, column in every_joint(plan, state.positions).items():
        near(rows[:, names.index(name)], column)


def test_mujoco(plan: fp.Plan, tmp_path: Path) -> None:
    with np.load(export(plan, "mujoco", tmp_path / "file")) as archive:
        state, qpos, names = plan.at(archive["time"]), archive["qpos"], archive["joint_names"].tolist()
        qvel, ctrl, plane = archive["qvel"], archive["ctrl"], plan.robot.plane
        near(qpos[:, :3] @ np.stack((plane.horizontal, plane.vertical), axis=1), state.base_position)
        near(angle_about(plane.normal, np.roll(qpos[:, 3:7], -1, axis=1)), state.orientation)
        near(qvel[:, 3:6], np.outer(state.orientation_rate, plane.normal))
        for name, column in every_joint(plan, state.positions).items():
            near(qpos[:, 7 + names.index(name)], column)
        for name, column in every_joint(plan, state.velocities).items():
            near(qvel[:, 6 + names.index(name)], column)
        for joint, column in zip(plan.robot.joints, state.torques.T, strict=True):
            near(ctrl[:, [names.index(name) for name in group_of(plan, joint)]].sum(axis=1), column)
        speeds = CubicSpline(archive["time"], qpos[:, :3]).derivative()(archive["time"])
        np.testing.assert_allclose(qvel[1:-1, :3], speeds[1:-1], atol=1e-5)


def test_mujoco_flies_from_the_exported_file(plan: fp.Plan, tmp_path: Path) -> None:
    """The URDF with a free joint, the file's first state, and its torques: it lands where the file ends."""
    with np.load(export(plan, "mujoco", tmp_path / "file")) as archive:
        content = dict(archive)
    model, order = free_model(plan, content["joint_names"].tolist())
    model.opt.gravity[:] = content["gravity"]
    duration = content["time"][-1]
    steps = round(duration / 1e-3)
    model.opt.timestep = duration / steps
    torques = CubicSpline(content["time"], content["ctrl"])
    data = mujoco.MjData(model)
    qpos, qvel = np.array([*range(7), *(7 + order)]), np.array([*range(6), *(6 + order)])
    data.qpos[qpos], data.qvel[qvel] = content["qpos"][0], content["qvel"][0]
    fly(model, data, lambda time: torques(time), 6 + order, steps)
    np.testing.assert_allclose(data.qpos[qpos], content["qpos"][-1], atol=1e-6)
    np.testing.assert_allclose(data.qvel[qvel], content["qvel"][-1], atol=1e-5)


def free_model(plan: fp.Plan, names: list[str]) -> tuple[Any, np.ndarray]:
    """The robot's URDF, free in space, for MuJoCo; and the place of each named joint among its joints."""
    root = plan.robot.layout.tree.root
    free = f'<link name="outside"/><joint name="free" type="floating"><parent link="outside"/><child link="{root}"/>'
    head, _, rest = plan.robot.xml.partition("<link")
    spec = mujoco.MjSpec.from_string(f"{head}{HEADER}{free}</joint><link{rest}")
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    for joint in spec.joints:
        joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
    model = spec.compile()
    return model, np.array([model.jnt_qposadr[model.joint(name).id] - 7 for name in names])


def fly(model: Any, data: Any, torques: Callable[[float], np.ndarray], joints: np.ndarray, steps: int) -> None:
    def push(_: Any, now: Any) -> None:
        now.qfrc_applied[joints] = torques(now.time)

    mujoco.set_mjcb_control(push)
    try:
        mujoco.mj_step(model, data, nstep=steps)
    finally:
        mujoco.set_mjcb_control(None)


def test_coupled_and_locked_joints_are_all_there(tmp_path: Path, planned: Callable[[str], fp.Plan]) -> None:
    """A quadruped's twelve joints, of which four are planned."""
    source = pytest.importorskip("floatplan.robot.urdf.tree")
    if source.robots_folder() is None:
        pytest.skip("example-robot-data is not installed")
    plan = planned("gallery/go2")
    path = export(plan, "unitree", tmp_path / "file")
    names, rows = unitree_columns(path), np.loadtxt(path, delimiter=",")
    assert rows.shape[1] == len(names) == 7 + 12
    near(rows[:, names.index("FR_thigh_joint")], rows[:, names.index("FL_thigh_joint")])
    q = np.zeros(plan.robot.model.nq)
    q[3:] = rows[0, 7:]
    data = plan.robot.model.createData()
    pin.forwardKinematics(plan.robot.model, data, q)


@pytest.mark.parametrize("form", [form for form in FORMATS if form != "unitree-sdk"])
def test_the_command_writes_beside_the_plan_or_where_told(
    floatplan: Callable[..., Any], handstand: fp.Plan, tmp_path: Path, form: str
) -> None:
    plan_file = handstand.save(tmp_path / "run" / "plan.json")
    run = floatplan("export", plan_file, "--format", form)
    assert run.code == 0, run
    assert Path(run.stdout.strip()) == plan_file.parent / FORMATS[form].file
    told = tmp_path / "elsewhere" / "file"
    assert floatplan("export", plan_file, "-f", form, "-o", told, "--rate", "100", "--quiet").stdout == ""
    assert told.stat().st_size > 0


@pytest.mark.parametrize("arguments", [("-f", "bvh"), ("-f", "csv", "--rate", "0"), ("-f", "npz", "--rate", "nan")])
def test_wrong_choices_are_bad_input(
    floatplan: Callable[..., Any], handstand: fp.Plan, tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    plan_file = handstand.save(tmp_path / "run" / "plan.json")
    run = floatplan("export", plan_file, *arguments)
    assert run.code == 2
    assert run.stderr.startswith("error: ")
    assert sorted(path.name for path in plan_file.parent.iterdir()) == ["plan.json"]


def test_a_missing_plan_is_bad_input(floatplan: Callable[..., Any]) -> None:
    assert floatplan("export", "nowhere.json", "-f", "csv").code == 2
    assert floatplan("show", "nowhere.json").code == 2


def test_python_names_the_formats(handstand: fp.Plan) -> None:
    with pytest.raises(
        InputError,
        match="must be one of csv, csv-full, parquet, npz, pinocchio, mujoco, ros, mcap, unitree, unitree-sdk",
    ):
        export(handstand, "bvh")
