"""The fork server: loads modules once, and every process begins as a copy of what it has loaded.

Only public members of multiprocessing are used. It has one fork server, which it starts where there is none.
"""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing.context import ForkServerContext
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

PATIENCE = 10.0  # [s] for the end of a fork server that refuses to start a process and whose process ID is unknown
PAUSE = 0.01  # [s] between two attempts to start a process

_lock = threading.Lock()
_starting = 0  # threads that start an interpreter: the environment is one for all of them
_before: dict[str, str | None] = {}  # of its variables, before the first of them
_server: int | None = None  # process ID of the fork server, as the last process reported when it started


def start_server(*modules: str) -> ForkServerContext:
    """Begin to load modules, once for all processes, unless that has begun already; return at once.

    Every process is a copy of one that has loaded them, and the only one that an interpreter is started for.
    """
    context = ForkServerContext()
    context.set_forkserver_preload(list(modules))
    _ensure_server()
    return context


def start(context: ForkServerContext, target: Callable[..., None], arguments: tuple[Any, ...]) -> BaseProcess:
    """Start a process although the fork server is ending, as where the system kills it: by the next one.

    A fork server that ends closes its socket first. Until it is gone it refuses, and is taken for one that runs.

    Raises
    ------
    ConnectionError, EOFError
        Two fork servers in a row were lost before the process had begun, or one refuses for ``PATIENCE``.
    OSError
        The system allows no further process.
    """
    until = time.monotonic() + PATIENCE
    lost = 0
    while True:
        try:
            _ensure_server()
            process = context.Process(target=target, args=arguments)
            process.start()
        except ConnectionRefusedError:
            if time.monotonic() > until:
                raise
            _end_server()
        except (ConnectionError, EOFError):
            lost += 1
            if lost > 1:  # perhaps it is the process that ends where it begins
                raise
        else:
            return process
        time.sleep(PAUSE)


def remember(server: int) -> None:
    """Keep the process ID of the fork server, which each of its processes knows as its parent."""
    global _server
    _server = server


def _ensure_server() -> None:
    from multiprocessing import forkserver, resource_tracker

    with same_modules():
        resource_tracker.ensure_running()
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # Ctrl-C is not for what is started here
        try:
            forkserver.ensure_running()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _end_server() -> None:
    """Kill a fork server that serves nobody any more, where its process ID is known."""
    if _server is None:
        return
    with suppress(ProcessLookupError, ChildProcessError):
        # another process may have its ID by now: ChildProcessError, unless it is a child of this one too
        os.waitid(os.P_PID, _server, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        os.kill(_server, signal.SIGKILL)


@contextmanager
def same_modules() -> Iterator[None]:
    """Let an interpreter that is started meanwhile import what this one does, whatever lies in the working directory.

    Its BLAS has one thread: such processes are as many as the processors.
    """
    places = [folder or str(Path.cwd()) for folder in sys.path]
    environment = {
        "PYTHONPATH": os.pathsep.join(folder for folder in places if os.pathsep not in folder),
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
