"""What is going on, on stderr: a bar in a terminal for what takes more than a second, and a log on request."""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Timer
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from rich.progress import Progress

DELAY = 1.0  # [s] before a bar appears
EVERY = 2.0  # [s] words about how much is done
LOG_FORMAT = "%(relativeCreated)7.0f ms  %(message)s"


class ProgressBar:
    """A bar in a terminal; elsewhere messages, a line each, where ``printed``.

    Parameters
    ----------
    what : str
        The work: "planning".
    printed : bool
        Whether words are printed.
    bar : rich.progress.Progress, optional
        What has the work as its only task.
    """

    def __init__(self, what: str, printed: bool, bar: Progress | None) -> None:
        self._what = what
        self._printed = printed
        self._bar = bar
        self._last_message = time.monotonic()

    def say(self, words: str) -> None:
        """Say in a few words how the work goes."""
        if self._printed:
            typer.echo(f"{self._what}: {words}", err=True)
        self._update(description=f"{self._what}: {words}")

    def reach(self, done: int, total: int) -> None:
        """Say how much of the work is done."""
        self._update(completed=done, total=total or None)

    def count(self, thing: str, done: int, total: int) -> None:
        """Say how much is done of what is counted, "flight 3 of 20", now and then where that is a line of its own."""
        self.say_now_and_then(f"{thing} {done} of {total}", done, total)

    def say_now_and_then(self, words: str, done: int, total: int) -> None:
        """Say how much of the work is done, in words where the last ones were a while ago, or all is done."""
        self.reach(done, total)
        if done == total or time.monotonic() - self._last_message >= EVERY:
            self._last_message = time.monotonic()
            self.say(words)

    def _update(self, **looks: Any) -> None:
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
    if not heard or not sys.stderr.isatty():
        yield ProgressBar(what, heard and tell, None)
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
    bar = Progress(*columns, console=Console(stderr=True), transient=True)
    bar.add_task(what, total=None)
    timer = Timer(DELAY, bar.start)
    timer.daemon = True
    timer.start()
    try:
        yield ProgressBar(what, False, bar)
    finally:
        timer.cancel()
        timer.join()  # it may just begin
        bar.stop()


@contextmanager
def log_on_stderr(verbose: bool) -> Iterator[None]:
    """Print what the package logs, with ``verbose``."""
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
