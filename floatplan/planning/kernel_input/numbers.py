"""Problems that the kernel plans in a batch, and arrays of what they differ in, without making a family's problems.

Some have no inequalities. Others have obstacles, clearances or limits, of the same kinds in all of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np

from floatplan.arrays import Array, BoolArray, IntArray
from floatplan.errors import InputError
from floatplan.motion.exact_polynomials import CONDITIONS
from floatplan.planning.kernel_input.rows import can_write, obstacle_numbers
from floatplan.problem.ballistics import rising
from floatplan.problem.family import BY_MOTOR, Family, motor_limits_with, obstacles_with
from floatplan.problem.parts import Obstacle
from floatplan.problem.problem import Problem
from floatplan.problem.resolution import least_of_motors, sum_of_motors
from floatplan.robot.planar.inertia import momentum_intervals
from floatplan.robot.robot import Robot
from floatplan.tables import FLIGHT_EVENTS, JOINT_LIMITS, JOINT_VALUES, RANGES

OF_STATES = ("orientation", *JOINT_VALUES)
BALLISTIC: dict[str, tuple[str, int | None]] = {  # what the path of the centre of mass depends on: name, column
    "flight.gravity": ("gravity", None),
    "flight.horizontal_velocity": ("horizontal_velocity", None),
    "flight.takeoff.position.0": ("position", 0),
    "flight.takeoff.position.1": ("position", 1),
    "flight.landing.height": ("height", None),
}


def is_batchable(problem: Problem) -> bool:
    """Whether problems that differ from this one in numbers are planned in batches, with inequalities or without."""
    always = all(obstacle.window is None and can_write(obstacle) for obstacle in problem.obstacles)
    steers = max(problem.degrees, default=0) >= CONDITIONS
    return problem.is_plain or (problem.is_standard and steers and not problem.ground and always)


def is_unconstrained_family(family: Family) -> bool:
    """Whether all problems of a family have no inequalities, and the same joint ranges and degrees."""
    return family.base.is_plain and all(_is_unconstrained(path, family.base.robot) for path in family.arrays)


def is_batchable_family(family: Family) -> bool:
    """Whether the problems of a family, of which there are some, are planned in batches."""
    if not len(family):
        return False
    base = family.base
    others = {path: array[:1] for path, array in family.arrays.items() if not _is_unconstrained(path, base.robot)}
    heads = (path.split(".")[:2] for path in others)
    if not (
        is_batchable(base) and all(head == "obstacles" or (head == "limits" and k in BY_MOTOR) for head, k in heads)
    ):
        return False
    first = _limits_of_family(base, others)
    return first is not None and _finite(first) == _finite(base) and not any(".window" in path for path in others)


def _finite(of: Problem) -> list[list[bool]]:
    """Which limits there are; of many, of the first."""
    return [np.isfinite(values.reshape(-1, values.shape[-1])[0]).tolist() for values in of.limited]


def _is_unconstrained(path: str, robot: Robot) -> bool:
    return path in BALLISTIC or _target(path, robot) is not None


def _target(path: str, robot: Robot) -> tuple[str, str, int | None] | None:
    """End (or ""), quantity and joint (None for all) that a path sets; None where it sets something else."""
    match path.split("."):
        case ["flight", "duration" | "angular_momentum" as name]:
            return "", name, None
        case ["start" | "goal" as end, name] if name in OF_STATES:
            return end, name, None
        case ["start" | "goal" as end, name, joint] if name in JOINT_VALUES and joint in robot.joints:
            return end, name, robot.joints.index(joint)
    return None


@dataclass(frozen=True, eq=False)
class Numbers:
    """What N problems of one robot, joint ranges, degrees and kinds of rows differ in.

    ``values`` are ``duration`` (N,) s; ``angular_momentum`` (N,) kg m^2/s, left out where it is (10) of the others; at
    both ends ``orientation`` (N, 2) rad and ``positions, velocities, accelerations`` (N, 2, n). ``sound`` (N,) says
    whether all else is in its range. Where there are inequalities: ``position`` (N, 2) m at takeoff, ``height`` (N,) m
    at landing, ``horizontal_velocity`` (N,) m/s, ``gravity`` (N,) m/s^2, the ``obstacles`` of each, and ``limits``,
    which may be one problem's where they are the same.
    """

    like: Problem
    values: Mapping[str, Array]
    sound: BoolArray
    obstacles: Sequence[tuple[Obstacle, ...]] = ()
    limits: Problem | None = None

    @classmethod
    def of_problems(cls, problems: Sequence[Problem]) -> Numbers:
        """Of problems as they are."""
        like = problems[0]
        values: dict[str, Array] = {}
        for name in OF_STATES:
            ends = [(getattr(problem.initial, name), getattr(problem.final, name)) for problem in problems]
            values[name] = np.array(ends)
        values["duration"] = np.array([problem.flight.duration for problem in problems], dtype=np.float64)
        values["angular_momentum"] = np.array([problem.angular_momentum for problem in problems], dtype=np.float64)
        sound = np.ones(len(problems), dtype=np.bool_)
        if not like.has_inequalities:
            return cls(like, values, sound)
        values["position"] = np.array([problem.takeoff.planar_position for problem in problems], dtype=np.float64)
        values["height"] = np.array([problem.landing_height for problem in problems], dtype=np.float64)
        for name in ("horizontal_velocity", "gravity"):
            values[name] = np.array([getattr(problem.flight, name) for problem in problems], dtype=np.float64)
        limits = like
        if len(problems) > 1:
            of_joints = {}
            for row in JOINT_LIMITS:
                of_joints[row.key] = np.array([problem.joint_limits[row.key] for problem in problems])
            others = {}
            for name in ("torque_limits", "motor_torque_limits", "motor_stall", "motor_slope"):
                others[name] = np.array([getattr(problem, name) for problem in problems])
            limits = _limited(like, joint_limits=of_joints, **others)
        return cls(like, values, sound, [problem.obstacles for problem in problems], limits)

    @classmethod
    def of_family(cls, family: Family, rows: IntArray) -> Numbers:
        """Of some rows of a family that is planned in batches; numbers may be bad, see :meth:`doubtful`."""
        base = family.base
        like = cls.of_problems([family.base])
        values = {name: np.repeat(array, len(rows), axis=0) for name, array in like.values.items()}
        varied = {path: array[rows].astype(np.float64) for path, array in family.arrays.items()}
        if isinstance(base.flight.angular_momentum, str):
            del values["angular_momentum"]  # it follows from what is varied
        sound = np.ones(len(rows), dtype=np.bool_)
        for path, array in varied.items():
            if target := _target(path, base.robot):
                end, name, joint = target
                if not end:
                    values[name] = array
                elif joint is None:
                    at_end = values[name][:, list(FLIGHT_EVENTS).index(end)]
                    at_end[...] = array if at_end.ndim == 1 else array[:, None]
                else:
                    values[name][:, list(FLIGHT_EVENTS).index(end), joint] = array
            elif path in BALLISTIC:
                name, column = BALLISTIC[path]
                sound &= _within(name, array)
                if name in values:
                    values[name][(...,) if column is None else (..., column)] = array
            elif path.startswith("limits."):
                sound &= _within("limit", array)
        if like.limits and not base.flight.landing and "flight.landing.height" not in varied:
            values["height"] = values["position"][:, 1]
        obstacles = _obstacles_of_family(base, varied, sound)
        return cls(base, values, sound, obstacles, _limits_of_family(base, varied) if like.limits else None)

    def doubtful(self) -> BoolArray:
        """Rows (N,) whose numbers are out of range, or so near that a :class:`Problem` must say."""
        low, high = self.like.position_limits.T
        margin = 1e-9 * (high - low)  # rows with a joint nearer to the edge of its range are checked as problems
        positions = self.values["positions"]
        good = [_within(name, array) for name, array in self.values.items()]
        good += [self.sound, positions > low + margin, positions < high - margin]
        return np.asarray(~np.all([rows.all(axis=tuple(range(1, rows.ndim))) for rows in good], axis=0))

    def angular_momentum(self) -> Array:
        """Their h (N,), kg m^2/s."""
        values = self.values
        if "angular_momentum" in values:
            return values["angular_momentum"]
        changes = np.diff(np.concatenate((values["orientation"][..., None], values["positions"]), axis=2), axis=1)
        low, high = momentum_intervals(self.like.inertia_extremes, changes[:, 0], values["duration"])
        return (low + high) / 2

    def paths(self) -> Array:
        """Of the centre of mass (N, 5), as the kernel has it: position, velocity, gravity."""
        like = self.like
        values = self.values
        orientation = values["orientation"]
        positions = values["positions"]
        gravity = values["gravity"]
        tree = like.robot.tree
        foot = tree.places_from_com(like.takeoff_frame.weights, orientation[:, 0], positions[:, 0])
        landing = tree.places_from_com(like.landing_frame.weights, orientation[:, 1], positions[:, 1])
        takeoff = values["position"][:, 0] + 1j * values["position"][:, 1] - foot
        upwards = rising(takeoff.imag, landing.imag, values["height"], gravity, values["duration"])
        return np.stack((takeoff.real, takeoff.imag, values["horizontal_velocity"], upwards, gravity), axis=1)

    def obstacle_numbers(self) -> Array:
        """Of the obstacles (N, k), as the kernel has them."""
        rows = []
        for own in self.obstacles:
            numbers: list[float] = []
            for obstacle in own:
                numbers += obstacle_numbers(obstacle)
            rows.append(numbers)
        return np.array(rows)


def _obstacles_of_family(
    base: Problem, varied: Mapping[str, Array], sound: BoolArray
) -> Sequence[tuple[Obstacle, ...]]:
    """Obstacles of some rows; where they are wrong, rows are not ``sound``."""
    of_obstacles = {path: array.tolist() for path, array in varied.items() if path.startswith("obstacles.")}
    obstacles = [base.obstacles] * (len(sound) if base.obstacles else 0)
    for row in range(len(sound) if of_obstacles else 0):
        try:
            obstacles[row] = obstacles_with(base, tuple((path, values[row]) for path, values in of_obstacles.items()))
        except InputError:
            sound[row] = False
    return obstacles


def _limited(like: Problem, **limits: Any) -> Problem:
    """Return a problem whose limits are those (N, ..) of many, for what is made of limits alone."""
    many = copy(like)
    vars(many).update(limits)
    return many


def _limits_of_family(base: Problem, varied: Mapping[str, Array]) -> Problem | None:
    """The base problem with the limits of some rows; None where one problem cannot hold them."""
    limits: dict[str, Any] = {"joint_limits": dict(base.joint_limits)}
    for key, row in BY_MOTOR.items():
        about = {path: array for path, array in varied.items() if path.split(".")[:2] == ["limits", key]}
        own = motor_limits_with(base, row, about) if about else None
        if about and own is None:
            return None
        if own is not None and key == "torque":
            limits |= {"motor_torque_limits": own, "torque_limits": sum_of_motors(base.robot, own)}
        elif own is not None:
            limits["joint_limits"][key] = least_of_motors(base.robot, own)
    return _limited(base, **limits) if any(path.startswith("limits.") for path in varied) else base


def _within(key: str, values: Array) -> BoolArray:
    allowed = RANGES[key]
    return np.asarray((values >= allowed.low) & (values <= allowed.high))


def key(problem: Problem) -> tuple[Any, ...]:
    """What problems must share to be planned in one batch."""
    of_motion = problem.robot, problem.position_limits.tobytes(), problem.degrees
    if not problem.has_inequalities:
        return of_motion
    limits = str(_finite(problem)), problem.limits.orientation_rate
    kinds = tuple((type(obstacle), len(obstacle.pieces)) for obstacle in problem.obstacles)
    return *of_motion, *limits, kinds, problem.self_clearances, problem.takeoff.frame, problem.landing.frame
