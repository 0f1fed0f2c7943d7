"""How much corrections can do: the errors of momentum and of inertia from which the landing is still reached."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.arguments import FINITE, Outlined
from floatplan.arrays import Array, read_only
from floatplan.files import plain
from floatplan.inflight.estimate import Estimate, adapted
from floatplan.inflight.remaining_motion import Rewriting
from floatplan.inflight.replanner import REACHED, Replanner
from floatplan.inflight.update import Update
from floatplan.motion.quadrature import gauss_legendre
from floatplan.plans.plan import Plan, given_plan
from floatplan.pool import one_thread

SHARES = (0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9)  # [-] of the flight, when corrections begin
LARGEST = 0.5  # [-] error that is tried
STEP = 0.01  # [-] from error to error that is tried, from zero outwards
RESOLUTION = 0.001  # [-] of an interval's ends
RATE = 40  # [-] corrections per flight
ALLOWED = 0.01  # [-] by which a limit may be broken; of distances, of 0.1 m, beyond the margin
NODES = 6  # [-] of the quadrature from correction to correction


@dataclass(frozen=True, eq=False, repr=False)
class Authority(Outlined):
    """From which errors the landing is reached, by when corrections begin.

    Attributes
    ----------
    times : (K,) s since takeoff
        When corrections begin; before, the robot follows the plan.
    momentum, inertia : (K, 2)
        Relative errors between which it lands at the goal from all that were tried, and keeps the problem's limits: of
        the angular momentum, or of all inertia of the bodies but the base's. NaN where it does not land even without
        an error. At most ``largest`` is tried.
    largest : float
    reached : rad, the miss that counts as reached
    """

    times: Array
    momentum: Array
    inertia: Array
    largest: float
    reached: float

    def until(self, error: float) -> float | None:
        """Latest of ``times``, s, from which a momentum error of this size, either way, is still corrected."""
        size = abs(FINITE(error, "error"))
        enough = (self.momentum[:, 0] <= -size) & (self.momentum[:, 1] >= size)
        return float(self.times[enough].max()) if enough.any() else None

    def to_dict(self) -> dict[str, Any]:
        """Return what ``floatplan replay --authority --json`` prints."""
        facts: dict[str, Any] = plain({name: getattr(self, name) for name in self.__dataclass_fields__})
        return facts


@one_thread
def authority(plan: Plan | str | Path) -> Authority:
    """Return from which errors of momentum and of inertia corrections in flight reach the landing, and until when.

    The joints are taken to follow their reference exactly, and what is measured to be exact: no controller does better.
    The angular momentum has the error from takeoff on; corrections begin later. Errors are tried from zero outwards,
    0.01 apart, and between the last that lands and the first that does not the end is bisected to 0.001: an interval
    has no holes, but such as lie between two errors that were tried.

    Parameters
    ----------
    plan : Plan, or path of a plan file

    Raises
    ------
    InputError
        The plan reaches no goal, or has no angular momentum to be wrong.
    """
    plan = given_plan(plan)
    replanner = Replanner(plan, RATE / plan.duration)
    times = plan.duration * np.array(SHARES)

    real = Update(plan.robot.tree, replanner.views, Rewriting(plan), 1.0, 1.0)
    links = np.ones(len(plan.robot.tree.mass))
    links[0] = 0.0

    def with_momentum(error: float, begin: float) -> bool:
        return _lands(replanner, real, plan.angular_momentum * (1 + error), 0.0 * links, begin)

    def with_inertia(error: float, begin: float) -> bool:
        return _lands(replanner, real, plan.angular_momentum, error * links, begin)

    return Authority(
        read_only(times), _intervals(with_momentum, times), _intervals(with_inertia, times), LARGEST, REACHED
    )


def _intervals(lands: Callable[[float, float], bool], times: Array) -> Array:
    """Ends (K, 2) of the errors from which a flight lands; later ones are within earlier ones."""
    found = []
    reach = [LARGEST, LARGEST]
    for begin in times.tolist():
        if not lands(0.0, begin):
            found.append((np.nan, np.nan))
            continue
        reach = [_farthest(lands, sign, begin, most) for sign, most in zip((-1.0, 1.0), reach, strict=True)]
        found.append((-reach[0], reach[1]))
    return read_only(found)


def _farthest(lands: Callable[[float, float], bool], sign: float, begin: float, most: float) -> float:
    """Largest size up to ``most`` of an error of that sign from which, as from all smaller ones, a flight lands."""
    low = 0.0
    for high in [*np.arange(STEP, most, STEP).tolist(), most]:
        if not lands(sign * high, begin):
            break
        low = high
    else:
        return most
    while high - low > RESOLUTION:
        middle = (low + high) / 2
        low, high = (middle, high) if lands(sign * middle, begin) else (low, middle)
    return low


def _lands(replanner: Replanner, real: Update, momentum: float, errors: Array, begin: float) -> bool:
    """Whether a robot reaches the goal within all limits, corrected from ``begin`` on.

    It has a momentum, kg m^2/s, and relative ``errors`` of its links' masses and inertias; ``real`` says how it flies.
    """
    plan = replanner.plan
    replanner.reset()
    inertial = replanner.identification(momentum)
    inertial.state[2:] = np.tile(errors, 2)
    path, robot = plan.ballistics, adapted(plan.robot.tree, inertial.state[2:])
    real.begin(Estimate(0.0, inertial, path.position0, path.velocity0, path.gravity))
    time, step = 0.0, plan.duration / RATE
    quadrature = gauss_legendre(NODES)
    for number in range(RATE):
        following = (number + 1) * step
        if time >= begin - 1e-9 * plan.duration:
            positions, velocities, _ = replanner.motion.at(time)
            rate = float(robot.base_rate(positions, velocities, momentum)[0])
            replanner.update(time, inertial.orientation, rate, positions[0], velocities[0])
        if replanner.views.rows:
            real.predicted(replanner.rest(time))
            if not (real.row_values.T[real.times <= following] >= -ALLOWED).all():
                return False
        times = time + (following - time) * quadrature.nodes
        positions, velocities, _ = replanner.motion.at(times)
        rates = robot.base_rate(positions, velocities, momentum)
        inertial.state[0] += (following - time) * float(quadrature.weights @ rates)
        time = following
    return abs(inertial.orientation - plan.problem.final.orientation) <= REACHED
