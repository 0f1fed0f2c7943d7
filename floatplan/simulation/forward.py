"""Forward dynamics with Pinocchio's articulated-body algorithm, integrated far more finely than anything it checks."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

from floatplan.arrays import Array
from floatplan.errors import FloatplanError
from floatplan.robot.planar.model import BASE_COORDINATES

Torques: TypeAlias = Callable[[float, Array, Array], Array]  # time, positions, velocities (3 + m,) -> (m,)

TIGHT = 1e-12  # [-] per step; open loop, errors grow with the motion: 10-fold in a flight, 1e12-fold with 20 links
MOST_EVALUATIONS = 40_000  # [-] of the dynamics; flights of real robots take up to 2000
LOOSE = 1e-8  # [-] where what is flown was disturbed by far more


def fly_pinocchio(
    model: Any, torques: Torques, takeoff: tuple[Array, Array], times: Array, tolerance: float = TIGHT
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
    data = model.createData()
    forces = np.zeros(model.nv)
    evaluations = count()

    def rate(time: float, state: Array) -> Array:
        if next(evaluations) == MOST_EVALUATIONS or not np.isfinite(state).all():
            raise FloatplanError(
                f"the replay was stopped {time:.3g} s after takeoff: motion or feedback is too fast to be integrated"
            )
        positions, velocities = state[: model.nv], state[model.nv :]
        forces[BASE_COORDINATES:] = torques(time, positions, velocities)
        return np.concatenate((velocities, pin.aba(model, data, positions, velocities, forces)))

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
