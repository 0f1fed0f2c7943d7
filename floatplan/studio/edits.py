"""Changes of a problem, and the numbers at its paths."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, Literal, TypeAlias

import numpy as np

import floatplan as fp
from floatplan.arguments import attributes
from floatplan.jumps.jump import Jump
from floatplan.problem.parts import JointState, Obstacle
from floatplan.tables import LimitKey

Edit: TypeAlias = Callable[[fp.Problem], fp.Problem]
FlightKey: TypeAlias = Literal["duration", "angular_momentum", "start", "goal"]

BY_HAND = "by hand"
AMPLE = 1.2  # [-] limits by hand begin at so many times the peaks of the present motion


def end_state(problem: fp.Problem, end: str) -> JointState:
    """Return the state at "start" or "goal"."""
    return problem.initial if end == "start" else problem.final


def numbers(values: Mapping[str, float]) -> Edit:
    """Set numbers by the paths of a problem file, in SI units and radians."""

    def edit(problem: fp.Problem) -> fp.Problem:
        return fp.Family(problem, {path: np.array([float(value)]) for path, value in values.items()})[0]

    return edit


def number_at(problem: fp.Problem, path: str) -> float:
    """Return the number at a path, SI units and radians; NaN where a word stands instead, or nothing."""
    head, *keys = path.split(".")
    if head == "limits":
        return limit_of(problem, keys[0], keys[1])  # type: ignore[arg-type]
    value: Any = end_state(problem, head) if head in ("start", "goal") else getattr(problem, head)
    for key in keys:
        if isinstance(value, JointState) and key == "orientation" and value.attitude is not None:
            value = value.attitude
        elif value is None:
            return math.nan
        elif isinstance(value, np.ndarray):
            value = value[problem.robot.joints.index(key)]
        elif isinstance(value, Mapping):
            value = value[key]
        else:
            value = value[int(key)] if key.isdecimal() else getattr(value, key)
    return math.nan if isinstance(value, str) else float(value)


def change(table: Literal["flight", "motion", "jump"], **changes: Any) -> Edit:
    """Change fields of the flight, the motion or the jump, such as ``angular_momentum="free"``."""
    return lambda problem: replace(problem, **{table: replace(getattr(problem, table), **changes)})


def phases(ends: Sequence[float] | None, flight: int = 0) -> Edit:
    """Fix the durations of the phases of a jump, of which the flight is one, by their ends, s; None frees them."""

    def edit(problem: fp.Problem) -> fp.Problem:
        request = problem.jump or fp.JumpRequest()
        if not ends:
            others = [key for key in request.fixed if key != "duration"]
            takeoff = replace(request.takeoff, durations=None)
            landing = replace(request.landing, durations=None)
            return replace(problem, jump=replace(request, takeoff=takeoff, landing=landing, fixed=others))
        durations = np.diff(ends, prepend=0.0).tolist()
        ranges = [(duration, duration) for duration in durations]
        takeoff = replace(request.takeoff, durations=ranges[:flight])
        landing = replace(request.landing, durations=ranges[flight + 1 :])
        fixed = list(request.fixed)
        if "duration" not in fixed:
            fixed.append("duration")
        jump = replace(request, takeoff=takeoff, landing=landing, fixed=fixed)
        return replace(problem, flight=replace(problem.flight, duration=durations[flight]), jump=jump)

    return edit


def keep(key: FlightKey, plan: fp.Plan | None) -> Edit:
    """Let a jump keep a value of its flight as the plan has it; without a plan it is a guess."""

    def edit(problem: fp.Problem) -> fp.Problem:
        request = problem.jump or fp.JumpRequest()
        fixed = [other for other in request.fixed if other != key]
        if plan is None:
            return replace(problem, jump=replace(request, fixed=fixed))
        jump = replace(request, fixed=[*fixed, key])
        if key in ("start", "goal"):
            state = end_state(plan.problem, key)
            value: Any = {key: fp.Posture(state.orientation, state.positions)}
        else:
            value = {"flight": replace(problem.flight, **{key: getattr(plan, key)})}
        return replace(problem, jump=jump, **value)

    return edit


@lru_cache(maxsize=4)
def displacement_of(jump: Jump) -> tuple[float, float]:
    """How far the centre of mass comes in a jump in space, along x and y, m, to a millimetre."""
    first, last = jump.state([0.0, jump.duration]).com_position[:, :2].tolist()
    return round(last[0] - first[0], 3), round(last[1] - first[1], 3)


def displaced(jump: Jump | None) -> Edit:
    """Let a jump in space come as far as another one; without one, wherever it lands."""

    def edit(problem: fp.Problem) -> fp.Problem:
        request = problem.jump or fp.JumpRequest()
        landing = replace(request.landing, displacement=None if jump is None else displacement_of(jump))
        return replace(problem, jump=replace(request, landing=landing))

    return edit


def phase_ends(problem: fp.Problem) -> tuple[float, ...] | None:
    """When the phases of a jump end, s, where all their durations are fixed."""
    jump = problem.jump
    if jump is None or not jump.takeoff.durations or not jump.landing.durations or "duration" not in jump.fixed:
        return None
    lasting = (problem.flight.duration, problem.flight.duration)
    pairs = np.array([*jump.takeoff.durations, lasting, *jump.landing.durations])
    return tuple(np.cumsum(pairs[:, 0]).tolist()) if (pairs[:, 0] == pairs[:, 1]).all() else None


def ground(is_on: bool) -> Edit:
    """Require that links stay above the ground, or no longer."""
    return lambda problem: replace(problem, ground=is_on)


def limit(key: LimitKey, choice: str, peaks: Mapping[str, float]) -> Edit:
    """Choose where a limit comes from; by hand, it begins with a little more than the peaks (motor -> value)."""

    def edit(problem: fp.Problem) -> fp.Problem:
        value: Any = choice
        if choice == BY_HAND:
            value = {motor: AMPLE * max(peak, 1e-3) for motor, peak in peaks.items()}
        motors = {} if key == "torque" else problem.limits.motor
        return replace(problem, limits=replace(problem.limits, **{key: value}, motor=motors))

    return edit


def with_obstacle(obstacle: Obstacle) -> Edit:
    """Add an obstacle."""
    return lambda problem: replace(problem, obstacles=(*problem.obstacles, obstacle))


def put_obstacle(index: int, *put: Obstacle) -> Edit:
    """Replace an obstacle, or remove it; where there is none of that index, nothing changes."""

    def edit(problem: fp.Problem) -> fp.Problem:
        obstacles = problem.obstacles
        if index >= len(obstacles):
            return problem
        return replace(problem, obstacles=(*obstacles[:index], *put, *obstacles[index + 1 :]))

    return edit


def moved(obstacle: Obstacle, by: complex) -> Obstacle:
    """Return an obstacle that stands elsewhere, m."""
    places = attributes(obstacle, obstacle.places())
    changes: dict[str, Any] = {name: (x + by.real, y + by.imag) for name, (x, y) in places.items()}
    return replace(obstacle, **changes)


def limit_choice(problem: fp.Problem, key: LimitKey) -> str:
    """Where a limit comes from: "none", "urdf" or "by hand"."""
    choice = getattr(problem.limits, key)
    return choice if isinstance(choice, str) else BY_HAND


def limit_of(problem: fp.Problem, key: LimitKey, joint: str) -> float:
    """The limit of a planned joint's own motor; infinite where there is none."""
    limits = problem.motor_torque_limits if key == "torque" else problem.joint_limits[key]
    return float(limits[problem.robot.joints.index(joint)])


def limit_paths(robot: fp.Robot, key: LimitKey, joint: str) -> tuple[str, ...]:
    """Paths of the limits of a planned joint's motor, and of those that follow it."""
    followers = [name for name in robot.motors if name in robot.coupled and robot.coupled[name].leader == joint]
    return tuple(f"limits.{key}.{name}" for name in (joint, *followers))
