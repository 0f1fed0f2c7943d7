"""Integration of forward dynamics: finely by a method of order 8, or at fixed steps by the classical one of order 4.

A replay is integrated far more finely than anything that it checks, but for MuJoCo's of plans in a plane. Those, in the
plane and on a free base, and control loops, whose torques are constant in a period, take fixed steps.
"""

import math
from collections.abc import Callable
from itertools import count
from typing import TypeAlias

import numpy as np

from floatplan.arrays import Array
from floatplan.errors import FloatplanError

State: TypeAlias = tuple[Array, Array]  # configuration q, velocity v
Dynamics: TypeAlias = Callable[[float, Array, Array], Array]  # time, q, v -> acceleration
Moved: TypeAlias = Callable[[Array, Array, float], Array]  # q, v, duration -> q
Rate: TypeAlias = Callable[[Array, Array], Array]  # q, v -> derivative of q by time

TIGHT = 1e-12  # [-] error of a step; open loop, errors grow with the motion: 10-fold in a flight, 1e12 with 20 links
LOOSE = 1e-8  # [-] where the robot was perturbed by far more
MOST_EVALUATIONS = 40_000  # [-] of the dynamics; flights of real robots take up to 2000
MOST_STEPS = 100_000  # [-] of a flight, where steps are fixed


def fly_finely(dynamics: Dynamics, rate: Rate, takeoff: State, times: Array, tolerance: float) -> list[State]:
    """Integrate by a Runge-Kutta method of order 8 and return the states at times.

    Parameters
    ----------
    dynamics, rate : accelerations, and derivatives of configurations
    takeoff : the state at time zero
    times : (N,) s, rising; the last is the end
    tolerance : float
        Of a step's error, relative; a tenth of it absolute, in m, rad, m/s, rad/s.

    Raises
    ------
    FloatplanError
        The motion cannot be integrated to its end, or not within ``MOST_EVALUATIONS``.
    """
    from scipy.integrate import solve_ivp  # here, because what only reads gains does without

    evaluations = count()
    size = len(takeoff[0])

    def state_rate(time: float, state: Array) -> Array:
        if next(evaluations) == MOST_EVALUATIONS or not np.isfinite(state).all():
            raise FloatplanError(
                f"the replay was stopped {time:.3g} s after takeoff: motion or feedback is too fast to be integrated"
            )
        q = state[:size]
        v = state[size:]
        return np.concatenate((rate(q, v), dynamics(time, q, v)))

    result = solve_ivp(
        state_rate,
        (0.0, float(times[-1])),
        np.concatenate(takeoff),
        method="DOP853",
        t_eval=times,
        rtol=tolerance,
        atol=0.1 * tolerance,
    )
    if result.status != 0:
        raise FloatplanError(f"the replay stopped before the end of the flight: {result.message}")
    return [(state[:size], state[size:]) for state in result.y.T]


def fly_in_steps(dynamics: Dynamics, moved: Moved, takeoff: State, times: Array, step: float) -> list[State]:
    """Integrate at fixed steps, s, which divide all ``times`` (N,), and return the states at these."""
    state = takeoff
    states = []
    done = 0
    for steps in np.rint(times / step).astype(int).tolist():
        for number in range(done, steps):
            state = runge_kutta_step(dynamics, moved, state, number * step, (number + 1) * step)
        done = steps
        states.append(state)
    return states


def whole_step(duration: float, step: float, parts: int) -> float:
    """Return the longest step up to ``step`` that divides each of so many equal parts of a duration, s."""
    return duration / (parts * max(1, math.ceil(duration / (parts * step) - 1e-9)))


def runge_kutta_step(dynamics: Dynamics, moved: Moved, state: State, begin: float, end: float) -> State:
    """One step of the classical Runge-Kutta method; the next one begins at the very time at which this one ends.

    Configurations move by ``moved``: along the geodesic where the base rotates in space.
    """
    q, v = state
    duration = end - begin
    half = duration / 2
    middle = begin + half
    a1 = dynamics(begin, q, v)
    v2 = v + half * a1
    a2 = dynamics(middle, moved(q, v, half), v2)
    v3 = v + half * a2
    a3 = dynamics(middle, moved(q, v2, half), v3)
    v4 = v + duration * a3
    a4 = dynamics(end, moved(q, v3, duration), v4)
    return moved(q, (v + 2 * (v2 + v3) + v4) / 6, duration), v + duration / 6 * (a1 + 2 * (a2 + a3) + a4)
