"""What the studio does not show: what went wrong in the program without ending it, and the processes that plan."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager

from floatplan.studio.session import Session


class _Kept(logging.Handler):
    """Keeps the exceptions that are logged."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.errors: list[BaseException] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a record's exception."""
        if record.exc_info and record.exc_info[1]:
            self.errors.append(record.exc_info[1])


@contextmanager
def logged_errors() -> Iterator[list[BaseException]]:
    """Keep what the studio logs meanwhile."""
    kept, log = _Kept(), logging.getLogger("floatplan.studio")
    log.addHandler(kept)
    try:
        yield kept.errors
    finally:
        log.removeHandler(kept)


def process_ids(session: Session) -> list[int]:
    """Of the processes that plan: at once, then thoroughly."""
    planning = session._planning
    executors = [worker._executor for worker in (planning._quick, planning._thorough)]
    return [number for executor in executors if executor for number in executor.process_ids]
