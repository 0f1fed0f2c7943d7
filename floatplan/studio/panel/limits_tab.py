"""The tab of limits: where they come from, sliders where they are set by hand, and how much of them is used."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, get_args

import numpy as np

import floatplan as fp
from floatplan.studio.panel.cards import limits_card, put
from floatplan.studio.panel.choices import Choices
from floatplan.studio.panel.dials import Dial, Dials
from floatplan.studio.session.edits import BY_HAND, LimitKey, limit, limit_choice, limit_of, limit_paths
from floatplan.studio.session.session import Session, View
from floatplan.tables import LIMIT_TABLE

LEAST = 0.01  # [-] of a slider's end
WIDE = 3.0  # [-] of what the first motion needs, where the URDF has no limit: a slider's end


class LimitsTab:
    """Limits of velocities and torques."""

    def __init__(self, gui: Any, session: Session, dials: Dials, choices: Choices) -> None:
        self._session, self._choices, self._dials = session, choices, dials
        self._sliders: dict[LimitKey, list[Any]] = {key: self._add(key) for key in get_args(LimitKey)}
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
        of_urdf = getattr(robot, f"motor_{key}_limits")
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
