"""Tabs of limits and of obstacles: what is there, with sliders."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

import floatplan as fp
from floatplan.problem.parts import OBSTACLE_KINDS, Obstacle
from floatplan.studio.panel.cards import limits_card, put
from floatplan.studio.panel.dials import Choices, Dial, Dials
from floatplan.studio.session.actions import Actions, on
from floatplan.studio.session.edits import (
    BY_HAND,
    Edit,
    limit,
    limit_choice,
    limit_of,
    limit_paths,
    with_obstacle,
    without_obstacle,
)
from floatplan.studio.session.session import Session, View
from floatplan.tables import LIMIT_TABLE, LimitKey

LEAST = 0.01  # [-] of a slider's end
WIDE = 3.0  # [-] of what the first motion needs, where the URDF has no limit: a slider's end
REACH = 2.0  # [m] that a place's slider reaches, to both sides


class LimitsTab:
    """Limits of joints and motors."""

    def __init__(self, gui: Any, session: Session, dials: Dials, choices: Choices) -> None:
        self._session, self._choices, self._dials = session, choices, dials
        self._sliders: dict[LimitKey, list[Any]] = {
            key: self._add(key) for key, row in LIMIT_TABLE.items() if row.of != "base"
        }
        self._table = gui.add_html("")

    def draw(self, view: View) -> None:
        """Show sliders where they count, and the table."""
        put(self._table, limits_card(view.flown))
        for key, sliders in self._sliders.items():
            wanted = limit_choice(view.problem, key) == BY_HAND
            for slider in sliders:
                if slider.visible != wanted:
                    slider.visible = wanted

    def _add(self, key: LimitKey) -> list[Any]:
        robot = self._session.view.problem.robot
        in_urdf = LIMIT_TABLE[key].in_urdf
        of_urdf = getattr(robot, f"motor_{key}_limits") if in_urdf else np.full(len(robot.motors), math.inf)
        words = ("none", "urdf", BY_HAND) if np.isfinite(of_urdf).any() else ("none", BY_HAND)
        self._choices.add(
            f"{key} limit",
            words,
            lambda each: limit_choice(each, key),
            lambda word: limit(key, word, self._needed(key)),
        )
        needed = self._needed(key)
        ends = {
            motor: float(value) if math.isfinite(value) else WIDE * max(needed[motor], 1e-3)
            for motor, value in zip(robot.motors, of_urdf.tolist(), strict=True)
        }
        problem = self._session.view.problem
        return [self._dials.add(self._dial(robot, key, joint, ends[joint]), problem) for joint in robot.joints]

    def _dial(self, robot: fp.Robot, key: LimitKey, joint: str, end: float) -> Dial:
        return Dial(
            f"{joint}, {LIMIT_TABLE[key].unit}",
            limit_paths(robot, key, joint),
            lambda each: limit_of(each, key, joint),
            LEAST * end,
            end,
        )

    def _needed(self, key: LimitKey) -> Mapping[str, float]:
        """Peaks of the present motion, by motor."""
        flown, robot = self._session.view.flown, self._session.view.problem.robot
        peaks = {} if flown is None else {row.joint: getattr(row, f"{key}_peak") for row in flown.utilisation}
        return {motor: float(peaks.get(motor, 1.0)) for motor in robot.motors}


class ObstaclesTab:
    """A folder of sliders for each obstacle; ``free_place`` is where a new one goes, and the robot's size, m."""

    def __init__(
        self, gui: Any, tab: Any, session: Session, actions: Actions, dials: Dials, free_place: tuple[complex, float]
    ) -> None:
        self._gui, self._tab, self._session, self._actions, self._dials = gui, tab, session, actions, dials
        self._kinds: list[str] = []
        self._folders: list[Any] = []
        self._sliders: list[Any] = []
        for kind, known in OBSTACLE_KINDS.items():
            button = gui.add_button(f"Add a {kind}", color="gray")
            on(button.on_click, partial(self._edit, with_obstacle(known.example(*free_place))))

    def draw(self, view: View) -> None:
        """List the obstacles anew where there are others."""
        kinds = [obstacle.kind for obstacle in view.problem.obstacles]
        if kinds == self._kinds:
            return
        self._dials.forget(self._sliders)
        for folder in self._folders:
            folder.remove()
        self._folders, self._sliders = [], []
        with self._tab:
            self._folders = [self._folder(view.problem, index) for index in range(len(kinds))]
        self._kinds = kinds

    def _folder(self, problem: fp.Problem, index: int) -> Any:
        obstacle = problem.obstacles[index]
        with self._gui.add_folder(f"{obstacle.kind} {index}") as folder:
            self._sliders += [self._dials.add(dial, problem) for dial in obstacle_dials(index, obstacle)]
            remove = self._gui.add_button("Remove", color="gray")
            on(remove.on_click, partial(self._edit, without_obstacle(index)))
        return folder

    def _edit(self, edit: Edit, event: Any) -> None:
        self._actions.do(f"obstacles {id(event)}", lambda: self._session.edit(edit))


def obstacle_dials(index: int, obstacle: Obstacle) -> list[Dial]:
    """Sliders of an obstacle: its places, radius and margin."""
    dials = []
    for name in obstacle.places():
        for axis, place in enumerate(getattr(obstacle, name)):
            label = f"{name} {'→↑'[axis]}, m"
            dials.append(_dial(index, f"{name}.{axis}", label, float(place) - REACH, float(place) + REACH))
    if hasattr(obstacle, "radius"):
        dials.append(_dial(index, "radius", "radius, m", 0.0, max(1.0, 2 * obstacle.radius)))
    dials.append(_dial(index, "margin", "margin, m", 0.0, max(0.3, 2 * obstacle.margin)))
    return dials


def _dial(index: int, path: str, label: str, low: float, high: float) -> Dial:
    name, _, axis = path.partition(".")

    def get(problem: fp.Problem) -> float:
        value = getattr(problem.obstacles[index], name)
        return float(value[int(axis)] if axis else value)

    return Dial(label, (f"obstacles.{index}.{path}",), get, low, high)
