"""The panel: what is asked, as sliders and choices, and what the session says about it."""

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

import floatplan as fp
from floatplan.errors import printable
from floatplan.problem.jump import MARGIN
from floatplan.problem.parts import OBSTACLE_KINDS, Obstacle
from floatplan.studio import cards, edits
from floatplan.studio.answers import COLUMNS, ROWS
from floatplan.studio.curves import bar_style, curves_card, instant_mark, phase_colours
from floatplan.studio.inputs import Inputs, by_user, in_turn, is_alike, on
from floatplan.studio.planning import Actions
from floatplan.studio.session import Part, Session, View
from floatplan.studio.stage import Player, Stage
from floatplan.tables import LIMIT_TABLE, OBJECTIVES, LimitKey

DEGREE = math.pi / 180  # [rad]
TURNS = 400 * DEGREE  # [rad] that an orientation's slider reaches, to both sides
FASTER = 4.0  # [m/s] that the horizontal velocity's slider reaches, to both sides
REACH = 2.0  # [m] that a place's slider reaches, to both sides
LEAST = 0.01  # [-] of a limit slider's end
WIDE = 3.0  # [-] of what the first motion needs, where the URDF has no limit: a slider's end
SPEEDS = {"real time": 1.0, "half speed": 0.5, "a quarter": 0.25, "a tenth": 0.1}
FRICTION = 0.1, 1.5  # [-] ends of its slider
LEAST_MARGIN = 0.3  # [-], [m] of clearance: the same
HIGHEST = 0.1
LONGER = 1.25  # [-] of a jump: end of the bar of its phases; [s] of a phase
SHORTEST = 0.02
A_NUMBER = "a number"
MOMENTA = ("midpoint", "free", A_NUMBER)
DEGREES = ("auto", "7", "9", "11", "13")
SAVED: dict[str, Part] = {"Save problem": "problem", "Save plan": "plan", "Save report": "report"}


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
        self._drawn: View | None = None
        self._begun = 0  # number of the newest question whose search was not drawn at once
        self._status = self._gui.add_html(cards.status_card(session.view))
        self._flying()
        tabs = self._gui.add_tab_group()
        self._jump = None
        if session.view.problem.jump is not None:
            with tabs.add_tab("Jump"):
                self._jump = JumpTab(self._gui, session, self.inputs)
        with tabs.add_tab("Goal"):
            self._posture("goal")
        with tabs.add_tab("Start"):
            self._posture("start")
        with tabs.add_tab("Flight"):
            self._flight()
        with tabs.add_tab("Limits"):
            self._limits = LimitsTab(self._gui, session, self.inputs)
        with tabs.add_tab("Obstacles") as tab:
            self._obstacles = ObstaclesTab(self._gui, tab, session, actions, self.inputs, stage.free_place())
        self._map_html = None
        if self._jump is None:
            with tabs.add_tab("Map"):
                self._map()
        with tabs.add_tab("Compare"):
            self._compare()
        with tabs.add_tab("Save"):
            self._save(folder)
        self._beside, self._curves, self._now = (self._gui.add_html("") for _ in range(3))

    def draw(self, view: View) -> bool:
        """Say and show what has changed; return whether it has to be drawn again soon.

        So it is where the user holds a slider, or a search may take long enough to be shown.
        """
        self.inputs.problem = view.problem
        begun = not cards.is_news(self._drawn, view) and view.number != self._begun
        if begun:
            self._begun = view.number
        else:
            self._drawn = view
            self._status.content = cards.status_card(view)
            self._beside.content = cards.warning_card(view)
            if view.answer is not None:
                self._curves.content = curves_card(view.answer.motion, view.answer.shares)
        if self._map_html is not None:
            self._map_html.content = cards.map_card(view.map, self._map_wanted.value)
        if self._jump is not None:
            self._jump.draw(view)
        self._comparison.content = cards.comparison_card(view.answer, view.kept)
        self._limits.draw(view)
        self._obstacles.draw(view)
        self._momentum.disabled = isinstance(view.problem.flight.angular_momentum, str)
        longest = max(shown.motion.duration for shown in (view.answer, view.kept) if shown is not None)
        self.time.max = math.ceil(1e3 * longest) / 1e3
        return in_turn(self._server, lambda: self.inputs.follow(view.problem)) or begun

    def at(self, instant: float) -> None:
        """Show the flight's time, s."""
        value = round(float(np.clip(instant, 0.0, self.time.max)), 3)
        in_turn(self._server, lambda: setattr(self.time, "value", value))
        answer = self._session.view.answer
        self._now.content = "" if answer is None else instant_mark(instant / answer.motion.duration)

    def _button(self, label: str, about: str, act: Callable[[], object], **look: Any) -> Any:
        button = self._gui.add_button(label, **look)
        on(button.on_click, lambda _: self._actions.do(about, act))
        return button

    def _flying(self) -> None:
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

    def _posture(self, end: edits.Part) -> None:
        problem = self._session.view.problem
        path = f"{end}.orientation"
        turn = edits.number_at(problem, path)
        hint = "360° more is one somersault more."
        self.inputs.slider("base, °", (path,), turn - TURNS, turn + TURNS, DEGREE, hint)
        for joint, (low, high) in zip(problem.robot.joints, problem.position_limits.tolist(), strict=True):
            self.inputs.slider(f"{joint}, °", (f"{end}.positions.{joint}",), low, high, DEGREE)
        root = self._stage.ghosts[end].root
        hint = "Drag its links to change it."
        shown = self._gui.add_checkbox(f"show the {end}", initial_value=root.visible, hint=hint)
        on(shown.on_update, lambda _: setattr(root, "visible", shown.value))

        self._keep(end, f"keep the {end}", lambda: setattr(shown, "value", True))

    def _keep(self, part: edits.Part, label: str, also: Callable[[], None] = lambda: None) -> None:
        """A tick by which a jump keeps a part of its flight, as it was found; without, what is asked is a guess."""
        if self._jump is None:
            return

        def edit(wanted: bool) -> edits.Edit:
            answer = self._session.view.answer
            if wanted:
                also()
            return edits.keep(part, answer.plan if wanted and answer else None)

        hint = "As it was found, or is changed then. Without, it is a guess from which the jump is sought."
        self.inputs.tick(label, lambda each: each.jump is not None and part in each.jump.fixed, edit, hint)

    def _flight(self) -> None:
        answer = self._session.view.answer
        problem = self._session.view.problem
        low, high = (answer and answer.plan.angular_momentum_bounds) or (0.0, 1.0)
        half = max(high - low, abs(low), abs(high), 0.1)
        present = problem.flight.duration
        speed = problem.flight.speed_in_plane
        self.inputs.slider("duration, s", ("flight.duration",), 0.4 * present, 2.5 * present)
        hint = "Angular momentum: the middle of what suits joints that do not turn back "
        hint += f"({low:.3g} to {high:.3g} kg m²/s at first), free, or a number."
        self.inputs.choice("h is", MOMENTA, _momentum_word, self._momentum_edit, hint)
        path = "flight.angular_momentum"
        self._momentum = self.inputs.slider("h, kg m²/s", (path,), low - half, high + half, get=self._momentum_of)
        path = "flight.horizontal_velocity"
        hint = "Of the centre of mass, horizontal."
        self.inputs.slider("speed, m/s", (path,), speed - FASTER, speed + FASTER, hint=hint)
        self.inputs.choice(
            "least",
            OBJECTIVES,
            lambda each: each.motion.objective,
            lambda word: edits.change("motion", objective=word),
            "What the motion minimises.",
        )
        self._keep("duration", "keep duration")
        self._keep("angular_momentum", "keep h")
        hint = "Of the polynomials: higher ones move more freely."
        self.inputs.choice("degree", DEGREES, _degree_word, _degree_edit, hint)
        self.inputs.tick("keep above the ground", lambda each: each.ground, edits.ground)

    def _momentum_of(self, problem: fp.Problem, unknown: float = math.nan) -> float:
        """The angular momentum that is asked for; that of the present motion where a word is."""
        asked = problem.flight.momentum_in_plane
        answer = self._session.view.answer
        if isinstance(asked, str):
            return unknown if answer is None else answer.plan.angular_momentum
        return float(asked)

    def _momentum_edit(self, word: str) -> edits.Edit:
        present = self._momentum_of(self._session.view.problem, 0.0)
        return edits.change("flight", angular_momentum=present if word == A_NUMBER else word)

    def _map(self) -> None:
        session = self._session
        wanted = self._map_wanted = self._gui.add_checkbox("plan around this point", initial_value=True)
        on(wanted.on_update, lambda _: self._actions.do("map", lambda: session.draw_map(wanted.value)))
        for row, column in np.ndindex(ROWS, COLUMNS):  # page.js hides these, and presses them
            self._button(f"map point {row},{column}", "jump", partial(session.jump, row, column))
        self._map_html = self._gui.add_html("")

    def _compare(self) -> None:
        self._button("Keep this plan", "keep", lambda: self._session.keep(True))
        self._button("Let it go", "keep", lambda: self._session.keep(False), color="gray")
        self._comparison = self._gui.add_html("")
        speed = self._gui.add_dropdown("flown at", tuple(SPEEDS), initial_value="half speed")
        on(speed.on_update, lambda _: setattr(self._player, "speed", SPEEDS.get(speed.value, self._player.speed)))

    def _save(self, folder: str) -> None:
        place = self._gui.add_text("folder", folder)

        def save(part: Part) -> None:
            saved.content = cards.saved_card([self._session.save(part, place.value)])

        for label, part in SAVED.items():
            self._button(label, label, partial(save, part))
        saved = self._gui.add_html(cards.saved_card([]))


def _momentum_word(problem: fp.Problem) -> str:
    momentum = problem.flight.angular_momentum
    return momentum if isinstance(momentum, str) else A_NUMBER


def _degree_word(problem: fp.Problem) -> str:
    return DEGREES[0] if problem.raises_degree else ", ".join(dict.fromkeys(map(str, problem.degrees)))


def _degree_edit(word: str) -> edits.Edit:
    return edits.change("motion", degree=int(word) if word.isdecimal() else word)


class JumpTab:
    """What a whole jump is asked: its phases as a bar, friction, margins."""

    def __init__(self, gui: Any, session: Session, inputs: Inputs) -> None:
        self._gui = gui
        self._session = session
        self._inputs = inputs
        self._folder = gui.add_folder("Phases")
        self._bar: Any = None
        self._last_ends: tuple[float, ...] = ()  # [s] of the phases
        self._flight = 0  # which phase it is
        with self._folder:
            self._look = gui.add_html("")
            hint = "How long all phases last, by the bar of their ends: dragging one fixes all."
            inputs.tick("fixed", lambda each: edits.phase_ends(each) is not None, self._kept, hint)
        inputs.slider("friction", ("jump.friction",), *FRICTION, hint="Coefficient of the ground.")
        hint = "Of the limits, what stances may use."
        for name in MARGIN:
            inputs.slider(f"{name}, %", (f"jump.margin.{name}",), LEAST_MARGIN, 1.0, 0.01, hint)
        hint = "Height that what does not stand keeps above the ground."
        inputs.slider("clearance, mm", ("jump.clearance",), 0.0, HIGHEST, 1e-3, hint)
        for key, words in (("objective", ("torque", "limits")), ("feet", ("auto", "rolling", "points"))):
            inputs.choice(key, words, partial(_of_jump, key), partial(_jump_edit, key))

    def draw(self, view: View) -> None:
        """Show the phases as they are planned; the bar comes with the first jump."""
        shown = None if view.answer is None else view.answer.found_jump
        if shown is None:
            return
        if self._bar is None:
            ends = self._ends(view.problem)
            self._flight = [phase.kind for phase in shown.phases].index("flight")
            with self._folder:
                most = round(LONGER * ends[-1], 2)
                self._bar = self._gui.add_multi_slider("ends, s", 0.0, most, 0.001, ends, min_range=SHORTEST)
            self._inputs.add(self._bar, self._ends, "phases", self._drag)
        self._bar.max = max(self._bar.max, *self._ends(view.problem))
        ends = self._bar.value
        present = self._ends(view.problem)
        shares = [each / self._bar.max for each in (ends if is_alike(ends, present) else present)]
        self._look.content = bar_style(phase_colours(shown), shares)

    def _ends(self, problem: fp.Problem) -> tuple[float, ...]:
        """When the phases end: as is asked, else as they were found."""
        answer = self._session.view.answer
        asked = edits.phase_ends(problem)
        found = () if answer is None or answer.jump is None else tuple(phase.end for phase in answer.jump.phases)
        self._last_ends = tuple(round(each, 3) for each in asked or found or self._last_ends)
        return self._last_ends

    def _drag(self, ends: Sequence[float]) -> None:
        self._session.edit(edits.phases(ends, self._flight), "phases")

    def _kept(self, wanted: bool) -> edits.Edit:
        present = self._session.view.problem
        return edits.phases(self._ends(present) if wanted and self._bar else None, self._flight)


def _of_jump(key: str, problem: fp.Problem) -> str:
    return str(getattr(problem.jump, key))


def _jump_edit(key: str, word: str) -> edits.Edit:
    return edits.change("jump", **{key: word})


class LimitsTab:
    """Limits of joints and motors."""

    def __init__(self, gui: Any, session: Session, inputs: Inputs) -> None:
        self._session = session
        self._inputs = inputs
        self._sliders = {key: self._add(key) for key, row in LIMIT_TABLE.items() if row.of != "base"}
        self._table = gui.add_html("")

    def draw(self, view: View) -> None:
        """Show sliders where they count, and the table."""
        self._table.content = cards.limits_card(view.answer)
        for key, sliders in self._sliders.items():
            for slider in sliders:
                slider.visible = edits.limit_choice(view.problem, key) == edits.BY_HAND

    def _add(self, key: LimitKey) -> list[Any]:
        problem = self._session.view.problem
        row = LIMIT_TABLE[key]
        needed = self._needed(key)
        robot = problem.robot
        of_urdf = getattr(robot, f"motor_{key}_limits").tolist() if row.in_urdf else [math.inf] * len(robot.motors)
        words = ("none", "urdf", edits.BY_HAND) if np.isfinite(of_urdf).any() else ("none", edits.BY_HAND)
        self._inputs.choice(
            f"{key} limit",
            words,
            lambda each: edits.limit_choice(each, key),
            lambda word: edits.limit(key, word, self._needed(key)),
        )
        ends = {
            motor: value if math.isfinite(value) else WIDE * max(needed[motor], 1e-3)
            for motor, value in zip(robot.motors, of_urdf, strict=True)
        }
        return [
            self._inputs.slider(
                f"{joint}, {row.unit}", edits.limit_paths(robot, key, joint), LEAST * ends[joint], ends[joint]
            )
            for joint in robot.joints
        ]

    def _needed(self, key: LimitKey) -> dict[str, float]:
        """Peaks of the present motion, by motor."""
        answer = self._session.view.answer
        robot = self._session.view.problem.robot
        peaks = {} if answer is None else {row.joint: getattr(row, f"{key}_peak") for row in answer.utilisation}
        return {motor: float(peaks.get(motor, 1.0)) for motor in robot.motors}


class ObstaclesTab:
    """A folder of sliders for each obstacle; ``free_place`` is where a new one goes, and the robot's size, m."""

    def __init__(
        self, gui: Any, tab: Any, session: Session, actions: Actions, inputs: Inputs, free_place: tuple[complex, float]
    ) -> None:
        self._gui = gui
        self._tab = tab
        self._session = session
        self._actions = actions
        self._inputs = inputs
        self._kinds: list[str] = []
        self._folders: list[Any] = []
        self._sliders: list[Any] = []
        for kind, known in OBSTACLE_KINDS.items():
            self._button(f"Add a {kind}", edits.with_obstacle(known.example(*free_place)))

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
    """Labels, paths and ends of the sliders of an obstacle: its places, radius and margin."""
    ends = {
        f"{name}.{axis}": (f"{name} {'→↑'[axis]}", float(place) - REACH, float(place) + REACH)
        for name in obstacle.places()
        for axis, place in enumerate(getattr(obstacle, name))
    }
    if hasattr(obstacle, "radius"):
        ends["radius"] = "radius", 0.0, max(1.0, 2 * obstacle.radius)
    ends["margin"] = "margin", 0.0, max(0.3, 2 * obstacle.margin)
    return [(f"{label}, m", (f"obstacles.{index}.{key}",), low, high) for key, (label, low, high) in ends.items()]
