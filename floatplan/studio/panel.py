"""The panel: the problem as sliders and choices, and the cards of the session."""

import math
from collections.abc import Callable
from functools import partial
from typing import Any, Literal, get_args

import numpy as np

import floatplan as fp
from floatplan.errors import printable
from floatplan.problem.parts import OBSTACLE_KINDS, Obstacle
from floatplan.studio import cards, edits
from floatplan.studio.curves import curves_card, instant_mark
from floatplan.studio.inputs import ENDS, Inputs, by_user, in_turn, is_alike, on
from floatplan.studio.jump_tabs import JumpTab, LandingTab
from floatplan.studio.planning import Actions
from floatplan.studio.session import Document, Session, View
from floatplan.studio.stage import Player, Stage
from floatplan.studio.tasks import COLUMNS, ROWS
from floatplan.tables import KEY_TABLE, LIMIT_TABLE, OBJECTIVES, LimitKey, MomentumWordInPlane

SPEEDS = {"real time": 1.0, "half speed": 0.5, "a quarter": 0.25, "a tenth": 0.1}
A_NUMBER = "a number"
DEGREES = ("auto", "7", "9", "11", "13")


class Controls:
    """The panel; :meth:`draw` follows the session's view, what the user does changes the session."""

    def __init__(
        self, server: Any, session: Session, actions: Actions, stage: Stage, player: Player, folder: str
    ) -> None:
        self._server = server
        self._gui = server.gui
        self._session = session
        self._actions = actions
        self._stage = stage
        self._player = player
        self.inputs = Inputs(self._gui, session, actions)
        self._shown: View | None = None
        self._postponed = 0  # number of the newest problem whose search was not shown at once
        self._status = self._gui.add_html(cards.status_card(session.view))
        self._add_player()
        tabs = self._gui.add_tab_group()
        self._jump = None
        if session.view.problem.jump is not None:
            with tabs.add_tab("Jump"):
                self._jump = JumpTab(self._gui, session, self.inputs)
        self._landing: LandingTab | None = None
        self._momentum: Any = None
        self._obstacles: ObstaclesTab | None = None
        is_planar = bool(stage.ghosts)  # there are postures and obstacles to drag
        with tabs.add_tab("Goal"):
            if is_planar:
                self._add_posture("goal")
            else:
                self._landing = LandingTab(self._gui, session, self.inputs)
        if is_planar:
            with tabs.add_tab("Start"):
                self._add_posture("start")
        with tabs.add_tab("Flight"):
            self._add_flight(is_planar)
        with tabs.add_tab("Limits"):
            self._limits = LimitsTab(self._gui, session, self.inputs)
        if is_planar:
            with tabs.add_tab("Obstacles") as tab:
                self._obstacles = ObstaclesTab(self._gui, tab, session, actions, self.inputs, stage.free_position())
        self._map_html = None
        if self._jump is None:
            with tabs.add_tab("Map"):
                self._add_map()
        with tabs.add_tab("Compare"):
            self._add_comparison()
        with tabs.add_tab("Save"):
            self._add_saving(folder)
        self._warnings = self._gui.add_html("")
        self._curves = self._gui.add_html("")
        self._instant = self._gui.add_html("")

    def draw(self, view: View) -> bool:
        """Show what has changed; return whether to call this again soon.

        So it is where the user holds a slider, or a search may last long enough to be shown.
        """
        self.inputs.problem = view.problem
        postponed = not cards.is_news(self._shown, view) and view.number != self._postponed
        if postponed:
            self._postponed = view.number
        else:
            self._shown = view
            self._status.content = cards.status_card(view)
            self._warnings.content = cards.warning_card(view)
            if view.result is not None:
                self._curves.content = curves_card(view.result.motion, view.result.shares)
        if self._map_html is not None:
            self._map_html.content = cards.map_card(view.map, self._map_switch.value)
        if self._jump is not None:
            self._jump.draw(view)
        self._comparison.content = cards.comparison_card(view.result, view.compared)
        self._limits.draw(view)
        if self._landing is not None:
            self._landing.draw(view)
        if self._obstacles is not None:
            self._obstacles.draw(view)
        if self._momentum is not None:
            self._momentum.disabled = isinstance(view.problem.flight.angular_momentum, str)
        longest = 0.0
        for shown in (view.result, view.compared):
            if shown is not None:
                longest = max(longest, shown.motion.duration)
        self.time.max = math.ceil(1e3 * longest) / 1e3
        return in_turn(self._server, lambda: self.inputs.follow(view.problem)) or postponed

    def at(self, instant: float) -> None:
        """Show the flight's time, s."""
        value = round(float(np.clip(instant, 0.0, self.time.max)), 3)
        in_turn(self._server, lambda: setattr(self.time, "value", value))
        result = self._session.view.result
        self._instant.content = "" if result is None else instant_mark(instant / result.motion.duration)

    def _button(self, label: str, about: str, act: Callable[[], object], **look: Any) -> Any:
        button = self._gui.add_button(label, **look)
        on(button.on_click, lambda _: self._actions.do(about, act))
        return button

    def _add_player(self) -> None:
        """Buttons and keys to go back and forth, and the time of the flight."""
        session = self._session
        player = self._player
        actions = {
            "Undo": session.undo,
            "Redo": session.redo,
            "Stop search": session.stop,
            "Play / pause": lambda: setattr(player, "playing", not player.playing),
        }

        def act(name: str, event: Any) -> None:
            if name in actions:  # a page may send anything
                self._actions.do(f"{name} {id(event)}", actions[name])

        buttons = self._gui.add_button_group("", tuple(actions))
        on(buttons.on_click, lambda event: act(event.target.value, event))
        for name, hotkey in (("Undo", "Z"), ("Redo", "Y")):
            command = self._gui.add_command(name, hotkey=hotkey, modifier="cmd/ctrl")
            on(command.on_trigger, partial(act, name))
        duration = float(session.view.problem.flight.duration)
        self.time = self._gui.add_slider(
            "time, s", min=0.0, max=duration, step=0.001, initial_value=0.0, hint="Moving it stops the flight."
        )
        by_user(self.time.on_update, lambda event: self._seek(event.target.value))

    def _seek(self, instant: Any) -> None:
        longest = float(self.time.max)
        if is_alike(instant, longest) and 0.0 <= instant <= longest:
            self._player.seek(float(instant))
        else:
            self._session.refuse(f"time: {printable(repr(instant))} s is not within the flight, 0 to {longest:g} s")
            self.time.value = 0.0

    def _add_posture(self, end: Literal["start", "goal"]) -> None:
        problem = self._session.view.problem
        path = f"{end}.orientation"
        angle = edits.number_at(problem, path)
        hint = "360° more is one somersault more."
        self.inputs.slider(
            "base, °", (path,), angle - ENDS.orientation, angle + ENDS.orientation, math.radians(1), hint
        )
        for joint, (low, high) in zip(problem.robot.joints, problem.position_limits.tolist(), strict=True):
            self.inputs.slider(f"{joint}, °", (f"{end}.positions.{joint}",), low, high, math.radians(1))
        root = self._stage.ghosts[end].root
        hint = "Drag its links to change it."
        shown = self._gui.add_checkbox(f"show the {end}", initial_value=root.visible, hint=hint)
        on(shown.on_update, lambda _: setattr(root, "visible", shown.value))

        self._add_keep(end, f"keep the {end}", lambda: setattr(shown, "value", True))

    def _add_keep(self, key: edits.FlightKey, label: str, also: Callable[[], None] = lambda: None) -> None:
        """A tick by which a jump keeps a value of its flight as it is in the plan; without, it is a guess."""
        if self._jump is None:
            return

        def edit(is_on: bool) -> edits.Edit:
            result = self._session.view.result
            if is_on:
                also()
            return edits.keep(key, result.plan if is_on and result else None)

        hint = "As it was found, or is changed then. Without, it is a guess from which the jump is sought."
        self.inputs.tick(label, lambda problem: problem.jump is not None and key in problem.jump.fixed, edit, hint)

    def _add_flight(self, is_planar: bool) -> None:
        """Duration and degree of the flight; in a plane also what a jump in space finds by itself."""
        present = self._session.view.problem.flight.duration
        self.inputs.slider("duration, s", ("flight.duration",), 0.4 * present, 2.5 * present)
        if is_planar:
            self._add_momentum()
        self._add_keep("duration", "keep duration")
        if is_planar:
            self._add_keep("angular_momentum", "keep h")
        hint = "Of the polynomials: higher ones move more freely."
        self.inputs.choice("degree", DEGREES, _degree_word, _degree_edit, hint)
        if is_planar:
            self.inputs.tick("keep above the ground", lambda problem: problem.ground, edits.ground)

    def _add_momentum(self) -> None:
        """Angular momentum, horizontal velocity and objective of a flight in a plane."""
        result = self._session.view.result
        low, high = (result and result.plan.angular_momentum_bounds) or (0.0, 1.0)
        half = max(high - low, abs(low), abs(high), 0.1)
        speed = self._session.view.problem.flight.speed_in_plane
        hint = "Angular momentum: the middle of what suits joints that do not turn back "
        hint += f"({low:.3g} to {high:.3g} kg m²/s at first), free, or a number."
        self.inputs.choice(
            "h is", (*get_args(MomentumWordInPlane), A_NUMBER), _momentum_word, self._momentum_edit, hint
        )
        path = "flight.angular_momentum"
        self._momentum = self.inputs.slider("h, kg m²/s", (path,), low - half, high + half, get=self._momentum_of)
        path = "flight.horizontal_velocity"
        hint = f"{KEY_TABLE[path].meaning}, horizontal."
        self.inputs.slider("speed, m/s", (path,), speed - ENDS.speed, speed + ENDS.speed, hint=hint)
        self.inputs.choice(
            "least",
            OBJECTIVES,
            lambda problem: problem.motion.objective,
            lambda word: edits.change("motion", objective=word),
            "What the motion minimises.",
        )

    def _momentum_of(self, problem: fp.Problem, unknown: float = math.nan) -> float:
        """The angular momentum of the problem; that of the present motion where the problem has a word."""
        momentum = problem.flight.momentum_in_plane
        result = self._session.view.result
        if isinstance(momentum, str):
            return unknown if result is None else result.plan.angular_momentum
        return float(momentum)

    def _momentum_edit(self, word: str) -> edits.Edit:
        present = self._momentum_of(self._session.view.problem, 0.0)
        return edits.change("flight", angular_momentum=present if word == A_NUMBER else word)

    def _add_map(self) -> None:
        session = self._session
        switch = self._map_switch = self._gui.add_checkbox("plan around this point", initial_value=True)
        on(switch.on_update, lambda _: self._actions.do("map", lambda: session.draw_map(switch.value)))
        for row, column in np.ndindex(ROWS, COLUMNS):  # page.js hides these, and presses them
            self._button(f"map point {row},{column}", "jump", partial(session.jump, row, column))
        self._map_html = self._gui.add_html("")

    def _add_comparison(self) -> None:
        self._button("Keep this plan", "keep", lambda: self._session.keep(True))
        self._button("Let it go", "keep", lambda: self._session.keep(False), color="gray")
        self._comparison = self._gui.add_html("")
        speed = self._gui.add_dropdown("flown at", tuple(SPEEDS), initial_value="half speed")
        on(speed.on_update, lambda _: setattr(self._player, "speed", SPEEDS.get(speed.value, self._player.speed)))

    def _add_saving(self, folder: str) -> None:
        directory = self._gui.add_text("folder", folder)

        def save(document: Document) -> None:
            saved.content = cards.saved_card([self._session.save(document, directory.value)])

        documents: dict[str, Document] = {"Save problem": "problem", "Save plan": "plan", "Save report": "report"}
        for label, document in documents.items():
            self._button(label, label, partial(save, document))
        saved = self._gui.add_html(cards.saved_card([]))


def _momentum_word(problem: fp.Problem) -> str:
    momentum = problem.flight.angular_momentum
    return momentum if isinstance(momentum, str) else A_NUMBER


def _degree_word(problem: fp.Problem) -> str:
    return DEGREES[0] if problem.raises_degree else ", ".join(dict.fromkeys(map(str, problem.degrees)))


def _degree_edit(word: str) -> edits.Edit:
    return edits.change("motion", degree=int(word) if word.isdecimal() else word)


class LimitsTab:
    """Limits of joints and motors."""

    def __init__(self, gui: Any, session: Session, inputs: Inputs) -> None:
        self._session = session
        self._inputs = inputs
        self._sliders = {}
        for key, row in LIMIT_TABLE.items():
            if row.of != "base":
                self._sliders[key] = self._add(key)
        self._table = gui.add_html("")

    def draw(self, view: View) -> None:
        """Show sliders where they count, and the table."""
        self._table.content = cards.limits_card(view.result)
        for key, sliders in self._sliders.items():
            for slider in sliders:
                slider.visible = edits.limit_choice(view.problem, key) == edits.BY_HAND

    def _add(self, key: LimitKey) -> list[Any]:
        problem = self._session.view.problem
        row = LIMIT_TABLE[key]
        peaks = self._peaks(key)
        robot = problem.robot
        of_urdf = getattr(robot, f"motor_{key}_limits").tolist() if row.in_urdf else [math.inf] * len(robot.motors)
        words = ("none", "urdf", edits.BY_HAND) if np.isfinite(of_urdf).any() else ("none", edits.BY_HAND)
        self._inputs.choice(
            f"{key} limit",
            words,
            lambda problem: edits.limit_choice(problem, key),
            lambda word: edits.limit(key, word, self._peaks(key)),
        )
        sliders = []
        for joint in robot.joints:
            high = of_urdf[robot.motors.index(joint)]
            if math.isinf(high):
                high = ENDS.largest_limit * max(peaks[joint], 1e-3)
            paths = edits.limit_paths(robot, key, joint)
            sliders.append(self._inputs.slider(f"{joint}, {row.unit}", paths, ENDS.least_limit * high, high))
        return sliders

    def _peaks(self, key: LimitKey) -> dict[str, float]:
        """Peaks of the present motion, by motor."""
        result = self._session.view.result
        robot = self._session.view.problem.robot
        peaks = {} if result is None else {row.joint: getattr(row, f"{key}_peak") for row in result.utilisation}
        return {motor: float(peaks.get(motor, 1.0)) for motor in robot.motors}


class ObstaclesTab:
    """A folder of sliders for each obstacle; ``free_position`` is that of a new one, and the robot's size, m."""

    def __init__(
        self,
        gui: Any,
        tab: Any,
        session: Session,
        actions: Actions,
        inputs: Inputs,
        free_position: tuple[complex, float],
    ) -> None:
        self._gui = gui
        self._tab = tab
        self._session = session
        self._actions = actions
        self._inputs = inputs
        self._kinds: list[str] = []
        self._folders: list[Any] = []
        self._sliders: list[Any] = []
        for name, kind in OBSTACLE_KINDS.items():
            self._button(f"Add a {name}", edits.with_obstacle(kind.example(*free_position)))

    def draw(self, view: View) -> None:
        """List the obstacles anew where there are others."""
        kinds = [obstacle.kind for obstacle in view.problem.obstacles]
        if kinds == self._kinds:
            return
        self._inputs.forget(self._sliders)
        for folder in self._folders:
            folder.remove()
        self._folders = []
        self._sliders = []
        self._kinds = kinds
        for index, obstacle in enumerate(view.problem.obstacles):
            with self._tab, self._gui.add_folder(f"{obstacle.kind} {index}") as folder:
                self._sliders += [self._inputs.slider(*dial) for dial in obstacle_dials(index, obstacle)]
                self._button("Remove", edits.put_obstacle(index))
            self._folders.append(folder)

    def _button(self, label: str, edit: edits.Edit) -> None:
        button = self._gui.add_button(label, color="gray")
        on(
            button.on_click,
            lambda event: self._actions.do(f"obstacles {id(event)}", lambda: self._session.edit(edit)),
        )


def obstacle_dials(index: int, obstacle: Obstacle) -> list[tuple[str, tuple[str], float, float]]:
    """Labels, paths and ends of the sliders of an obstacle: its positions, radius and margin."""
    dials = []

    def add(label: str, key: str, low: float, high: float) -> None:
        dials.append((f"{label}, m", (f"obstacles.{index}.{key}",), low, high))

    for name in obstacle.places():
        for axis, value in enumerate(map(float, getattr(obstacle, name))):
            add(f"{name} {'→↑'[axis]}", f"{name}.{axis}", value - ENDS.position, value + ENDS.position)
    if hasattr(obstacle, "radius"):
        add("radius", "radius", 0.0, max(1.0, 2 * obstacle.radius))
    add("margin", "margin", 0.0, max(0.3, 2 * obstacle.margin))
    return dials
