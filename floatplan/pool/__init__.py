"""Processes that compute for this one: they import the modules that it does, and end with it.

Nothing else is loaded with this module, so that processes may load while others do.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import contextmanager, suppress
from itertools import zip_longest
from multiprocessing import forkserver, get_context, resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerContext
from pathlib import Path
from typing import Any


def get_ready(*modules: str) -> ForkServerContext:
    """Begin to load modules, once for all processes, unless that has begun already; return at once.

    Every process is a copy of one that has loaded them, and the only one that an interpreter is started for.
    """
    context = get_context("forkserver")
    context.set_forkserver_preload(list(modules))
    with same_modules():
        resource_tracker.ensure_running()
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # Ctrl-C is not for what is started here
        try:
            forkserver.ensure_running()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
    return context


@contextmanager
def same_modules() -> Iterator[None]:
    """Let an interpreter that is started meanwhile import what this one does, whatever lies in the working directory.

    Its BLAS has one thread: such processes are as many as the processors.
    """
    places = [place or str(Path.cwd()) for place in sys.path]
    environment = {
        "PYTHONPATH": os.pathsep.join(place for place in places if os.pathsep not in place),
        "PYTHONSAFEPATH": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }
    before = {name: os.environ.get(name) for name in environment}
    os.environ.update(environment)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def processes(
    count: int, modules: tuple[str, ...], prepare: Callable[..., Any] | None = None, *given: Any
) -> Iterator[Executor]:
    """Make processes that end at once, amid their work too, where they are let go or this process ends.

    Parameters
    ----------
    count : int
    modules : names of what they need, loaded before they begin
    prepare : callable, optional
        Called with ``given`` in each process when it begins; what it returns does the tasks of :func:`in_order`.
    """
    from concurrent.futures import ProcessPoolExecutor  # here, because :func:`get_ready` does without

    context = get_ready(*modules)
    ended, held = context.Pipe(duplex=False)
    begin = (ended, prepare, given)
    with ended, ProcessPoolExecutor(count, context, initializer=_begin, initargs=begin) as executor, held:
        answers: Any = executor._result_queue
        try:
            yield executor
        finally:
            answers._writer.close()  # else the rest of what a process was sending when it ended is waited for


def in_order(pool: Executor | None, tasks: Sequence[tuple[Any, ...]], alone: Callable[..., Any]) -> Iterator[Any]:
    """Yield what the processes of a pool make of the arguments of each task, in their order.

    What is lost where the system kills a process, and all of it without a pool, is done by ``alone``, here, when its
    turn comes.
    """
    futures: list[Future[Any]] = []
    with suppress(BrokenExecutor):
        futures += [pool.submit(_do, *task) for task in tasks] if pool else []
    for task, future in zip_longest(tasks, futures):
        try:
            result = future.result() if future else alone(*task)
        except BrokenExecutor:
            result = alone(*task)
        yield result


_work: Callable[..., Any]  # of a process that is ready


def _do(*task: Any) -> Any:
    return _work(*task)


def _begin(ended: Connection, prepare: Callable[..., Any] | None, given: tuple[Any, ...]) -> None:
    """Make a process ready: Ctrl-C is for the main one; where that lets go of its end of a pipe, this one goes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        ended.poll(None)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    if prepare is not None:
        global _work
        _work = prepare(*given)
