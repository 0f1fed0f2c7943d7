"""The session: the problem as it stands, the answer to it, and all that can be done, without a page."""

import os
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import chain, count
from pathlib import Path
from typing import Generic, Literal, TypeAlias, TypeVar

import floatplan as fp
from floatplan.studio.answers import Failure, Map, ShownPlan
from floatplan.studio.edits import Edit, numbers
from floatplan.studio.planning import Planning

State = TypeVar("State")
Verdict: TypeAlias = Literal["waiting", "planned", "proved", "undecided", "refuted", "not found", "failed", "stopped"]
Part: TypeAlias = Literal["problem", "plan", "report"]
FILE_NAMES: dict[Part, str] = {"problem": "problem.toml", "plan": "plan.json", "report": "report.html"}
JUMP = "jump.json"  # in the place of a plan
MOST = 200  # [-] states of a history
STOPPED = "Change something, or take the last change back, to search again."
ONE_GESTURE = 1.0  # [s] between changes of one gesture that count as one


@dataclass(frozen=True, eq=False)
class View:
    """What is to be shown, all at one instant.

    Attributes
    ----------
    problem : Problem
        As asked.
    number : of the question
    answer : ShownPlan or None
        The newest one, perhaps to an older question.
    answered : number of the question that it answers
    doing : what is done to answer the newest question
    fault : why the newest question has no answer; empty where it has one, or waits for it
    refusal : why the last change was not made; empty where it was
    kept : ShownPlan or None
        To compare with.
    map : Map or None
    """

    problem: fp.Problem
    number: int = 0
    answer: ShownPlan | None = None
    answered: int = 0
    doing: str = ""
    fault: str = ""
    refusal: str = ""
    kept: ShownPlan | None = None
    map: Map | None = None

    @property
    def is_current(self) -> bool:
        """Whether the answer is to what is asked."""
        return self.answer is not None and self.answered == self.number

    @property
    def verdict(self) -> Verdict:
        """What is known of the present question; "planned" has no proof yet."""
        if self.fault:
            return "stopped" if self.fault == STOPPED else "failed"
        if self.answer is None or not self.is_current or not (self.answer.settled or self.answer.plan.ok):
            return "waiting"
        if self.problem.jump is not None and not (self.answer.jump and self.answer.jump.ok):
            return "not found" if self.answer.jump else "waiting"
        if self.answer.settled and self.answer.plan.certificate is not None:
            return self.answer.plan.certificate.verdict
        return "planned" if self.answer.plan.ok else "not found"


class History(Generic[State]):
    """A sequence of states with a present one.

    Changes of the same gesture that follow each other closely are one: a drag is undone as a whole.
    """

    def __init__(self, first: State, clock: Callable[[], float] = time.monotonic) -> None:
        self._states = [first]
        self._at = 0
        self._clock = clock
        self._gesture = ""
        self._last = -1e9

    @property
    def present(self) -> State:
        """The present state."""
        return self._states[self._at]

    def change(self, state: State, gesture: str = "") -> None:
        """Go to a new state, after the present one; of the same gesture, in its place."""
        now = self._clock()
        del self._states[self._at + 1 :]
        if gesture and gesture == self._gesture and now - self._last < ONE_GESTURE and self._at > 0:
            self._states[self._at] = state
        else:
            self._states = [*self._states, state][-MOST:]
            self._at = len(self._states) - 1
        self._gesture = gesture
        self._last = now

    def go(self, step: int) -> bool:
        """Go so many steps forth, or back where negative, if there is such a state; return whether there is."""
        if not 0 <= self._at + step < len(self._states):
            return False
        self._at = self._at + step
        self._gesture = ""
        return True


class Session:
    """A problem that is changed by hand, planned anew at each change.

    Every method may be called from any thread, and none of them raises: what cannot be done is said in
    ``view.refusal``. Listeners are called after each change of :attr:`view`, from whatever thread made it.
    """

    def __init__(self, problem: fp.Problem, with_map: bool = True) -> None:
        self._lock = threading.RLock()
        self._changed = threading.Condition(self._lock)
        self._history = History(problem)
        self._listeners: list[Callable[[], None]] = []
        self._view = View(problem)
        self._with_map = with_map
        self._written: dict[Path, tuple[int, int]] = {}
        self._planning = Planning(problem.robot, self._take_plan, self._take_map, self._take_words)
        self._settled: View | None = None  # the newest with an answer to what was asked
        self._ask()

    @property
    def view(self) -> View:
        """What is to be shown now."""
        return self._view

    def listen(self, listener: Callable[[], None]) -> None:
        """Call a function after each change."""
        self._listeners.append(listener)

    def edit(self, edit: Edit, gesture: str = "") -> bool:
        """Change the problem; return whether that was possible. Edits of one gesture are undone together."""
        with self._lock:
            try:
                problem = edit(self._view.problem)
            except Exception as error:  # of whatever a user can reach: it is said, and nothing changes
                self.refuse(Failure.of(error).words)
                return False
            if problem is self._view.problem:
                return True
            self._history.change(problem, gesture)
            self._ask()
            return True

    def set(self, path: str, value: float) -> bool:
        """Set a number by its path in a problem file, SI units and radians."""
        return self.edit(numbers({path: value}), path)

    def undo(self) -> bool:
        """Take back the last change; return whether there was one."""
        return self._go(-1)

    def redo(self) -> bool:
        """Make it again; return whether there was one."""
        return self._go(1)

    def _go(self, step: int) -> bool:
        with self._lock:
            moved = self._history.go(step)
            if moved:
                self._ask()
            return moved

    def stop(self) -> None:
        """End a search; all is as it was when the newest answer came, which may be undone as any change."""
        with self._lock:
            if self._view.verdict != "waiting":
                return
            self._planning.drop()
            if self._settled is None:
                self._show(fault=STOPPED)
                return
            self._history.change(self._settled.problem)
            self._show(**vars(replace(self._settled, kept=self._view.kept)))

    def jump(self, row: int, column: int) -> None:
        """Go to a point of the map."""
        chart = self._view.map
        if chart is not None:
            self.edit(numbers(chart.values(row, column)))

    def refuse(self, words: str) -> None:
        """Say why something that was asked is not done."""
        self._show(refusal=words)

    def keep(self, wanted: bool = True) -> None:
        """Keep the present answer to compare with, or let it go."""
        with self._lock:
            self._show(kept=self._view.answer if wanted else None)

    def draw_map(self, wanted: bool) -> None:
        """Whether to plan around the present point."""
        with self._lock:
            self._with_map = wanted
            if wanted and self._view.map is None:
                self._ask()

    def wait(self, done: Callable[[View], bool], patience: float) -> bool:
        """Wait for a view; return whether it came within so many seconds."""
        with self._changed:
            return self._changed.wait_for(lambda: done(self._view), patience)

    def save(self, part: Part, folder: str) -> str:
        """Write the problem, its plan or the report into a folder; return what to say about it.

        What this session has not written, or others have changed since, is not overwritten.
        """
        try:
            name = JUMP if part == "plan" and self.view.problem.jump is not None else FILE_NAMES[part]
            wanted = Path(folder).expanduser() / name
            numbered = (wanted.with_stem(f"{wanted.stem}-{number}") for number in count(2))
            path = next(each for each in chain((wanted,), numbered) if not os.path.lexists(each) or self._is_own(each))
            _write(self.view, part, path)
            self._written[path.resolve()] = _version(path)
        except Exception as error:  # of a name, of a full disk, of what a report may find: the page goes on
            return f"Not saved: {Failure.of(error).words}"
        return f"{path} is saved." if path == wanted else f"{path} is saved: there is another {wanted.name} already."

    def _is_own(self, path: Path) -> bool:
        return path.is_file() and self._written.get(path.resolve()) == _version(path)

    def close(self) -> None:
        """End the planning."""
        self._planning.close()

    def _ask(self) -> None:
        with self._lock:
            problem = self._history.present
            number = self._planning.ask(problem, self._with_map)
            self._show(problem=problem, number=number, doing="", fault="", refusal="", map=None)

    def _take_plan(self, number: int, answer: ShownPlan | Failure) -> None:
        with self._lock:
            if number > self._view.number:  # it was stopped
                return
            if isinstance(answer, ShownPlan):
                self._show(answer=answer, answered=number)
                if answer.settled and self._view.is_current:
                    self._settled = self._view
            elif number == self._view.number:
                self._show(fault=answer.words)

    def _take_map(self, number: int, chart: Map) -> None:
        with self._lock:
            if number == self._view.number:
                self._show(map=chart)
                self._settled = self._view if self._view.is_current else self._settled

    def _take_words(self, number: int, words: str) -> None:
        with self._lock:
            if number == self._view.number:
                self._show(doing=words)

    def _show(self, **changes: object) -> None:
        with self._changed:
            self._view = replace(self._view, **changes)  # type: ignore[arg-type]
            self._changed.notify_all()
        for listener in self._listeners:
            listener()


def _write(view: View, part: Part, path: Path) -> None:
    if part == "problem":
        fp.save_problem(view.problem, path)
        return
    if view.answer is None or not view.is_current or not view.answer.settled:
        raise fp.InputError("the plan is not settled yet", advice="wait a moment")
    found = view.answer.jump or view.answer.plan
    if part == "plan":
        found.save(path)
    else:
        found.show(path, browse=False)


def _version(path: Path) -> tuple[int, int]:
    """What changes when a file is written anew."""
    state = path.stat()
    return state.st_ino, state.st_mtime_ns
