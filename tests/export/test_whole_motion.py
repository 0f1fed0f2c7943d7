"""Exports of the whole motion, base and all joints: each read back by the programs that it is for."""

from __future__ import annotations

import csv
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from robot_samples import PAIR, TWO_LINKS, RandomTree, inertial, robot_text

import floatplan as fp
from floatplan.errors import InputError
from floatplan.export.formats import FORMATS, export

EXACT = 1e-9
RATE = 100.0


def flown(robot: fp.Robot, seed: int = 0) -> fp.Plan:
    """A plan of a robot between postures drawn at random."""
    generator = np.random.default_rng(seed)
    start, goal = generator.uniform(-0.6, 0.6, (2, len(robot.joints)))
    flight = fp.Flight(0.8, angular_momentum="free", horizontal_velocity=0.4)
    plan = fp.plan(fp.Problem(robot, fp.Posture(0.2, start), fp.Posture(1.0, goal), flight))
    assert plan.ok, plan.explanation
    return plan


@pytest.fixture(scope="module")
def coupled(tmp_path_factory: pytest.TempPathFactory) -> fp.Plan:
    path = tmp_path_factory.mktemp("robot") / "pair.urdf"
    path.write_text(robot_text(f'<link name="body">{inertial(2.0, "0 0 0")}</link>', PAIR))
    return flown(fp.Robot.from_urdf(path, coupled={"right_hip": "left_hip", "right_knee": "left_knee"}))


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> fp.Plan:
    """Turned frames, fixed, sliding and off-plane joints between: a locked slide is there in metres."""
    drawn = RandomTree(1260, "y", joints=7)
    path = tmp_path_factory.mktemp("robot") / "tree.urdf"
    path.write_text(drawn.text)
    return flown(fp.Robot.from_urdf(path, plane="xz", locked=drawn.locked))


@pytest.fixture(params=["coupled", "tree"])
def plan(request: pytest.FixtureRequest) -> fp.Plan:
    return request.getfixturevalue(request.param)


def free_model(plan: fp.Plan) -> tuple[Any, Any]:
    model = pin.buildModelFromUrdf(str(plan.robot.path), pin.JointModelFreeFlyer())
    return model, model.createData()


def test_pinocchio_flies_from_the_file(plan: fp.Plan, tmp_path: Path) -> None:
    """Inverse dynamics of the file's arrays give its torques, and the integral of v goes from q to q."""
    model, data = free_model(plan)
    with np.load(export(plan, "pinocchio", tmp_path / "file.npz")) as archive:
        content = dict(archive)
    model.gravity.linear = content["gravity"]
    assert content["joint_names"].tolist() == list(model.names)[2:]
    assert content["q"].shape == (len(content["time"]), model.nq)
    for index in range(0, len(content["time"]), 50):
        q, v, a, tau = (content[name][index] for name in ("q", "v", "a", "tau"))
        forces = pin.rnea(model, data, q, v, a)
        np.testing.assert_allclose(forces[6:], tau[6:], atol=1e-9)
        np.testing.assert_allclose(forces[:6] @ in_plane(plan), 0.0, atol=1e-8)
        momentum = pin.computeCentroidalMomentum(model, data, q, v).angular @ plan.robot.plane.normal
        assert momentum == pytest.approx(plan.angular_momentum, abs=1e-9)
    for index in range(0, len(content["time"]) - 1, 50):
        step = content["time"][index + 1] - content["time"][index]
        middle = (content["v"][index] + content["v"][index + 1]) / 2
        moved = pin.integrate(model, content["q"][index], step * middle)
        np.testing.assert_allclose(pin.difference(model, moved, content["q"][index + 1]), 0.0, atol=1e-6)


def in_plane(plan: fp.Plan) -> np.ndarray:
    """The base's force in the plane and moment about its normal, of a wrench in the base's axes."""
    columns = np.zeros((6, 3))
    columns[:3, 0], columns[:3, 1] = plan.robot.plane.horizontal, plan.robot.plane.vertical
    columns[3:, 2] = plan.robot.plane.normal
    return columns


def check_table(plan: fp.Plan, columns: dict[str, np.ndarray]) -> None:
    """Columns put into Pinocchio's model give the plan's centre of mass and its momentum."""
    model, data = free_model(plan)
    joints = list(model.names)[2:]
    quantities = ("position", "velocity", "acceleration", "torque")
    base = [f"base_{name}" for name in ("x", "y", "z", "qx", "qy", "qz", "qw", "vx", "vy", "vz", "wx", "wy", "wz")]
    assert list(columns) == ["time", *base, *(f"{joint}_{name}" for joint in joints for name in quantities)]
    plane = plan.robot.plane
    for index in range(0, len(columns["time"]), 20):
        now = {name: float(column[index]) for name, column in columns.items()}
        q, v = pin.neutral(model), np.zeros(model.nv)
        q[:7] = [now[name] for name in base[:7]]
        rotation = pin.Quaternion(q[3:7]).matrix()
        v[:3] = rotation.T @ [now[name] for name in base[7:10]]
        v[3:6] = rotation.T @ [now[name] for name in base[10:]]
        for name in joints:
            joint = model.joints[model.getJointId(name)]
            angle = now[f"{name}_position"]
            q[joint.idx_q : joint.idx_q + joint.nq] = (np.cos(angle), np.sin(angle)) if joint.nq == 2 else angle
            v[joint.idx_v] = now[f"{name}_velocity"]
        pin.computeCentroidalMomentum(model, data, q, v)
        state = plan.at(now["time"])
        place = pin.centerOfMass(model, data, q, v)
        assert [place @ plane.horizontal, place @ plane.vertical] == pytest.approx(state.com_position, abs=EXACT)
        speed = data.vcom[0]
        assert [speed @ plane.horizontal, speed @ plane.vertical] == pytest.approx(state.com_velocity, abs=EXACT)
        assert data.hg.angular @ plane.normal == pytest.approx(plan.angular_momentum, abs=EXACT)
        torques = [now[f"{name}_torque"] for name in plan.robot.motors]
        assert torques == pytest.approx(state.motor_torques, abs=EXACT)
        holding = plan.tau(now["time"])
        for name in plan.robot.locked:
            column = model.joints[model.getJointId(name)].idx_v
            assert now[f"{name}_torque"] == pytest.approx(holding[column], abs=EXACT)


def test_csv(plan: fp.Plan, tmp_path: Path) -> None:
    with export(plan, "csv-full", tmp_path / "file.csv", rate=RATE).open() as stream:
        rows = list(csv.DictReader(stream))
    check_table(plan, {name: np.array([float(row[name]) for row in rows]) for name in rows[0]})


def test_parquet(plan: fp.Plan, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    table = parquet.read_table(export(plan, "parquet", tmp_path / "file.parquet", rate=RATE))
    check_table(plan, {name: table[name].to_numpy() for name in table.column_names})
    about = {key.decode(): value.decode() for key, value in table.schema.metadata.items()}
    assert float(about["angular_momentum"]) == plan.angular_momentum
    assert float(about["duration"]) == plan.duration
    gravity = np.array(about["gravity"].split(), dtype=float)
    np.testing.assert_allclose(gravity, -plan.ballistics.gravity * plan.robot.plane.vertical)
    units = {field.name: field.metadata[b"unit"].decode() for field in table.schema}
    assert (units["time"], units["base_x"], units["base_qw"], units["base_wy"]) == ("s", "m", "1", "rad/s")
    tree = plan.robot.file_tree
    for name in plan.robot.locked:
        slides = not tree.joint[name].turns
        assert units[f"{name}_position"] == ("m" if slides else "rad")
        assert units[f"{name}_torque"] == ("N" if slides else "N m")


def messages(path: Path) -> dict[str, list[Any]]:
    """Messages by topic, as the ROS 2 reader of MCAP decodes them."""
    reader = pytest.importorskip("mcap_ros2.reader")
    found: dict[str, list[Any]] = {}
    for message in reader.read_ros2_messages(str(path)):
        found.setdefault(message.channel.topic, []).append(message)
    return found


def seconds(message: Any) -> float:
    return message.log_time_ns / 1e9


def test_mcap_is_a_ros_2_bag(plan: fp.Plan, tmp_path: Path) -> None:
    reader = pytest.importorskip("mcap.reader")
    path = export(plan, "mcap", tmp_path / "flight.mcap")
    with path.open("rb") as stream:
        bag = reader.make_reader(stream)
        assert bag.get_header().profile == "ros2"
        summary = bag.get_summary()
    assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
    assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
    qualities = {channel.topic: channel.metadata["offered_qos_profiles"] for channel in summary.channels.values()}
    kept = {topic for topic, text in qualities.items() if "durability: 1" in text}
    assert kept == {"/robot_description", "/tf_static"}
    found = messages(path)
    assert found["/robot_description"][0].ros_msg.data == plan.robot.xml
    assert len(found["/tf"]) == len(found["/joint_states"]) == 81


def test_mcap_has_the_joints(plan: fp.Plan, tmp_path: Path) -> None:
    found = messages(export(plan, "mcap", tmp_path / "flight.mcap", rate=37))["/joint_states"]
    times = np.array([seconds(message) for message in found])
    assert times[-1] == pytest.approx(plan.duration, abs=2e-9)
    motion = plan.full_motion(times)
    for index, message in enumerate(found):
        stamp = message.ros_msg.header.stamp
        assert stamp.sec + stamp.nanosec / 1e9 == pytest.approx(times[index], abs=1e-12)
        assert message.ros_msg.name == list(motion.joints)
        assert list(message.ros_msg.position) == pytest.approx(motion.positions[index], abs=EXACT)
        assert list(message.ros_msg.velocity) == pytest.approx(motion.velocities[index], abs=EXACT)
        assert list(message.ros_msg.effort) == pytest.approx(motion.motor_torques[index], abs=EXACT)


def pose(transform: Any) -> Any:
    place, turn = transform.translation, transform.rotation
    rotation = pin.Quaternion(turn.w, turn.x, turn.y, turn.z).matrix()
    return pin.SE3(rotation, np.array([place.x, place.y, place.z]))


def test_mcap_places_every_link_where_pinocchio_has_it(plan: fp.Plan, tmp_path: Path) -> None:
    found = messages(export(plan, "mcap", tmp_path / "flight.mcap"))
    model, data = free_model(plan)
    static = list(found["/tf_static"][0].ros_msg.transforms)
    for message in found["/tf"][::20]:
        placed = {"world": pin.SE3.Identity()}
        waiting = [*message.ros_msg.transforms, *static]
        while waiting:
            ready = [each for each in waiting if each.header.frame_id in placed]
            assert ready, [each.child_frame_id for each in waiting]
            for each in ready:
                assert each.child_frame_id not in placed
                placed[each.child_frame_id] = placed[each.header.frame_id] * pose(each.transform)
            waiting = [each for each in waiting if each.child_frame_id not in placed]
        assert set(placed) == {"world", *plan.robot.file_tree.links}
        pin.framesForwardKinematics(model, data, plan.q(min(seconds(message), plan.duration)))
        for link in plan.robot.file_tree.links:
            expected = data.oMf[model.getFrameId(link, pin.FrameType.BODY)]
            assert np.abs(placed[link].homogeneous - expected.homogeneous).max() < 1e-8, link


def test_a_link_called_world_keeps_its_name(coupled: fp.Plan, tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    path.write_text(coupled.robot.xml.replace('"body"', '"world"'))
    joints = {"right_hip": "left_hip", "right_knee": "left_knee"}
    plan = flown(fp.Robot.from_urdf(path, coupled=joints))
    first = messages(export(plan, "mcap", tmp_path / "flight.mcap"))["/tf"][0].ros_msg.transforms[0]
    assert (first.header.frame_id, first.child_frame_id) == ("world_", "world")


def test_so_many_transforms_are_refused(coupled: fp.Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("floatplan.export.table.MOST_PLACES", 100)
    with pytest.raises(InputError, match="more than 100 places"):
        export(coupled, "mcap", tmp_path / "flight.mcap")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("form", "module"), [("mcap", "mcap.writer"), ("mcap", "mcap_ros2._dynamic"), ("parquet", "pyarrow")]
)
def test_what_is_missing_is_named(
    coupled: fp.Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, form: str, module: str
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InputError, match=rf"pip install .*\[{form}\]"):
        export(coupled, form, tmp_path / "file")
    assert not list(tmp_path.iterdir())


def test_the_command_s_help_tells_of_every_format(floatplan: Any) -> None:
    text = floatplan("export", "--help").stdout
    for form in FORMATS:
        assert f"\n  {form:<11}" in text, text


def test_a_rotor_alone_is_no_obstacle(tmp_path: Path) -> None:
    """Pinocchio refuses ``<dynamics>`` without damping and friction: the coordinates are the same."""
    path = tmp_path / "rotor.urdf"
    path.write_text(TWO_LINKS.replace("</joint>", '<dynamics armature="0.01"/></joint>'))
    plan = flown(fp.Robot.from_urdf(path))
    np.testing.assert_array_equal(plan.q(0.4)[7:], plan.at(0.4).positions)
    np.testing.assert_array_equal(plan.v(0.4)[6:], plan.at(0.4).velocities)
