"""What is going on, on stderr: a bar in a terminal for what takes more than a second, and a log if asked for."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock, Timer
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from rich.progress import Progress

DELAY = 1.0  # [s] before a bar appears
LOG_FORMAT = "%(relativeCreated)7.0f ms  %(message)s"


class ProgressBar:
    """A bar that appears in a terminal once it has begun; ``told`` elsewhere, words in a line each, or nothing.

    Parameters
    ----------
    what : str
        The work: "planning".
    told : bool
        Whether words are printed.
    """

    def __init__(self, what: str, told: bool) -> None:
        self._what, self._told, self._ended = what, told, False
        self._looks: dict[str, Any] = {"description": what, "completed": 0, "total": None}
        self._lock = Lock()
        self._bar: Progress | None = None

    def say(self, words: str) -> None:
        """Say in a few words how the work goes."""
        if self._told:
            typer.echo(f"{self._what}: {words}", err=True)
        self._update(description=f"{self._what}: {words}")

    def reach(self, done: int, total: int) -> None:
        """Say how much of the work is done."""
        self._update(completed=done, total=total or None)

    def begin(self) -> None:
        """Show the bar, unless the work has ended meanwhile."""
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        with self._lock:
            if not self._ended:
                columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
                self._bar = Progress(*columns, console=Console(stderr=True), transient=True)
                self._bar.add_task(**self._looks)
                self._bar.start()

    def end(self) -> None:
        """Take the bar away."""
        with self._lock:
            self._ended = True
            if self._bar is not None:
                self._bar.stop()

    def _update(self, **looks: Any) -> None:
        with self._lock:
            self._looks |= looks
            if self._bar is not None:
                self._bar.update(self._bar.task_ids[0], **looks)


@contextmanager
def progress(what: str, quiet: bool = False, tell: bool = False) -> Iterator[ProgressBar]:
    """Show that work is going on.

    Parameters
    ----------
    what : str
        The work: "planning".
    quiet : bool
        Whether nothing is shown at all.
    tell : bool
        Whether words go to stderr also where there is no terminal.
    """
    heard = not quiet and sys.stderr is not None and not logging.getLogger("floatplan").handlers
    terminal = heard and sys.stderr.isatty()
    bar = ProgressBar(what, told=heard and tell and not terminal)
    timer = Timer(DELAY, bar.begin)
    timer.daemon = True
    if terminal:
        timer.start()
    try:
        yield bar
    finally:
        timer.cancel()
        bar.end()


@contextmanager
def log_on_stderr(verbose: bool) -> Iterator[None]:
    """Print what the package logs, where it is asked for."""
    if not verbose or sys.stderr is None:
        yield
        return
    log = logging.getLogger("floatplan")
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter(LOG_FORMAT))
    before = log.level
    log.addHandler(handler)
    log.setLevel(logging.INFO)
    try:
        yield
    finally:
        log.removeHandler(handler)
        log.setLevel(before)
