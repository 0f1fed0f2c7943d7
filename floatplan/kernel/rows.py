"""Which problems the kernel can plan, and their numbers as arrays: from a family without making its problems."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from floatplan.arrays import Array, BoolArray, IntArray
from floatplan.kernel.batch import Rows, Solver
from floatplan.kernel.layout import kernel
from floatplan.motion.dynamics import FlightDynamics
from floatplan.motion.planar.bounds import inertia_extremes, monotonic_midpoints
from floatplan.motion.planar.flight import PlanarFlight
from floatplan.motion.sine_polynomial import boundary_arguments
from floatplan.problem.family import Family
from floatplan.problem.problem import Problem
from floatplan.robot.robot import Robot
from floatplan.tables import RANGES

ENDS = ("start", "goal")
QUANTITIES = ("positions", "velocities", "accelerations")
OF_STATES = ("orientation", *QUANTITIES)
BALLISTIC = {  # what the path of the centre of mass alone depends on, and the range of its numbers
    "flight.gravity": "gravity",
    "flight.horizontal_velocity": "horizontal_velocity",
    "flight.takeoff.position.0": "position",
    "flight.takeoff.position.1": "position",
    "flight.landing.height": "height",
}
NEAR_EDGE = 1e-9  # of a joint's range: rows with a joint nearer to the edge are checked as problems


def is_planar(flight: FlightDynamics) -> bool:
    """Whether a flight is one in a plane, as the kernel's are."""
    return isinstance(flight, PlanarFlight)


def is_plain(problem: Problem) -> bool:
    """Whether a problem asks for no more than the kernel does: (17) between given states, h given, no inequalities."""
    limits = (*problem.joint_limits.values(), problem.motor_torque_limits, problem.torque_limits, problem.motor_stall)
    return (
        problem.motion.objective == "coefficients"
        and problem.flight.angular_momentum != "free"
        and not problem.chooses_ends
        and not (problem.obstacles or problem.self_clearances or problem.ground)
        and problem.limits.orientation_rate is None
        and not any(np.isfinite(values).any() for values in limits)
        and len(problem.robot.joints) > 0
    )


def is_plain_family(family: Family) -> bool:
    """Whether all problems of a family are plain, with the same joint ranges and degrees."""
    base = family.base
    return is_plain(base) and all(_place(path, base.robot) or path in BALLISTIC for path in family.arrays)


def _place(path: str, robot: Robot) -> tuple[str, str, int | None] | None:
    """End (or ""), quantity and joint (None for all) that a path is about; None where it is about something else."""
    match path.split("."):
        case ["flight", "duration" | "angular_momentum" as name]:
            return "", name, None
        case ["start" | "goal" as end, name] if name in OF_STATES:
            return end, name, None
        case ["start" | "goal" as end, name, joint] if name in QUANTITIES and joint in robot.joints:
            return end, name, robot.joints.index(joint)
    return None


@dataclass(frozen=True, eq=False)
class Numbers:
    """What N plain problems of one robot, joint ranges and degrees differ in.

    ``values`` are ``duration`` (N,) s; ``angular_momentum`` (N,) kg m^2/s, left out for the middle of (9); at both ends
    ``orientation`` (N, 2) rad and ``positions, velocities, accelerations`` (N, 2, n). ``sound`` (N,) says whether all
    else is in its range.
    """

    like: Problem
    values: Mapping[str, Array]
    sound: BoolArray

    @classmethod
    def of_problems(cls, problems: Sequence[Problem]) -> Numbers:
        """Of problems as they are; all of them give h, or all take the middle."""
        like, states = problems[0], [state for problem in problems for state in (problem.initial, problem.final)]
        arrays = {name: np.array([getattr(state, name) for state in states]) for name in OF_STATES}
        values = {name: array.reshape(-1, 2, *array.shape[1:]) for name, array in arrays.items()}
        given = ("duration",) if like.flight.angular_momentum == "midpoint" else ("duration", "angular_momentum")
        for name in given:
            values[name] = np.array([getattr(problem.flight, name) for problem in problems], dtype=np.float64)
        return cls(like, values, np.ones(len(problems), dtype=np.bool_))

    @classmethod
    def of_family(cls, family: Family, rows: IntArray) -> Numbers:
        """Of some rows of a plain family; numbers may be bad, see :meth:`doubtful`."""
        base = cls.of_problems([family.base])
        values = {name: np.repeat(array, len(rows), axis=0) for name, array in base.values.items()}
        sound = np.ones(len(rows), dtype=np.bool_)
        for path, array in family.arrays.items():
            place, varied = _place(path, base.like.robot), array[rows].astype(np.float64)
            if place is None:
                sound &= _within(BALLISTIC[path], varied)
                continue
            end, name, joint = place
            if not end:
                values[name] = varied
            elif joint is None:
                target = values[name][:, ENDS.index(end)]
                target[...] = varied if target.ndim == 1 else varied[:, None]
            else:
                values[name][:, ENDS.index(end), joint] = varied
        return cls(base.like, values, sound)

    def doubtful(self) -> BoolArray:
        """Rows (N,) whose numbers are out of range, or so near that a :class:`Problem` must say."""
        low, high = self.like.position_limits.T
        margin, positions = NEAR_EDGE * (high - low), self.values["positions"]
        good = [_within(name, array) for name, array in self.values.items()]
        good += [self.sound, positions > low + margin, positions < high - margin]
        return np.asarray(~np.all([each.all(axis=tuple(range(1, each.ndim))) for each in good], axis=0))

    def some(self, rows: IntArray) -> Numbers:
        """Return those of some rows."""
        return Numbers(self.like, {name: array[rows] for name, array in self.values.items()}, self.sound[rows])

    def rows(self) -> Rows:
        """As the solver takes them: the plain motion's boundary, arcsines on their first branch."""
        low, high = self.like.position_limits.T
        duration, branch = self.values["duration"], np.zeros(len(low), dtype=np.int64)
        positions, rates, accelerations = (self.values[name] for name in QUANTITIES)
        centre, amplitude = (low + high) / 2, (high - low) / 2
        p, rate, curvature = boundary_arguments(positions, rates, accelerations, centre, amplitude, branch)
        time = duration[:, None, None]
        boundary = np.stack((p, time * rate, time**2 * curvature), axis=-1).swapaxes(1, 2)
        change = np.diff(self.values["orientation"], axis=1)[:, 0]
        return Rows(duration, self.angular_momentum(), change, boundary.reshape(len(duration), len(low), 6))

    def angular_momentum(self) -> Array:
        """The h (N,) of each, kg m^2/s."""
        values = self.values
        if "angular_momentum" in values:
            return values["angular_momentum"]
        changes = np.diff(np.concatenate((values["orientation"][..., None], values["positions"]), axis=2), axis=1)
        extremes = inertia_extremes(self.like.robot, self.like.position_limits)
        return monotonic_midpoints(extremes, changes[:, 0], values["duration"])


def _within(key: str, values: Array) -> BoolArray:
    allowed = RANGES[key]
    return np.asarray((values >= allowed.low) & (values <= allowed.high))


def solver(problem: Problem, degrees: tuple[int, ...]) -> Solver:
    """Return the compiled solver for a problem's robot and joint ranges."""
    return _solver(problem.robot, tuple(map(tuple, problem.position_limits.tolist())), degrees)


@lru_cache(maxsize=32)
def _solver(robot: Robot, ranges: tuple[tuple[float, float], ...], degrees: tuple[int, ...]) -> Solver:
    return Solver(kernel(), robot.tree, np.array(ranges), [degree - 5 for degree in degrees])


def key(problem: Problem) -> tuple[Any, ...]:
    """What plain problems must share to be planned in one batch."""
    given = not isinstance(problem.flight.angular_momentum, str)
    return problem.robot, problem.position_limits.tobytes(), problem.degrees, given
