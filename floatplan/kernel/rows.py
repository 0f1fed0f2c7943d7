"""Which problems the kernel can plan, and their numbers as arrays: from a family without making its problems."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from floatplan.arrays import Array, BoolArray, IntArray
from floatplan.kernel.batch import Rows, Solver
from floatplan.kernel.library import kernel
from floatplan.motion.dynamics import FlightDynamics
from floatplan.motion.planar.bounds import inertia_extremes, monotonic_midpoints
from floatplan.motion.planar.flight import PlanarFlight
from floatplan.motion.sine_polynomial import boundary_arguments
from floatplan.problem.family import Family
from floatplan.problem.problem import Problem
from floatplan.robot.robot import Robot
from floatplan.tables import RANGES

ENDS = {"start": "initial", "goal": "final"}
QUANTITIES = ("positions", "velocities", "accelerations")
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
        case ["start" | "goal" as end, "orientation" as name]:
            return end, name, None
        case ["start" | "goal" as end, "positions" | "velocities" | "accelerations" as name]:
            return end, name, None
        case ["start" | "goal" as end, "positions" | "velocities" | "accelerations" as name, joint]:
            return (end, name, robot.joints.index(joint)) if joint in robot.joints else None
    return None


@dataclass(frozen=True, eq=False)
class Numbers:
    """What N plain problems of one robot, joint ranges and degrees differ in.

    ``duration`` (N,) s; ``momentum`` (N,) kg m^2/s, None for the middle of (9); at both ends ``orientation`` (2, N) rad
    and ``positions, velocities, accelerations`` (2, N, n). ``sound`` (N,) says whether all else is in its range.
    """

    like: Problem
    duration: Array
    momentum: Array | None
    orientation: Array
    positions: Array
    velocities: Array
    accelerations: Array
    sound: BoolArray

    @classmethod
    def of_problems(cls, problems: Sequence[Problem]) -> Numbers:
        """Of problems as they are; all of them give h, or all take the middle."""
        ends = [[getattr(problem, name) for problem in problems] for name in ENDS.values()]
        flights = [problem.flight for problem in problems]
        given = None if flights[0].angular_momentum == "midpoint" else [flight.angular_momentum for flight in flights]
        numbers: dict[str, Any] = {
            name: np.array([[getattr(state, name) for state in states] for states in ends])
            for name in ("orientation", *QUANTITIES)
        }
        return cls(
            problems[0],
            np.array([flight.duration for flight in flights], dtype=np.float64),
            None if given is None else np.array(given, dtype=np.float64),
            **numbers,
            sound=np.ones(len(problems), dtype=np.bool_),
        )

    @classmethod
    def of_family(cls, family: Family, rows: IntArray) -> Numbers:
        """Of some rows of a plain family; numbers may be bad, see :meth:`doubtful`."""
        base, count = family.base, len(rows)
        states = [base.initial, base.final]

        def repeated(values: npt.ArrayLike) -> Array:
            array = np.asarray(values, dtype=np.float64)
            return np.repeat(array[:, None], count, axis=1)

        numbers: dict[str, Any] = {
            name: repeated([getattr(state, name) for state in states]) for name in ("orientation", *QUANTITIES)
        }
        asked = base.flight.angular_momentum
        numbers["duration"] = np.full(count, base.flight.duration, dtype=np.float64)
        numbers["momentum"] = None if isinstance(asked, str) else np.full(count, asked, dtype=np.float64)
        numbers["sound"] = np.ones(count, dtype=np.bool_)
        for path, array in family.arrays.items():
            place, values = _place(path, base.robot), array[rows]
            if place is None:
                numbers["sound"] &= _within(BALLISTIC[path], values)
                continue
            end, name, joint = place
            if not end:
                numbers["momentum" if name == "angular_momentum" else name] = values.astype(np.float64)
            elif joint is None:
                target = numbers[name][list(ENDS).index(end)]
                target[...] = values if target.ndim == 1 else values[:, None]
            else:
                numbers[name][list(ENDS).index(end), :, joint] = values
        return cls(base, **numbers)

    def doubtful(self) -> BoolArray:
        """Rows (N,) whose numbers are out of range, or so near that a :class:`Problem` must say."""
        low, high = self.like.position_limits.T
        margin = NEAR_EDGE * (high - low)
        good = self.sound & _within("duration", self.duration)
        if self.momentum is not None:
            good &= _within("angular_momentum", self.momentum)
        good &= _within("orientation", self.orientation).all(axis=0)
        for name in QUANTITIES:
            good &= _within(name, getattr(self, name)).all(axis=(0, 2))
        inside = (self.positions > low + margin) & (self.positions < high - margin)
        return np.asarray(~(good & inside.all(axis=(0, 2))))

    def some(self, rows: IntArray) -> Numbers:
        """Return those of some rows."""
        numbers: dict[str, Any] = {name: getattr(self, name)[:, rows] for name in ("orientation", *QUANTITIES)}
        momentum = None if self.momentum is None else self.momentum[rows]
        return Numbers(self.like, self.duration[rows], momentum, **numbers, sound=self.sound[rows])

    def rows(self) -> Rows:
        """As the solver takes them: the plain motion's boundary, arcsines on their first branch."""
        low, high = self.like.position_limits.T
        centre, amplitude = (low + high) / 2, (high - low) / 2
        branch = np.zeros(len(centre), dtype=np.int64)
        p, rate, curvature = boundary_arguments(
            self.positions, self.velocities, self.accelerations, centre, amplitude, branch
        )
        time = self.duration[:, None]
        parts = np.stack((p[0], time * rate[0], time**2 * curvature[0], p[1], time * rate[1], time**2 * curvature[1]))
        return Rows(
            self.duration,
            self.angular_momentum(),
            self.orientation[1] - self.orientation[0],
            np.ascontiguousarray(parts.transpose(1, 2, 0)),
        )

    def angular_momentum(self) -> Array:
        """The h (N,) of each, kg m^2/s."""
        if self.momentum is not None:
            return self.momentum
        changes = np.concatenate(
            ((self.orientation[1] - self.orientation[0])[:, None], self.positions[1] - self.positions[0]), axis=1
        )
        extremes = inertia_extremes(self.like.robot, self.like.position_limits)
        return monotonic_midpoints(extremes, changes, self.duration)


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
