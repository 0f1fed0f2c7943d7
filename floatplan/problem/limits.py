"""What a problem's limits bound, in one place for the search and for corrections in flight."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from floatplan.arrays import Array
from floatplan.problem.problem import Problem
from floatplan.tables import JOINT_LIMITS, LIMIT_TABLE, LimitKey


@dataclass(frozen=True, eq=False)
class Shares:
    """Limits (r,) of a key, in a unit, and what is used of them: the magnitudes of two sums of quantities, together.

    ``used, also`` : weights (r, m) of quantities by their names; their sums are 1 where the whole of a limit is used
    """

    key: LimitKey
    labels: tuple[str, ...]
    limit: Array
    unit: str
    used: Mapping[str, Array]
    also: Mapping[str, Array] = field(default_factory=dict)


def shares_of_limits(problem: Problem, tangent: int = 1) -> Iterator[Shares]:
    """Yield what a problem's limits bound of motions whose base turns in so many directions.

    They are those of the motors' own torques, of generalised ones where these do not imply them, of the joints' rates
    and accelerations, of motors that are weaker when they turn, and of the base's rate.
    """
    robot, own = problem.robot, problem.motor_torque_limits
    implied = ((robot.motor_ratios == 0) | np.isfinite(own)[:, None]).all(axis=0)
    generalized = np.where(implied, np.inf, problem.torque_limits)
    of_motors, of_joints = (robot.motors, np.eye(len(robot.motors))), (robot.joints, np.eye(len(robot.joints)))
    kinds: list[tuple[LimitKey, str, Array, tuple[Sequence[str], Array], Array | None]] = [
        ("torque", "torque", own, of_motors, None),
        ("torque", "generalized torque", generalized, (robot.joints, robot.motor_ratios.T), None),
        *((row.key, row.key, problem.joint_limits[row.key], of_joints, None) for row in JOINT_LIMITS),
        ("torque", "speed-dependent torque", problem.motor_stall, of_motors, problem.motor_slope),
    ]
    for key, what, limits, (subjects, rows), slope in kinds:
        limited = np.flatnonzero(np.isfinite(limits))
        if limited.size:
            row, limit = LIMIT_TABLE[key], limits[limited]
            names = tuple(f"{what} of {subjects[i]}" for i in limited.tolist())
            also = (
                {} if slope is None else {"velocities": (slope[limited] / limit)[:, None] * robot.motor_ratios[limited]}
            )
            yield Shares(key, names, limit, row.unit, {row.quantity: rows[limited] / limit[:, None]}, also)
    if problem.limits.orientation_rate is not None:
        row, limit = LIMIT_TABLE["orientation_rate"], np.full(tangent, problem.limits.orientation_rate)
        used = {row.quantity: np.eye(tangent) / limit[:, None]}
        yield Shares(row.key, ("orientation rate",) * tangent, limit, row.unit, used)
