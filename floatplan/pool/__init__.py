"""Processes that compute for this one: they import the modules that it does, and end with it.

BLAS is held to one thread while floatplan computes: a sum shared among threads has other last bits.

Nothing else is loaded with this module, so that processes may load while others do.
"""

import functools
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import contextmanager, suppress
from itertools import zip_longest
from multiprocessing.context import ForkServerContext, ForkServerProcess
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

PATIENCE = 10.0  # [s] for the end of a fork server

_lock = threading.Lock()
_starting = 0  # threads that start an interpreter: the environment is one for all of them
_before: dict[str, str | None] = {}  # of its variables, before the first of them
_here = threading.local()  # ``held``: whether this thread is in such a call already
_calls = 0  # under way, in all threads of this process: BLAS has one number of threads for all of them
_held: list[tuple[Any, int]] = []  # libraries, and the threads that each had before


class _Process(ForkServerProcess):
    """A process that starts although the fork server is ending, as where the system kills it: by the next one."""

    @staticmethod
    def _Popen(process: Any) -> Any:
        until, lost = time.monotonic() + PATIENCE, 0
        while True:
            try:
                _ensure_server()
                return ForkServerProcess._Popen(process)
            except (ConnectionError, EOFError) as error:
                lost += not isinstance(error, ConnectionRefusedError)  # or the process ended where it began
                if lost > 1 or time.monotonic() > until:
                    raise
                time.sleep(0.01)


def get_ready(*modules: str) -> ForkServerContext:
    """Begin to load modules, once for all processes, unless that has begun already; return at once.

    Every process is a copy of one that has loaded them, and the only one that an interpreter is started for.
    """
    context: Any = ForkServerContext()
    context.Process = _Process
    context.set_forkserver_preload(list(modules))
    _ensure_server()
    return context  # type: ignore[no-any-return]


def _ensure_server() -> None:
    from multiprocessing import forkserver, resource_tracker

    with same_modules():
        resource_tracker.ensure_running()
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # Ctrl-C is not for what is started here
        try:
            forkserver.ensure_running()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)


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
    global _starting
    with _lock:
        if not _starting:
            _before.update({name: os.environ.get(name) for name in environment})
        _starting += 1
        os.environ.update(environment)
    try:
        yield
    finally:
        with _lock:
            _starting -= 1
            for name, value in _before.items() if not _starting else ():
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
            with executor._shutdown_lock:  # not amid a start: a fork server ends that is sent what is closed
                executor._shutdown_thread = True
                answers._writer.close()  # else the rest of what a process was sending when it ended is waited for


def in_order(pool: Executor | None, tasks: Sequence[tuple[Any, ...]], alone: Callable[..., Any]) -> Iterator[Any]:
    """Yield what the processes of a pool make of the arguments of each task, in their order.

    What is lost where the system kills a process, and all of it without a pool, is done by ``alone``, here, when its
    turn comes.
    """
    futures: list[Future[Any]] = []
    with suppress(BrokenExecutor, OSError):  # a process that is made while another is killed finds pipes closed
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


def _begin(ended: Any, prepare: Callable[..., Any] | None, given: tuple[Any, ...]) -> None:
    """Make a process ready: Ctrl-C is for the main one; where that lets go of its end of a pipe, this one goes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        ended.poll(None)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    if prepare is not None:
        global _work
        _work = prepare(*given)


@functools.cache
def _libraries() -> tuple[Any, ...]:
    """NumPy's BLAS, and what else is loaded when floatplan first computes; looking for them takes milliseconds."""
    import numpy as np  # noqa: F401 - so that its library is there
    from threadpoolctl import ThreadpoolController

    return tuple(ThreadpoolController().select(user_api="blas").lib_controllers)


def _count(more: int) -> None:
    """Count the calls under way: BLAS is held from the first that begins to the last that ends.

    It costs microseconds, as threads come and go.
    """
    global _calls
    with _lock:
        if not _calls:
            _held[:] = [(library, library.num_threads) for library in _libraries()]
        if not _calls or not _calls + more:
            for library, threads in _held:
                if threads != 1:
                    library.set_num_threads(1 if more > 0 else threads)
        _calls += more


def one_thread(function: Callable[P, R]) -> Callable[P, R]:
    """Let a function compute the same bits whatever the number of threads that BLAS may use, and put that back."""

    @functools.wraps(function)
    def held(*args: P.args, **kwargs: P.kwargs) -> R:
        if getattr(_here, "held", False):
            return function(*args, **kwargs)
        _count(1)
        _here.held = True
        try:
            return function(*args, **kwargs)
        finally:
            _here.held = False
            _count(-1)

    return held
