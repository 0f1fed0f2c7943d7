"""Forward dynamics with MuJoCo: an engine independent of Pinocchio."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.robot.planar.model import BASE_COORDINATES
from floatplan.simulation.forward import Torques
from floatplan.simulation.mujoco_model import import_mujoco

MOST_STEPS = 100_000  # [-] of a flight
CLASSICAL = np.array([1, 2, 2, 1]) / 6  # [-] weights of the stages


def whole_step(duration: float, step: float, panels: int) -> float:
    """Return the longest step up to ``step`` that divides each of ``panels`` equal parts of a duration, s."""
    return duration / (panels * max(1, math.ceil(duration / (panels * step) - 1e-9)))


def fly_mujoco(
    model: Any, order: list[int], torques: Torques, takeoff: tuple[Array, Array], times: Array
) -> tuple[Array, Array]:
    """Integrate MuJoCo's accelerations at fixed steps; as :func:`floatplan.simulation.forward.fly_pinocchio`.

    By the Runge-Kutta method of fourth order that MuJoCo has too. Its own takes torques from a callback that is one for
    all threads of the process.

    Parameters
    ----------
    model : mujoco.MjModel
        Its time step is to divide all ``times``.
    order : (3 + m) ints
        MuJoCo's coordinate of each of the robot's.
    """
    mujoco = import_mujoco()
    data = mujoco.MjData(model)
    positions, velocities, accelerations, forces = data.qpos, data.qvel, data.qacc, data.qfrc_applied  # views
    coordinates = np.array(order)
    joints = coordinates[BASE_COORDINATES:]

    def rate(time: float, state: Array, out: Array) -> None:
        """Velocities and accelerations (2, 3 + m) from positions and velocities."""
        positions[coordinates], velocities[coordinates] = state
        forces[joints] = torques(time, state[0], state[1])
        mujoco.mj_forward(model, data)
        out[0], out[1] = state[1], accelerations[coordinates]

    step, state, done = model.opt.timestep, np.stack(takeoff), 0
    flown = []
    for steps in np.rint(times / step).astype(int).tolist():
        for number in range(done, steps):
            state = _stepped(rate, number, state, step)
        done = steps
        flown.append(state)
    return np.array(flown)[:, 0], np.array(flown)[:, 1]


def _stepped(rate: Callable[[float, Array, Array], None], number: int, state: Array, step: float) -> Array:
    """One step of the classical Runge-Kutta method; the next one begins at the very time at which this one ends."""
    start, middle, end = number * step, (number + 0.5) * step, (number + 1) * step
    rates = np.empty((4, *state.shape))
    rate(start, state, rates[0])
    rate(middle, state + step / 2 * rates[0], rates[1])
    rate(middle, state + step / 2 * rates[1], rates[2])
    rate(end, state + step * rates[2], rates[3])
    return np.asarray(state + step * (CLASSICAL @ rates.reshape(4, -1)).reshape(state.shape))
