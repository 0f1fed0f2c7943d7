"""A first flight as a problem file: commented, in degrees, with what was found and what could be chosen otherwise."""

import json
import math
import re
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np

from floatplan.initial.afloat import FAST
from floatplan.initial.barely import USUAL
from floatplan.initial.flight import DIGITS, FirstFlight
from floatplan.initial.robots import ChosenRobot
from floatplan.problem.file import file_of
from floatplan.problem.jump import JumpRequest
from floatplan.problem.parts import Posture, SelfClearance
from floatplan.problem.problem import Problem
from floatplan.robot.robot import Robot
from floatplan.robot.urdf.check import LIMITS
from floatplan.robot.wheels import explain_wheels, wheels

USED = {"torque": "torque", "velocity": "velocity"}  # figures of the check, and of which limits they are shares
WIDTH = 110  # [-] characters of a comment
PITCH = "  # degrees, by which it may be turned where it lands, with nothing but feet on the ground"
BARE = re.compile(r"[A-Za-z0-9_-]+")


def problem_file_text(chosen: ChosenRobot, flight: FirstFlight, path: Path) -> str:
    """Return the problem file that goes to ``path``."""
    problem = flight.problem
    blocks = [
        _title(chosen.robot, flight, path),
        ['angles = "deg"', *_ground(problem)],
        _robot(chosen, path),
        _joints(chosen.robot),
        _posture("start", problem.start, chosen.robot),
        _posture("goal", problem.goal, chosen.robot),
        _flight(flight),
        ["[motion]", f"degree = {_value(problem.motion.degree)}", f"objective = {_value(problem.motion.objective)}"],
        _limits(flight),
        *(_apart(pair) for pair in problem.self_clearances),
        *([] if problem.jump is None else _jump(problem.jump, chosen)),
    ]
    return "\n\n".join("\n".join(block) for block in blocks if block) + "\n"


def _title(robot: Robot, flight: FirstFlight, path: Path) -> list[str]:
    name, turn, found = flight.problem.name, math.degrees(flight.turn), flight.jump
    if found is None:
        what = f"{name}, afloat without gravity, turns its base by {turn:.3g} degrees with its joints."
        return [*_comment(what), *_comment(" ".join(flight.reasons))]
    times = round(abs(turn) / 360)
    way = "backwards" if turn * robot.plane.turn > 0 else "forwards"
    does = "jumps" if not turn else f"flips {way}" if times == 1 else f"turns {way} {times} times"
    what = f"{name} stands, {does} and stands again: floatplan jump {path.name}"
    check = found.check
    used = [
        f"{check.figures[key]:.0%} of the {limit} limits" for key, limit in USED.items() if key not in check.unlimited
    ]
    shares = f"take {' and '.join(used)}" if used else "hold"
    checked = (
        "Start and goal are those of its flight, which is proved: floatplan plan plans it alone. Its stances were"
        f" found too, and checked 2000 times a second: they {shares}."
    )
    told = [line for warning in flight.warnings for line in _comment(f"Warning: {warning}")]
    return [*_comment(what), *_comment(checked), *told, *_comment(" ".join(flight.reasons))]


def _ground(problem: Problem) -> list[str]:
    """The key without which a flight that was planned above the ground is another one."""
    return ["ground = true  # the flight keeps above the line on which it takes off"] if problem.ground else []


def _robot(chosen: ChosenRobot, path: Path) -> list[str]:
    robot = chosen.robot
    lines = [
        "[robot]",
        f"{robot.kind} = {_value(file_of(robot, path))}",
        f"plane = {_value(robot.plane.name)}            # of the motion: horizontal and vertical axis of the base",
    ]
    if chosen.stepping:
        lines += _comment(f"It is the plane in which the legs step: {', '.join(chosen.stepping)} bend them.")
    choices = chosen.choices
    if "joints" in choices:
        lines.append(f"joints = {_value(list(choices['joints']))}  # the others carry little and stay locked")
    if choices.get("coupled"):
        mirror = choices["coupled"] == "mirror"
        pairs = {name: asdict(each) | {"offset": _degrees(each.offset)} for name, each in robot.coupled.items()}
        asked = "mirror" if mirror else pairs
        lines.append(f"coupled = {_value(asked)}{'     # left and right move as one' if mirror else ''}")
        follows = (f"{follower} follows {coupling.leader}" for follower, coupling in robot.coupled.items())
        lines += _comment(f"{', '.join(follows)}.")
    if "reference" in choices:
        lines.append(f"reference = {_value(choices['reference'])} # where the other joints are locked")
    if choices.get("locked"):
        places = {name: robot.locked[name] for name in choices["locked"]}
        told = {name: _degrees(at) if robot.layout.tree.joint[name].turns else at for name, at in places.items()}
        lines.append(f"locked = {_value(told)}")
    if robot.balance_inertias:
        lines.append("balance_inertias = true  # of links whose inertia no body can have")
    sliding = [joint.name for joint in robot.layout.tree.joints if joint.name in robot.locked and not joint.turns]
    turning = [name for name in robot.locked if name not in sliding]
    for words, names in (("Locked", turning), ("Held, because joints that slide are not planned", sliding)):
        lines += _comment(f"{words}: {', '.join(names)}.") if names else []
    lines += [line for told in explain_wheels(robot) for line in _comment(f"{told[0].upper()}{told[1:]}.")]
    if chosen.feet:
        held = " They are wheels that their joints hold: those are locked, and the wheels roll with the legs."
        lines += _comment(f"Feet: {', '.join(chosen.feet)}.{held if chosen.on_wheels else ''}")
        bare = [foot for foot in chosen.feet if not robot.stands_on_geometry(robot.frames[foot].link)]
        if bare:
            lines += _comment(f"Without collision geometry in the file they stand on points: {', '.join(bare)}.")
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
        reach = f"{low:.0f} to {high:.0f}" if np.isfinite([low, high]).all() else "no limit"
        rows.append((joint, reach, rate, torque, f"{rest:.0f}"))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    cells = [[cell.ljust(width) for cell, width in zip(row, widths, strict=True)] for row in rows]
    not_meant = [warning for warning in robot.warnings if warning.startswith(LIMITS)]
    remarks = [line for warning in not_meant for line in _comment(f"The file has {warning}.")]
    return [*(f"# {'  '.join(row).rstrip()}" for row in cells), *remarks]


def _posture(table: str, posture: Posture, robot: Robot) -> list[str]:
    lines = [f"[{table}]", f"orientation = {_degrees(posture.angle)}"]
    for key in ("positions", "velocities", "accelerations"):
        angles = np.asarray(getattr(posture, key))
        if key == "positions" or angles.any():
            lines.append(f"{key} = {_value(dict(zip(robot.joints, map(_degrees, angles.tolist()), strict=True)))}")
    return lines


def _flight(flight: FirstFlight) -> list[str]:
    problem = flight.problem
    asked, landing = problem.flight, problem.landing
    lines = ["[flight]", f"duration = {asked.duration!r}  # s", f"angular_momentum = {_value(asked.angular_momentum)}"]
    if flight.jump is None:
        return [*lines, "gravity = 0"]
    lines[-1] += "  # kg m^2/s"
    on_the_ground = problem.ground and (asked.landing is None or asked.landing.height is None)
    height = f", height = {landing.height!r}" if landing.height and not on_the_ground else ""
    return [
        *lines,
        f"horizontal_velocity = {asked.horizontal_velocity!r}  # m/s",
        f"takeoff = {{ frame = {_value(problem.takeoff.frame)} }}",
        f"landing = {{ frame = {_value(landing.frame)}{height} }}",
    ]


def _jump(jump: JumpRequest, chosen: ChosenRobot) -> list[list[str]]:
    margin = ", ".join(f"{name} = {share:g}" for name, share in jump.margin.items())
    shares = "  # shares of the limits that stances may use"
    return [
        [
            "[jump]",
            f"friction = {jump.friction:g}",
            f"margin = {{ {margin} }}{shares}",
            *([f"fixed = {_value(list(jump.fixed))}"] if jump.fixed else []),
            *([f"feet = {_value(jump.feet)}"] if jump.feet != "auto" else []),
            *([f"pitch_error = {_degrees(jump.pitch_error)}{PITCH}"] if jump.pitch_error != USUAL else []),
        ],
        [
            "[jump.takeoff]",
            f"contacts = {_value(jump.takeoff.contacts)}  # what stands, phase by phase; and its pairs",
            *_standing(jump, chosen),
        ],
        ["[jump.landing]", f"contacts = {_value(jump.landing.contacts)}"],
    ]


def _standing(jump: JumpRequest, chosen: ChosenRobot) -> list[str]:
    """The posture from which it jumps, where that is not the reference posture."""
    if not isinstance(jump.takeoff.from_, Mapping):
        return []
    fault = chosen.stance.sought if chosen.stance else ""
    why = f"It does not stand in its reference posture: {fault}. It stands as follows:" if fault else ""
    angles = {joint: _degrees(position) for joint, position in jump.takeoff.from_.items()}
    return [*_comment(why), f"from = {_value(angles)}"]


def _limits(flight: FirstFlight) -> list[str]:
    limits, robot = flight.problem.limits, flight.problem.robot
    lines = ["[limits]"]
    ranges = limits.position if isinstance(limits.position, Mapping) else {}
    ranged = (math.isfinite(low) and math.isfinite(high) for low, high in robot.position_limits.tolist())
    if not all(known or name in ranges for name, known in zip(robot.joints, ranged, strict=True)):
        lines.append("# Joints without a range in their file have -180 to 180 degrees.")
    if ranges:
        of_wheels = set(ranges) & set(wheels(robot))
        reasons = ["a wheel may turn on"] if of_wheels else []
        reasons += ["links do not overlap there"] if set(ranges) - of_wheels else []
        written = {name: [_degrees(end) for end in ends] for name, ends in ranges.items()}
        lines.append(f"position = {_value(written)}  # degrees: {'; '.join(reasons)}")
    fast = f"velocity = {round(math.degrees(FAST), 6):g}  # degrees/s: the file gives none"
    lines.append('velocity = "urdf"' if limits.velocity == "urdf" else fast)
    none = "# torque: the file gives none; a number is for all, N m"
    lines.append('torque = "urdf"' if limits.torque == "urdf" else none)
    if isinstance(limits.acceleration, int | float):
        degrees = round(math.degrees(limits.acceleration))
        lines.append(f"acceleration = {degrees}  # degrees/s^2: locked joints hold then")
    return lines


def _apart(pair: SelfClearance) -> list[str]:
    margin = float(f"{pair.margin:.{DIGITS}g}")
    return [
        "[[self_clearance]]  # else they overlap",
        f"links = {_value(list(pair.links))}",
        f"margin = {margin:g}  # m",
    ]


def _degrees(angle: float) -> float | int:
    """A round number of degrees where it is one, else all digits."""
    degrees = math.degrees(angle)
    rounded = float(f"{degrees:.{DIGITS}g}")
    if abs(degrees - rounded) > 1e-9 * max(1.0, abs(degrees)):
        return degrees
    return int(rounded) if rounded.is_integer() else rounded


def _value(value: Any) -> str:
    """A TOML value: texts are escaped as JSON's are, of which TOML's are a superset."""
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{_key(name)} = {_value(each)}' for name, each in value.items())} }}"
    return json.dumps(value, ensure_ascii=False)


def _key(name: str) -> str:
    return name if BARE.fullmatch(name) else _value(name)


def _comment(text: str) -> list[str]:
    return [f"# {line}" for line in wrap(" ".join(text.split()), WIDTH, break_long_words=False)]
