"""The panel: what is asked, as sliders and choices, and what the session says about it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

import floatplan as fp
from floatplan.problem.parts import Obstacle
from floatplan.studio.page import cards
from floatplan.studio.page.dials import Dial, Dials
from floatplan.studio.page.hands import Hands
from floatplan.studio.page.player import Player
from floatplan.studio.page.stage import Stage
from floatplan.studio.session import edits
from floatplan.studio.session.saving import Part, Saving
from floatplan.studio.session.session import Session, View
from floatplan.studio.work.around import COLUMNS, ROWS
from floatplan.tables import OBJECTIVE_TABLE

DEGREE = math.pi / 180  # [rad]
TURNS = 400 * DEGREE  # [rad] an orientation's slider reaches, to both sides
SPEEDS = {"real time": 1.0, "half": 0.5, "a quarter": 0.25, "a tenth": 0.1}
MOMENTA = ("midpoint", "free", "a number")
DEGREES = ("auto", "7", "9", "11", "13")
FARTHEST = 10.0  # [m] that an obstacle's slider reaches


class Controls:
    """The panel; :meth:`draw` follows the session's view, hands change the session."""

    def __init__(
        self, server: Any, session: Session, hands: Hands, stage: Stage, player: Player, folder: str
    ) -> None:
        self._gui, self._session, self._hands, self._stage, self._player = server.gui, session, hands, stage, player
        self._folder, self._saving = folder, Saving()
        self._dials = Dials(self._gui, session, hands)
        self._choices: list[tuple[Any, Callable[[fp.Problem], Any]]] = []
        self._drawn: View | None = None
        self._obstacles: list[Any] = []
        self._obstacle_dials: list[Any] = []
        problem = session.view.problem
        self._status = self._gui.add_html(cards.status_card(session.view))
        self._history_buttons()
        tabs = self._gui.add_tab_group()
        for name, fill in {
            "Goal": lambda: self._posture("goal", problem),
            "Start": lambda: self._posture("start", problem),
            "Flight": lambda: self._flight(problem),
            "Limits": lambda: self._limits(problem),
            "Obstacles": self._obstacle_buttons,
            "Map": self._map,
            "Compare": self._compare,
            "Save": self._save,
        }.items():
            with tabs.add_tab(name) as tab:
                fill()
            if name == "Obstacles":
                self._obstacle_tab = tab

    def draw(self, view: View) -> bool:
        """Say and show what has changed; return whether a hand is on a slider, so that it has to be drawn again."""
        before, self._drawn = self._drawn, view
        put(self._status, cards.status_card(view))
        put(self._limits_table, cards.limits_card(view.flown))
        put(self._map_html, cards.map_card(view.map, self._points, self._map_wanted.value))
        put(self._comparison, cards.comparison_card(view.flown, view.kept))
        kinds = [type(obstacle) for obstacle in view.problem.obstacles]
        if before is None or kinds != [type(obstacle) for obstacle in before.problem.obstacles]:
            self._list_obstacles(view.problem)
        for choice, get in self._choices:
            wanted = get(view.problem)
            if choice.value != wanted:
                choice.value = wanted
        self._show_limits(view.problem)
        self._momentum.disabled = isinstance(view.problem.flight.angular_momentum, str)
        return self._dials.follow(view.problem)

    def at(self, instant: float) -> None:
        """Show the flight's time, s."""
        self._time.value = round(float(np.clip(instant, self._time.min, self._time.max)), 3)

    def _history_buttons(self) -> None:
        session = self._session
        buttons = self._gui.add_button_group("", ("Undo", "Redo", "Play / pause"))
        actions = {
            "Undo": session.undo,
            "Redo": session.redo,
            "Play / pause": lambda: self._player.play(not self._player.playing),
        }

        @buttons.on_click
        async def _(event: Any) -> None:
            self._hands.do(f"{event.target.value} {id(event)}", actions[event.target.value])

        for label, hotkey, modifier in (("Undo", "Z", "cmd/ctrl"), ("Redo", "Y", "cmd/ctrl")):
            command = self._gui.add_command(label, hotkey=hotkey, modifier=modifier)

            @command.on_trigger
            async def _(event: Any, label: str = label) -> None:
                self._hands.do(f"{label} {id(event)}", actions[label])

        self._time = self._gui.add_slider(
            "time, s", min=0.0, max=self._duration(), step=0.001, initial_value=0.0, hint="Moving it stops the flight."
        )

        @self._time.on_update
        async def _(event: Any) -> None:
            if event.client is not None:
                self._player.seek(float(self._time.value))

        speed = self._gui.add_dropdown("speed", tuple(SPEEDS), initial_value="half")

        @speed.on_update
        async def _(event: Any) -> None:
            self._player.set_speed(SPEEDS[speed.value])

    def _duration(self) -> float:
        return float(self._session.view.problem.flight.duration)

    def _posture(self, end: str, problem: fp.Problem) -> None:
        turn = getattr(problem, end).orientation
        self._dials.add(
            Dial(
                "base, °",
                (f"{end}.orientation",),
                lambda problem: float(getattr(problem, end).orientation),
                turn - TURNS,
                turn + TURNS,
                DEGREE,
                "360° more is one somersault more.",
            )
        )
        for index, joint in enumerate(problem.robot.joints):
            low, high = problem.position_limits[index].tolist()
            self._dials.add(
                Dial(
                    f"{joint}, °",
                    (f"{end}.positions.{joint}",),
                    lambda problem, index=index: float(_state(problem, end).positions[index]),  # type: ignore[misc]
                    low,
                    high,
                    DEGREE,
                )
            )
        shown = self._gui.add_checkbox(f"show the {end}", initial_value=True, hint="Drag its links to change it.")

        @shown.on_update
        async def _(event: Any) -> None:
            self._stage.show_ghost(end, shown.value)

    def _flight(self, problem: fp.Problem) -> None:
        flown = self._session.view.flown
        low, high = (0.0, 1.0) if flown is None else flown.plan.angular_momentum_bounds
        half = max(high - low, abs(low), abs(high), 0.1)
        present = problem.flight.duration
        self._dials.add(
            Dial("duration, s", ("flight.duration",), lambda each: each.flight.duration, 0.4 * present, 2.5 * present)
        )
        self._choose(
            "h is",
            MOMENTA,
            _momentum_choice,
            self._choose_momentum,
            "Angular momentum: the middle of what suits joints that do not turn back; free; or a number.",
        )
        self._momentum = self._dials.add(
            Dial("h, kg m²/s", ("flight.angular_momentum",), self._momentum_of, low - half, high + half)
        )
        self._dials.add(
            Dial(
                "speed, m/s",
                ("flight.horizontal_velocity",),
                lambda each: each.flight.horizontal_velocity,
                problem.flight.horizontal_velocity - 4,
                problem.flight.horizontal_velocity + 4,
                hint="Of the centre of mass, horizontal.",
            )
        )
        self._choose(
            "least",
            tuple(OBJECTIVE_TABLE),
            lambda each: each.motion.objective,
            lambda word: edits.motion(objective=word),
            "What the motion minimises.",
        )
        self._choose(
            "degree",
            tuple(dict.fromkeys((*DEGREES, _degree_word(problem)))),
            _degree_word,
            lambda word: edits.motion(degree=word if word == "auto" else int(word)),
            "Of the polynomials: higher ones move more freely.",
        )
        ground = self._gui.add_checkbox("keep above the ground", initial_value=problem.ground)
        self._on_choice(ground, lambda each: each.ground, edits.ground)

    def _limits(self, problem: fp.Problem) -> None:
        self._limit_dials: dict[str, list[Any]] = {}
        for key, unit in (("velocity", "rad/s"), ("torque", "N m")):
            of_urdf = getattr(problem.robot, f"motor_{key}_limits")
            words = ("none", *(("urdf",) if np.isfinite(of_urdf).any() else ()), "by hand")
            words = tuple(dict.fromkeys((*words, edits.limit_choice(problem, key))))
            self._choose(
                f"{key} limit",
                words,
                lambda each, key=key: edits.limit_choice(each, key),  # type: ignore[misc]
                lambda word, key=key: edits.limit(key, word, self._needed(key)),  # type: ignore[misc]
            )
            self._limit_dials[key] = [
                self._dials.add(
                    Dial(
                        f"{joint}, {unit}",
                        edits.limit_paths(problem.robot, key, joint),
                        lambda each, key=key, joint=joint: edits.limit_of(each, key, joint),  # type: ignore[misc]
                        0.01 * top,
                        top,
                    )
                )
                for joint, top in zip(problem.robot.joints, self._tops(key, of_urdf), strict=False)
            ]
        self._limits_table = self._gui.add_html("")

    def _tops(self, key: str, of_urdf: Any) -> list[float]:
        """Ends of the sliders of limits."""
        needed = self._needed(key)
        return [
            float(limit) if math.isfinite(limit) else 3 * max(need, 1e-3)
            for limit, need in zip(of_urdf.tolist(), needed.values(), strict=True)
        ]

    def _needed(self, key: str) -> dict[str, float]:
        """Peaks of the present motion, by motor."""
        flown, robot = self._session.view.flown, self._session.view.problem.robot
        peaks = {} if flown is None else {row.joint: getattr(row, f"{key}_peak") for row in flown.utilisation}
        return {motor: float(peaks.get(motor, 1.0)) for motor in robot.motors}

    def _show_limits(self, problem: fp.Problem) -> None:
        for key, sliders in self._limit_dials.items():
            wanted = edits.limit_choice(problem, key) == "by hand"
            for slider in sliders:
                if slider.visible != wanted:
                    slider.visible = wanted

    def _obstacle_buttons(self) -> None:
        for label, make in OBSTACLES.items():
            button = self._gui.add_button(f"Add a {label}", color="gray")

            @button.on_click
            async def _(_event: Any, make: Callable[[complex, float], Obstacle] = make) -> None:
                place, size = self._stage.free_place()
                self._hands.do("add", lambda: self._session.edit(edits.with_obstacle(make(place, size))))

    def _list_obstacles(self, problem: fp.Problem) -> None:
        """A folder of sliders for each obstacle."""
        self._dials.forget(self._obstacle_dials)
        for folder in self._obstacles:
            folder.remove()
        self._obstacles, self._obstacle_dials = [], []
        with self._obstacle_tab:
            for index, obstacle in enumerate(problem.obstacles):
                with self._gui.add_folder(f"{obstacle.kind} {index}") as folder:
                    self._obstacle_dials += [self._dials.add(dial) for dial in obstacle_dials(index, obstacle)]
                    remove = self._gui.add_button("Remove", color="gray")

                    @remove.on_click
                    async def _(_event: Any, index: int = index) -> None:
                        self._hands.do(f"remove {index}", lambda: self._session.edit(edits.without_obstacle(index)))

                self._obstacles.append(folder)

    def _map(self) -> None:
        self._map_wanted = self._gui.add_checkbox("plan around this point", initial_value=True)

        @self._map_wanted.on_update
        async def _(_event: Any) -> None:
            wanted = self._map_wanted.value
            self._hands.do("map", lambda: self._session.draw_map(wanted))

        self._points = {}
        for row in range(ROWS):
            for column in range(COLUMNS):
                button = self._gui.add_button("")

                @button.on_click
                async def _(_event: Any, row: int = row, column: int = column) -> None:
                    self._hands.do("jump", lambda: self._session.jump(row, column))

                self._points[row, column] = button._impl.uuid
        self._map_html = self._gui.add_html("")

    def _compare(self) -> None:
        for label, wanted in (("Keep this plan", True), ("Let it go", False)):
            button = self._gui.add_button(label, color=None if wanted else "gray")

            @button.on_click
            async def _(_event: Any, wanted: bool = wanted) -> None:
                self._hands.do("keep", lambda: self._session.keep(wanted))

        self._comparison = self._gui.add_html("")

    def _save(self) -> None:
        folder = self._gui.add_text("folder", self._folder)
        parts: dict[str, Part] = {"Save problem": "problem", "Save plan": "plan", "Save report": "report"}
        for label, part in parts.items():
            button = self._gui.add_button(label)

            @button.on_click
            async def _(_event: Any, part: Part = part) -> None:
                self._hands.do(f"save {part}", lambda: self._tell_saved(part, folder.value))

        self._saved = self._gui.add_html(cards.saved_card([]))

    def _tell_saved(self, part: Part, folder: str) -> None:
        self._saved.content = cards.saved_card([self._saving.save(self._session.view, part, folder)])

    def _choose(
        self,
        label: str,
        words: tuple[str, ...],
        get: Callable[[fp.Problem], str],
        edit: Callable[[Any], edits.Edit],
        hint: str | None = None,
    ) -> None:
        """Add a choice of words."""
        dropdown = self._gui.add_dropdown(label, words, initial_value=get(self._session.view.problem), hint=hint)
        self._on_choice(dropdown, get, edit)

    def _on_choice(self, choice: Any, get: Callable[[fp.Problem], Any], edit: Callable[[Any], edits.Edit]) -> None:
        self._choices.append((choice, get))

        @choice.on_update
        async def _(event: Any) -> None:
            if event.client is not None:
                self._hands.do(f"choice {id(choice)}", lambda: self._chosen(choice, get, edit))

    def _chosen(self, choice: Any, get: Callable[[fp.Problem], Any], edit: Callable[[Any], edits.Edit]) -> None:
        if not self._session.edit(edit(choice.value)):
            choice.value = get(self._session.view.problem)

    def _choose_momentum(self, word: str) -> edits.Edit:
        flown = self._session.view.flown
        number = 0.0 if flown is None else flown.plan.angular_momentum
        return edits.flight(angular_momentum=number if word == "a number" else word)

    def _momentum_of(self, problem: fp.Problem) -> float:
        asked = problem.flight.angular_momentum
        if not isinstance(asked, str):
            return float(asked)
        flown = self._session.view.flown
        return math.nan if flown is None else flown.plan.angular_momentum


def put(html: Any, content: str) -> None:
    """Change HTML where it differs."""
    if html.content != content:
        html.content = content


def _state(problem: fp.Problem, end: str) -> Any:
    return problem.initial if end == "start" else problem.final


def _momentum_choice(problem: fp.Problem) -> str:
    asked = problem.flight.angular_momentum
    return asked if isinstance(asked, str) else MOMENTA[-1]


def _degree_word(problem: fp.Problem) -> str:
    if problem.raises_degree:
        return DEGREES[0]
    return ", ".join(dict.fromkeys(map(str, problem.degrees)))


OBSTACLES: dict[str, Callable[[complex, float], Obstacle]] = {
    "circle": lambda place, size: fp.Circle(center=(place.real, place.imag), radius=0.1 * size),
    "bar": lambda place, size: fp.Bar(
        start=(place.real - 0.2 * size, place.imag), end=(place.real + 0.2 * size, place.imag), radius=0.04 * size
    ),
    "half-plane": lambda place, size: fp.HalfPlane(point=(place.real, place.imag), normal=(0.0, -1.0)),
}


def obstacle_dials(index: int, obstacle: Obstacle) -> list[Dial]:
    """Sliders of an obstacle."""
    dials = []
    for name in edits.ANCHORS:
        if hasattr(obstacle, name):
            for axis, letter in enumerate(("→", "↑")):
                here = float(getattr(obstacle, name)[axis])
                dials.append(_obstacle_dial(index, f"{name}.{axis}", f"{name} {letter}, m", here - 2, here + 2))
    if hasattr(obstacle, "radius"):
        dials.append(_obstacle_dial(index, "radius", "radius, m", 0.0, max(1.0, 2 * obstacle.radius)))
    dials.append(_obstacle_dial(index, "margin", "margin, m", 0.0, max(0.3, 2 * obstacle.margin)))
    return dials


def _obstacle_dial(index: int, path: str, label: str, low: float, high: float) -> Dial:
    name, *rest = path.split(".")

    def get(problem: fp.Problem) -> float:
        value = getattr(problem.obstacles[index], name)
        return float(value[int(rest[0])] if rest else value)

    return Dial(label, (f"obstacles.{index}.{path}",), get, low, high)
