"""How much corrections can do: the errors of momentum and of inertia with which the robot still lands at the goal."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.arguments import FINITE, Outlined
from floatplan.arrays import Array, read_only
from floatplan.files import json_value
from floatplan.inflight.estimate import Estimate
from floatplan.inflight.remaining_motion import Rewriting
from floatplan.inflight.replanner import REACHED, Replanner
from floatplan.inflight.update import Update
from floatplan.plans.plan import Plan, as_plan
from floatplan.pool import one_thread

SHARES = (0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9)  # [-] of the flight, when corrections begin
LARGEST = 0.5  # [-] error that is tried
STEP = 0.01  # [-] from error to error that is tried, from zero outwards
STEP_IN_SPACE = 0.05  # [-] the same: there are three momenta, and an update takes ten times as long
RESOLUTION = 0.001  # [-] of an interval's ends
CORRECTIONS = 40  # [-] per flight


@dataclass(frozen=True, eq=False, repr=False)
class Authority(Outlined):
    """From which errors the robot lands at the goal, by when corrections begin.

    Attributes
    ----------
    times : (K,) s since takeoff
        When corrections begin; before, the robot follows the plan.
    momentum, inertia : (K, 2), in space the former (K, 3, 2)
        Relative errors between which it lands at the goal from all that were tried, within the problem's limits: of
        the angular momentum, or of all inertia of the bodies but the base's. In space errors of the momentum are of
        each of its components in the world, x, y, z, relative to its length. NaN where it does not land even without
        an error. At most ``largest`` is tried.
    largest : float
    reached : rad, the miss of a landing that counts as at the goal
    """

    times: Array
    momentum: Array
    inertia: Array
    largest: float
    reached: float

    def until(self, error: float) -> float | None:
        """Latest of ``times``, s, from which a momentum error of this size, either way, is still corrected.

        In space, of any of the components.
        """
        size = abs(FINITE(error, "error"))
        enough = (self.momentum[..., 0] <= -size) & (self.momentum[..., 1] >= size)
        enough = enough.reshape(len(self.times), -1).all(axis=1)
        return float(self.times[enough].max()) if enough.any() else None

    def to_dict(self) -> dict[str, Any]:
        """Return what ``floatplan replay --authority --json`` prints."""
        facts: dict[str, Any] = json_value({name: getattr(self, name) for name in self.__dataclass_fields__})
        return facts


@one_thread
def authority(plan: Plan | str | Path) -> Authority:
    """Return from which errors of momentum and of inertia corrections in flight lead to the goal, and until when.

    The joints are taken to follow their reference exactly, and what is measured to be exact: no controller does better.
    The angular momentum has the error from takeoff on; corrections begin later. Errors are tried from zero outwards,
    0.01 apart, in space 0.05, and between the last that lands and the first that does not the end is bisected to 0.001:
    an interval has no holes, but such as lie between two errors that were tried.

    Parameters
    ----------
    plan : Plan, or path of a plan file

    Raises
    ------
    InputError
        The plan reaches no goal, or has no angular momentum to be wrong.
    """
    plan = as_plan(plan)
    replanner = Replanner(plan, CORRECTIONS / plan.duration)
    times = plan.duration * np.array(SHARES)
    foreseen = Update(replanner.views, Rewriting(plan), 1.0, 1.0)
    planned = np.atleast_1d(plan.angular_momentum)
    size = float(np.linalg.norm(planned)) if len(planned) > 1 else float(planned[0])
    bodies = len(replanner.identification(plan.angular_momentum).errors) // 2
    links = np.ones(2 * bodies)
    links[[0, bodies]] = 0.0

    def with_momentum(axis: Array, error: float, begin: float) -> bool:
        momentum = planned + error * size * axis
        return _lands(replanner, foreseen, momentum, 0.0 * links, begin)

    def with_inertia(error: float, begin: float) -> bool:
        return _lands(replanner, foreseen, planned, error * links, begin)

    step = STEP if len(planned) == 1 else STEP_IN_SPACE
    of_momentum = [_intervals(partial(with_momentum, axis), times, step) for axis in np.eye(len(planned))]
    return Authority(
        times=read_only(times),
        momentum=read_only(np.stack(of_momentum, axis=1) if len(planned) > 1 else of_momentum[0]),
        inertia=_intervals(with_inertia, times, step),
        largest=LARGEST,
        reached=REACHED,
    )


def _intervals(lands: Callable[[float, float], bool], times: Array, step: float) -> Array:
    """Ends (K, 2) of the errors from which a flight lands; later ones are within earlier ones."""
    intervals = []
    below = LARGEST
    above = LARGEST
    for begin in times.tolist():
        if not lands(0.0, begin):
            intervals.append((np.nan, np.nan))
            continue
        below = _farthest(lands, -1.0, begin, below, step)
        above = _farthest(lands, 1.0, begin, above, step)
        intervals.append((-below, above))
    return read_only(intervals)


def _farthest(lands: Callable[[float, float], bool], sign: float, begin: float, most: float, step: float) -> float:
    """Largest size up to ``most`` of an error of that sign from which, as from all smaller ones, a flight lands."""
    low = 0.0
    for high in [*np.arange(step, most, step).tolist(), most]:
        if not lands(sign * high, begin):
            break
        low = high
    else:
        return most
    while high - low > RESOLUTION:
        middle = (low + high) / 2
        if lands(sign * middle, begin):
            low = middle
        else:
            high = middle
    return low


def _lands(replanner: Replanner, foreseen: Update, momentum: Array, errors: Array, begin: float) -> bool:
    """Whether a robot lands at the goal within all limits, corrected from ``begin`` on.

    It has an angular momentum (e,), kg m^2/s, and relative ``errors`` (2m,) of its bodies' masses and inertias;
    ``foreseen`` says what that does to the limits.
    """
    plan = replanner.plan
    flying: Any = replanner.views.flying  # whose momenta are of one kind
    replanner.reset()
    own_momentum = momentum if len(momentum) > 1 else float(momentum[0])
    inertial = replanner.identification(own_momentum)
    inertial.errors[:] = errors
    path = plan.ballistics
    robot = flying.ideal_robot(own_momentum, errors)
    foreseen.begin(Estimate(0.0, inertial, path.position0, path.velocity0, path.gravity))
    step = plan.duration / CORRECTIONS
    allowed = 0.01  # by which a limit may be exceeded; of distances, of 0.1 m, beyond the margin
    for number in range(CORRECTIONS):
        following = (number + 1) * step
        time = robot.time
        if time >= begin - 1e-9 * plan.duration:
            positions, velocities, _ = replanner.motion.at(time)
            rate = robot.rate(positions, velocities)
            replanner.update(time, robot.measured_orientation, rate, positions[0], velocities[0])
        if replanner.views.rows:
            foreseen.predicted(replanner.rest(time))
            if not (foreseen.row_values.T[foreseen.times <= following] >= -allowed).all():
                return False
        robot.fly(replanner.motion, following)
        robot.write(inertial)
    return bool(robot.miss <= REACHED)
