"""File formats of controllers, robots and simulators; SI units and radians in all of them."""

import json
import zipfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation

from floatplan.arrays import Array
from floatplan.errors import InputError, naming
from floatplan.export import reference, table
from floatplan.export.actuators import controls
from floatplan.export.model_names import MjcfModel, ModelNames, matched, own_mjcf, own_names
from floatplan.export.motion import Exported, exported
from floatplan.export.ros_bag import mcap_content
from floatplan.export.table import archive
from floatplan.files import write_all, write_atomically
from floatplan.plans.plan import Plan
from floatplan.plans.trajectory import Trajectory, sample_times
from floatplan.robot.robot import Robot
from floatplan.simulation.gains import Gain

Content: TypeAlias = Callable[[Exported, float], str | bytes]  # of a file: a motion, and instants per second

UNITREE_JOINTS = [  # in the order of Unitree's SDK
    *("FR_hip_joint", "FR_thigh_joint", "FR_calf_joint", "FL_hip_joint", "FL_thigh_joint", "FL_calf_joint"),
    *("RR_hip_joint", "RR_thigh_joint", "RR_calf_joint", "RL_hip_joint", "RL_thigh_joint", "RL_calf_joint"),
]


@dataclass(frozen=True)
class Format:
    """A file format.

    Attributes
    ----------
    content : of its files
    file : their usual name
    text : its description in the command's help
    rate : their usual rate, Hz
    gains : whether its files can have gains
    of_model : which names of the model of a reading program its files use: joints, bodies
    of_plans : content of plans' files, which have less than those of other motions, and no gains
    by_limbs : whether joints and bodies of a URDF are in MuJoCo's order, not in that of the file
    extras : content of a second file, of what the format cannot hold; none where that is empty
    """

    content: Content
    file: str
    text: str
    rate: float = 1000.0
    gains: bool = True
    of_model: tuple[str, ...] = ()
    of_plans: Callable[[Any, float], str | bytes] | None = None
    by_limbs: bool = False
    extras: Content | None = None


def export(
    motion: Trajectory,
    form: str,
    path: str | Path | None = None,
    rate: float | None = None,
    *,
    kp: Gain | None = None,
    kd: Gain | None = None,
    model: str | Path | None = None,
) -> Path:
    """Write a plan or a jump in a format of :data:`FORMATS`, whole or not at all.

    Parameters
    ----------
    motion : Plan or Jump
    form, path, rate, model : as of :meth:`floatplan.Plan.export`, which lists what it refuses
    kp, kd : float or mapping, optional
        Gains as of :func:`floatplan.export.motion.exported`.
    """
    format_ = format_of(form)
    names = names_of_model(form, model, motion.problem.robot)
    rate = format_.rate if rate is None else rate
    of_plans = format_.of_plans if isinstance(motion, Plan) else None
    if (of_plans is not None or not format_.gains) and (kp is not None or kd is not None):
        with_gains = [name for name, other in FORMATS.items() if other.gains and other.of_plans is None]
        raise _no_room("gains", form, with_gains)
    path = Path(format_.file if path is None else path)
    if of_plans is not None:
        return write_atomically(path, of_plans(motion, rate))
    sampled = exported(motion, kp, kd, names)
    contents = {path: format_.content(sampled, rate)}
    if format_.extras is not None:
        extras = format_.extras(sampled, rate)
        if extras:
            contents[extras_path(path)] = extras
        else:
            with suppress(OSError):  # it may not be there, or may not be removed
                extras_path(path).unlink()  # of another motion, under the same name
    return write_all(contents)[0]


def extras_path(path: str | Path) -> Path:
    """Return where the second file of a format lies that has :attr:`Format.extras`: ``motion.extras.npz``."""
    path = Path(path)
    return path.parent / f"{path.stem}.extras.npz"


def names_of_model(form: str, model: str | Path | None, robot: Robot) -> ModelNames | None:
    """Return the names in the model that is to read a robot's motion, if there is one, or refuse it."""
    format_ = format_of(form)
    if model is not None and not format_.of_model:
        raise _no_room("the order of a model", form, [name for name, other in FORMATS.items() if other.of_model])
    if model is None and form in ("mujoco", "loco-mujoco") and robot.kind == "mjcf":
        own = own_mjcf(robot)  # the coordinates of these files are an MJCF's
        if form == "mujoco" or own.floats_by_joints:
            return own
    if model is None:
        return own_names(robot, by_limbs=True) if format_.by_limbs else None
    return matched(own_names(robot), model, with_bodies="bodies" in format_.of_model, by_limbs=format_.by_limbs)


def _no_room(what: str, form: str, others: list[str]) -> InputError:
    advice = f"take one of {', '.join(others)}"
    return InputError(f'a file "{form}" has no room for {what}', element="format", advice=advice)


def format_of(name: str) -> Format:
    """Return the format of that name; InputError where there is none."""
    if name not in FORMATS:
        raise InputError(f"must be one of {', '.join(FORMATS)}, not {name!r}", element="format")
    return FORMATS[name]


def npz_content(plan: Plan, rate: float) -> bytes:
    """Return NumPy's archive: ``times``, ``joints``, ``motors`` (names), and the arrays of :class:`FlightState`."""
    state = plan.at(sample_times(plan.duration, rate))
    arrays = {field.name: getattr(state, field.name) for field in fields(state)}
    names = {"joints": np.array(plan.robot.joints), "motors": np.array(plan.robot.motors)}
    return archive({"times": state.times} | names | arrays)


def pinocchio_content(motion: Exported, rate: float) -> bytes:
    """Return NumPy's archive for ``pinocchio.buildModelFromUrdf(file, pinocchio.JointModelFreeFlyer())``.

    ``time`` (N,); ``q`` (N, nq), ``v``, ``a``, ``tau`` (N, nv) as of ``plan.q``, ``plan.v``, ``plan.a``, ``plan.tau``;
    ``gravity`` (3,) for ``model.gravity.linear``; ``joint_names``: the model's joints without the free flyer; and
    the arrays of :func:`_controlled`.
    """
    times = sample_times(motion.duration, rate)
    sample = motion.sample(times)
    arrays = {
        "time": times,
        "q": sample.q,
        "v": sample.v,
        "a": sample.a,
        "tau": sample.tau,
        "gravity": motion.gravity,
        "joint_names": np.array(motion.joints),
    }
    return archive(arrays | _controlled(motion, times))


def _controlled(motion: Exported, times: Array) -> dict[str, Array]:
    """Return data for a controller in addition to the motion at times (N,), as far as there is any.

    These are :meth:`Exported.contacts`, and ``kp``, ``kd`` (J,), N m/rad and N m s/rad, of ``joint_names``.
    """
    gains = {} if motion.gains is None else dict(zip(("kp", "kd"), motion.gains, strict=True))
    return motion.contacts(times) | gains


def ros_content(motion: Exported, rate: float) -> str:
    """Return a ``trajectory_msgs/JointTrajectory`` as YAML: all joints that can move, instants in whole nanoseconds.

    Efforts are the motors' own torques.
    """
    nanoseconds = table.whole_nanoseconds(motion.duration, rate)
    whole = motion.at(nanoseconds / 1e9)
    names = ", ".join([json.dumps(name, ensure_ascii=False) for name in motion.joints])
    lines = ["header:", "  stamp: {sec: 0, nanosec: 0}", '  frame_id: ""', f"joint_names: [{names}]", "points:"]
    rows = zip(whole.positions, whole.velocities, whole.accelerations, whole.motor_torques, strict=True)
    for instant, (positions, velocities, accelerations, effort) in zip(nanoseconds.tolist(), rows, strict=True):
        lines += [
            f"- positions: {_yaml(positions)}",
            f"  velocities: {_yaml(velocities)}",
            f"  accelerations: {_yaml(accelerations)}",
            f"  effort: {_yaml(effort)}",
            f"  time_from_start: {{sec: {instant // 10**9}, nanosec: {instant % 10**9}}}",
        ]
    return "\n".join(lines) + "\n"


def mujoco_content(motion: Exported, rate: float) -> bytes:
    """Return NumPy's archive for MuJoCo, which a model of the robot reads as it is: ``data.qpos[:] = qpos[k]``.

    ``time`` (N,); ``joint_names`` (J,); ``torque`` (N, J): the motors' own torques; ``gravity`` (3,); and the arrays of
    :func:`_controlled`. Of an MJCF, ``qpos`` (N, nq), ``qvel`` (N, nv) and ``ctrl`` (N, nu) are that file's, as of
    :func:`_in_model`. Otherwise there is a free joint at the root link, then one hinge (or slide) per joint: ``qpos``
    (N, 7 + J) is position, quaternion w x y z, joints; ``qvel`` (N, 6 + J) velocity in the world, angular velocity in
    the body, joints; ``ctrl`` (N, J) is ``torque``, as of actuators of gear 1.
    """
    times = sample_times(motion.duration, rate)
    whole = motion.at(times)
    names = motion.joints if motion.model is None else motion.model.joints
    order = list(map(motion.joints.index, names))
    of_joints = {
        "positions": whole.positions[:, order],
        "velocities": whole.velocities[:, order],
        "torques": whole.motor_torques[:, order],
    }
    position = whole.base_position
    rotation = Rotation.from_quat(whole.base_quaternion)
    velocity = whole.base_velocity
    spin = whole.base_twist[:, 3:]
    if motion.model is None or motion.model.mjcf is None:
        quaternion = np.roll(whole.base_quaternion, 1, axis=1)
        in_model = {
            "qpos": np.concatenate((position, quaternion, of_joints["positions"]), axis=1),
            "qvel": np.concatenate((velocity, spin, of_joints["velocities"]), axis=1),
            "ctrl": of_joints["torques"],
        }
    else:
        with naming(motion.model.mjcf.path):
            in_model = _in_model(motion.model.mjcf, times, (position, rotation, velocity, spin), of_joints)
    arrays = {
        "time": times,
        **in_model,
        "torque": of_joints["torques"],
        "joint_names": np.array(names),
        "gravity": motion.gravity,
    }
    controlled = _controlled(motion, times)
    for name in controlled.keys() & {"kp", "kd"}:
        controlled[name] = controlled[name][order]
    return archive(arrays | controlled)


def _in_model(
    mjcf: MjcfModel, times: Array, base: tuple[Array, Rotation, Array, Array], of_joints: dict[str, Array]
) -> dict[str, Array]:
    """Return ``qpos``, ``qvel`` and ``ctrl`` as an MJCF has them, ``actuator_names``, and ``notes``.

    The base is where the file's own joints have it: a free joint, or joints that slide and rotate. Other bodies of the
    file are where it has them. ``ctrl`` makes its actuators give the torques of the motion: of a motor it is the
    torque over its gear, of a servo the target at which it gives that torque; where the file has no actuators, the
    torque of each joint. ``notes`` say what the actuators cannot do.
    """
    model = mjcf.compiled
    joints = mjcf.joints
    base_qpos, base_qvel = mjcf.base.coordinates(*base)
    qpos = np.tile(model.qpos0, (len(times), 1))
    qvel = np.zeros((len(times), len(model.dof_bodyid)))
    notes: list[str] = []
    if mjcf.base.numbers:
        first = mjcf.base.numbers[0]
        start = int(model.jnt_qposadr[first])
        degree = int(model.jnt_dofadr[first])
        qpos[:, start : start + base_qpos.shape[1]] = base_qpos
        qvel[:, degree : degree + base_qvel.shape[1]] = base_qvel
    numbers = list(joints.values())
    qpos[:, model.jnt_qposadr[numbers]] = of_joints["positions"]
    qvel[:, model.jnt_dofadr[numbers]] = of_joints["velocities"]
    if not mjcf.base.numbers:
        notes.append("the file holds its base to the world; with <freejoint/> in it, it takes this qpos and qvel")
        qpos = np.concatenate((base_qpos, qpos), axis=1)
        qvel = np.concatenate((base_qvel, qvel), axis=1)
    ctrl = of_joints["torques"]
    if model.names["actuator"]:
        of_actuators = controls(model, joints, times, of_joints)
        ctrl = of_actuators.ctrl
        notes += of_actuators.notes
    else:
        notes.append("the file has no actuators; ctrl is the torque of each joint, N m")
    return {
        "qpos": qpos,
        "qvel": qvel,
        "ctrl": ctrl,
        "actuator_names": np.array(model.names["actuator"], dtype=str),
        "notes": np.array(notes, dtype=str),
    }


def read_notes(path: Path) -> list[str]:
    """Return the notes of an exported file about the model that is to read it; none where its format has no notes."""
    try:
        with np.load(path, allow_pickle=False) as content:
            return list(map(str, content["notes"]))
    except (KeyError, ValueError, OSError, zipfile.BadZipFile):
        return []


def unitree_content(motion: Exported, rate: float) -> str:
    """Return CSV as Unitree's motion data: base position, quaternion x y z w, all joints; no time, rows 1/rate apart.

    As Unitree's own files it has no header; comments before the first row name the columns, one line each. Where the
    flight is not a whole number of steps, the last row is the landing, less than a step early.
    """
    whole = motion.at(sample_times(motion.duration, rate))
    names = ["base_x", "base_y", "base_z", "base_qx", "base_qy", "base_qz", "base_qw", *motion.joints]
    rows = np.concatenate((whole.base_position, whole.base_quaternion, whole.positions), axis=1)
    comments = [f"# column {number}: {' '.join(name.split())}\n" for number, name in enumerate(names)]
    return "".join(comments) + table.number_rows(rows)


def unitree_sdk_content(motion: Exported, rate: float) -> str:
    """Return CSV in the order of Unitree's ``motor_cmd``: front right, front left, rear right, rear left; hip to calf.

    Columns: ``time``; ``q``, ``dq``, ``tau``, ``kp``, ``kd``, each of all twelve motors, such as ``q_FR_hip_joint``;
    then contacts and forces as of the other tables.

    Raises
    ------
    InputError
        The robot is none of Unitree's quadrupeds with twelve motors: A1, Go1, Go2, B1.
    """
    missing = [name for name in UNITREE_JOINTS if name not in motion.joints]
    others = [name for name in motion.joints if name not in UNITREE_JOINTS]
    if missing or others:
        why = f'it has no joint "{missing[0]}"' if missing else f'its joint "{others[0]}" is none of theirs'
        reason = f"is none of Unitree's quadrupeds with twelve motors (A1, Go1, Go2, B1): {why}"
        raise InputError(
            reason, source=motion.robot.source, element=f'robot "{motion.robot.name}"', advice="take csv-full"
        )
    times = sample_times(motion.duration, rate)
    whole = motion.at(times)
    order = list(map(motion.joints.index, UNITREE_JOINTS))
    columns = [("time", times)]
    blocks = {"q": whole.positions, "dq": whole.velocities, "tau": whole.motor_torques}
    if motion.gains is not None:
        kp, kd = motion.gains
        blocks |= {"kp": np.tile(kp, (len(times), 1)), "kd": np.tile(kd, (len(times), 1))}
    for name, values in blocks.items():
        for joint, index in zip(UNITREE_JOINTS, order, strict=True):
            columns.append((f"{name}_{joint}", values[:, index]))
    return table.csv_text(columns + [(column.name, column.values) for column in table.contact_columns(motion, times)])


def _yaml(values: Array) -> str:
    """Numbers that read back bit for bit; YAML 1.1 reads 1e-05 as text, and 1.0e-05 as a number."""
    return f"[{', '.join(map(_yaml_number, values.tolist()))}]"


def _yaml_number(value: float) -> str:
    text = repr(value)
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


JOINTS = ("joints",)
FORMATS: dict[str, Format] = {
    "csv": Format(table.full_csv, "trajectory.csv", "planned joints; of a jump as csv-full", of_plans=table.table_text),
    "csv-full": Format(table.full_csv, "full_trajectory.csv", "base pose and all joints, one row per instant"),
    "parquet": Format(table.parquet_content, "trajectory.parquet", 'the same as Parquet (extra "parquet")'),
    "npz": Format(
        pinocchio_content, "trajectory.npz", "NumPy: plan.at(); of a jump as pinocchio", of_plans=npz_content
    ),
    "pinocchio": Format(pinocchio_content, "pinocchio.npz", "NumPy: q, v, a, tau of its free-flyer model"),
    "mujoco": Format(mujoco_content, "mujoco.npz", "NumPy: qpos, qvel, ctrl of its MJCF", of_model=JOINTS),
    "ros": Format(ros_content, "joint_trajectory.yaml", "trajectory_msgs/JointTrajectory as YAML", 100.0, gains=False),
    "mcap": Format(mcap_content, "flight.mcap", 'a ROS 2 bag, also for Foxglove (extra "mcap")', 100.0),
    "unitree": Format(unitree_content, "unitree.csv", "CSV as Unitree's motion data", 50.0, gains=False),
    "unitree-sdk": Format(unitree_sdk_content, "unitree_sdk.csv", "CSV in its motors' order: A1, Go1, Go2, B1", 500.0),
    "isaac-amp": Format(
        reference.isaac_amp_content, "isaac_amp.npz", "NumPy: AMP in Isaac Lab", 50.0, False, ("joints", "bodies")
    ),
    "motion-csv": Format(
        reference.motion_csv_content,
        "motion.csv",
        "CSV for csv_to_npz: BeyondMimic, mjlab",
        50.0,
        gains=False,
        of_model=JOINTS,
        extras=reference.motion_csv_extras,
    ),
    "loco-mujoco": Format(
        reference.loco_mujoco_content,
        "loco_mujoco.npz",
        "NumPy: a trajectory of LocoMuJoCo",
        50.0,
        gains=False,
        of_model=JOINTS,
        extras=reference.contact_extras,
    ),
    "unitree-csv": Format(
        reference.motion_csv_content,
        "unitree_motion.csv",
        "CSV of Unitree's retargeted motions: no comments",
        30.0,
        gains=False,
        of_model=JOINTS,
        extras=reference.motion_csv_extras,
    ),
    "mjlab-npz": Format(
        reference.mjlab_content,
        "mjlab.npz",
        "NumPy: a motion of mjlab, bodies in MuJoCo's order",
        50.0,
        gains=False,
        of_model=("joints", "bodies"),
        by_limbs=True,
    ),
    "gmr": Format(
        reference.gmr_content,
        "gmr.pkl",
        "pickle of arrays and lists, as GMR's",
        50.0,
        gains=False,
        of_model=JOINTS,
        by_limbs=True,
    ),
    "mimickit": Format(
        reference.mimickit_content,
        "mimickit.pkl",
        "pickle of lists, as MimicKit's",
        50.0,
        gains=False,
        of_model=JOINTS,
        by_limbs=True,
    ),
}
