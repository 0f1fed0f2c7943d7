"""Changes of a problem that are more than a number at a path."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Literal, TypeAlias

import numpy as np

import floatplan as fp
from floatplan.problem.parts import Obstacle

Edit: TypeAlias = Callable[[fp.Problem], fp.Problem]
LimitChoice: TypeAlias = Literal["none", "urdf", "by hand"]

AMPLE = 1.2  # [-] of what the present motion needs: limits by hand begin there


def numbers(values: Mapping[str, float]) -> Edit:
    """Set numbers by the paths of a problem file, in SI units and radians."""

    def edit(problem: fp.Problem) -> fp.Problem:
        return fp.Family(problem, {path: np.array([float(value)]) for path, value in values.items()})[0]

    return edit


def flight(**changes: Any) -> Edit:
    """Change fields of the flight, such as ``angular_momentum="free"``."""
    return lambda problem: replace(problem, flight=replace(problem.flight, **changes))


def motion(**changes: Any) -> Edit:
    """Change degree or objective."""
    return lambda problem: replace(problem, motion=replace(problem.motion, **changes))


def ground(wanted: bool) -> Edit:
    """Ask for the ground, or no longer."""
    return lambda problem: replace(problem, ground=wanted)


def limit(key: Literal["velocity", "torque"], choice: LimitChoice, needed: Mapping[str, float]) -> Edit:
    """Choose where a limit comes from; by hand, it begins with a little more than is ``needed`` (motor -> value)."""

    def edit(problem: fp.Problem) -> fp.Problem:
        value: Any = choice
        if choice == "by hand":
            value = {motor: AMPLE * max(need, 1e-3) for motor, need in needed.items()}
        motors = {} if key == "torque" else problem.limits.motor
        return replace(problem, limits=replace(problem.limits, **{key: value}, motor=motors))

    return edit


def with_obstacle(obstacle: Obstacle) -> Edit:
    """Add an obstacle."""
    return lambda problem: replace(problem, obstacles=(*problem.obstacles, obstacle))


def without_obstacle(index: int) -> Edit:
    """Take an obstacle away; one that is gone already stays so."""
    return lambda problem: replace(
        problem, obstacles=tuple(each for number, each in enumerate(problem.obstacles) if number != index)
    )


def moved_obstacle(index: int, by: complex) -> Edit:
    """Move an obstacle, m."""

    def edit(problem: fp.Problem) -> fp.Problem:
        if index >= len(problem.obstacles):
            return problem
        moved = list(problem.obstacles)
        obstacle = moved[index]
        places = {name: _moved(getattr(obstacle, name), by) for name in ANCHORS if hasattr(obstacle, name)}
        moved[index] = replace(obstacle, **places)
        return replace(problem, obstacles=tuple(moved))

    return edit


ANCHORS = ("center", "point", "start", "end")  # fields of obstacles that are places


def _moved(place: tuple[float, float], by: complex) -> tuple[float, float]:
    return float(place[0] + by.real), float(place[1] + by.imag)
