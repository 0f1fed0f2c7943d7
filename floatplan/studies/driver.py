"""Distributes the rows of a study in chunks of about a second, and saves each as soon as it is done.

Chunks are planned by this process, a pool of processes, the machines of a dask cluster, or any other executor.
"""

import logging
import math
import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import dataclass
from datetime import timedelta
from typing import Any

from floatplan.arguments import one_of, optional
from floatplan.errors import FloatplanError, InputError, import_optional, printable
from floatplan.planning.kernel_input.numbers import is_batchable_family
from floatplan.planning.options import JOBS, MOST_JOBS
from floatplan.pool import processes, same_modules
from floatplan.studies.file import StudyFile
from floatplan.studies.folder import Range, StudyFolder, decoded
from floatplan.studies.rows import PlannedChunk, lost_row, packed, planned_rows, row_check
from floatplan.tables import CHOICES

FIRST_CHUNK = 64  # [-] rows of the first chunks where rows are planned in batches; else one
MOST_IN_CHUNK = 32_768  # [-] rows
AHEAD = 2  # [-] chunks submitted for each process, so that none waits
PATIENCE = 30  # [s] for the response of a scheduler
LOADED = ("floatplan.studies.study",)  # modules that are imported before a process begins
GOES_ON = "what is done stays, and the same call with another executor goes on from there"


class Here(Executor):
    """Plans in this process, at once."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Call at once."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class CallersExecutor(Executor):
    """The executor of whoever calls, whose faults are raised as :class:`FloatplanError`: it may be anything."""

    def __init__(self, executor: Executor) -> None:
        self._executor = executor

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Hand over a task.

        Raises
        ------
        RuntimeError, OSError
            The executor is broken, or was shut down.
        FloatplanError
            Its ``submit`` raises something else, or returns no future.
        """
        try:
            future = self._executor.submit(fn, *args, **kwargs)
        except (RuntimeError, OSError):
            raise
        except Exception as error:
            raise FloatplanError(f"the executor's submit raised {_quoted(error)}; {GOES_ON}") from error
        if not isinstance(future, Future):
            kind = type(future).__name__
            raise FloatplanError(f"the executor's submit returned {kind!r}, not a concurrent.futures.Future; {GOES_ON}")
        return future


def _quoted(error: BaseException) -> str:
    """An error of somebody else's code, for a message."""
    return printable(f"{type(error).__name__}: {error}" if str(error) else type(error).__name__)


@dataclass(frozen=True)
class Engine:
    """An executor for chunks.

    Attributes
    ----------
    begin : begins the executor, as a context
    capacity : tells how many chunks it takes at a time
    isolated : begins an executor for one chunk that may end its process
    is_callers : whether it is the executor of whoever calls, whose results are checked before they are saved
    """

    begin: Callable[[], AbstractContextManager[Executor]]
    capacity: Callable[[], int]
    isolated: Callable[[], AbstractContextManager[Executor]]
    is_callers: bool = False


def processors() -> int:
    """Return how many processors this process may use, at most ``MOST_JOBS``."""
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(count, MOST_JOBS)


@contextmanager
def started(engine: str, jobs: int | None, scheduler: str | None, executor: Executor | None = None) -> Iterator[Engine]:
    """Offer an engine as long as it lasts.

    Parameters
    ----------
    engine : "processes" or "dask"
    jobs : processes; None for as many as there are processors that this one may use
    scheduler : address of dask's; None for a cluster on this machine
    executor : instead of an engine; rows that end its process are searched for in one of this machine

    Raises
    ------
    InputError
        There is no such engine, or it cannot be started.
    """
    one_of(*CHOICES["workers"])(engine, "engine")
    if scheduler is not None and engine != "dask":
        raise InputError("is for the engine dask", element="scheduler", advice="--engine dask")
    count = optional(JOBS)(jobs, "jobs") or processors()
    if executor is not None:
        if engine != "processes" or not isinstance(executor, Executor):
            reason = "must be a concurrent.futures.Executor, without an engine beside it"
            raise InputError(reason, element="executor")
        callers = CallersExecutor(executor)
        yield Engine(lambda: _probed(callers), lambda: AHEAD * count, lambda: processes(1, LOADED), is_callers=True)
    elif engine == "dask":
        with _client(count, scheduler) as client:
            cluster = nullcontext(client.get_executor(pure=False))  # which outlives its workers
            yield Engine(lambda: cluster, lambda: AHEAD * max(sum(client.nthreads().values()), 1), lambda: cluster)
    elif count > 1:
        yield Engine(lambda: _pool(count), lambda: AHEAD * count, lambda: processes(1, LOADED))
    else:
        yield Engine(lambda: nullcontext(Here()), lambda: 1, lambda: nullcontext(Here()))


@contextmanager
def _pool(count: int) -> Iterator[Executor]:
    """Processes of this machine, which end with this one."""
    with processes(count, LOADED) as executor:
        try:
            executor.submit(os.getpid).result()
        except RuntimeError:  # one that cannot even begin would be begun for ever
            advice = "in a script, plan below \"if __name__ == '__main__':\", or with jobs=1"
            raise FloatplanError(f"no process can be started: see above; {advice}") from None
        yield executor


@contextmanager
def _probed(executor: CallersExecutor) -> Iterator[Executor]:
    """The executor of whoever calls, once it has done a first task: one that does none would get tasks for ever."""
    try:
        executor.submit(os.getpid).result()
    except FloatplanError:
        raise
    except RuntimeError:
        raise FloatplanError(f"the executor takes no more tasks; {GOES_ON}") from None
    except CancelledError:
        raise FloatplanError(f"the executor cancelled its first task; {GOES_ON}") from None
    except Exception as error:
        raise FloatplanError(f"the executor's first task raised {_quoted(error)}; {GOES_ON}") from error
    yield executor


@contextmanager
def _client(jobs: int, scheduler: str | None) -> Iterator[Any]:
    """A client of a dask scheduler, which gives the chunks of a dead worker to others."""
    distributed = import_optional("distributed", name="dask", element="engine", extra="study")
    with ExitStack() as opened:
        try:
            cluster = scheduler
            if scheduler is None:
                opened.enter_context(same_modules())  # until the end, as workers that die are started again
                local = distributed.LocalCluster(
                    n_workers=jobs, threads_per_worker=1, dashboard_address=None, silence_logs=logging.CRITICAL
                )
                cluster = opened.enter_context(local)
            client = opened.enter_context(distributed.Client(cluster, timeout=PATIENCE))
        except (OSError, ValueError, TimeoutError) as error:
            raise InputError(f"no scheduler answers: {error}", element="scheduler") from None
        yield client


@dataclass(frozen=True)
class Progress:
    """How far a run is: rows ``done`` of ``total``, how many a second, and the seconds left."""

    done: int
    total: int
    rate: float
    left: float

    def __str__(self) -> str:
        """As it is shown."""
        left = timedelta(seconds=round(self.left))
        return f"{self.done} of {self.total} rows, {self.rate:.3g} rows/s, {left} left"


class StudyRun:
    """Plans the rows that are missing."""

    def __init__(
        self, study: StudyFile, folder: StudyFolder, engine: Engine, progress: Callable[[Progress], None] | None
    ) -> None:
        self._study = study
        self._folder = folder
        self._engine = engine
        self._progress = progress
        self._packed = packed(study)
        self._row_check = row_check(study) if engine.is_callers else None
        is_batched = is_batchable_family(study.family(0, 1)) and not study.plan.jump
        self._size = self._least = FIRST_CHUNK if is_batched else 1

    def fill(self, gaps: list[Range]) -> None:
        """Submit chunks until no row is missing; as many at a time as the engine takes."""
        self._missing = sum(stop - first for first, stop in gaps)
        self._done = 0
        self._begin_time = time.monotonic()
        pending = list(reversed(gaps))
        running: dict[Future[PlannedChunk], Range] = {}
        lost: list[Range] = []
        with ExitStack() as executors:
            executor = executors.enter_context(self._engine.begin())
            while pending or running or lost:
                if lost and not running:
                    executors.close()
                    for chunk in lost:
                        self._isolate(chunk)
                    lost = []
                    executor = executors.enter_context(self._engine.begin())
                capacity = self._engine.capacity()
                while pending and len(running) < capacity and not lost:
                    chunk = self._next(pending, capacity)
                    try:
                        running[self._submit(executor, chunk)] = chunk
                    except (RuntimeError, OSError):  # it is broken, or was shut down
                        lost.append(chunk)
                finished, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in finished:
                    chunk = running.pop(future)
                    if self._is_lost(future):
                        lost.append(chunk)
                    else:
                        self._save(chunk, self._checked(chunk, future.result()))

    def _next(self, pending: list[Range], capacity: int) -> Range:
        """Take a chunk from what is pending: about a second of work, less at the end, so that all end at one time."""
        first, stop = pending.pop()
        left = stop - first + sum(end - begin for begin, end in pending)
        shortest = max(self._least, int(self._size / 16))  # a submission takes some time, too
        size = max(min(self._size, -(-left // capacity)), shortest)
        if stop - first > size:
            pending.append((first + size, stop))
            stop = first + size
        return first, stop

    def _submit(self, executor: Executor, chunk: Range) -> Future[PlannedChunk]:
        return executor.submit(planned_rows, self._packed, chunk[0], self._study.samples.values(*chunk))

    def _save(self, chunk: Range, planned: PlannedChunk) -> None:
        first, stop = chunk
        self._folder.save(first, stop, planned.content)
        rows = stop - first
        self._done += rows
        in_a_second = int(rows / max(planned.seconds, 1e-6))
        # at most 8 times as large as the chunk by which the speed was measured
        self._size = max(min(in_a_second, 8 * rows, MOST_IN_CHUNK), self._least)
        if self._progress:
            rate = self._done / max(time.monotonic() - self._begin_time, 1e-9)
            left = self._missing - self._done
            total = self._folder.rows[1] - self._folder.rows[0]
            self._progress(Progress(total - left, total, rate, left / rate))

    def _isolate(self, chunk: Range) -> None:
        """Plan a chunk whose process died; it is halved until the row is identified that ends it."""
        with self._engine.isolated() as executor:
            future = self._submit(executor, chunk)
            wait([future])
        first, stop = chunk
        if not self._is_lost(future):
            self._save(chunk, future.result())
        elif stop - first > 1:
            middle = (first + stop) // 2
            self._isolate((first, middle))
            self._isolate((middle, stop))
        else:
            reason = "The system ended the process that planned this row: it crashed, or memory ran out."
            self._save(chunk, lost_row(self._packed, first, self._study.samples.values(first, stop), reason))

    def _is_lost(self, future: Future[PlannedChunk]) -> bool:
        """Whether a chunk's process died, or its executor cancelled it; any other error is no row's, and is raised."""
        if future.cancelled():
            return True
        error = future.exception()
        if error is None:
            return False
        if isinstance(error, BrokenExecutor) or type(error).__name__ == "KilledWorker":
            return True
        if self._engine.is_callers and isinstance(error, Exception):
            raise FloatplanError(f"a task of the executor raised {_quoted(error)}; {GOES_ON}") from error
        raise error

    def _checked(self, chunk: Range, result: Any) -> PlannedChunk:
        """The result of a chunk, which is checked where it comes from the caller's executor.

        Raises
        ------
        FloatplanError
            It does not have the rows of that chunk.
        """
        if self._row_check is None:
            return result  # type: ignore[no-any-return]
        rows = f"rows {chunk[0]} to {chunk[1] - 1}"
        if not (
            isinstance(result, PlannedChunk)
            and isinstance(result.content, bytes)
            and isinstance(result.seconds, float)
            and 0 <= result.seconds < math.inf
        ):
            kind = type(result).__name__
            raise FloatplanError(f"the executor returned {kind!r} in the place of {rows}; {GOES_ON}")
        table = decoded(result.content)
        if table is None or not self._row_check(table, *chunk):
            raise FloatplanError(f"the executor returned {rows} damaged, or others in their place; {GOES_ON}")
        return result
