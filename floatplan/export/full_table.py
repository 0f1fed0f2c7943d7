"""The whole motion as one table: the base in space, and every joint that the URDF has; as CSV or Parquet."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from floatplan.arrays import Array
from floatplan.export.table import csv_text, sample_times
from floatplan.files import write_atomically
from floatplan.optional import import_optional
from floatplan.plans.plan import Plan

SPACE = ("x", "y", "z")
QUATERNION = ("qx", "qy", "qz", "qw")


@dataclass(frozen=True, eq=False)
class Column:
    """A quantity at all instants: name, unit, values (N,)."""

    name: str
    unit: str
    values: Array


def full_columns(plan: Plan, rate: float) -> list[Column]:
    """Return the columns: time, base, joints in Pinocchio's order.

    The world's axes are the root link's at orientation 0. ``base_x`` to ``base_qw`` are place and orientation of the
    root link, ``base_vx`` to ``base_wz`` its velocities, all in the world. A joint's torque is its motor's own.
    """
    motion = plan.full_motion(sample_times(plan.duration, rate))
    columns = [Column("time", "s", motion.state.times)]
    for prefix, unit, letters, values in (
        ("base_", "m", SPACE, motion.base_position),
        ("base_", "1", QUATERNION, motion.base_quaternion),
        ("base_v", "m/s", SPACE, motion.base_velocity),
        ("base_w", "rad/s", SPACE, motion.base_angular_velocity),
    ):
        columns += [Column(prefix + letter, unit, column) for letter, column in zip(letters, values.T, strict=True)]
    tree = plan.robot.layout.tree
    for index, joint in enumerate(motion.joints):
        angle, torque = ("rad", "N m") if tree.joint[joint].turns else ("m", "N")
        columns += [
            Column(f"{joint}_position", angle, motion.positions[:, index]),
            Column(f"{joint}_velocity", f"{angle}/s", motion.velocities[:, index]),
            Column(f"{joint}_acceleration", f"{angle}/s^2", motion.accelerations[:, index]),
            Column(f"{joint}_torque", torque, motion.motor_torques[:, index]),
        ]
    return columns


def write_full_csv(plan: Plan, path: Path, rate: float) -> Path:
    """Write the columns of :func:`full_columns` as CSV, numbers that read back bit for bit."""
    columns = full_columns(plan, rate)
    header = [column.name for column in columns]
    return write_atomically(path, csv_text(header, np.column_stack([column.values for column in columns])))


def write_parquet(plan: Plan, path: Path, rate: float) -> Path:
    """Write the columns of :func:`full_columns` as Parquet; each has its unit in its metadata.

    The file's metadata has ``problem``, ``robot``, ``duration``, ``angular_momentum`` and ``gravity`` (x y z).

    Raises
    ------
    InputError
        PyArrow is not installed.
    """
    arrow = import_optional("pyarrow", name="PyArrow", element="format", extra="parquet")
    parquet = import_optional("pyarrow.parquet", name="PyArrow", element="format", extra="parquet")
    columns = full_columns(plan, rate)
    fields = [arrow.field(column.name, arrow.float64(), False, {"unit": column.unit}) for column in columns]
    gravity = -plan.ballistics.gravity * plan.robot.plane.vertical
    about = {
        "problem": plan.problem.name,
        "robot": plan.robot.name,
        "duration": repr(plan.duration),
        "angular_momentum": repr(plan.angular_momentum),
        "gravity": " ".join(repr(float(value) + 0.0) for value in gravity),
    }
    table = arrow.table([arrow.array(column.values) for column in columns], schema=arrow.schema(fields, about))
    stream = io.BytesIO()
    parquet.write_table(table, stream)
    return write_atomically(path, stream.getvalue())
