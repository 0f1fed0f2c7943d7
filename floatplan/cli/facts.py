"""Results of ``floatplan info`` and ``floatplan bounds`` as plain data: the objects that ``--json`` prints."""

from __future__ import annotations

from typing import Any

from floatplan.files import plain
from floatplan.motion.planar.bounds import angular_momentum_interval, inertia_extremes
from floatplan.problem.limits import position_limits
from floatplan.problem.parts import Limits
from floatplan.problem.problem import Problem
from floatplan.robot.leak import explain_leak, out_of_plane_leak
from floatplan.robot.robot import Robot


def robot_facts(robot: Robot) -> dict[str, Any]:
    """Return a robot's properties; lists in the order of ``joints``, ``None`` for a limit that is not given.

    The extremes of D are those over the joint ranges of the URDF, [-pi, pi] where it gives none.
    """
    low, high = inertia_extremes(robot, position_limits(robot, Limits()))
    leak = out_of_plane_leak(robot)
    facts: dict[str, Any] = plain(
        {
            "name": robot.name,
            "joints": robot.joints,
            "locked": dict(robot.locked),
            "coupled": {
                follower: {"leader": coupling.leader, "ratio": coupling.ratio, "offset": coupling.offset}
                for follower, coupling in robot.coupled.items()
            },
            "plane": {
                "name": robot.plane.name,
                "horizontal": robot.plane.horizontal,
                "vertical": robot.plane.vertical,
                "normal": robot.plane.normal,
            },
            "mass": robot.mass,
            "position_limits": robot.position_limits,
            "velocity_limits": robot.velocity_limits,
            "torque_limits": robot.torque_limits,
            "motors": robot.motors,
            "motor_torque_limits": robot.motor_torque_limits,
            "motor_velocity_limits": robot.motor_velocity_limits,
            "D_min": low,
            "D_max": high,
            "frames": sorted(robot.frames),
            "shapes": [
                {"link": shape.link, "length": abs(shape.end - shape.start), "radius": shape.radius}
                for shape in robot.shapes
            ],
            "out_of_plane_leak": leak,
            "tilt": robot.tilt,
            "warnings": [*robot.warnings, *filter(None, [explain_leak(robot, leak)])],
        }
    )
    return facts


def momentum_facts(problem: Problem) -> dict[str, Any]:
    """Return (7)-(10): the extremes of D over the problem's joint ranges, the interval for h and its midpoint."""
    low, high = inertia_extremes(problem.robot, problem.position_limits)
    interval = angular_momentum_interval(problem)
    facts: dict[str, Any] = plain(
        {
            "angular_momentum_bounds": interval,
            "angular_momentum_midpoint": sum(interval) / 2,
            "D_min": low,
            "D_max": high,
        }
    )
    return facts
