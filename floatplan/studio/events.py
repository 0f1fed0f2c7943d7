"""What a user does, one thing at a time: of what comes faster than it can be done, the newest counts."""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Callable
from typing import Any, TypeVar

Result = TypeVar("Result")
LOG = logging.getLogger(__name__)


class Actions:
    """Actions by what they are about, done in a thread of their own in the order in which they were begun."""

    def __init__(self, name: str) -> None:
        self._actions: dict[str, Callable[[], object]] = {}
        self._change = threading.Condition()
        self._closed = False
        self._busy = False
        self.errors: list[BaseException] = []
        self._thread = threading.Thread(target=self._work, name=name, daemon=True)
        self._thread.start()

    def do(self, about: str, action: Callable[[], object]) -> None:
        """Do something soon; in place of what was to be done about the same before."""
        with self._change:
            self._actions[about] = action
            self._change.notify_all()

    def wait(self, patience: float) -> bool:
        """Wait until nothing is left to do; return whether that came within so many seconds."""
        with self._change:
            return self._change.wait_for(lambda: not self._actions and not self._busy, patience)

    def close(self) -> None:
        """Do no more."""
        with self._change:
            self._closed = True
            self._change.notify_all()
        self._thread.join()

    def _work(self) -> None:
        while True:
            with self._change:
                self._busy = False
                self._change.notify_all()
                self._change.wait_for(lambda: self._closed or self._actions)
                if self._closed:
                    return
                about = next(iter(self._actions))
                action = self._actions.pop(about)
                self._busy = True
            try:
                action()
            except Exception as error:  # the page goes on whatever happens; it is an error of the program
                self.errors.append(error)
                LOG.exception("%s: %s", self._thread.name, about)


def on(register: Any, action: Callable[[Any], object]) -> None:
    """Register what is done at an event of viser; coroutines are called in the order of the events."""

    async def call(event: Any) -> None:
        action(event)

    register(call)


def by_user(register: Any, action: Callable[[Any], object]) -> None:
    """The same, of events that the user made; the program's own changes are none."""
    on(register, lambda event: event.client is not None and action(event))


def in_turn(server: Any, action: Callable[[], Result]) -> Result:
    """Call a function in the thread of viser's events, between two of them, and return what it returns.

    viser sets an input's value before it tells of the event: what the program shows in that input must not come in
    between, or the user's value is lost.
    """

    async def call() -> Result:
        return action()

    return asyncio.run_coroutine_threadsafe(call(), server.get_event_loop()).result()
