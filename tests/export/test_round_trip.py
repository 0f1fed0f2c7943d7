"""One round trip for every format: what its reader finds in a file is the motion, of plans and of jumps."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from pyarrow import parquet
from scipy.spatial.transform import Rotation

import floatplan as fp
from floatplan.export.formats import FORMATS, UNITREE_JOINTS, export

EXACT = 1e-9
QUANTITIES = ("position", "velocity", "acceleration", "torque")
BASE = [f"base_{name}" for name in ("x", "y", "z", "qx", "qy", "qz", "qw", "vx", "vy", "vz", "wx", "wy", "wz")]


def from_columns(columns):
    """Columns named by joint and quantity; a base in space and contacts where there are any."""
    names = [name.removesuffix("_position") for name in columns if name.endswith("_position")]
    found = {"time": columns["time"], "names": names}
    for quantity in QUANTITIES:
        having = [name for name in names if f"{name}_{quantity}" in columns]
        found[quantity] = {name: columns[f"{name}_{quantity}"] for name in having}
    if BASE[0] in columns:
        found["pose"] = np.stack([columns[name] for name in BASE[:7]], axis=1)
        found["base"] = np.stack([columns[name] for name in BASE[7:]], axis=1)
    feet = [name.removesuffix("_contact") for name in columns if name.endswith("_contact")]
    found["stands"] = {name: columns[f"{name}_contact"] for name in feet}
    found["forces"] = {name: np.stack([columns[f"{name}_f{axis}"] for axis in "xyz"], axis=1) for name in feet}
    return found


def read_csv(path):
    with path.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    return from_columns({name: np.array([float(row[name]) for row in rows]) for name in rows[0]})


def read_parquet(path):
    table = parquet.read_table(path)
    return from_columns({name: table[name].to_numpy() for name in table.column_names})


def read_archive(path):
    """Coordinates of the file's model, as Pinocchio's q, v, a and tau, or as MuJoCo's qpos and qvel."""
    with np.load(path, allow_pickle=False) as archive:
        content = dict(archive)
    found = {"time": content["time"], "names": content["joint_names"].tolist()}
    if "qpos" in content:
        qpos, qvel = content["qpos"], content["qvel"]
        found["pose"] = np.concatenate((qpos[:, :3], np.roll(qpos[:, 3:7], -1, axis=1)), axis=1)
        turned = Rotation.from_quat(found["pose"][:, 3:]).apply(qvel[:, 3:6])  # MuJoCo's are in the body's axes
        found["base"] = np.concatenate((qvel[:, :3], turned), axis=1)
        joints = {"position": qpos[:, 7:], "velocity": qvel[:, 6:], "torque": content["ctrl"]}
        for quantity, values in joints.items():
            found[quantity] = dict(zip(found["names"], values.T, strict=True))
    else:
        found["coordinates"] = {name: content[name] for name in ("q", "v", "a", "tau")}
    feet = content.get("contact_names", np.array([])).tolist()
    found["stands"] = {name: content["contacts"][:, index] for index, name in enumerate(feet)}
    found["forces"] = {name: content["forces"][:, index] for index, name in enumerate(feet)}
    return found


def read_ros(path):
    message = yaml.safe_load(path.read_text())
    points = message["points"]
    since = [point["time_from_start"] for point in points]
    found = {"time": [each["sec"] + 1e-9 * each["nanosec"] for each in since], "names": message["joint_names"]}
    keys = ("positions", "velocities", "accelerations", "effort")
    for quantity, key in zip(QUANTITIES, keys, strict=True):
        values = np.array([point[key] for point in points])
        assert values.dtype == np.float64, "YAML takes small numbers for numbers"
        found[quantity] = dict(zip(found["names"], values.T, strict=True))
    return found


def read_mcap(path):
    topics = {}
    for message in pytest.importorskip("mcap_ros2.reader").read_ros2_messages(str(path)):
        topics.setdefault(message.channel.topic, []).append(message)
    states = [message.ros_msg for message in topics["/joint_states"]]
    found = {"time": [message.log_time_ns / 1e9 for message in topics["/joint_states"]], "names": states[0].name}
    for quantity, key in (("position", "position"), ("velocity", "velocity"), ("torque", "effort")):
        values = np.array([getattr(state, key) for state in states])
        found[quantity] = dict(zip(found["names"], values.T, strict=True))
    feet = {topic.split("/")[2] for topic in topics if topic.startswith("/contacts/")}
    found["stands"] = {name: [each.ros_msg.data for each in topics[f"/contacts/{name}/stands"]] for name in feet}
    pushes = {name: [each.ros_msg.vector for each in topics[f"/contacts/{name}/force"]] for name in feet}
    found["forces"] = {name: [[each.x, each.y, each.z] for each in vectors] for name, vectors in pushes.items()}
    return found


def read_unitree(path):
    """Rows of a base and joints at 50 Hz, which a comment names in the files of plans."""
    comments = [line for line in path.read_text().splitlines() if line.startswith("#")]
    names = [comment.partition(": ")[2] for comment in comments]
    rows = np.loadtxt(path, delimiter=",")
    found = {"time": np.arange(len(rows)) / 50, "pose": rows[:, :7], "names": names[7:]}
    if not names:
        found["coordinates"] = {"q": rows}
    found["position"] = dict(zip(names[7:], rows[:, 7:].T, strict=bool(names)))
    return found


def read_sdk(path):
    with path.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    columns = {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
    for block, key in enumerate(("q", "dq", "tau", "kp", "kd")):  # motor_cmd of the SDK: FR_0, FR_1, FR_2, FL_0, ..
        assert list(columns)[1 + 12 * block : 13 + 12 * block] == [f"{key}_{name}" for name in UNITREE_JOINTS]
    found = {"time": columns["time"], "names": UNITREE_JOINTS}
    for quantity, key in (("position", "q"), ("velocity", "dq"), ("torque", "tau")):
        found[quantity] = {name: columns[f"{key}_{name}"] for name in UNITREE_JOINTS}
    return found


READERS = {
    "csv": read_csv,
    "csv-full": read_csv,
    "parquet": read_parquet,
    "npz": read_archive,
    "pinocchio": read_archive,
    "mujoco": read_archive,
    "ros": read_ros,
    "mcap": read_mcap,
    "unitree": read_unitree,
    "unitree-sdk": read_sdk,
}


def assert_is(motion, found):
    """Hold what was found to the motion's own coordinates, which are Pinocchio's, and to its phases."""
    model = motion.problem.robot.free_flyer()
    times = np.minimum(found["time"], motion.duration)
    assert times[0] == 0.0
    assert times[-1] == pytest.approx(motion.duration, abs=2e-9)
    q, v, a, tau = (quantity(times) for quantity in (motion.q, motion.v, motion.a, motion.tau))
    for name, values in found.get("coordinates", {}).items():
        np.testing.assert_array_equal(values, {"q": q, "v": v, "a": a, "tau": tau}[name])
    whole = motion.full_motion(times)
    for name in found["names"]:
        row = model.joints[model.getJointId(name)].idx_v
        expected = (whole.positions[:, whole.joints.index(name)], v[:, row], a[:, row], tau[:, row])
        for quantity, values in zip(QUANTITIES, expected, strict=True):
            if name in found.get(quantity, {}):
                np.testing.assert_allclose(found[quantity][name], values, atol=EXACT, err_msg=f"{name} {quantity}")
    if "pose" in found:
        np.testing.assert_allclose(found["pose"], q[:, :7], atol=EXACT)
    if "base" in found:
        turn = Rotation.from_quat(q[:, 3:7])
        expected = np.concatenate((turn.apply(v[:, :3]), turn.apply(v[:, 3:6])), axis=1)
        np.testing.assert_allclose(found["base"], expected, atol=EXACT)
    forces = motion.forces(times)
    for name, stands in found.get("stands", {}).items():
        within = [(times > phase.begin) & (times <= phase.end) for phase in motion.phases]
        within[0] |= times == 0.0  # at a change a point stands as before it
        on = [now for now, phase in zip(within, motion.phases, strict=True) if name in phase.contacts]
        np.testing.assert_array_equal(np.asarray(stands, dtype=bool), np.any(on, axis=0))
        np.testing.assert_allclose(found["forces"][name], forces[name], atol=EXACT * np.abs(forces[name]).max())


@pytest.mark.parametrize("kind", ["coupled", "tree", "jump"])
@pytest.mark.parametrize("form", READERS)
def test_what_is_read_is_the_motion(request, tmp_path, form, kind):
    motion = request.getfixturevalue(kind)
    if form == "unitree-sdk" and kind != "jump":
        with pytest.raises(fp.InputError, match=r"is none of Unitree\'s .*\(A1, Go1, Go2, B1\)"):
            export(motion, form, tmp_path / "file")
        assert not list(tmp_path.iterdir())
        return
    rate = {"unitree": 50.0, "mcap": 37.0}.get(form, 60.0)
    path = export(motion, form, tmp_path / "file", rate)
    if form == "npz" and kind != "jump":  # the planned joints alone, as the plan's own states have them
        with np.load(path) as archive:
            state = motion.at(archive["times"])
            for name in set(archive.files) - {"joints", "motors"}:
                np.testing.assert_array_equal(archive[name], getattr(state, name))
        return
    found = READERS[form](path)
    robot = motion.problem.robot
    names = set(robot.free_flyer().names[2:])
    if form == "csv" and kind != "jump":
        assert set(found["names"]) == names - set(robot.locked)
    elif found["names"]:
        assert set(found["names"]) == names
    if kind == "jump" and form not in ("ros", "unitree", "unitree-sdk"):
        assert set(found["stands"]) == {name for phase in motion.phases for name in phase.contacts}
    assert_is(motion, found)


def test_parquet_says_units_and_what_was_asked(tree, jump, tmp_path):
    for motion in (tree, jump):
        schema = parquet.read_table(export(motion, "parquet", tmp_path / "file", 50.0)).schema
        about = {key.decode(): value.decode() for key, value in schema.metadata.items()}
        units = {field.name: field.metadata[b"unit"].decode() for field in schema}
        assert float(about["duration"]) == motion.duration
        assert [units[name] for name in ("time", "base_x", "base_qw", "base_wy")] == ["s", "m", "1", "rad/s"]
        joints = motion.problem.robot.file_tree.joint
        for name in motion.problem.robot.locked:
            assert units[f"{name}_position"] == ("rad" if joints[name].turns else "m")
            assert units[f"{name}_torque"] == ("N m" if joints[name].turns else "N")
    assert [each["end"] for each in json.loads(about["phases"])] == [phase.end for phase in jump.phases]
    assert (units["RL_foot_fz"], units["FL_hip_joint_kp"], units["FL_hip_joint_kd"]) == ("N", "N m/rad", "N m s/rad")


@pytest.mark.parametrize("form", [form for form in FORMATS if form != "unitree-sdk"])
def test_the_command_writes_beside_the_plan_or_where_told(floatplan, handstand, tmp_path, form):
    plan_file = handstand.save(tmp_path / "run" / "plan.json")
    run = floatplan("export", plan_file, "--format", form)
    assert run.code == 0, run
    assert Path(run.stdout.strip()) == plan_file.parent / FORMATS[form].file
    told = tmp_path / "elsewhere" / "file"
    assert floatplan("export", plan_file, "-f", form, "-o", told, "--rate", "100", "--quiet").stdout == ""
    assert told.stat().st_size > 0


def test_python_names_the_formats(handstand):
    with pytest.raises(
        fp.InputError,
        match="must be one of csv, csv-full, parquet, npz, pinocchio, mujoco, ros, mcap, unitree, unitree-sdk",
    ):
        export(handstand, "bvh")
