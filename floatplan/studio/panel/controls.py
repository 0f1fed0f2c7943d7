"""The panel: what is asked, as sliders and choices, and what the session says about it."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

import floatplan as fp
from floatplan.studio.panel import cards
from floatplan.studio.panel.dials import Choices, Dial, Dials
from floatplan.studio.panel.tabs import LimitsTab, ObstaclesTab
from floatplan.studio.player import Player
from floatplan.studio.session import edits
from floatplan.studio.session.actions import Actions, by_user, in_turn, on
from floatplan.studio.session.saving import Part, Saving
from floatplan.studio.session.session import Session, View
from floatplan.studio.stage import Stage
from floatplan.studio.work.around import COLUMNS, ROWS
from floatplan.tables import OBJECTIVE_TABLE

DEGREE = math.pi / 180  # [rad]
TURNS = 400 * DEGREE  # [rad] that an orientation's slider reaches, to both sides
FASTER = 4.0  # [m/s] that the horizontal velocity's slider reaches, to both sides
SPEEDS = {"real time": 1.0, "half speed": 0.5, "a quarter": 0.25, "a tenth": 0.1}
A_NUMBER = "a number"
MOMENTA = ("midpoint", "free", A_NUMBER)
DEGREES = ("auto", "7", "9", "11", "13")
SAVED: dict[str, Part] = {"Save problem": "problem", "Save plan": "plan", "Save report": "report"}


class Controls:
    """The panel; :meth:`draw` follows the session's view, what the user does changes the session."""

    def __init__(
        self, server: Any, session: Session, actions: Actions, stage: Stage, player: Player, folder: str
    ) -> None:
        self._server, self._gui, self._session, self._actions = server, server.gui, session, actions
        self._stage, self._player = stage, player
        self._saving = Saving()
        self.dials = Dials(self._gui, session, actions)
        self._choices = Choices(self._gui, session, actions)
        self._told: View | None = None
        self._begun = 0  # number of the newest question whose search was not told at once
        self._status = self._gui.add_html(cards.status_card(session.view))
        self._history()
        self._playing()
        tabs = self._gui.add_tab_group()
        with tabs.add_tab("Goal"):
            self._posture("goal")
        with tabs.add_tab("Start"):
            self._posture("start")
        with tabs.add_tab("Flight"):
            self._flight()
        with tabs.add_tab("Limits"):
            self._limits = LimitsTab(self._gui, session, self.dials, self._choices)
        with tabs.add_tab("Obstacles") as tab:
            self._obstacles = ObstaclesTab(self._gui, tab, session, actions, self.dials, stage.free_place())
        with tabs.add_tab("Map"):
            self._map()
        with tabs.add_tab("Compare"):
            self._compare()
        with tabs.add_tab("Save"):
            self._save(folder)

    def draw(self, view: View) -> bool:
        """Say and show what has changed; return whether it has to be drawn again soon.

        So it is where the user holds a slider, or a search may take long enough to be told.
        """
        begun = not cards.is_news(self._told, view) and view.number != self._begun
        if begun:
            self._begun = view.number
        else:
            self._told = view
            cards.put(self._status, cards.status_card(view))
        cards.put(self._map_html, cards.map_card(view.map, self._points, self._map_wanted.value))
        cards.put(self._comparison, cards.comparison_card(view.flown, view.kept))
        self._limits.draw(view)
        self._obstacles.draw(view)
        fixed = isinstance(view.problem.flight.angular_momentum, str)
        if self._momentum.disabled != fixed:
            self._momentum.disabled = fixed
        longest = max(flown.plan.duration for flown in (view.flown, view.kept) if flown is not None)
        if self.time.max != longest:
            self.time.max = longest
        return in_turn(self._server, partial(self._follow, view.problem)) or begun

    def _follow(self, problem: fp.Problem) -> bool:
        self._choices.follow(problem)
        return self.dials.follow(problem)

    def at(self, instant: float) -> None:
        """Show the flight's time, s."""
        value = round(float(np.clip(instant, 0.0, self.time.max)), 3)
        in_turn(self._server, lambda: setattr(self.time, "value", value))

    def _history(self) -> None:
        session, player = self._session, self._player
        actions = {
            "Undo": session.undo,
            "Redo": session.redo,
            "Play / pause": lambda: player.play(not player.playing),
        }

        def act(name: str, event: Any) -> None:
            self._actions.do(f"{name} {id(event)}", actions[name])

        buttons = self._gui.add_button_group("", tuple(actions))
        on(buttons.on_click, lambda event: act(event.target.value, event))
        for name, hotkey in (("Undo", "Z"), ("Redo", "Y")):
            command = self._gui.add_command(name, hotkey=hotkey, modifier="cmd/ctrl")
            on(command.on_trigger, partial(act, name))

    def _playing(self) -> None:
        duration = float(self._session.view.problem.flight.duration)
        self.time = self._gui.add_slider(
            "time, s", min=0.0, max=duration, step=0.001, initial_value=0.0, hint="Moving it stops the flight."
        )
        by_user(self.time.on_update, lambda _: self._seek(float(self.time.value)))

    def _seek(self, instant: float) -> None:
        longest = float(self.time.max)
        if 0.0 <= instant <= longest:
            self._player.seek(instant)
        else:
            self._session.refuse(f"time: {instant:g} s is not within the flight, 0 to {longest:g} s")
            self.time.value = 0.0

    def _posture(self, end: str) -> None:
        problem = self._session.view.problem
        turn, hint = edits.end_state(problem, end).orientation, "360° more is one somersault more."

        def orientation(each: fp.Problem) -> float:
            return edits.end_state(each, end).orientation

        path = (f"{end}.orientation",)
        self.dials.add(Dial("base, °", path, orientation, turn - TURNS, turn + TURNS, DEGREE, hint), problem)
        for index, joint in enumerate(problem.robot.joints):
            low, high = problem.position_limits[index].tolist()
            self.dials.add(_joint_dial(end, index, joint, low, high), problem)
        shown = self._gui.add_checkbox(f"show the {end}", initial_value=True, hint="Drag its links to change it.")
        on(shown.on_update, lambda _: self._stage.show_ghost(end, shown.value))

    def _flight(self) -> None:
        flown, problem = self._session.view.flown, self._session.view.problem
        low, high = (0.0, 1.0) if flown is None else flown.plan.angular_momentum_bounds
        half = max(high - low, abs(low), abs(high), 0.1)
        present, speed = problem.flight.duration, problem.flight.horizontal_velocity
        self.dials.add(
            Dial("duration, s", ("flight.duration",), lambda each: each.flight.duration, 0.4 * present, 2.5 * present),
            problem,
        )
        self._choices.add(
            "h is",
            MOMENTA,
            _momentum_word,
            self._momentum_edit,
            f"Angular momentum: the middle of what suits joints that do not turn back ({low:.3g} to {high:.3g} kg m²/s"
            " at first), free, or a number.",
        )
        self._momentum = self.dials.add(
            Dial("h, kg m²/s", ("flight.angular_momentum",), self._momentum_of, low - half, high + half), problem
        )
        self.dials.add(
            Dial(
                "speed, m/s",
                ("flight.horizontal_velocity",),
                lambda each: each.flight.horizontal_velocity,
                speed - FASTER,
                speed + FASTER,
                hint="Of the centre of mass, horizontal.",
            ),
            problem,
        )
        objectives, hint = tuple(OBJECTIVE_TABLE), "What the motion minimises."
        self._choices.add(
            "least", objectives, lambda each: each.motion.objective, lambda word: edits.motion(objective=word), hint
        )
        hint = "Of the polynomials: higher ones move more freely."
        self._choices.add("degree", DEGREES, _degree_word, _degree_edit, hint)
        self._choices.add_tick("keep above the ground", lambda each: each.ground, edits.ground)

    def _map(self) -> None:
        session, actions = self._session, self._actions
        wanted = self._map_wanted = self._gui.add_checkbox("plan around this point", initial_value=True)
        on(wanted.on_update, lambda _: actions.do("map", lambda: session.draw_map(wanted.value)))
        self._points = {}
        for row, column in np.ndindex(ROWS, COLUMNS):
            button = self._gui.add_button("")
            on(button.on_click, partial(self._jump, row, column))
            self._points[row, column] = button._impl.uuid  # its id in the page
        self._map_html = self._gui.add_html("")

    def _jump(self, row: int, column: int, _: Any) -> None:
        self._actions.do("jump", lambda: self._session.jump(row, column))

    def _compare(self) -> None:
        session, actions = self._session, self._actions
        keep = self._gui.add_button("Keep this plan")
        on(keep.on_click, lambda _: actions.do("keep", lambda: session.keep(True)))
        release = self._gui.add_button("Let it go", color="gray")
        on(release.on_click, lambda _: actions.do("keep", lambda: session.keep(False)))
        self._comparison = self._gui.add_html("")
        speed = self._gui.add_dropdown("flown at", tuple(SPEEDS), initial_value="half speed")
        on(speed.on_update, lambda _: self._player.set_speed(SPEEDS[speed.value]))

    def _save(self, folder: str) -> None:
        place = self._gui.add_text("folder", folder)

        def save(part: Part) -> None:
            self._saved.content = cards.saved_card([self._saving.save(self._session.view, part, place.value)])

        def ask(part: Part, _: Any) -> None:
            self._actions.do(f"save {part}", lambda: save(part))

        for label, part in SAVED.items():
            button = self._gui.add_button(label)
            on(button.on_click, partial(ask, part))
        self._saved = self._gui.add_html(cards.saved_card([]))

    def _momentum_edit(self, word: str) -> edits.Edit:
        flown = self._session.view.flown
        number = 0.0 if flown is None else flown.plan.angular_momentum
        return edits.flight(angular_momentum=number if word == A_NUMBER else word)

    def _momentum_of(self, problem: fp.Problem) -> float:
        asked, flown = problem.flight.angular_momentum, self._session.view.flown
        if not isinstance(asked, str):
            return float(asked)
        return math.nan if flown is None else flown.plan.angular_momentum


def _joint_dial(end: str, index: int, joint: str, low: float, high: float) -> Dial:
    path = (f"{end}.positions.{joint}",)
    return Dial(f"{joint}, °", path, lambda each: float(edits.end_state(each, end).positions[index]), low, high, DEGREE)


def _momentum_word(problem: fp.Problem) -> str:
    asked = problem.flight.angular_momentum
    return asked if isinstance(asked, str) else A_NUMBER


def _degree_word(problem: fp.Problem) -> str:
    if problem.raises_degree:
        return DEGREES[0]
    return ", ".join(dict.fromkeys(map(str, problem.degrees)))


def _degree_edit(word: str) -> edits.Edit:
    return edits.motion(degree=int(word) if word.isdecimal() else word)
