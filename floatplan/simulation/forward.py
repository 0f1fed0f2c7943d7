"""Forward dynamics: Pinocchio's articulated-body algorithm or MuJoCo's accelerations, integrated.

Open loop, a replay with Pinocchio is integrated far more finely than anything it checks. MuJoCo, flights in space and
control loops, whose torques are held for a period, take the fixed steps of the classical Runge-Kutta method.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import count
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

from floatplan.arrays import Array
from floatplan.errors import FloatplanError
from floatplan.robot.planar.model import BASE_COORDINATES
from floatplan.simulation.mujoco_model import import_mujoco

State: TypeAlias = tuple[Array, Array]  # positions, velocities (3 + m,)
Torques: TypeAlias = Callable[[float, Array, Array], Array]  # time, positions, velocities (3 + m,) -> (m,)
Accelerations: TypeAlias = Callable[[Array, Array, Array], Array]  # positions, velocities, forces (3 + m,) -> (3 + m,)
Moved: TypeAlias = Callable[[Array, Array, float], Array]  # positions, velocities, duration -> positions

TIGHT = 1e-12  # [-] per step; open loop, errors grow with the motion: 10-fold in a flight, 1e12-fold with 20 links
LOOSE = 1e-8  # [-] where what is flown was perturbed by far more
MOST_EVALUATIONS = 40_000  # [-] of the dynamics; flights of real robots take up to 2000
MOST_STEPS = 100_000  # [-] of a flight, where steps are fixed


def fly_pinocchio(
    model: Any, torques: Torques, takeoff: State, times: Array, tolerance: float = TIGHT
) -> tuple[Array, Array]:
    """Integrate ``q'' = ABA(q, q', (0, torques))`` and return positions and velocities at times, (N, 3 + m) each.

    Parameters
    ----------
    model : pinocchio.Model
        With nq = nv = 3 + m, and gravity.
    torques : callable
    takeoff : positions, velocities (3 + m,) at time zero
    times : (N,) s, rising; the last is the end
    tolerance : float
        Of a step's error, relative; a tenth of it absolute, in m, rad, m/s, rad/s.

    Raises
    ------
    FloatplanError
        The motion cannot be integrated to its end, or not within ``MOST_EVALUATIONS``.
    """
    accelerations = pinocchio_accelerations(model)
    forces = np.zeros(model.nv)
    evaluations = count()

    def rate(time: float, state: Array) -> Array:
        if next(evaluations) == MOST_EVALUATIONS or not np.isfinite(state).all():
            raise FloatplanError(
                f"the replay was stopped {time:.3g} s after takeoff: motion or feedback is too fast to be integrated"
            )
        positions, velocities = state[: model.nv], state[model.nv :]
        forces[BASE_COORDINATES:] = torques(time, positions, velocities)
        return np.concatenate((velocities, accelerations(positions, velocities, forces)))

    flown = solve_ivp(
        rate,
        (0.0, float(times[-1])),
        np.concatenate(takeoff),
        method="DOP853",
        t_eval=times,
        rtol=tolerance,
        atol=0.1 * tolerance,
    )
    if flown.status != 0:
        raise FloatplanError(f"the replay stopped before the end of the flight: {flown.message}")
    return flown.y.T[:, : model.nv], flown.y.T[:, model.nv :]


def fly_in_steps(
    accelerations: Accelerations, torques: Torques, takeoff: State, times: Array, step: float
) -> tuple[Array, Array]:
    """Integrate accelerations at fixed steps, which divide all ``times``; as :func:`fly_pinocchio`."""
    forces = np.zeros_like(takeoff[1])

    def under_torques(time: float, positions: Array, velocities: Array) -> Array:
        forces[BASE_COORDINATES:] = torques(time, positions, velocities)
        return accelerations(positions, velocities, forces)

    state, done, flown = takeoff, 0, []
    for steps in np.rint(times / step).astype(int).tolist():
        for number in range(done, steps):
            state = runge_kutta_step(under_torques, state, number * step, (number + 1) * step)
        done = steps
        flown.append(state)
    return np.array(flown)[:, 0], np.array(flown)[:, 1]


def whole_step(duration: float, step: float, panels: int) -> float:
    """Return the longest step up to ``step`` that divides each of ``panels`` equal parts of a duration, s."""
    return duration / (panels * max(1, math.ceil(duration / (panels * step) - 1e-9)))


def _straight(positions: Array, velocities: Array, duration: float) -> Array:
    return np.asarray(positions + duration * velocities)


def runge_kutta_step(
    acceleration: Callable[[float, Array, Array], Array],
    state: State,
    begin: float,
    end: float,
    moved: Moved = _straight,
) -> State:
    """One step of the classical Runge-Kutta method; the next one begins at the very time at which this one ends.

    Parameters
    ----------
    acceleration : of a time, s, positions and velocities
    state : positions, velocities
    begin, end : s
    moved : positions after a duration at given velocities: along the geodesic where the base turns in space
    """
    q, v = state
    duration = end - begin
    half, middle = duration / 2, begin + duration / 2
    a1 = acceleration(begin, q, v)
    v2 = v + half * a1
    a2 = acceleration(middle, moved(q, v, half), v2)
    v3 = v + half * a2
    a3 = acceleration(middle, moved(q, v2, half), v3)
    v4 = v + duration * a3
    a4 = acceleration(end, moved(q, v3, duration), v4)
    return moved(q, (v + 2 * (v2 + v3) + v4) / 6, duration), v + duration / 6 * (a1 + 2 * (a2 + a3) + a4)


def pinocchio_accelerations(model: Any) -> Accelerations:
    """Accelerations by the articulated-body algorithm."""
    data = model.createData()
    return lambda q, v, forces: pin.aba(model, data, q, v, forces).copy()


def mujoco_accelerations(model: Any, order: list[int]) -> Accelerations:
    """Accelerations by MuJoCo; ``order`` (3 + m) is its coordinate of each of the robot's.

    MuJoCo's own integrator takes torques from a callback that is one for all threads of the process.
    """
    mujoco = import_mujoco()
    data = mujoco.MjData(model)
    coordinates = np.array(order)

    def accelerations(q: Array, v: Array, forces: Array) -> Array:
        data.qpos[coordinates], data.qvel[coordinates], data.qfrc_applied[coordinates] = q, v, forces
        mujoco.mj_forward(model, data)
        return np.array(data.qacc[coordinates])

    return accelerations
