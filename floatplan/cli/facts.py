"""Results of ``floatplan info`` and ``floatplan bounds`` as plain data: the objects that ``--json`` prints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, get_args

from floatplan.files import plain
from floatplan.motion.flight import End, Reachable, angular_momentum_interval, inertia_extremes
from floatplan.problem.parts import Limits
from floatplan.problem.problem import Problem
from floatplan.problem.resolution import position_limits
from floatplan.robot.leak import explain_leak, out_of_plane_leak
from floatplan.robot.robot import Robot

OF_ROBOT = (  # as they are
    *("name", "joints", "mass", "position_limits", "velocity_limits", "torque_limits"),
    *("motors", "motor_torque_limits", "motor_velocity_limits", "tilt"),
)
OF_ENDS = ("asked", "angular_momentum_bounds", "horizontal_velocity_bounds", "vertical_velocity_bounds", "polygon")


def robot_facts(robot: Robot) -> dict[str, Any]:
    """Return a robot's properties; lists in the order of ``joints``, ``None`` for a limit that is not given.

    The extremes of D are those over the joint ranges of the URDF, [-pi, pi] where it gives none.
    """
    low, high = inertia_extremes(robot, position_limits(robot, Limits()))
    leak = out_of_plane_leak(robot)
    facts: dict[str, Any] = plain(
        {
            **{name: getattr(robot, name) for name in OF_ROBOT},
            "locked": dict(robot.locked),
            **{name: dict(getattr(robot, name)) for name in ("armature", "damping", "friction")},
            "coupled": {follower: asdict(coupling) for follower, coupling in robot.coupled.items()},
            "plane": {name: getattr(robot.plane, name) for name in ("name", "horizontal", "vertical", "normal")},
            "D_min": low,
            "D_max": high,
            "frames": sorted(robot.frames),
            "shapes": [
                {"link": shape.link, "length": abs(shape.end - shape.start), "radius": shape.radius}
                for shape in robot.shapes
            ],
            "out_of_plane_leak": leak,
            "warnings": [*robot.warnings, *filter(None, [explain_leak(robot, leak)])],
        }
    )
    return facts


def momentum_facts(problem: Problem, sets: Mapping[str, Reachable]) -> dict[str, Any]:
    """Return (7)-(10): the extremes of D over the problem's joint ranges, the interval for h and its midpoint.

    Beside them what joint rates reach at each end: null where no frame stands there or nothing is reached, and ends of
    intervals null where they are not bounded.
    """
    low, high = inertia_extremes(problem.robot, problem.position_limits)
    interval = angular_momentum_interval(problem)
    facts: dict[str, Any] = plain(
        {
            "angular_momentum_bounds": interval,
            "angular_momentum_midpoint": sum(interval) / 2,
            "D_min": low,
            "D_max": high,
            **{
                f"{end}_{key}": getattr(sets.get(end), key.removesuffix("_bounds"), None)
                for end in get_args(End)
                for key in OF_ENDS
            },
        }
    )
    return facts
