"""The session: the problem as it stands, the answer to it, and all that can be done."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic, Literal, TypeAlias, TypeVar

import floatplan as fp
from floatplan.studio.session.edits import Edit, numbers
from floatplan.studio.work.around import Map
from floatplan.studio.work.flown import Flown
from floatplan.studio.work.planning import Planning
from floatplan.studio.work.tasks import Failure, words_of

State = TypeVar("State")
Verdict: TypeAlias = Literal["waiting", "planned", "proved", "undecided", "refuted", "not found", "failed"]
MOST = 200  # [-] states of a history
ONE_GESTURE = 1.0  # [s] between changes of one gesture that count as one


@dataclass(frozen=True, eq=False)
class View:
    """What is to be shown, all at one instant.

    Attributes
    ----------
    problem : Problem
        As asked.
    number : of the question
    flown : Flown or None
        The newest answer, perhaps to an older question.
    answers : number of the question that it answers
    fault : why the newest question has no answer; empty where it has one, or waits for it
    refusal : why the last change was not made; empty where it was
    kept : Flown or None
        To compare with.
    map : Map or None
    can_undo, can_redo : bool
    """

    problem: fp.Problem
    number: int = 0
    flown: Flown | None = None
    answers: int = 0
    fault: str = ""
    refusal: str = ""
    kept: Flown | None = None
    map: Map | None = None
    can_undo: bool = False
    can_redo: bool = False

    @property
    def is_current(self) -> bool:
        """Whether what is flown answers what is asked."""
        return self.flown is not None and self.answers == self.number

    @property
    def verdict(self) -> Verdict:
        """What is known of the present question; "planned" has no proof yet."""
        if self.fault:
            return "failed"
        if self.flown is None or not self.is_current:
            return "waiting"
        if not self.flown.settled:
            return "planned" if self.flown.plan.ok else "waiting"
        if self.flown.certificate is not None:
            return self.flown.certificate.verdict
        return "planned" if self.flown.plan.ok else "not found"


class History(Generic[State]):
    """A sequence of states with a present one.

    Changes of the same gesture that follow each other closely are one: a drag is undone as a whole.
    """

    def __init__(self, first: State, clock: Callable[[], float] = time.monotonic) -> None:
        self._states = [first]
        self._at = 0
        self._clock = clock
        self._gesture, self._last = "", -1e9

    @property
    def present(self) -> State:
        """The present state."""
        return self._states[self._at]

    @property
    def can_undo(self) -> bool:
        """Whether there is an earlier state."""
        return self._at > 0

    @property
    def can_redo(self) -> bool:
        """Whether there is a later one."""
        return self._at + 1 < len(self._states)

    def change(self, state: State, gesture: str = "") -> None:
        """Go to a new state, after the present one; of the same gesture, in its place."""
        now = self._clock()
        del self._states[self._at + 1 :]
        if gesture and gesture == self._gesture and now - self._last < ONE_GESTURE and self._at > 0:
            self._states[self._at] = state
        else:
            self._states = [*self._states, state][-MOST:]
            self._at = len(self._states) - 1
        self._gesture, self._last = gesture, now

    def undo(self) -> None:
        """Go back by one state, if there is one."""
        self._go(-1)

    def redo(self) -> None:
        """Go forth by one state, if there is one."""
        self._go(1)

    def _go(self, step: int) -> None:
        self._at = min(max(self._at + step, 0), len(self._states) - 1)
        self._gesture = ""


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
        self._planning = Planning(problem.robot, self._take_flown, self._take_map)
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
                self.refuse(words_of(error))
                return False
            if problem is self._view.problem:
                return True
            self._history.change(problem, gesture)
            self._ask()
            return True

    def set(self, path: str, value: float, gesture: str = "") -> bool:
        """Set a number by its path in a problem file, SI units and radians."""
        return self.edit(numbers({path: value}), gesture or path)

    def undo(self) -> None:
        """Take back the last change."""
        with self._lock:
            if self._history.can_undo:
                self._history.undo()
                self._ask()

    def redo(self) -> None:
        """Make it again."""
        with self._lock:
            if self._history.can_redo:
                self._history.redo()
                self._ask()

    def jump(self, row: int, column: int) -> None:
        """Go to a point of the map."""
        chart = self._view.map
        if chart is not None:
            self.edit(numbers(chart.values(row, column)))

    def refuse(self, words: str) -> None:
        """Say why something that was asked is not done."""
        with self._lock:
            self._show(refusal=words)

    def keep(self, wanted: bool = True) -> None:
        """Keep the present answer to compare with, or let it go."""
        with self._lock:
            self._show(kept=self._view.flown if wanted else None)

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

    def close(self) -> None:
        """End the planning."""
        self._planning.close()

    @property
    def process_ids(self) -> list[int]:
        """Of the processes that plan."""
        return self._planning.process_ids

    def _ask(self) -> None:
        with self._lock:
            problem = self._history.present
            number = self._planning.ask(problem, self._with_map)
            self._show(problem=problem, number=number, fault="", refusal="", map=None)

    def _take_flown(self, number: int, answer: Flown | Failure) -> None:
        with self._lock:
            if isinstance(answer, Flown):
                self._show(flown=answer, answers=number)
            elif number == self._view.number:
                self._show(fault=answer.words)

    def _take_map(self, number: int, chart: Map) -> None:
        with self._lock:
            if number == self._view.number:
                self._show(map=chart)

    def _show(self, **changes: object) -> None:
        with self._changed:
            history = {"can_undo": self._history.can_undo, "can_redo": self._history.can_redo}
            self._view = replace(self._view, **history, **changes)  # type: ignore[arg-type]
            self._changed.notify_all()
        for listener in self._listeners:
            listener()
