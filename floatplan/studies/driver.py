"""Hands out the rows of a study in chunks of about a second, and keeps each as soon as it is done."""

from __future__ import annotations

import pickle
import time
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import dataclass

from floatplan.kernel.rows import is_plain_family
from floatplan.studies.engines import Engine
from floatplan.studies.file import StudyFile
from floatplan.studies.folder import Range, StudyFolder
from floatplan.studies.rows import Planned, Work, lost_row, planned_rows

CHUNK_SECONDS = 1.0  # [s] of work
FIRST_TOGETHER, FIRST_ALONE = 64, 1  # rows of the first chunks, of batches and of whole searches
MOST_IN_CHUNK = 32_768  # rows
GROWTH = 8  # times that a chunk may be larger than the one that its speed was measured with
SHORTEST = 1 / 16  # [-] of a chunk, at the end: what is handed out costs a little too
DIED = "The system ended the process that planned this row: it crashed, or memory ran out."


@dataclass(frozen=True)
class Progress:
    """How far a run is: rows ``done`` of ``total``, how many a second, and the seconds left (None: not known)."""

    done: int
    total: int
    rate: float
    left: float | None

    def __str__(self) -> str:
        """As it is shown."""
        left = "" if self.left is None else f", {_duration(self.left)} left"
        return f"{self.done} of {self.total} rows, {self.rate:.3g} rows/s{left}"


def _duration(seconds: float) -> str:
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    return f"{whole // 60} min {whole % 60} s" if whole < 3600 else f"{whole // 3600} h {whole % 3600 // 60} min"


def fill(
    study: StudyFile,
    folder: StudyFolder,
    gaps: list[Range],
    engine: Engine,
    progress: Callable[[Progress], None] | None,
) -> None:
    """Plan the rows that are missing."""
    missing = sum(stop - first for first, stop in gaps)
    _Run(study, folder, engine, missing, progress).run(gaps)


class _Run:
    """One run over the missing rows."""

    def __init__(
        self,
        study: StudyFile,
        folder: StudyFolder,
        engine: Engine,
        missing: int,
        progress: Callable[[Progress], None] | None,
    ) -> None:
        self._study, self._folder, self._engine, self._progress = study, folder, engine, progress
        self._work = pickle.dumps(Work.of(study))
        together = is_plain_family(study.family(0, 1))
        self._size = self._least = FIRST_TOGETHER if together else FIRST_ALONE
        self._missing, self._done, self._began = missing, 0, time.monotonic()

    def run(self, gaps: list[Range]) -> None:
        """Keep every process busy until nothing is left."""
        waiting = list(reversed(gaps))
        running: dict[Future[Planned], Range] = {}
        lost: list[Range] = []
        while waiting or running or lost:
            if lost and not running:
                self._engine.renew()
                for chunk in lost:
                    self._alone(chunk)
                lost = []
            places = self._engine.places()
            while waiting and len(running) < places and not lost:
                chunk = self._next(waiting, places)
                try:
                    running[self._submit(self._engine.executor, chunk)] = chunk
                except BrokenExecutor:
                    lost.append(chunk)
            finished, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in finished:
                chunk = running.pop(future)
                if _is_lost(future):
                    lost.append(chunk)
                else:
                    self._keep(chunk, future.result())

    def _next(self, waiting: list[Range], places: int) -> Range:
        """Take a chunk from what is waiting: about a second of work, less at the end, so that all end together."""
        first, stop = waiting.pop()
        left = stop - first + sum(end - begin for begin, end in waiting)
        shortest = max(self._least, int(SHORTEST * self._size))
        size = max(min(self._size, -(-left // places)), shortest)
        if stop - first > size:
            waiting.append((first + size, stop))
            stop = first + size
        return first, stop

    def _submit(self, executor: Executor, chunk: Range) -> Future[Planned]:
        return executor.submit(planned_rows, self._work, chunk[0], self._study.samples.values(*chunk))

    def _keep(self, chunk: Range, planned: Planned) -> None:
        first, stop = chunk
        self._folder.keep(first, stop, planned.content)
        rows = stop - first
        self._done += rows
        wanted = int(CHUNK_SECONDS * rows / max(planned.seconds, 1e-6))
        self._size = max(min(wanted, GROWTH * rows, MOST_IN_CHUNK), self._least)
        if self._progress:
            seconds = time.monotonic() - self._began
            rate = self._done / max(seconds, 1e-9)
            done = len(self._study) - self._missing + self._done
            self._progress(Progress(done, len(self._study), rate, (self._missing - self._done) / rate))

    def _alone(self, chunk: Range) -> None:
        """Plan a chunk whose process died, halved until the row is found that ends it."""
        with self._engine.alone() as executor:
            future = self._submit(executor, chunk)
            wait([future])
        first, stop = chunk
        if not _is_lost(future):
            self._keep(chunk, future.result())
        elif stop - first > 1:
            middle = (first + stop) // 2
            self._alone((first, middle))
            self._alone((middle, stop))
        else:
            values = self._study.samples.values(first, stop)
            self._keep(chunk, lost_row(self._work, first, values, DIED))


def _is_lost(future: Future[Planned]) -> bool:
    """Whether a chunk's process died; any other error is no row's, and is raised."""
    error = future.exception()
    if error is None:
        return False
    if isinstance(error, BrokenExecutor) or type(error).__name__ == "KilledWorker":
        return True
    raise error
