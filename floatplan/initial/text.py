"""A first flight as a problem file: commented, in degrees, with what was chosen and what could be chosen otherwise."""

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
from floatplan.initial.flight import DIGITS, FirstFlight
from floatplan.initial.robots import ChosenRobot
from floatplan.initial.shortcomings import USUAL_PITCH_ERROR
from floatplan.problem.file import file_of
from floatplan.problem.jump import JumpRequest
from floatplan.problem.parts import Posture, SelfClearance
from floatplan.robot.robot import Robot
from floatplan.robot.urdf.check import LIMITS
from floatplan.robot.wheels import explain_wheels, wheels


def problem_file_text(chosen: ChosenRobot, flight: FirstFlight, path: Path) -> str:
    """Return the problem file that goes to ``path``."""
    problem = flight.problem
    ground = ["ground = true  # the flight keeps above the line on which it takes off"] if problem.ground else []
    blocks = [
        _title(chosen.robot, flight, path),
        ['angles = "deg"', *ground],
        _robot(chosen, path),
        _joints(chosen.robot),
        _posture("start", problem.start, chosen.robot),
        _posture("goal", problem.goal, chosen.robot),
        _flight(flight),
        [
            "[motion]",
            f"degree = {toml_value(problem.motion.degree)}",
            f"objective = {toml_value(problem.motion.objective)}",
        ],
        _limits(flight),
        *map(_self_clearance, problem.self_clearances),
        *([] if problem.jump is None else _jump(problem.jump, chosen)),
    ]
    return "\n\n".join("\n".join(block) for block in blocks if block) + "\n"


def _title(robot: Robot, flight: FirstFlight, path: Path) -> list[str]:
    name = flight.problem.name
    degrees = math.degrees(flight.base_rotation)
    reasons = comment_lines(" ".join(flight.reasons))
    if flight.jump is None:
        summary = f"{name}, afloat without gravity, turns its base by {degrees:.3g} degrees with its joints."
        return [*comment_lines(summary), *reasons]
    times = round(abs(degrees) / 360)
    direction = "backwards" if degrees * robot.plane.turn > 0 else "forwards"
    verb = "jumps"
    if degrees:
        verb = f"flips {direction}" if times == 1 else f"turns {direction} {times} times"
    lines = comment_lines(f"{name} stands, {verb} and stands again: floatplan jump {path.name}")
    check = flight.jump.check
    limits = [limit for limit in ("torque", "velocity") if limit not in check.unlimited]
    shares = [f"{check.figures[limit]:.0%} of the {limit} limits" for limit in limits]
    stances = f"they take {' and '.join(shares)}" if shares else "they hold"
    lines += comment_lines(
        "Start and goal are those of its flight, which is proved: floatplan plan plans it alone. Its stances were"
        f" found too, and checked 2000 times a second: {stances}."
    )
    for warning in flight.warnings:
        lines += comment_lines(f"Warning: {warning}")
    return [*lines, *reasons]


def _robot(chosen: ChosenRobot, path: Path) -> list[str]:
    robot = chosen.robot
    lines = [
        "[robot]",
        f"{robot.kind} = {toml_value(file_of(robot, path))}",
        f"plane = {toml_value(robot.plane.name)}            # of the motion: horizontal and vertical axis of the base",
    ]
    if chosen.stepping:
        lines += comment_lines(f"It is the plane in which the legs step: {', '.join(chosen.stepping)} bend them.")
    choices = chosen.choices
    if "joints" in choices:
        lines.append(f"joints = {toml_value(list(choices['joints']))}  # the others carry little and stay locked")
    if choices.get("coupled"):
        lines += _coupled(choices["coupled"], robot)
    if "reference" in choices:
        lines.append(f"reference = {toml_value(choices['reference'])} # where the other joints are locked")
    if choices.get("locked"):
        positions = {}
        for name in choices["locked"]:
            position = robot.locked[name]
            positions[name] = degrees_of(position) if robot.layout.tree.joint[name].turns else position
        lines.append(f"locked = {toml_value(positions)}")
    if robot.balance_inertias:
        lines.append("balance_inertias = true  # of links whose inertia no body can have")
    lines += rotors_comment(robot)
    sliding = [joint.name for joint in robot.layout.tree.joints if joint.name in robot.locked and not joint.turns]
    rotating = [name for name in robot.locked if name not in sliding]
    if rotating:
        lines += comment_lines(f"Locked: {', '.join(rotating)}.")
    if sliding:
        lines += comment_lines(f"Held, because joints that slide are not planned: {', '.join(sliding)}.")
    for sentence in explain_wheels(robot):
        lines += comment_lines(f"{sentence[0].upper()}{sentence[1:]}.")
    return lines + _feet(chosen)


def rotors_comment(robot: Robot) -> list[str]:
    """How to state rotors, where none are known."""
    if any(robot.armature.values()):
        return []
    meaning = "a rotor's inertia times the square of its gear ratio"
    return [f"# armature: no rotors are known; a number is for all, kg m^2: {meaning}"]


def _coupled(coupled: Any, robot: Robot) -> list[str]:
    """The key ``coupled``, "mirror" or all couplings, and which joint follows which."""
    couplings = {}
    follows = []
    for follower, coupling in robot.coupled.items():
        couplings[follower] = asdict(coupling) | {"offset": degrees_of(coupling.offset)}
        follows.append(f"{follower} follows {coupling.leader}")
    line = f"coupled = {toml_value(couplings)}"
    if coupled == "mirror":
        line = 'coupled = "mirror"     # left and right move as one'
    return [line, *comment_lines(f"{', '.join(follows)}.")]


def _feet(chosen: ChosenRobot) -> list[str]:
    """A comment on the feet."""
    if not chosen.feet:
        return []
    text = f"Feet: {', '.join(chosen.feet)}."
    if chosen.on_wheels:
        text += " They are wheels that their joints hold: those are locked, and the wheels roll with the legs."
    lines = comment_lines(text)
    robot = chosen.robot
    points = [foot for foot in chosen.feet if not robot.stands_on_geometry(robot.frames[foot].link)]
    if points:
        lines += comment_lines(f"Without collision geometry in the file they stand on points: {', '.join(points)}.")
    return lines


def _joints(robot: Robot) -> list[str]:
    """A comment with range, rate and torque of each planned joint."""
    rows = [("joint", "range, degrees", "rate, rad/s", "torque, N m", "at rest, degrees")]
    ranges = np.rad2deg(robot.position_limits)
    for joint, (low, high), resting in zip(robot.joints, ranges, np.rad2deg(robot.resting), strict=True):
        motor = robot.motors.index(joint)
        rate = _limit(robot.motor_velocity_limits[motor])
        torque = _limit(robot.motor_torque_limits[motor])
        position = f"{low:.0f} to {high:.0f}" if np.isfinite([low, high]).all() else "no limit"
        rows.append((joint, position, rate, torque, f"{resting:.0f}"))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        cells = [cell.ljust(width) for cell, width in zip(row, widths, strict=True)]
        lines.append(f"# {'  '.join(cells).rstrip()}")
    for warning in robot.warnings:
        if warning.startswith(LIMITS):
            lines += comment_lines(f"The file has {warning}.")
    return lines


def _limit(limit: float) -> str:
    return f"{limit:.4g}" if math.isfinite(limit) else "no limit"


def _posture(table: str, posture: Posture, robot: Robot) -> list[str]:
    lines = [f"[{table}]", f"orientation = {degrees_of(posture.angle)}"]
    for key in ("positions", "velocities", "accelerations"):
        angles = np.asarray(getattr(posture, key))
        if key == "positions" or angles.any():
            lines.append(
                f"{key} = {toml_value(dict(zip(robot.joints, map(degrees_of, angles.tolist()), strict=True)))}"
            )
    return lines


def _flight(flight: FirstFlight) -> list[str]:
    problem = flight.problem
    free = problem.flight
    landing = problem.landing
    duration = f"duration = {free.duration!r}  # s"
    momentum = f"angular_momentum = {toml_value(free.angular_momentum)}"
    if flight.jump is None:
        return ["[flight]", duration, momentum, "gravity = 0"]
    on_the_ground = problem.ground and (free.landing is None or free.landing.height is None)
    height = f", height = {landing.height!r}" if landing.height and not on_the_ground else ""
    return [
        "[flight]",
        duration,
        f"{momentum}  # kg m^2/s",
        f"horizontal_velocity = {free.horizontal_velocity!r}  # m/s",
        f"takeoff = {{ frame = {toml_value(problem.takeoff.frame)} }}",
        f"landing = {{ frame = {toml_value(landing.frame)}{height} }}",
    ]


def _jump(jump: JumpRequest, chosen: ChosenRobot) -> list[list[str]]:
    margin = ", ".join(f"{name} = {share:g}" for name, share in jump.margin.items())
    general = [
        "[jump]",
        f"friction = {jump.friction:g}",
        f"margin = {{ {margin} }}  # shares of the limits that stances may use",
    ]
    if jump.fixed:
        general.append(f"fixed = {toml_value(list(jump.fixed))}")
    if jump.feet != "auto":
        general.append(f"feet = {toml_value(jump.feet)}")
    if jump.pitch_error != USUAL_PITCH_ERROR:
        meaning = "degrees, by which it may be turned where it lands, with nothing but feet on the ground"
        general.append(f"pitch_error = {degrees_of(jump.pitch_error)}  # {meaning}")
    takeoff = [
        "[jump.takeoff]",
        f"contacts = {toml_value(jump.takeoff.contacts)}  # what stands, phase by phase; and its pairs",
        *_standing(jump, chosen),
    ]
    return [general, takeoff, ["[jump.landing]", f"contacts = {toml_value(jump.landing.contacts)}"]]


def _standing(jump: JumpRequest, chosen: ChosenRobot) -> list[str]:
    """The posture from which it jumps, where that is not the reference posture."""
    if not isinstance(jump.takeoff.from_, Mapping):
        return []
    fault = chosen.stance.fault if chosen.stance else ""
    reason = f"It does not stand in its reference posture: {fault}. It stands as follows:" if fault else ""
    angles = {joint: degrees_of(position) for joint, position in jump.takeoff.from_.items()}
    return [*comment_lines(reason), f"from = {toml_value(angles)}"]


def _limits(flight: FirstFlight) -> list[str]:
    limits = flight.problem.limits
    robot = flight.problem.robot
    lines = ["[limits]"]
    ranges = limits.position if isinstance(limits.position, Mapping) else {}
    has_range: list[bool] = np.all(np.isfinite(robot.position_limits), axis=1).tolist()
    if not all(limited or name in ranges for name, limited in zip(robot.joints, has_range, strict=True)):
        lines.append("# Joints without a range in their file have -180 to 180 degrees.")
    if ranges:
        of_wheels = set(ranges) & set(wheels(robot))
        reasons = ["a wheel may turn on"] if of_wheels else []
        reasons += ["links do not overlap there"] if set(ranges) - of_wheels else []
        written = {name: list(map(degrees_of, ends)) for name, ends in ranges.items()}
        lines.append(f"position = {toml_value(written)}  # degrees: {'; '.join(reasons)}")
    fast = f"velocity = {round(math.degrees(FAST), 6):g}  # degrees/s: the file gives none"
    lines.append('velocity = "urdf"' if limits.velocity == "urdf" else fast)
    none = "# torque: the file gives none; a number is for all, N m"
    lines.append('torque = "urdf"' if limits.torque == "urdf" else none)
    if isinstance(limits.acceleration, int | float):
        degrees = round(math.degrees(limits.acceleration))
        lines.append(f"acceleration = {degrees}  # degrees/s^2: locked joints hold then")
    return lines


def _self_clearance(pair: SelfClearance) -> list[str]:
    margin = float(f"{pair.margin:.{DIGITS}g}")
    return [
        "[[self_clearance]]  # else they overlap",
        f"links = {toml_value(list(pair.links))}",
        f"margin = {margin:g}  # m",
    ]


def degrees_of(angle: float) -> float | int:
    """A round number of degrees where it is one, else all digits."""
    degrees = math.degrees(angle)
    rounded = float(f"{degrees:.{DIGITS}g}")
    if abs(degrees - rounded) > 1e-9 * max(1.0, abs(degrees)):
        return degrees
    return int(rounded) if rounded.is_integer() else rounded


def toml_value(value: Any) -> str:
    """A TOML value: texts are escaped as JSON's are, of which TOML's are a superset."""
    if isinstance(value, Mapping):
        entries = []
        for name, entry in value.items():
            key = name if re.fullmatch("[A-Za-z0-9_-]+", name) else toml_value(name)
            entries.append(f"{key} = {toml_value(entry)}")
        return f"{{ {', '.join(entries)} }}"
    return json.dumps(value, ensure_ascii=False)


def comment_lines(text: str) -> list[str]:
    """Return a text as lines of a comment."""
    return [f"# {line}" for line in wrap(" ".join(text.split()), width=110, break_long_words=False)]
