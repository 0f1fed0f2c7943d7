"""Forward dynamics with MuJoCo: an engine that shares no code with Pinocchio."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.proof.forward import Torques
from floatplan.proof.held_model import BASE
from floatplan.proof.mujoco_model import import_mujoco


def whole_step(duration: float, step: float, panels: int) -> float:
    """Return the longest step up to ``step`` that divides each of ``panels`` equal parts of a duration, s."""
    return duration / (panels * math.ceil(duration / (panels * step) - 1e-9))


def fly_mujoco(
    model: Any, order: list[int], torques: Torques, takeoff: tuple[Array, Array], times: Array
) -> tuple[Array, Array]:
    """Integrate with MuJoCo's Runge-Kutta method of fourth order; as :func:`floatplan.proof.forward.fly`.

    Parameters
    ----------
    model : mujoco.MjModel
        Its time step is to divide all ``times``.
    order : (3 + m) ints
        MuJoCo's coordinate of each of the robot's.
    """
    mujoco = import_mujoco()
    data = mujoco.MjData(model)
    data.qpos[order], data.qvel[order] = takeoff

    def push(_: Any, now: Any) -> None:
        """MuJoCo calls this at every stage of a step, with the stage's time and state."""
        now.qfrc_applied[order[BASE:]] = torques(now.time, now.qpos[order], now.qvel[order])

    positions, velocities = [], []
    mujoco.set_mjcb_control(push)
    try:
        for time in times:
            steps = round((time - data.time) / model.opt.timestep)
            mujoco.mj_step(model, data, nstep=steps)
            positions.append(data.qpos[order].copy())
            velocities.append(data.qvel[order].copy())
    finally:
        mujoco.set_mjcb_control(None)
    return np.array(positions), np.array(velocities)
