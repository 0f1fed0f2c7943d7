"""Sliders of numbers of the problem, by their paths, and choices of words and ticks.

A slider does not fight with the user who holds it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import floatplan as fp
from floatplan.studio.session.actions import Actions, by_user
from floatplan.studio.session.edits import Edit, numbers
from floatplan.studio.session.session import Session

RELEASED = 0.7  # [s] after the user's last touch, before a slider follows the session
STEPS = 400  # [-] of a slider
FINER = 2  # [-] decimals that are shown beyond those of a step


@dataclass(frozen=True)
class Dial:
    """A number that a slider shows.

    Attributes
    ----------
    label : beside it
    paths : in a problem file; all get the value
    get : reads it, SI units and radians
    low, high : of the slider, SI units and radians
    unit : what the slider's numbers are in: one of them in SI units
    hint : for a person
    """

    label: str
    paths: Sequence[str]
    get: Callable[[fp.Problem], float]
    low: float
    high: float
    unit: float = 1.0
    hint: str = ""


@dataclass(eq=False)
class Shown:
    """A slider, what it shows and with how many decimals, and when the user last touched it, s."""

    slider: Any
    dial: Dial
    digits: int
    touched: float = -1e9


class Dials:
    """Sliders; each follows the session unless the user holds it."""

    def __init__(self, gui: Any, session: Session, actions: Actions) -> None:
        self._gui, self._session, self._actions = gui, session, actions
        self.shown: list[Shown] = []

    def add(self, dial: Dial, problem: fp.Problem) -> Any:
        """Add a slider that shows the number of a problem."""
        value = dial.get(problem) / dial.unit
        step = _step((dial.high - dial.low) / dial.unit)
        digits = max(0, -int(np.floor(np.log10(step))))
        value = round(value if np.isfinite(value) else dial.low / dial.unit, digits + FINER)
        low = min(round(float(np.ceil(dial.low / dial.unit / step)) * step, digits), value)
        high = max(round(float(np.floor(dial.high / dial.unit / step)) * step, digits), value)
        slider = self._gui.add_slider(
            dial.label, min=low, max=high, step=step, initial_value=value, hint=dial.hint or None
        )

        shown = Shown(slider, dial, digits + FINER)

        def turn(event: Any) -> None:
            shown.touched, value = time.monotonic(), float(event.target.value)  # before anything else sets it
            self._actions.do(dial.paths[0], lambda: self._turn(value * dial.unit, dial))

        by_user(slider.on_update, turn)
        self.shown.append(shown)
        return slider

    def forget(self, sliders: Sequence[Any]) -> None:
        """Remove sliders that are gone."""
        self.shown = [shown for shown in self.shown if all(shown.slider is not slider for slider in sliders)]

    def follow(self, problem: fp.Problem) -> bool:
        """Show the problem's numbers; return whether the user still holds one. In the thread of the user's events."""
        now, busy = time.monotonic(), False
        for shown in self.shown:
            if now - shown.touched < RELEASED:
                busy = True
                continue
            slider = shown.slider
            value = round(shown.dial.get(problem) / shown.dial.unit, shown.digits)
            if not np.isfinite(value) or value == slider.value:
                continue
            if value < slider.min:
                slider.min = value
            if value > slider.max:
                slider.max = value
            slider.value = value
        return busy

    def _turn(self, value: float, dial: Dial) -> None:
        if np.isfinite(value):
            self._session.edit(numbers(dict.fromkeys(dial.paths, value)), dial.paths[0])
        else:
            self._session.refuse(f"{dial.paths[0]}: {value} is not a finite number")


def _step(width: float) -> float:
    """A round step, about so fine that a slider has :data:`STEPS`."""
    power = 10.0 ** np.floor(np.log10(max(width, 1e-9) / STEPS))
    return float(power * next(each for each in (1, 2, 5, 10) if each * power >= width / STEPS))


class Choices:
    """Dropdowns and ticks; each follows the session."""

    def __init__(self, gui: Any, session: Session, actions: Actions) -> None:
        self._gui, self._session, self._actions = gui, session, actions
        self._shown: list[tuple[Any, Callable[[fp.Problem], Any]]] = []

    def add(
        self,
        label: str,
        words: Sequence[str],
        get: Callable[[fp.Problem], str],
        edit: Callable[[Any], Edit],
        hint: str | None = None,
    ) -> None:
        """Add a choice of words: how to read it from a problem, and the edit that makes it."""
        present = get(self._session.view.problem)
        offered = tuple(dict.fromkeys((*words, present)))
        self._follow(self._gui.add_dropdown(label, offered, initial_value=present, hint=hint), get, edit)

    def add_tick(self, label: str, get: Callable[[fp.Problem], bool], edit: Callable[[Any], Edit]) -> None:
        """Add a tick."""
        self._follow(self._gui.add_checkbox(label, get(self._session.view.problem)), get, edit)

    def follow(self, problem: fp.Problem) -> None:
        """Show the problem's choices. In the thread of the user's events."""
        for choice, get in self._shown:
            wanted = get(problem)
            if choice.value != wanted:
                choice.value = wanted

    def _follow(self, choice: Any, get: Callable[[fp.Problem], Any], edit: Callable[[Any], Edit]) -> None:
        self._shown.append((choice, get))

        def choose(event: Any) -> None:
            chosen = event.target.value  # before anything else sets it
            self._actions.do(f"choice {id(choice)}", lambda: self._session.edit(edit(chosen)))

        by_user(choice.on_update, choose)
