"""``trajectory.csv``: a plan sampled in time, for controllers and other programs."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import InputError
from floatplan.motion_plan import Plan
from floatplan.plan_record import write_whole

MOST_ROWS = 10_000_000


def sample_times(duration: float, rate: float) -> Array:
    """Instants 0, 1/rate, 2/rate, ... before the end, and the end itself, s.

    Raises
    ------
    InputError
        The rate is not a positive number, or gives more than ten million instants.
    """
    if not (rate > 0 and math.isfinite(rate)):
        raise InputError(f"{rate} Hz is not a positive number", element="rate")
    if duration * rate > MOST_ROWS:
        raise InputError(f"{rate} Hz for {duration} s are more than {MOST_ROWS} rows", element="rate")
    steps = math.ceil(duration * rate * (1 - 1e-12))
    return np.append(np.arange(steps) / rate, duration)


def write_trajectory(plan: Plan, path: str | Path, rate: float = 1000.0) -> Path:
    """Write the plan as CSV: one row per instant, numbers that read back bit for bit.

    Columns: time, orientation, orientation_rate, com_x, com_y (horizontal, vertical), then per joint its position,
    velocity, acceleration and torque; SI units and radians.

    Parameters
    ----------
    plan : Plan
    path : path
    rate : float
        Rows per second, Hz; the end of the flight is always a row.
    """
    times = sample_times(plan.duration, rate)
    state = plan.at(times)
    header = ["time", "orientation", "orientation_rate", "com_x", "com_y"]
    columns = [times, state.orientation, state.orientation_rate, *state.com_position.T]
    of_joints = {
        "position": state.positions,
        "velocity": state.velocities,
        "acceleration": state.accelerations,
        "torque": state.torques,
    }
    for index, joint in enumerate(plan.robot.joints):
        header += [f"{joint}_{quantity}" for quantity in of_joints]
        columns += [values[:, index] for values in of_joints.values()]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(np.column_stack(columns).tolist())
    return write_whole(path, text.getvalue())
