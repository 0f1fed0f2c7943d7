"""Tabs of whole jumps: phases, friction and margins; of those in space also how they turn, and where they land."""

import math
from collections.abc import Sequence
from functools import partial
from typing import Any, get_args

import floatplan as fp
from floatplan.problem.jump import MARGIN, JumpRequest
from floatplan.studio import edits
from floatplan.studio.curves import bar_style, phase_colours
from floatplan.studio.inputs import ENDS, Inputs, is_alike
from floatplan.studio.session import Session, View
from floatplan.tables import KEY_TABLE


class JumpTab:
    """The request of a whole jump: its phases as a bar, friction, margins."""

    def __init__(self, gui: Any, session: Session, inputs: Inputs) -> None:
        self._gui = gui
        self._session = session
        self._inputs = inputs
        self._folder = gui.add_folder("Phases")
        self._bar: Any = None
        self._last_ends: tuple[float, ...] = ()  # [s] of the phases
        self._flight = 0  # index of the flight among the phases
        problem = session.view.problem
        with self._folder:
            self._style = gui.add_html("")
            hint = "How long all phases last, by the bar of their ends: dragging one fixes all."
            inputs.tick("fixed", lambda problem: edits.phase_ends(problem) is not None, self._fix, hint)
        inputs.slider("friction", ("jump.friction",), *ENDS.friction, hint=f"{KEY_TABLE['jump.friction'].meaning}.")
        hint = "Of the limits, what stances may use."
        for name in MARGIN:
            inputs.slider(f"{name}, %", (f"jump.margin.{name}",), ENDS.least_margin, 1.0, 0.01, hint)
        hint = "Height that what does not stand keeps above the ground."
        inputs.slider("clearance, mm", ("jump.clearance",), 0.0, ENDS.clearance, 1e-3, hint)
        # A free flyer's jumps have one objective.
        keys = ("feet",) if problem.robot.base == "free-flyer" else ("objective", "feet")
        for key in keys:
            words = [word for word in get_args(JumpRequest.hints[key]) if word != "point"]  # it has "points"
            inputs.choice(key, words, partial(_of_jump, key), partial(_jump_edit, key))

    def draw(self, view: View) -> None:
        """Show the phases of the plan; the bar comes with the first jump."""
        jump = None if view.result is None else view.result.solved_jump
        if jump is None:
            return
        if self._bar is None:
            ends = self._ends(view.problem)
            self._flight = [phase.kind for phase in jump.phases].index("flight")
            with self._folder:
                most = round(ENDS.phases * ends[-1], 2)
                shortest = ENDS.shortest_phase
                self._bar = self._gui.add_multi_slider("ends, s", 0.0, most, 0.001, ends, min_range=shortest)
            self._inputs.add(self._bar, self._ends, "phases", self._drag)
        present = self._ends(view.problem)
        self._bar.max = max(self._bar.max, *present)
        ends = self._bar.value if is_alike(self._bar.value, present) else present
        self._style.content = bar_style(phase_colours(jump), [end / self._bar.max for end in ends])

    def _ends(self, problem: fp.Problem) -> tuple[float, ...]:
        """When the phases end: as the problem fixes them, else as in the plan."""
        result = self._session.view.result
        ends = edits.phase_ends(problem)
        if ends is None and result is not None and result.jump is not None:
            ends = tuple(phase.end for phase in result.jump.phases)
        self._last_ends = tuple(round(end, 3) for end in ends or self._last_ends)
        return self._last_ends

    def _drag(self, ends: Sequence[float]) -> None:
        self._session.edit(edits.phases(ends, self._flight), "phases")

    def _fix(self, is_on: bool) -> edits.Edit:
        present = self._session.view.problem
        return edits.phases(self._ends(present) if is_on and self._bar else None, self._flight)


def _of_jump(key: str, problem: fp.Problem) -> str:
    return str(getattr(problem.jump, key))


def _jump_edit(key: str, word: str) -> edits.Edit:
    return edits.change("jump", **{key: word})


class LandingTab:
    """How a jump in space has turned when it lands, and where it stands then."""

    def __init__(self, gui: Any, session: Session, inputs: Inputs) -> None:
        self._session = session
        goal = session.view.problem.final.attitude
        if goal is not None and goal.axes is not None:
            for index in (0, 2):  # the middle one stays small: the base is level in the end
                path = f"goal.orientation.angles.{index}"
                angle = edits.number_at(session.view.problem, path)
                hint = "About an axis of the base as the angles before have rotated it; 360° is a whole one."
                ends = (angle - ENDS.rotation, angle + ENDS.rotation)
                inputs.slider(f"about {goal.axes[index]}, °", (path,), *ends, math.radians(1), hint)
        hint = "How far the robot comes is fixed as it is now, and may be changed then. Without, it is free."
        inputs.tick("landing fixed", _is_fixed, self._keep, hint)
        hint = "How far the centre of mass has come in the end."
        self._displacement = []
        for index, axis in enumerate("xy"):
            path = f"jump.landing.displacement.{index}"
            ends = (-ENDS.displacement, ENDS.displacement)
            get = partial(self._shown, index)
            self._displacement.append(inputs.slider(f"along {axis}, m", (path,), *ends, hint=hint, get=get))

    def draw(self, view: View) -> None:
        """Let the displacement be changed where it is fixed."""
        for slider in self._displacement:
            slider.disabled = not _is_fixed(view.problem)

    def _shown(self, axis: int, problem: fp.Problem) -> float:
        """How far the robot comes along x or y, m: as the problem has it, else as the jump that is shown."""
        result = self._session.view.result
        if problem.jump is not None and problem.jump.landing.displacement is not None:
            return problem.jump.landing.displacement[axis]
        if result is None or result.solved_jump is None:
            return 0.0
        return edits.displacement_of(result.solved_jump)[axis]

    def _keep(self, is_on: bool) -> edits.Edit:
        result = self._session.view.result
        return edits.displaced(result.solved_jump if is_on and result else None)


def _is_fixed(problem: fp.Problem) -> bool:
    return problem.jump is not None and problem.jump.landing.displacement is not None
