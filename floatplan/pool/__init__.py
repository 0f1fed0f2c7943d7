"""Processes that compute for this one: they import the modules that it does, and end with it.

BLAS has one thread while floatplan computes: a sum shared among threads has other last bits.

Nothing else is loaded with this module, so that processes may load while others do.
"""

import functools
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import contextmanager, suppress
from itertools import zip_longest
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any, ParamSpec, TypeVar

from floatplan.pool.fork_server import remember, same_modules, start, start_server

__all__ = ["in_order", "one_thread", "processes", "same_modules", "start_server"]

P = ParamSpec("P")
R = TypeVar("R")

_lock = threading.Lock()
_here = threading.local()  # ``single``: whether this thread is in such a call already
_calls = 0  # under way, in all threads of this process: BLAS has one number of threads for all of them
_limited: list[tuple[Any, int]] = []  # libraries, and the threads of each before


@contextmanager
def processes(
    count: int, modules: tuple[str, ...], prepare: Callable[..., Any] | None = None, *arguments: Any
) -> Iterator[Executor]:
    """Make processes that end at once, amid their work too, where they are let go or this process ends.

    Parameters
    ----------
    count : int
    modules : names of what they need, loaded before they begin
    prepare : callable, optional
        Called with ``arguments`` in each process when it begins; what it returns does the tasks of :func:`in_order`.
    """
    from floatplan.pool.executor import WorkerPool  # here, because :func:`start_server` does without

    context = start_server(*modules)
    main_end, child_end = context.Pipe(duplex=False)

    def begin(pipe: Connection) -> BaseProcess:
        return start(context, _begin, (pipe, main_end, prepare, arguments))

    with main_end, child_end, WorkerPool(count, begin, remember) as executor:
        yield executor


def in_order(pool: Executor | None, tasks: Sequence[tuple[Any, ...]], here: Callable[..., Any]) -> Iterator[Any]:
    """Yield what the processes of a pool make of the arguments of each task, in their order.

    What is lost where the system kills a process, and all without a pool, is done by ``here``, in this process, in
    its order.
    """
    futures: list[Future[Any]] = []
    with suppress(BrokenExecutor, OSError):  # a process that is made while another is killed finds pipes closed
        futures += [pool.submit(_do, *task) for task in tasks] if pool else []
    for task, future in zip_longest(tasks, futures):
        try:
            result = future.result() if future else here(*task)
        except BrokenExecutor:
            result = here(*task)
        yield result


_work: Callable[..., Any]  # of a process that has started


def _do(*task: Any) -> Any:
    return _work(*task)


def _begin(
    pipe: Connection, main_end: Connection, prepare: Callable[..., Any] | None, arguments: tuple[Any, ...]
) -> None:
    """Do the tasks that come through a pipe, in a process that ends where the main one lets go of the other pipe.

    Ctrl-C is for the main process.
    """
    from floatplan.pool.executor import serve

    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        main_end.poll(None)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    if prepare is not None:
        global _work
        _work = prepare(*arguments)
    serve(pipe)


@functools.cache
def _libraries() -> tuple[Any, ...]:
    """NumPy's BLAS, and what else is loaded when floatplan first computes; looking for them takes milliseconds."""
    import numpy as np  # noqa: F401 - so that its library is there
    from threadpoolctl import ThreadpoolController

    return tuple(ThreadpoolController().select(user_api="blas").lib_controllers)


def _count(more: int) -> None:
    """Count the calls under way: BLAS is limited from the first that begins to the last that ends.

    It costs microseconds, as threads come and go.
    """
    global _calls
    with _lock:
        if not _calls:
            _limited[:] = [(library, library.num_threads) for library in _libraries()]
        if not _calls or not _calls + more:
            for library, threads in _limited:
                if threads != 1:
                    library.set_num_threads(1 if more > 0 else threads)
        _calls += more


def one_thread(function: Callable[P, R]) -> Callable[P, R]:
    """Let a function compute the same bits whatever the number of threads that BLAS may use, and put that back."""

    @functools.wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> R:
        if getattr(_here, "single", False):
            return function(*args, **kwargs)
        _count(1)
        _here.single = True
        try:
            return function(*args, **kwargs)
        finally:
            _here.single = False
            _count(-1)

    return limited
