"""Changes of a problem, and the numbers at its paths."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal, TypeAlias

import numpy as np

import floatplan as fp
from floatplan.problem.parts import JointState, Obstacle
from floatplan.tables import LimitKey

Edit: TypeAlias = Callable[[fp.Problem], fp.Problem]
Part: TypeAlias = Literal["duration", "angular_momentum", "start", "goal"]

BY_HAND = "by hand"
AMPLE = 1.2  # [-] of what the present motion needs: limits by hand begin there


def end_state(problem: fp.Problem, end: str) -> JointState:
    """Return the state at "start" or "goal"."""
    return problem.initial if end == "start" else problem.final


def numbers(values: Mapping[str, float]) -> Edit:
    """Set numbers by the paths of a problem file, in SI units and radians."""

    def edit(problem: fp.Problem) -> fp.Problem:
        return fp.Family(problem, {path: np.array([float(value)]) for path, value in values.items()})[0]

    return edit


def number_at(problem: fp.Problem, path: str) -> float:
    """Return the number at a path, SI units and radians; NaN where a word is in its place."""
    head, *keys = path.split(".")
    if head == "limits":
        return limit_of(problem, keys[0], keys[1])  # type: ignore[arg-type]
    value: Any = end_state(problem, head) if head in ("start", "goal") else getattr(problem, head)
    for key in keys:
        if isinstance(value, np.ndarray):
            value = value[problem.robot.joints.index(key)]
        elif isinstance(value, Mapping):
            value = value[key]
        else:
            value = value[int(key)] if key.isdecimal() else getattr(value, key)
    return math.nan if isinstance(value, str) else float(value)


def change(part: Literal["flight", "motion", "jump"], **changes: Any) -> Edit:
    """Change fields of the flight, the motion or the jump, such as ``angular_momentum="free"``."""
    return lambda problem: replace(problem, **{part: replace(getattr(problem, part), **changes)})


def phases(ends: Sequence[float] | None, flight: int = 0) -> Edit:
    """Fix how long the phases of a jump last, the flight being one of them, by their ends, s; or leave it open."""

    def edit(problem: fp.Problem) -> fp.Problem:
        asked = problem.jump or fp.JumpRequest()
        lasts = np.diff(ends or (), prepend=0.0).tolist()
        pairs = [(each, each) for each in lasts]
        before, after = (pairs[:flight], pairs[flight + 1 :]) if pairs else (None, None)
        fixed = [each for each in asked.fixed if pairs or each != "duration"]
        if "duration" not in fixed and pairs:
            fixed.append("duration")
        takeoff = replace(asked.takeoff, durations=before)
        landing = replace(asked.landing, durations=after)
        lasting = replace(problem.flight, duration=lasts[flight]) if pairs else problem.flight
        jump = replace(asked, takeoff=takeoff, landing=landing, fixed=fixed)
        return replace(problem, flight=lasting, jump=jump)

    return edit


def keep(part: Part, found: fp.Plan | None) -> Edit:
    """Let a jump keep a part of the flight that was found; None leaves it a guess."""

    def edit(problem: fp.Problem) -> fp.Problem:
        asked = problem.jump or fp.JumpRequest()
        others = [each for each in asked.fixed if each != part]
        jump = replace(asked, fixed=others if found is None else [*others, part])
        if found is None:
            return replace(problem, jump=jump)
        if part in ("start", "goal"):
            state = end_state(found.problem, part)
            kept: Any = {part: fp.Posture(state.orientation, state.positions)}
        else:
            kept = {"flight": replace(problem.flight, **{part: getattr(found, part)})}
        return replace(problem, jump=jump, **kept)

    return edit


def phase_ends(problem: fp.Problem) -> tuple[float, ...] | None:
    """When the phases of a jump end, s, where all that they last is fixed."""
    jump = problem.jump
    if jump is None or not jump.takeoff.durations or not jump.landing.durations or "duration" not in jump.fixed:
        return None
    lasting = (problem.flight.duration, problem.flight.duration)
    pairs = np.array([*jump.takeoff.durations, lasting, *jump.landing.durations])
    return tuple(np.cumsum(pairs[:, 0]).tolist()) if (pairs[:, 0] == pairs[:, 1]).all() else None


def ground(wanted: bool) -> Edit:
    """Ask for the ground, or no longer."""
    return lambda problem: replace(problem, ground=wanted)


def limit(key: LimitKey, choice: str, needed: Mapping[str, float]) -> Edit:
    """Choose where a limit comes from; by hand, it begins with a little more than is ``needed`` (motor -> value)."""

    def edit(problem: fp.Problem) -> fp.Problem:
        value: Any = choice
        if choice == BY_HAND:
            value = {motor: AMPLE * max(need, 1e-3) for motor, need in needed.items()}
        motors = {} if key == "torque" else problem.limits.motor
        return replace(problem, limits=replace(problem.limits, **{key: value}, motor=motors))

    return edit


def with_obstacle(obstacle: Obstacle) -> Edit:
    """Add an obstacle."""
    return lambda problem: replace(problem, obstacles=(*problem.obstacles, obstacle))


def put_obstacle(index: int, *put: Obstacle) -> Edit:
    """Put an obstacle in the place of another, or take that away; where it is gone, nothing changes."""

    def edit(problem: fp.Problem) -> fp.Problem:
        obstacles = problem.obstacles
        if index >= len(obstacles):
            return problem
        return replace(problem, obstacles=(*obstacles[:index], *put, *obstacles[index + 1 :]))

    return edit


def moved(obstacle: Obstacle, by: complex) -> Obstacle:
    """Return an obstacle that stands elsewhere, m."""
    places = {name: getattr(obstacle, name) for name in obstacle.places()}
    changes: dict[str, Any] = {name: (x + by.real, y + by.imag) for name, (x, y) in places.items()}
    return replace(obstacle, **changes)


def limit_choice(problem: fp.Problem, key: LimitKey) -> str:
    """Where a limit comes from: "none", "urdf" or "by hand"."""
    given = getattr(problem.limits, key)
    return given if isinstance(given, str) else BY_HAND


def limit_of(problem: fp.Problem, key: LimitKey, joint: str) -> float:
    """The limit of a planned joint's own motor; infinite where there is none."""
    limits = problem.motor_torque_limits if key == "torque" else problem.joint_limits[key]
    return float(limits[problem.robot.joints.index(joint)])


def limit_paths(robot: fp.Robot, key: LimitKey, joint: str) -> tuple[str, ...]:
    """Paths of the limits of a planned joint's motor, and of those that follow it."""
    followers = [name for name in robot.motors if name in robot.coupled and robot.coupled[name].leader == joint]
    return tuple(f"limits.{key}.{name}" for name in (joint, *followers))
