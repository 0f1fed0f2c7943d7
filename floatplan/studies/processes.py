"""Processes of this machine that plan rows; nothing else is loaded with them, so that they may load while others do."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import forkserver, get_context, resource_tracker
from multiprocessing.connection import Connection


def get_ready() -> None:
    """Begin to load the package, once for all processes; return at once."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # for the processes: they are as many as the processors
    get_context("forkserver").set_forkserver_preload(["floatplan.studies.study"])
    resource_tracker.ensure_running()
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # Ctrl-C is not for what is started here
    try:
        forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


@contextmanager
def processes(count: int) -> Iterator[Executor]:
    """Make processes that end at once, in the middle of a row too, where they are let go or this process ends."""
    get_ready()
    context = get_context("forkserver")
    ended, held = context.Pipe(duplex=False)
    with ended, ProcessPoolExecutor(count, context, initializer=_end_with, initargs=(ended,)) as executor, held:
        yield executor


def _end_with(ended: Connection) -> None:
    """Make a process ready: Ctrl-C is for the main one; where that lets go of its end of a pipe, this one goes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        ended.poll(None)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
