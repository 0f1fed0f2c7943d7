"""Who plans the chunks of a study: this process, a pool of processes, or the machines of a dask cluster."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from typing import Any, Protocol

from floatplan.errors import FloatplanError, InputError, import_optional
from floatplan.planning.search import MOST_JOBS
from floatplan.pool import processes, same_modules

BROKEN = "no process can be started: see above; in a script, plan below \"if __name__ == '__main__':\", or with jobs=1"
ENGINES = ("processes", "dask")
PATIENCE = 30  # [s] for a scheduler to answer
LOADED = ("floatplan.studies.study",)  # before a process begins
AHEAD = 2  # chunks given to each process, so that none waits


class Engine(Protocol):
    """Where chunks go."""

    @property
    def executor(self) -> Executor:
        """Takes chunks."""

    def places(self) -> int:
        """How many it takes at a time."""

    def renew(self) -> None:
        """Put another executor in the place of one that a dead process has broken."""

    def alone(self) -> AbstractContextManager[Executor]:
        """Return an executor for one chunk that may end its process."""


class Here(Executor):
    """Plans in this process, when asked."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Call at once."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


def processors() -> int:
    """Processors that this process may use."""
    return min(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1, MOST_JOBS)


@contextmanager
def started(name: str, jobs: int | None, scheduler: str | None) -> Iterator[Engine]:
    """Start an engine, and end it.

    Parameters
    ----------
    name : "processes" or "dask"
    jobs : processes; None for as many as there are processors
    scheduler : address of dask's; None for a cluster on this machine

    Raises
    ------
    InputError
        There is no such engine, or it cannot be started.
    """
    if name not in ENGINES:
        raise InputError(f"must be {' or '.join(map(repr, ENGINES))}, not {name!r}", element="engine")
    if scheduler is not None and name != "dask":
        raise InputError("is for the engine dask", element="scheduler", advice="--engine dask")
    count = processors() if jobs is None else jobs
    engine = _Dask(count, scheduler) if name == "dask" else _Pool(count) if count > 1 else _Inline()
    try:
        yield engine
    finally:
        engine.close()


class _Inline:
    """The process that asks."""

    def __init__(self) -> None:
        self.executor: Executor = Here()

    def places(self) -> int:
        return 1

    def renew(self) -> None:
        """Nothing breaks here that is not the end."""

    def alone(self) -> AbstractContextManager[Executor]:
        return nullcontext(self.executor)

    def close(self) -> None:
        """Nothing to end."""


class _Pool:
    """Processes of this machine, which end with this one."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._begin()

    def _begin(self) -> None:
        self._open = ExitStack()
        self.executor = self._open.enter_context(processes(self._count, LOADED))
        try:
            self.executor.submit(os.getpid).result()  # else those that cannot even begin would be begun for ever
        except BrokenExecutor:
            self.close()
            raise FloatplanError(BROKEN) from None

    def places(self) -> int:
        return AHEAD * self._count

    def renew(self) -> None:
        self.close()
        self._begin()

    def alone(self) -> AbstractContextManager[Executor]:
        return processes(1, LOADED)

    def close(self) -> None:
        self._open.close()


class _Dask:
    """The workers of a dask scheduler, which gives the chunks of a dead worker to others."""

    def __init__(self, jobs: int, scheduler: str | None) -> None:
        distributed = import_optional("distributed", name="dask", element="engine", extra="study")
        with ExitStack() as opened:
            try:
                cluster = scheduler
                if scheduler is None:
                    opened.enter_context(same_modules())  # until the end, as workers that die are begun anew
                    local = distributed.LocalCluster(
                        n_workers=jobs, threads_per_worker=1, dashboard_address=None, silence_logs=logging.ERROR
                    )
                    cluster = opened.enter_context(local)
                self._client = opened.enter_context(distributed.Client(cluster, timeout=PATIENCE))
            except (OSError, ValueError, TimeoutError) as error:
                raise InputError(f"no scheduler answers: {error}", element="scheduler") from None
            self._open = opened.pop_all()
        self.executor: Executor = self._client.get_executor(pure=False)

    def places(self) -> int:
        return AHEAD * max(int(sum(self._client.nthreads().values())), 1)

    def renew(self) -> None:
        """The scheduler starts workers anew."""

    def alone(self) -> AbstractContextManager[Executor]:
        return nullcontext(self.executor)

    def close(self) -> None:
        self._open.close()
