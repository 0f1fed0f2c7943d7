"""The session: the present problem, its plan, and all that can be done, without a page."""

import os
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Generic, Literal, TypeAlias, TypeVar

import floatplan as fp
from floatplan.studio.edits import Edit, numbers
from floatplan.studio.planning import Planning
from floatplan.studio.tasks import Failure, Map, ShownPlan

State = TypeVar("State")
Verdict: TypeAlias = Literal["waiting", "planned", "proved", "undecided", "refuted", "not found", "failed", "stopped"]
Document: TypeAlias = Literal["problem", "plan", "report"]
FILE_NAMES: dict[Document, str] = {"problem": "problem.toml", "plan": "plan.json", "report": "report.html"}
MOST = 200  # [-] states of a history
STOPPED = "Change something, or take the last change back, to search again."
ONE_GESTURE = 1.0  # [s] between changes of one gesture that count as one


@dataclass(frozen=True, eq=False)
class View:
    """The state that a page shows, all of one instant.

    Attributes
    ----------
    problem : Problem
    number : of the problem; it grows
    result : ShownPlan or None
        The newest one, perhaps of an older problem.
    result_number : number of the problem that it is the result of
    doing : what the planning does for the newest problem
    fault : why the newest problem has no result; empty where it has one, or waits for it
    refusal : why the last change was not made; empty where it was
    compared : ShownPlan or None
        An older result to compare with.
    map : Map or None
    """

    problem: fp.Problem
    number: int = 0
    result: ShownPlan | None = None
    result_number: int = 0
    doing: str = ""
    fault: str = ""
    refusal: str = ""
    compared: ShownPlan | None = None
    map: Map | None = None

    @property
    def is_current(self) -> bool:
        """Whether the result is that of the newest problem."""
        return self.result is not None and self.result_number == self.number

    @property
    def verdict(self) -> Verdict:
        """State of the newest problem; "planned" has no proof yet."""
        if self.fault:
            return "stopped" if self.fault == STOPPED else "failed"
        if self.result is None or not self.is_current or not (self.result.settled or self.result.plan.ok):
            return "waiting"
        if self.problem.jump is not None and not (self.result.jump and self.result.jump.ok):
            return "not found" if self.result.jump else "waiting"
        if self.result.settled and self.result.plan.certificate is not None:
            return self.result.plan.certificate.verdict
        return "planned" if self.result.plan.ok else "not found"


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
        """Go to a new state, after the present one; of the same gesture, replace the present one."""
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

    Every method may be called from any thread, and none of them raises: the reason of a refusal is in
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
        self._settled: View | None = None  # the newest with a result of its own problem
        self._submit()

    @property
    def view(self) -> View:
        """The state that a page shows now."""
        return self._view

    def listen(self, listener: Callable[[], None]) -> None:
        """Call a function after each change."""
        self._listeners.append(listener)

    def edit(self, edit: Edit, gesture: str = "") -> bool:
        """Change the problem; return whether that was possible. Edits of one gesture are undone at once."""
        with self._lock:
            try:
                problem = edit(self._view.problem)
            except Exception as error:  # of whatever a user can reach: its message is shown, and nothing changes
                self.refuse(Failure.of(error).words)
                return False
            if problem is self._view.problem:
                return True
            self._history.change(problem, gesture)
            self._submit()
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
                self._submit()
            return moved

    def stop(self) -> None:
        """End a search; all is as it was when the newest result came, which may be undone as any change."""
        with self._lock:
            if self._view.verdict != "waiting":
                return
            self._planning.drop()
            if self._settled is None:
                self._show(fault=STOPPED)
                return
            self._history.change(self._settled.problem)
            self._show(**vars(replace(self._settled, compared=self._view.compared)))

    def jump(self, row: int, column: int) -> None:
        """Go to a point of the map."""
        chart = self._view.map
        if chart is not None:
            self.edit(numbers(chart.values(row, column)))

    def refuse(self, words: str) -> None:
        """Show why a request is not fulfilled."""
        self._show(refusal=words)

    def keep(self, is_on: bool = True) -> None:
        """Compare with the present result from now on, or with none."""
        with self._lock:
            self._show(compared=self._view.result if is_on else None)

    def draw_map(self, is_on: bool) -> None:
        """Whether to plan around the present point."""
        with self._lock:
            self._with_map = is_on
            if is_on and self._view.map is None:
                self._submit()

    def wait(self, done: Callable[[View], bool], patience: float) -> bool:
        """Wait for a view; return whether it came within so many seconds."""
        with self._changed:
            return self._changed.wait_for(lambda: done(self._view), patience)

    def save(self, document: Document, folder: str) -> str:
        """Write the problem, its plan or the report into a folder; return a message for the user.

        Files that this session has not written, or others have changed since, are not overwritten.
        """
        try:
            is_jump = document == "plan" and self.view.problem.jump is not None
            first = Path(folder).expanduser() / ("jump.json" if is_jump else FILE_NAMES[document])
            path = first
            numbers_of_copies = count(2)
            while os.path.lexists(path) and not self._is_own(path):
                path = first.with_stem(f"{first.stem}-{next(numbers_of_copies)}")
            _write(self.view, document, path)
            self._written[path.resolve()] = _version(path)
        except Exception as error:  # of a name, of a full disk, of what a report may find: the page goes on
            return f"Not saved: {Failure.of(error).words}"
        return f"{path} is saved." if path == first else f"{path} is saved: there is another {first.name} already."

    def _is_own(self, path: Path) -> bool:
        return path.is_file() and self._written.get(path.resolve()) == _version(path)

    def close(self) -> None:
        """End the planning."""
        self._planning.close()

    def _submit(self) -> None:
        with self._lock:
            problem = self._history.present
            number = self._planning.submit(problem, self._with_map)
            self._show(problem=problem, number=number, doing="", fault="", refusal="", map=None)

    def _take_plan(self, number: int, result: ShownPlan | Failure) -> None:
        with self._lock:
            if number > self._view.number:  # it was stopped
                return
            if isinstance(result, ShownPlan):
                self._show(result=result, result_number=number)
                if result.settled and self._view.is_current:
                    self._settled = self._view
            elif number == self._view.number:
                self._show(fault=result.words)

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


def _write(view: View, document: Document, path: Path) -> None:
    if document == "problem":
        fp.save_problem(view.problem, path)
        return
    if view.result is None or not view.is_current or not view.result.settled:
        raise fp.InputError("the plan is not settled yet", advice="wait a moment")
    motion = view.result.jump or view.result.plan
    if document == "plan":
        motion.save(path)
    else:
        motion.show(path, browse=False)


def _version(path: Path) -> tuple[int, int]:
    """What changes when a file is written anew."""
    state = path.stat()
    return state.st_ino, state.st_mtime_ns
