"""What curves are drawn from: a plan's quantities at the instants of a grid, in a plane and in space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeGuard, cast

import numpy as np
from scipy.spatial.transform import Rotation

from floatplan.arrays import Array
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.motion.dynamics import FlightState
from floatplan.plans.plan import Plan
from floatplan.plans.trajectory import Trajectory
from floatplan.problem.problem import Problem
from floatplan.tables import JOINT_LIMITS
from floatplan.view.jumps import jump_columns

LEAST_MOMENTUM = 1e-12  # [-] of what the base has: below it h counts as none


@dataclass(frozen=True, eq=False)
class SampledPlan:
    """A plan or jump, its states at the instants of the curves, and the sampled quantities (N,) by key, SI.

    Those of joint, motor or obstacle i end in ``.i``. A jump has those of
    :func:`floatplan.view.jumps.jump_columns` too.
    """

    plan: Trajectory
    state: FlightState
    columns: dict[str, Array]

    @classmethod
    def of(cls, plan: Trajectory, times: Array, beside: Trajectory | None = None) -> SampledPlan:
        """Sample a plan at times (N,), s; with the obstacles and in the order of motors of a plan ``beside``."""
        state = plan.state(times)
        beside = beside or plan
        columns = _columns_in_space(plan, state) if flies_in_space(plan) else _columns_in_plane(plan, state)
        for name in ("positions", *(row.quantity for row in JOINT_LIMITS)):
            columns |= {f"{name}.{index}": column for index, column in enumerate(getattr(state, name).T)}
        torques = dict(zip(plan.robot.motors, state.motor_torques.T, strict=True))
        motors = enumerate(beside.robot.motors)
        columns |= {f"motor_torques.{index}": torques[name] for index, name in motors if name in torques}
        for index, obstacle in enumerate(beside.whole_problem.obstacles):
            columns[f"clearance.{index}"] = plan.clearances(times, [obstacle])
        if isinstance(plan, JumpMotion):
            columns |= jump_columns(plan, state)
        return cls(plan, state, columns)

    @property
    def times(self) -> Array:
        """Instants (N,) of the curves, s."""
        return self.state.times


def _columns_in_plane(plan: Trajectory, state: FlightState) -> dict[str, Array]:
    inertia = plan.dynamics.momentum_map(state.positions)
    of_base = inertia[:, 0] * state.orientation_rate
    columns = {
        "orientation": state.orientation,
        **{row.base: getattr(state, row.base) for row in JOINT_LIMITS if row.base},
        "com_x": state.com_position[:, 0],
        "com_y": state.com_position[:, 1],
        "momentum_base": of_base,
        "momentum_joints": state.angular_momentum - of_base,
        "angular_momentum": state.angular_momentum,
    }
    return columns | {f"inertia.{index}": column for index, column in enumerate(inertia.T)}


def flies_in_space(plan: Trajectory) -> TypeGuard[Plan]:
    """Whether a robot flies in space."""
    return isinstance(plan, Plan) and plan.robot.in_plane is None


def attitude_axes(problem: Problem) -> tuple[str, tuple[str, str, str]]:
    """Axes about which the base's angles are told, those of the goal or the start, and names of turns about them."""
    for state in (problem.final, problem.initial):
        if state.attitude is not None and state.attitude.axes is not None:
            return state.attitude.axes, ("somersault", "tilt", "twist")
    return "zyx", ("yaw", "pitch", "roll")


def limits_in_use(plan: Plan) -> dict[str, Array]:
    """Limits (m,) of the motors' torques and rates, asked for or the file's; infinite where there are none."""
    rows = {use.joint: use for use in plan.utilisation}
    found = {}
    for key in ("torque", "velocity"):
        limits = [getattr(rows[name], f"{key}_limit") for name in plan.robot.motors]
        found[key] = np.array([np.inf if limit is None else limit for limit in limits])
    return found


def _columns_in_space(plan: Plan, state: FlightState) -> dict[str, Array]:
    """Places and vectors end in x, y, z; moments of inertia rise."""
    inertia, _ = plan.dynamics.momentum_maps(state.positions)
    turned = Rotation.from_quat(state.orientation)
    of_base = turned.apply(np.einsum("kab,kb->ka", inertia, state.orientation_rate))
    h = np.asarray(plan.angular_momentum)
    if (
        np.linalg.norm(h) <= LEAST_MOMENTUM * np.linalg.norm(of_base, axis=1).max()
    ):  # then along what the base turns about
        h = (turned[-1] * turned[0].inv()).as_rotvec()
    along = h / (np.linalg.norm(h) or 1.0)
    axes = attitude_axes(plan.problem)[0]
    whole = cast("Any", plan.whole)
    limits = limits_in_use(plan)
    rates = state.velocities @ plan.robot.motor_ratios.T
    columns = {
        "orientation_rate": np.linalg.norm(state.orientation_rate, axis=1),
        "momentum_base": of_base @ along,
        "momentum": state.angular_momentum @ along,
    }
    columns["momentum_joints"] = columns["momentum"] - columns["momentum_base"]
    vectors = {
        "com_": state.com_position,
        "base_": state.base_position,
        "angular_momentum_": state.angular_momentum,
    }
    for name, values in vectors.items():
        columns |= {f"{name}{axis}": column for axis, column in zip("xyz", values.T, strict=True)}
    rows = {
        "orientation": whole.angles_at(axes, state.times),
        "quaternion": state.orientation,
        "inertia": np.linalg.eigvalsh(inertia),
        "torque_use": state.motor_torques / limits["torque"],
        "rate_use": rates / limits["velocity"],
    }
    return columns | {f"{name}.{index}": column for name, of in rows.items() for index, column in enumerate(of.T)}
