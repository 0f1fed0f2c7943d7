"""Jumps in space of a robot with feet that are points: rolls, twists, turns and jumps aside, as problem files."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.arguments import without
from floatplan.errors import InputError
from floatplan.initial.robots import chosen_robot
from floatplan.initial.text import comment_lines, degrees_of, rotors_comment, toml_value
from floatplan.jumps.spatial.setup import SpatialSetup, spatial_setup
from floatplan.problem.attitude import Attitude
from floatplan.problem.file import file_of
from floatplan.problem.jump import JumpLanding, JumpRequest
from floatplan.problem.parts import Flight, Limits, Posture, Takeoff
from floatplan.problem.problem import Problem
from floatplan.robot.robot import Robot
from floatplan.tables import GRAVITY


@dataclass(frozen=True)
class Stunt:
    """A jump in space.

    Attributes
    ----------
    does : what the robot does between standing and standing, in a sentence
    axes : of the base's angles, the largest rotation's first
    meaning : of these axes
    angles : of the goal, degrees
    displacement : forwards and to the left, in heights of the centre of mass where the robot stands; free if None
    """

    does: str
    axes: str
    meaning: str
    angles: tuple[float, float, float] = (0.0, 0.0, 0.0)
    displacement: tuple[float, float] | None = None


STUNTS = {
    "roll": Stunt("rolls once about its long axis, over its right legs,", "xyz", "roll about x, ..", (360, 0, 0)),
    "roll-left": Stunt("rolls once about its long axis, over its left legs,", "xyz", "roll about x, ..", (-360, 0, 0)),
    "half-twist": Stunt(
        does="flips backwards by a half and twists by a half, so that it looks back,",
        axes="yzx",
        meaning="flip about y, tilt about z, twist about x",
        angles=(-180, 0, 180),
    ),
    "backflip": Stunt("flips backwards once", "yxz", "flip about y, tilt about x, twist about z", (-360, 0, 0)),
    "turn": Stunt("jumps and yaws to its left by a quarter", "zyx", "yaw about z, ..", (90, 0, 0)),
    "half-turn": Stunt("jumps and yaws to its left by a half", "zyx", "yaw about z, ..", (180, 0, 0)),
    "side": Stunt("jumps to its left", "zyx", "level throughout", displacement=(0.0, 1.2)),
    "diagonal": Stunt("jumps forwards and to its left", "zyx", "level throughout", displacement=(0.85, 0.85)),
}


def stunt_file_text(source: str, name: str, robot_options: Mapping[str, Any], path: Path) -> str:
    """Return the problem file of a jump in space that goes to ``path``; it has been resolved, not planned.

    Parameters
    ----------
    source : the robot's file
    name : of the stunt, of ``STUNTS``
    robot_options : "reference" and "balance_inertias", as of ``Robot.from_urdf``; others are for planes
    path : of the problem file

    Raises
    ------
    InputError
        The stunt is unknown, an option is for planes, the file is not sound, or the robot has no feet, or none that
        are points.
    """
    if name not in STUNTS:
        raise InputError(f"there is no stunt {name!r}", element="stunt", advice=f"give {', '.join(STUNTS)}")
    planar = without(robot_options, ("reference", "balance_inertias"))
    if planar:
        reason = "is for jumps in a plane; of a jump in space every joint moves on its own"
        raise InputError(reason, element=next(iter(planar)), advice="leave it out, or --stunt")
    chosen = chosen_robot(source, robot_options)
    if not chosen.feet:
        raise InputError("no foot was recognised on which it could stand", source=source, element="stunt")
    options = {key: value for key, value in chosen.choices.items() if key in ("reference", "balance_inertias")}
    options |= robot_options
    robot = Robot.from_urdf(source, base="free-flyer", **options)
    stunt = STUNTS[name]
    problem = _problem(robot, stunt, name, chosen.feet[-1])
    assert problem.jump is not None
    setup = spatial_setup(problem, problem.jump)
    return _text(robot, stunt, setup, options, path)


def _problem(robot: Robot, stunt: Stunt, name: str, foot: str) -> Problem:
    """The problem of a stunt, but for where it lands."""
    positions = np.deg2rad(np.round(np.rad2deg(robot.resting), 1))
    a, b, c = np.deg2rad(stunt.angles).tolist()
    start = Posture(Attitude(angles=(0.0, 0.0, 0.0), axes=stunt.axes), positions)
    goal = Posture(Attitude(angles=(a, b, c), axes=stunt.axes), positions)
    has_rates = bool(np.isfinite(robot.motor_velocity_limits).any())
    has_torques = bool(np.isfinite(robot.motor_torque_limits).any())
    return Problem(
        robot,
        start,
        goal,
        Flight(0.4, angular_momentum="free", takeoff=Takeoff(foot)),
        limits=Limits(velocity="urdf" if has_rates else "none", torque="urdf" if has_torques else "none"),
        name=f"{robot.name}_{name.replace('-', '_')}",
        jump=JumpRequest(landing=JumpLanding(displacement=stunt.displacement)),
    )


def _text(robot: Robot, stunt: Stunt, setup: SpatialSetup, options: Mapping[str, Any], path: Path) -> str:
    problem = setup.problem
    request = setup.request
    height = float(setup.ends.y[0, 2])  # of the centre of mass where it stands, m
    usual = 2.25 * math.sqrt(height / GRAVITY)  # s, of flights of quadrupeds
    flight = next(phase for phase in setup.phases if phase.side == "flight")
    duration = float(f"{min(usual, flight.duration):.1g}")
    chosen = [f"{key} = {toml_value(value)}" for key, value in options.items()]
    meaning = f"  # {stunt.meaning}"
    blocks = [
        [
            *comment_lines(f"{robot.name} stands, {stunt.does} and stands again: floatplan jump {path.name}"),
            *comment_lines(
                "Start, goal and duration of the flight are a guess, but for the goal's angles; which legs leave last"
                f" is chosen by the search: here first {_phases(setup)}."
            ),
            'angles = "deg"',
            f"name = {toml_value(problem.name)}",
        ],
        [
            "[robot]",
            f"{robot.kind} = {toml_value(file_of(robot, path))}",
            'base = "free-flyer"',
            *chosen,
            *rotors_comment(robot),
        ],
        ["[start]", _orientation((0.0, 0.0, 0.0), stunt.axes) + meaning, _positions(problem.start)],
        ["[goal]", _orientation(stunt.angles, stunt.axes), _positions(problem.goal)],
        [
            "[flight]",
            f"duration = {duration:g}  # s",
            'angular_momentum = "free"',
            f"takeoff = {{ frame = {toml_value(problem.takeoff.frame)} }}",
        ],
        ["[limits]", *_limits(problem)],
        [
            "[jump]",
            f"friction = {request.friction:g}",
            f"margin = {toml_value(dict(request.margin))}  # shares of the limits that stances may use",
        ],
    ]
    if stunt.displacement is not None:
        # Legs that are too slow for a usual flight are as slow sideways, and in the air for as much less time.
        slowness = min(1.0, flight.duration / usual) ** 2
        metres = [round(slowness * share * height, 2) for share in stunt.displacement]
        meaning = "# m, from standing to standing: forwards, to the left"
        blocks.append(["[jump.landing]", f"displacement = {toml_value(metres)}  {meaning}"])
    return "\n\n".join("\n".join(block) for block in blocks) + "\n"


def _phases(setup: SpatialSetup) -> str:
    """Which feet stand before takeoff and after landing, for a person."""
    stands = [" and ".join(phase.frames) or "none" for phase in setup.phases]
    return ", then ".join(stands)


def _orientation(angles: tuple[float, float, float], axes: str) -> str:
    return (
        f"orientation = {toml_value({'angles': [degrees_of(math.radians(angle)) for angle in angles], 'axes': axes})}"
    )


def _positions(posture: Posture) -> str:
    positions = np.asarray(posture.positions).tolist()
    return f"positions = {toml_value([degrees_of(position) for position in positions])}"


def _limits(problem: Problem) -> list[str]:
    """Limits of the robot's file, or how to give others."""
    lines = []
    for key, unit in (("velocity", "degrees/s"), ("torque", "N m")):
        if getattr(problem.limits, key) == "urdf":
            lines.append(f'{key} = "urdf"')
        else:
            lines.append(f"# {key}: the file gives none; a number is for all, {unit}")
    return lines
