"""The tab of obstacles: new ones, and sliders of those that are there."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import floatplan as fp
from floatplan.problem.parts import Obstacle
from floatplan.studio.panel.dials import Dial, Dials
from floatplan.studio.session.edits import ANCHORS, Edit, with_obstacle, without_obstacle
from floatplan.studio.session.hands import Hands, on
from floatplan.studio.session.session import Session, View

REACH = 2.0  # [m] that a place's slider reaches, to both sides
NEW: dict[str, Callable[[complex, float], Obstacle]] = {
    "circle": lambda place, size: fp.Circle(center=(place.real, place.imag), radius=0.1 * size),
    "bar": lambda place, size: fp.Bar(
        start=(place.real - 0.2 * size, place.imag), end=(place.real + 0.2 * size, place.imag), radius=0.04 * size
    ),
    "half-plane": lambda place, size: fp.HalfPlane(point=(place.real, place.imag), normal=(0.0, -1.0)),
}


class ObstaclesTab:
    """A folder of sliders for each obstacle; ``free_place`` is where a new one goes, and the robot's size, m."""

    def __init__(
        self, gui: Any, tab: Any, session: Session, hands: Hands, dials: Dials, free_place: tuple[complex, float]
    ) -> None:
        self._gui, self._tab, self._session, self._hands, self._dials = gui, tab, session, hands, dials
        self._kinds: list[str] = []
        self._folders: list[Any] = []
        self._sliders: list[Any] = []
        for label, make in NEW.items():
            button = gui.add_button(f"Add a {label}", color="gray")
            on(button.on_click, partial(self._edit, with_obstacle(make(*free_place))))

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
        self._hands.do(f"obstacles {id(event)}", lambda: self._session.edit(edit))


def obstacle_dials(index: int, obstacle: Obstacle) -> list[Dial]:
    """Sliders of an obstacle: its places, radius and margin."""
    dials = []
    for name in ANCHORS:
        for axis, place in enumerate(getattr(obstacle, name, ())):
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
