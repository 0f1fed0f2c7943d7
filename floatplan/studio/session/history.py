"""What was done, to undo and to do again."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Generic, TypeVar

State = TypeVar("State")

MOST = 200  # [-] states
ONE_GESTURE = 1.0  # [s] between changes by one hand that count as one


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
