"""Choices of words and ticks that change the problem."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import floatplan as fp
from floatplan.studio.session.edits import Edit
from floatplan.studio.session.hands import Hands, by_hand
from floatplan.studio.session.session import Session


class Choices:
    """Dropdowns and ticks; each follows the session."""

    def __init__(self, gui: Any, session: Session, hands: Hands) -> None:
        self._gui, self._session, self._hands = gui, session, hands
        self._shown: list[tuple[Any, Callable[[fp.Problem], Any]]] = []

    def add(
        self,
        label: str,
        words: Sequence[str],
        get: Callable[[fp.Problem], str],
        edit: Callable[[Any], Edit],
        hint: str | None = None,
    ) -> None:
        """Add a choice of words: how to read it from a problem, and the edit that makes it."""
        present = get(self._session.view.problem)
        offered = tuple(dict.fromkeys((*words, present)))
        self._follow(self._gui.add_dropdown(label, offered, initial_value=present, hint=hint), get, edit)

    def add_tick(self, label: str, get: Callable[[fp.Problem], bool], edit: Callable[[Any], Edit]) -> None:
        """Add a tick."""
        self._follow(self._gui.add_checkbox(label, get(self._session.view.problem)), get, edit)

    def follow(self, problem: fp.Problem) -> None:
        """Show the problem's choices."""
        for choice, get in self._shown:
            wanted = get(problem)
            if choice.value != wanted:
                choice.value = wanted

    def _follow(self, choice: Any, get: Callable[[fp.Problem], Any], edit: Callable[[Any], Edit]) -> None:
        self._shown.append((choice, get))

        def choose() -> None:
            if not self._session.edit(edit(choice.value)):
                choice.value = get(self._session.view.problem)

        by_hand(choice.on_update, lambda _: self._hands.do(f"choice {id(choice)}", choose))
