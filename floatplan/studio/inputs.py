"""Inputs: sliders of numbers by their paths, choices of words and ticks; none changes while the user moves it."""

import asyncio
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

import floatplan as fp
from floatplan.errors import printable
from floatplan.studio.edits import Edit, number_at, numbers
from floatplan.studio.planning import Actions
from floatplan.studio.session import Session

Result = TypeVar("Result")


@dataclass(frozen=True)
class SliderEnds:
    """How far sliders reach, so that a usual change is neither too small to hit nor out of reach."""

    orientation: float = math.radians(400)  # [rad] to both sides of the present value
    rotation: float = math.radians(180)  # [rad] of a jump in space, to both sides of the present value
    displacement: float = 1.0  # [m] of a jump in space, either way
    speed: float = 4.0  # [m/s] horizontal, to both sides
    position: float = 2.0  # [m] of obstacles, to both sides
    least_limit: float = 0.01  # [-] of the upper end of a limit's slider
    largest_limit: float = 3.0  # [-] of the first motion's peak, where the URDF has no limit
    friction: tuple[float, float] = (0.1, 1.5)  # [-]
    least_margin: float = 0.3  # [-] of the limits that stances may use
    clearance: float = 0.1  # [m] of a jump's links above the ground
    phases: float = 1.25  # [-] of the first jump's duration
    shortest_phase: float = 0.02  # [s]


ENDS = SliderEnds()


def on(register: Any, action: Callable[[Any], object]) -> None:
    """Register an action at an event of viser; coroutines are called in the order of the events."""

    async def call(event: Any) -> None:
        action(event)

    register(call)


def by_user(register: Any, action: Callable[[Any], object]) -> None:
    """The same, of events that the user made; the program's own changes are none."""
    on(register, lambda event: event.client is not None and action(event))


def in_turn(server: Any, action: Callable[[], Result]) -> Result:
    """Call a function in the thread of viser's events, between two of them, and return what it returns.

    viser sets an input's value before it tells of the event: what the program shows in that input must not come in
    between, or the user's value is lost.
    """

    async def call() -> Result:
        return action()

    return asyncio.run_coroutine_threadsafe(call(), server.get_event_loop()).result()


@dataclass(eq=False)
class Input:
    """An input: its handle, how to read its value from a problem, and when the user last touched it, s."""

    handle: Any
    get: Callable[[fp.Problem], Any]
    touched: float = -math.inf


class Inputs:
    """Sliders, choices and ticks of the shown ``problem``; each follows it unless the user moves it."""

    def __init__(self, gui: Any, session: Session, actions: Actions) -> None:
        self._gui = gui
        self._session = session
        self._actions = actions
        self.problem = session.view.problem
        self.sliders: dict[str, Any] = {}  # by the path that it shows
        self._shown: list[Input] = []

    def slider(
        self,
        label: str,
        paths: Sequence[str],
        low: float,
        high: float,
        unit: float = 1.0,
        hint: str | None = None,
        get: Callable[[fp.Problem], float] | None = None,
    ) -> Any:
        """Add a slider from ``low`` to ``high``, SI units and radians; its numbers are in a ``unit`` of so much in SI.

        All ``paths`` of a problem file get its value, the first one's is shown, or what ``get`` reads from a problem.
        """
        path = paths[0]
        step = _step((high - low) / unit)
        digits = max(0, -int(np.floor(np.log10(step))))
        shown_digits = digits + 2  # a number that was typed may be finer than a step

        def shown(problem: fp.Problem) -> float:
            return round((number_at(problem, path) if get is None else get(problem)) / unit, shown_digits)

        def set_to(value: float) -> None:
            if math.isfinite(value):
                self._session.edit(numbers(dict.fromkeys(paths, value * unit)), path)
            else:
                self._session.refuse(f"{path}: {value} is not a finite number")

        value = shown(self.problem)
        value = value if math.isfinite(value) else round(low / unit, shown_digits)
        least = min(round(math.ceil(low / unit / step) * step, digits), value)
        most = max(round(math.floor(high / unit / step) * step, digits), value)
        slider = self._gui.add_slider(label, min=least, max=most, step=step, initial_value=value, hint=hint)
        self.add(slider, shown, path, set_to)
        self.sliders[path] = slider
        return slider

    def choice(
        self,
        label: str,
        words: Sequence[str],
        get: Callable[[fp.Problem], str],
        edit: Callable[[str], Edit],
        hint: str | None = None,
    ) -> None:
        """Add a choice of words: how to read it from a problem, and the edit that makes it."""
        present = get(self.problem)
        offered = tuple(dict.fromkeys((*words, present)))
        dropdown = self._gui.add_dropdown(label, offered, initial_value=present, hint=hint)
        self.add(dropdown, get, label, lambda word: self._session.edit(edit(word)))

    def tick(
        self, label: str, get: Callable[[fp.Problem], bool], edit: Callable[[bool], Edit], hint: str | None = None
    ) -> None:
        """Add a tick."""
        tick = self._gui.add_checkbox(label, get(self.problem), hint=hint)
        self.add(tick, get, label, lambda is_on: self._session.edit(edit(is_on)))

    def add(self, handle: Any, get: Callable[[fp.Problem], Any], about: str, act: Callable[[Any], object]) -> None:
        """Add an input: how to read its value from a problem, and the action where the user sets it."""
        shown = Input(handle, get)

        def touch(event: Any) -> None:
            value = event.target.value  # before anything else sets it
            present = get(self.problem)
            if not is_alike(value, present):
                handle.value = present
                self._session.refuse(f"{about}: {printable(repr(value))} is not what this input takes")
                return
            shown.touched = time.monotonic()
            self._actions.do(about, lambda: act(value))

        by_user(handle.on_update, touch)
        self._shown.append(shown)

    def forget(self, handles: Sequence[Any]) -> None:
        """Remove inputs that are gone."""
        self._shown = [shown for shown in self._shown if shown.handle not in handles]
        for path, slider in list(self.sliders.items()):
            if slider in handles:
                del self.sliders[path]

    def follow(self, problem: fp.Problem) -> bool:
        """Show what a problem has; return whether the user still moves an input. In the thread of the user's events."""
        now = time.monotonic()
        busy = False
        for shown in self._shown:
            handle = shown.handle
            value = shown.get(problem)
            if now - shown.touched < 0.7:  # [s] then the user has let go
                busy = True
            elif value != handle.value and value == value:  # a number that the problem does not have is NaN
                if isinstance(value, float):
                    handle.min = min(handle.min, value)
                    handle.max = max(handle.max, value)
                handle.value = value
        return busy


def is_alike(value: Any, shown: Any) -> bool:
    """Whether a value is of the kind that an input shows: viser takes from a page whatever that sends."""
    if isinstance(shown, bool):
        return isinstance(value, bool)
    if isinstance(shown, int | float):
        return isinstance(value, int | float) and not isinstance(value, bool)
    if isinstance(shown, tuple | list):
        if not isinstance(value, tuple | list) or len(value) != len(shown):
            return False
        pairs = zip(value, shown, strict=True)
        return all(is_alike(item, other) and math.isfinite(item) for item, other in pairs)
    return isinstance(value, str)


def _step(width: float) -> float:
    """A round step, about so fine that a slider has 400."""
    least = max(width, 1e-9) / 400
    power = 10.0 ** np.floor(np.log10(least))
    for factor in (1, 2, 5):
        if factor * power >= width / 400:
            return float(factor * power)
    return float(10 * power)
