"""The samples of curves: a plan's quantities at the instants of a grid, in a plane and in space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from floatplan.arrays import Array
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.motion.dynamics import FlightState
from floatplan.motion.spatial.rotations import of_quaternions, unwrapped_angles
from floatplan.plans.plan import Plan
from floatplan.plans.trajectory import Trajectory
from floatplan.problem.attitude import required
from floatplan.problem.problem import Problem
from floatplan.tables import JOINT_LIMITS
from floatplan.view.jumps import add_columns, flies_in_space, jump_columns


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
    def of(cls, plan: Trajectory, times: Array, reference: Trajectory | None = None) -> SampledPlan:
        """Sample a plan at times (N,), s; with the obstacles and the order of motors of a ``reference`` or its own."""
        state = plan.state(times)
        reference = reference or plan
        if not flies_in_space(plan):
            columns = _columns_in_plane(plan, state)
        else:
            columns = _columns_in_space(plan, state)
            if isinstance(plan, Plan):
                columns |= _columns_of_flight(plan, state)
        add_columns(columns, "positions", state.positions)
        for row in JOINT_LIMITS:
            add_columns(columns, row.quantity, getattr(state, row.quantity))
        torques = dict(zip(plan.robot.motors, state.motor_torques.T, strict=True))
        for index, name in enumerate(reference.robot.motors):
            if name in torques:
                columns[f"motor_torques.{index}"] = torques[name]
        for index, obstacle in enumerate(reference.whole_problem.obstacles):
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
    columns = {"orientation": state.orientation}
    for row in JOINT_LIMITS:
        if row.base:
            columns[row.base] = getattr(state, row.base)
    columns |= {
        "com_x": state.com_position[:, 0],
        "com_y": state.com_position[:, 1],
        "momentum_base": of_base,
        "momentum_joints": state.angular_momentum - of_base,
        "angular_momentum": state.angular_momentum,
    }
    add_columns(columns, "inertia", inertia)
    return columns


def attitude_axes(problem: Problem) -> tuple[str, tuple[str, ...]]:
    """Axes of the base's angles, those of the goal or the start, and names of the rotations about them.

    Of jumps, whose x is forwards, they are roll, pitch and yaw; else those of the body in flight.
    """
    for state in (problem.final, problem.initial):
        if state.attitude is not None and state.attitude.axes is not None:
            axes = state.attitude.axes
            if problem.jump is None:
                return axes, ("somersault", "tilt", "twist")
            names = {"x": "roll", "y": "pitch", "z": "yaw"}  # of what stands with x forwards and z up
            return axes, tuple(names[axis] for axis in axes)
    return "zyx", ("yaw", "pitch", "roll")


def limits_in_use(plan: Plan) -> dict[str, Array]:
    """Limits (m,) of the motors' torques and rates, of the problem or the file; infinite where there are none."""
    rows = {use.joint: use for use in plan.utilisation}
    result = {}
    for key in ("torque", "velocity"):
        limits = [getattr(rows[name], f"{key}_limit") for name in plan.robot.motors]
        result[key] = np.array(limits, dtype=np.float64)  # None becomes NaN
        result[key][np.isnan(result[key])] = np.inf
    return result


def _columns_in_space(plan: Trajectory, state: FlightState) -> dict[str, Array]:
    """Positions, attitude and angles of the base; columns of positions and vectors end in x, y, z."""
    columns = {"orientation_rate": np.linalg.norm(state.orientation_rate, axis=1)}
    vectors = {
        "com_": state.com_position,
        "base_": state.base_position,
        "angular_momentum_": state.angular_momentum,
    }
    for name, values in vectors.items():
        for axis, column in zip("xyz", values.T, strict=True):
            columns[name + axis] = column
    add_columns(columns, "orientation", _angles(plan, state))
    add_columns(columns, "quaternion", state.orientation)
    return columns


def _angles(plan: Trajectory, state: FlightState) -> Array:
    """Angles (N, 3), rad, of the base, with whole turns, from those requested at the beginning."""
    axes = attitude_axes(plan.whole_problem)[0]
    if isinstance(plan, Plan):
        whole: Any = plan.whole
        return np.asarray(whole.angles_at(axes, state.times))
    angles = unwrapped_angles(axes, of_quaternions(state.orientation))
    requested = required(plan.whole_problem.initial.attitude).angles_about(axes)
    turns = np.rint((requested - angles[0]) / (2 * np.pi))
    return np.asarray(angles + 2 * np.pi * turns * [1, 0, 1])


def _columns_of_flight(plan: Plan, state: FlightState) -> dict[str, Array]:
    """Angular momentum of base and joints along h, moments of inertia, which rise, and shares of limits."""
    inertia, _ = plan.dynamics.momentum_maps(state.positions)
    rotation = Rotation.from_quat(state.orientation)
    of_base = rotation.apply(np.einsum("kab,kb->ka", inertia, state.orientation_rate))
    h = np.asarray(plan.angular_momentum)
    if np.linalg.norm(h) <= 1e-12 * np.linalg.norm(of_base, axis=1).max():  # h is 0 but for rounding
        h = (rotation[-1] * rotation[0].inv()).as_rotvec()  # the axis of the base's whole rotation takes its role
    along = h / (np.linalg.norm(h) or 1.0)
    limits = limits_in_use(plan)
    rates = state.velocities @ plan.robot.motor_ratios.T
    columns = {"momentum_base": of_base @ along, "momentum": state.angular_momentum @ along}
    columns["momentum_joints"] = columns["momentum"] - columns["momentum_base"]
    rows = {
        "inertia": np.linalg.eigvalsh(inertia),
        "torque_use": state.motor_torques / limits["torque"],
        "rate_use": rates / limits["velocity"],
    }
    for name, table in rows.items():
        add_columns(columns, name, table)
    return columns
