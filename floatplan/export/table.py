"""Tables of a motion sampled in time: a plan's motors as CSV, and the whole motion as CSV or Parquet.

The latter has the base in space, every joint that the URDF has, contacts and gains.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from floatplan.arrays import Array, IntArray
from floatplan.errors import InputError, import_optional
from floatplan.plans.plan import Plan
from floatplan.plans.trajectory import sample_times

if TYPE_CHECKING:
    from floatplan.export.motion import Exported

SPACE = ("x", "y", "z")
QUATERNION = ("qx", "qy", "qz", "qw")
MOST_PLACES = 1_000_000  # [-] links times instants, of a file


def check_size(instants: int, links: int, rate: float) -> None:
    """Raise InputError where a file would have more than ``MOST_PLACES`` places of links."""
    if instants * links > MOST_PLACES:
        reason = f"{rate} Hz are {instants} instants of {links} links, more than {MOST_PLACES} places"
        raise InputError(reason, element="rate", advice="give a lower rate")


def whole_nanoseconds(duration: float, rate: float) -> IntArray:
    """Instants of :func:`sample_times` in whole nanoseconds, as ROS has them."""
    return np.floor(sample_times(duration, rate) * 1e9 + 1e-3).astype(np.int64)


def table_text(plan: Plan, rate: float = 1000.0) -> str:
    """Return the plan as CSV: one row per instant, numbers that read back bit for bit.

    Columns: time, orientation, orientation_rate, com_x, com_y (horizontal, vertical; in space orientation_qx to
    orientation_qw, orientation_rate_x to orientation_rate_z in the base's axes, com_x to com_z), then per motor its
    joint's position, velocity, acceleration and its own torque; SI units and radians. A joint that others follow also
    has ``generalized_torque``: the sum over its motors, by their ratios.

    Parameters
    ----------
    plan : Plan
    rate : float
        Rows per second, Hz; the end of the flight is always a row.
    """
    state = plan.at(sample_times(plan.duration, rate))
    columns = [("time", state.times)]

    def add(prefix: str, letters: Sequence[str], values: Array) -> None:
        for letter, column in zip(letters, values.T, strict=True):
            columns.append((prefix + letter, column))

    if plan.robot.in_plane:
        columns += [("orientation", state.orientation), ("orientation_rate", state.orientation_rate)]
        add("com_", ("x", "y"), state.com_position)
    else:
        add("orientation_", QUATERNION, state.orientation)
        add("orientation_rate_", SPACE, state.orientation_rate)
        add("com_", SPACE, state.com_position)
    ratios = plan.robot.motor_ratios
    offsets = [plan.robot.coupled[name].offset if name in plan.robot.coupled else 0.0 for name in plan.robot.motors]
    of_motors = {
        "position": state.positions @ ratios.T + offsets,
        "velocity": state.velocities @ ratios.T,
        "acceleration": state.accelerations @ ratios.T,
        "torque": state.motor_torques,
    }
    for index, joint in enumerate(plan.robot.motors):
        columns += [(f"{joint}_{quantity}", values[:, index]) for quantity, values in of_motors.items()]
        if index < len(plan.robot.joints) and np.count_nonzero(ratios[:, index]) > 1:
            columns.append((f"{joint}_generalized_torque", state.torques[:, index]))
    return csv_text(columns)


@dataclass(frozen=True, eq=False)
class Column:
    """A quantity at all instants: name, unit, values (N,); whole numbers are counts, or 1 for true."""

    name: str
    unit: str
    values: Array | IntArray


def full_columns(motion: Exported, rate: float) -> list[Column]:
    """Return the columns: time, base, joints in Pinocchio's order, their gains and contacts where there are any.

    The world's axes are the root link's at orientation 0. ``base_x`` to ``base_qw`` are position and orientation of the
    root link, ``base_vx`` to ``base_wz`` its velocities, all in the world. A joint's torque is its motor's own.
    ``phase`` counts from 0; ``POINT_contact`` is 1 where the point stands, and ``POINT_fx`` to ``POINT_fz`` are the
    force on it, in the world; at a change of contacts all are those before it.
    """
    times = sample_times(motion.duration, rate)
    whole = motion.at(times)
    tree = motion.robot.joint_tree
    columns = [Column("time", "s", times)]
    for prefix, unit, letters, values in (
        ("base_", "m", SPACE, whole.base_position),
        ("base_", "1", QUATERNION, whole.base_quaternion),
        ("base_v", "m/s", SPACE, whole.base_velocity),
        ("base_w", "rad/s", SPACE, whole.base_angular_velocity),
    ):
        columns += [Column(prefix + letter, unit, column) for letter, column in zip(letters, values.T, strict=True)]
    for index, joint in enumerate(motion.joints):
        angle, torque = ("rad", "N m") if tree.joint[joint].turns else ("m", "N")
        columns += [
            Column(f"{joint}_position", angle, whole.positions[:, index]),
            Column(f"{joint}_velocity", f"{angle}/s", whole.velocities[:, index]),
            Column(f"{joint}_acceleration", f"{angle}/s^2", whole.accelerations[:, index]),
            Column(f"{joint}_torque", torque, whole.motor_torques[:, index]),
        ]
        if motion.gains is not None:
            units = f"{torque}/{angle}", f"{torque} s/{angle}"
            for name, unit, gain in zip(("kp", "kd"), units, motion.gains[:, index], strict=True):
                columns.append(Column(f"{joint}_{name}", unit, np.full(len(times), gain)))
    return columns + contact_columns(motion, times)


def contact_columns(motion: Exported, times: Array) -> list[Column]:
    """Return the columns of contacts at times (N,), s; none of a motion without phases."""
    contacts = motion.contacts(times)
    if not contacts:
        return []
    columns = [Column("phase", "1", contacts["phase"])]
    for index, point in enumerate(contacts["contact_names"]):
        columns.append(Column(f"{point}_contact", "1", contacts["contacts"][:, index].astype(np.int64)))
        forces = contacts["forces"][:, index].T
        columns += [Column(f"{point}_f{letter}", "N", force) for letter, force in zip(SPACE, forces, strict=True)]
    return columns


def full_csv(motion: Exported, rate: float) -> str:
    """Return the columns of :func:`full_columns` as CSV, numbers that read back bit for bit."""
    return csv_text([(column.name, column.values) for column in full_columns(motion, rate)])


def parquet_content(motion: Exported, rate: float) -> bytes:
    """Return the columns of :func:`full_columns` as Parquet; each has its unit in its metadata.

    The file's metadata has ``problem``, ``robot``, ``duration``, ``gravity`` (x y z), of a plan ``angular_momentum``,
    and of a jump ``phases`` as JSON.

    Raises
    ------
    InputError
        PyArrow is not installed.
    """
    arrow = import_optional("pyarrow", name="PyArrow", element="format", extra="parquet")
    parquet = import_optional("pyarrow.parquet", name="PyArrow", element="format", extra="parquet")
    columns = full_columns(motion, rate)
    arrays = []
    fields = []
    for column in columns:
        array = arrow.array(column.values)
        arrays.append(array)
        fields.append(arrow.field(column.name, array.type, False, {"unit": column.unit}))
    table = arrow.table(arrays, schema=arrow.schema(fields, motion.about))
    stream = io.BytesIO()
    parquet.write_table(table, stream)
    return stream.getvalue()


def number_rows(values: Array) -> str:
    """Rows (N, M) of numbers that read back bit for bit, between commas."""
    return "".join(",".join(map(repr, row)) + "\n" for row in values.tolist())


def archive(arrays: Mapping[str, Any]) -> bytes:
    """NumPy's archive of arrays by name, the same bytes whenever it is written."""
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def csv_text(columns: Sequence[tuple[str, Array | IntArray]]) -> str:
    """CSV of columns (N,) under their names, of which no spreadsheet takes one, from a URDF, for a formula."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(f"'{name}" if name.startswith(("=", "+", "-", "@")) else name for name, _ in columns)
    writer.writerows(zip(*(values.tolist() for _, values in columns), strict=True))
    return text.getvalue()
