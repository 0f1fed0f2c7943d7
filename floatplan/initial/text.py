"""A first flight as a problem file: commented, in degrees, with what was found and what could be chosen otherwise."""

from __future__ import annotations

import json
import math
import os
import re
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np

from floatplan.initial.flight import FirstFlight
from floatplan.initial.robots import ChosenRobot
from floatplan.initial.stance import FAST
from floatplan.problem.parts import Posture
from floatplan.problem.resolution import position_limits
from floatplan.robot.robot import Robot
from floatplan.robot.urdf.example_robots import PREFIX

HELD = (
    "No stance that pushes off or lands so was looked for, with its stroke, force and balance: only that the joints'"
    " velocity limits let the foot leave and meet the ground at rest."
)
WIDTH = 110  # [-] characters of a comment
BARE = re.compile(r"[A-Za-z0-9_-]+")


def problem_file_text(chosen: ChosenRobot, flight: FirstFlight, path: Path) -> str:
    """Return the problem file that goes to ``path``."""
    problem = flight.problem
    blocks = [
        _title(chosen.robot, flight),
        ['angles = "deg"', *(["ground = true          # every link stays above it"] if problem.ground else [])],
        _robot(chosen, path),
        _joints(chosen.robot),
        _posture("start", problem.start, chosen.robot),
        _posture("goal", problem.goal, chosen.robot),
        _flight(flight),
        ["[motion]", 'degree = "auto"', f'objective = "{problem.motion.objective}"'],
        _limits(flight),
    ]
    return "\n\n".join("\n".join(block) for block in blocks if block) + "\n"


def _title(robot: Robot, flight: FirstFlight) -> list[str]:
    problem, turn = flight.problem, math.degrees(flight.turn)
    name = problem.name
    if not problem.ground:
        what = f"{name}, afloat without gravity, turns its base by {turn:.3g} degrees with its joints."
    elif flight.reasons:
        what = f"{name} leaps from {problem.takeoff.frame} and turns by {turn:.3g} degrees: the largest turn found."
    else:
        direction = "backwards" if turn * robot.plane.turn > 0 else "forwards"
        what = f"{name} flips {direction}, from {problem.takeoff.frame} to {problem.landing.frame}."
    held = HELD if problem.ground else ""
    return _comment(what) + _comment(" ".join([*flight.reasons, held]).strip())


def _robot(chosen: ChosenRobot, path: Path) -> list[str]:
    robot = chosen.robot
    assert robot.path is not None
    relative = Path(os.path.relpath(robot.path.resolve(), path.resolve().parent)).as_posix()
    lines = [
        "[robot]",
        f"urdf = {_value(robot.source if robot.source.startswith(PREFIX) else relative)}",
        f"plane = {_value(robot.plane.name)}            # of the motion: horizontal and vertical axis of the base",
    ]
    choices = chosen.choices
    if "joints" in choices:
        lines.append(f"joints = {_value(list(choices['joints']))}  # the others carry little and stay locked")
    if "coupled" in choices:
        lines.append(f"coupled = {_value(choices['coupled'])}     # left and right move as one")
        pairs = (f"{follower} follows {coupling.leader}" for follower, coupling in robot.coupled.items())
        lines += _comment(f"{', '.join(pairs)}.")
    if "reference" in choices:
        lines.append(f"reference = {_value(choices['reference'])} # where the other joints are locked")
    if robot.locked:
        lines += _comment(f"Locked: {', '.join(robot.locked)}.")
    if chosen.feet:
        lines += _comment(f"Feet: {', '.join(chosen.feet)}.")
    return lines


def _joints(robot: Robot) -> list[str]:
    """A comment with range, rate and torque of each planned joint."""
    rows = [("joint", "range, degrees", "rate, rad/s", "torque, N m", "at rest, degrees")]
    for joint, (low, high), rest in zip(
        robot.joints, np.rad2deg(robot.position_limits), np.rad2deg(robot.resting), strict=True
    ):
        motor = robot.motors.index(joint)
        limits = robot.motor_velocity_limits[motor], robot.motor_torque_limits[motor]
        rate, torque = (f"{limit:.4g}" if math.isfinite(limit) else "no limit" for limit in limits)
        reach = f"{low:.0f} to {high:.0f}" if np.isfinite([low, high]).all() else "any"
        rows.append((joint, reach, rate, torque, f"{rest:.0f}"))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    cells = [[cell.ljust(width) for cell, width in zip(row, widths, strict=True)] for row in rows]
    return [f"# {'  '.join(row).rstrip()}" for row in cells]


def _posture(table: str, posture: Posture, robot: Robot) -> list[str]:
    angles = zip(robot.joints, np.asarray(posture.positions).tolist(), strict=True)
    pairs = (f"{joint if BARE.fullmatch(joint) else _value(joint)} = {_degrees(angle)}" for joint, angle in angles)
    lines = [
        f"[{table}]",
        f"orientation = {_degrees(posture.orientation)}",
        f"positions = {{ {', '.join(pairs)} }}",
    ]
    if isinstance(posture.velocities, str):
        verb = "leaves" if posture.velocities == "takeoff" else "meets"
        lines.append(f'velocities = "{posture.velocities}"  # those with which the foot {verb} the ground at rest')
        lines.append('accelerations = "free"')
    return lines


def _flight(flight: FirstFlight) -> list[str]:
    problem = flight.problem
    asked = problem.flight
    lines = ["[flight]", f"duration = {asked.duration:g}  # s"]
    if not problem.ground:
        return [*lines, "angular_momentum = 0", "gravity = 0"]
    shares = [f"{100 * (contact.ratio or 0):.0f} %" for contact in flight.plan.contacts]
    return [
        *lines,
        f"angular_momentum = {_value(asked.angular_momentum)}  # kg m^2/s",
        f"horizontal_velocity = {asked.horizontal_velocity:g}  # m/s",
        f"takeoff = {{ frame = {_value(problem.takeoff.frame)} }}  # with {shares[0]} of the velocity limits",
        f"landing = {{ frame = {_value(problem.landing.frame)} }}  # with {shares[1]}",
    ]


def _limits(flight: FirstFlight) -> list[str]:
    limits, robot = flight.problem.limits, flight.problem.robot
    lines = ["[limits]"]
    if not np.isfinite(position_limits(robot, limits) - robot.position_limits).all():
        lines.append("# Joints without a range in the URDF have -180 to 180 degrees.")
    fast = f"velocity = {round(math.degrees(FAST), 6):g}  # degrees/s: the URDF gives none"
    lines.append('velocity = "urdf"' if limits.velocity == "urdf" else fast)
    none = "# torque: the URDF gives none; a number is for all, N m"
    lines.append('torque = "urdf"' if limits.torque == "urdf" else none)
    if isinstance(limits.acceleration, int | float):
        degrees = round(math.degrees(limits.acceleration))
        lines.append(f"acceleration = {degrees}  # degrees/s^2: locked joints hold then")
    return lines


def _degrees(angle: float) -> float | int:
    """Whole degrees where it is that many, else all digits."""
    degrees = math.degrees(angle)
    return round(degrees) if abs(degrees - round(degrees)) < 1e-9 else degrees


def _value(value: Any) -> str:
    """A TOML value: texts are escaped as JSON's are, of which TOML's are a superset."""
    return json.dumps(value, ensure_ascii=False)


def _comment(text: str) -> list[str]:
    return [f"# {line}" for line in wrap(" ".join(text.split()), WIDTH, break_long_words=False)]
