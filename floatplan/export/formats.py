"""File formats of controllers, robots and simulators; SI units and radians in all of them."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.export.ros_bag import mcap_content
from floatplan.export.table import full_csv, gravity, parquet_content, sample_times, table_text, whole_nanoseconds
from floatplan.files import write_atomically
from floatplan.motion.flight import free_flyer
from floatplan.plans.plan import Plan

Content: TypeAlias = Callable[[Plan, float], str | bytes]  # of a file: a plan, and instants per second

ARRAYS = (
    "orientation",
    "orientation_rate",
    "positions",
    "velocities",
    "accelerations",
    "torques",
    "motor_torques",
    "com_position",
    "com_velocity",
    "base_position",
    "angular_momentum",
)  # of a FlightState, in the archive's order


@dataclass(frozen=True)
class Format:
    """A file format: the content of its files, their usual name, and their usual rate, Hz."""

    content: Content
    file: str
    rate: float


def export(plan: Plan, form: str, path: str | Path | None = None, rate: float | None = None) -> Path:
    """Write a plan in a format of :data:`FORMATS`, whole or not at all; otherwise as ``plan.export``."""
    known = format_of(form)
    content = known.content(plan, known.rate if rate is None else rate)
    return write_atomically(known.file if path is None else path, content)


def format_of(name: str) -> Format:
    """Return the format of that name; InputError where there is none."""
    if name not in FORMATS:
        raise InputError(f"must be one of {', '.join(FORMATS)}, not {name!r}", element="format")
    return FORMATS[name]


def npz_content(plan: Plan, rate: float) -> bytes:
    """Return NumPy's archive: ``times``, ``joints``, ``motors`` (names), and the arrays of :class:`FlightState`."""
    state = plan.at(sample_times(plan.duration, rate))
    arrays = {name: getattr(state, name) for name in ARRAYS}
    names = {"joints": np.array(plan.robot.joints), "motors": np.array(plan.robot.motors)}
    return _archive({"times": state.times, **names, **arrays})


def pinocchio_content(plan: Plan, rate: float) -> bytes:
    """Return NumPy's archive for ``pinocchio.buildModelFromUrdf(file, pinocchio.JointModelFreeFlyer())``.

    ``time`` (N,); ``q`` (N, nq), ``v``, ``a``, ``tau`` (N, nv) as of ``plan.q``, ``plan.v``, ``plan.a``, ``plan.tau``;
    ``gravity`` (3,) for ``model.gravity.linear``; ``joint_names``: the model's joints, the free flyer's left out.
    """
    motion, place = plan.full_motion(sample_times(plan.duration, rate)), free_flyer(plan.robot)
    arrays = {
        "time": motion.state.times,
        "q": place.configurations(motion),
        "v": place.velocities(motion),
        "a": place.accelerations(motion),
        "tau": place.torques(motion),
        "gravity": gravity(plan),
        "joint_names": np.array(motion.joints),
    }
    return _archive(arrays)


def ros_content(plan: Plan, rate: float) -> str:
    """Return a ``trajectory_msgs/JointTrajectory`` as YAML: all joints that can move, instants in whole nanoseconds.

    Efforts are the motors' own torques.
    """
    nanoseconds = whole_nanoseconds(plan, rate)
    motion = plan.full_motion(nanoseconds / 1e9)
    names = ", ".join(json.dumps(name, ensure_ascii=False) for name in motion.joints)
    lines = ["header:", "  stamp: {sec: 0, nanosec: 0}", '  frame_id: ""', f"joint_names: [{names}]", "points:"]
    rows = zip(motion.positions, motion.velocities, motion.accelerations, motion.motor_torques, strict=True)
    for instant, (positions, velocities, accelerations, effort) in zip(nanoseconds.tolist(), rows, strict=True):
        lines += [
            f"- positions: {_yaml(positions)}",
            f"  velocities: {_yaml(velocities)}",
            f"  accelerations: {_yaml(accelerations)}",
            f"  effort: {_yaml(effort)}",
            f"  time_from_start: {{sec: {instant // 10**9}, nanosec: {instant % 10**9}}}",
        ]
    return "\n".join(lines) + "\n"


def mujoco_content(plan: Plan, rate: float) -> bytes:
    """Return NumPy's archive for MuJoCo: a free joint at the root link, then one hinge (or slide) per joint.

    ``time`` (N,), ``qpos`` (N, 7 + J): place, quaternion w x y z, joints; ``qvel`` (N, 6 + J): velocity in the world,
    angular velocity in the body, joints; ``ctrl`` (N, J): the motors' own torques; ``joint_names`` (J). The order of a
    model's joints may be another: go by the names.
    """
    motion = plan.full_motion(sample_times(plan.duration, rate))
    quaternion = np.roll(motion.base_quaternion, 1, axis=1)
    arrays = {
        "time": motion.state.times,
        "qpos": np.concatenate((motion.base_position, quaternion, motion.positions), axis=1),
        "qvel": np.concatenate((motion.base_velocity, motion.base_angular_velocity, motion.velocities), axis=1),
        "ctrl": motion.motor_torques,
        "joint_names": np.array(motion.joints),
        "gravity": gravity(plan),
    }
    return _archive(arrays)


def unitree_content(plan: Plan, rate: float) -> str:
    """Return CSV as Unitree's motion data: base place, quaternion x y z w, all joints; no time, rows 1/rate apart.

    As Unitree's own files it has no header; comments before the first row name the columns, one line each. Where the
    flight is not a whole number of steps, the last row is the landing, less than a step early.
    """
    motion = plan.full_motion(sample_times(plan.duration, rate))
    names = ["base_x", "base_y", "base_z", "base_qx", "base_qy", "base_qz", "base_qw", *motion.joints]
    rows = np.concatenate((motion.base_position, motion.base_quaternion, motion.positions), axis=1)
    lines = [f"# column {number}: {' '.join(name.split())}" for number, name in enumerate(names)]
    lines += [",".join(map(repr, row)) for row in rows.tolist()]
    return "\n".join(lines) + "\n"


def _archive(arrays: Mapping[str, Array]) -> bytes:
    stream = io.BytesIO()
    np.savez(stream, **arrays)  # type: ignore[arg-type]
    return stream.getvalue()


def _yaml(values: Array) -> str:
    """Numbers that read back bit for bit; YAML 1.1 reads 1e-05 as text, and 1.0e-05 as a number."""
    texts = (repr(float(value)) for value in values)
    return (
        "[" + ", ".join(text.replace("e", ".0e") if "e" in text and "." not in text else text for text in texts) + "]"
    )


FORMATS: dict[str, Format] = {
    "csv": Format(table_text, "trajectory.csv", 1000.0),
    "csv-full": Format(full_csv, "full_trajectory.csv", 1000.0),
    "parquet": Format(parquet_content, "trajectory.parquet", 1000.0),
    "npz": Format(npz_content, "trajectory.npz", 1000.0),
    "pinocchio": Format(pinocchio_content, "pinocchio.npz", 1000.0),
    "mujoco": Format(mujoco_content, "mujoco.npz", 1000.0),
    "ros": Format(ros_content, "joint_trajectory.yaml", 100.0),
    "mcap": Format(mcap_content, "flight.mcap", 100.0),
    "unitree": Format(unitree_content, "unitree.csv", 50.0),
}
