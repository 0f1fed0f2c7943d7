"""A process that answers questions about one robot, which stays there: only what changes is sent."""

from __future__ import annotations

import contextlib
import io
import os
import pickle
import signal
import threading
from multiprocessing.connection import Connection
from typing import Any

import floatplan as fp
from floatplan.pool import get_ready
from floatplan.studio.work.tasks import Failure, Task, words_of

ROBOT = "robot"
LOADED = (  # before a process begins
    *("floatplan.certificate.certify", "floatplan.kernel.library", "floatplan.planning.many"),
    *("floatplan.planning.planner", "floatplan.planning.repair", __name__),
)


class StoppedError(Exception):
    """The process was stopped, or has died, before it answered."""


class Worker:
    """A process, started when it is asked something, and again after it was stopped."""

    def __init__(self, robot: fp.Robot, niceness: int = 0) -> None:
        self._robot, self._niceness = robot, niceness
        self._lock = threading.Lock()
        self._process: Any = None
        self._pipe: Connection | None = None
        self._stops = 0  # so far
        self._closed = False

    def ask(self, task: Task) -> Any:
        """Return the answer, or a :class:`Failure`; one thread at a time may ask.

        Raises
        ------
        StoppedError
            :meth:`stop` was called meanwhile, or the process has died.
        """
        try:
            pipe = self._running()
        except StoppedError:
            raise
        except Exception as error:  # whatever the system says: the page goes on and says it
            return Failure(f"the process that plans cannot be started: {words_of(error)}")
        try:
            pipe.send_bytes(packed(task, self._robot))
            return unpacked(pipe.recv_bytes(), self._robot)
        except (EOFError, OSError):
            self.stop()
            raise StoppedError from None

    def stop(self) -> None:
        """End the process, whatever it does; from any thread, and without waiting for one that only starts."""
        with self._lock:
            self._stops += 1
            process, self._process, self._pipe = self._process, None, None
        if process is not None:
            process.kill()
            process.join()
            process.close()

    def close(self) -> None:
        """Stop for good."""
        self._closed = True
        self.stop()

    @property
    def process_id(self) -> int | None:
        """Of the process, where one runs."""
        with self._lock:
            return None if self._process is None else self._process.pid

    def _running(self) -> Connection:
        with self._lock:
            if self._pipe is not None:
                return self._pipe
            stops = self._stops
        process, pipe = self._started()
        with self._lock:
            self._process, self._pipe = process, pipe
        if self._closed:
            self.stop()
        if self._stops != stops:
            raise StoppedError
        return pipe

    def _started(self) -> tuple[Any, Connection]:
        if self._closed:
            raise StoppedError
        context = get_ready("__main__", *LOADED)
        ours, theirs = context.Pipe()
        process = context.Process(target=serve, args=(theirs, self._robot, self._niceness), daemon=True)
        process.start()
        theirs.close()
        return process, ours


def serve(pipe: Connection, robot: fp.Robot, niceness: int) -> None:
    """Answer until the other end is closed, with so much less priority; Ctrl-C is for the main process."""
    if hasattr(os, "nice"):
        os.nice(niceness)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(EOFError, OSError):
        while True:
            task = unpacked(pipe.recv_bytes(), robot)
            try:
                answer = task.answer()
            except Exception as error:  # whatever it is, the page goes on and says it
                answer = Failure(words_of(error))
            pipe.send_bytes(packed(answer, robot))


def packed(content: object, robot: fp.Robot) -> bytes:
    """Content as bytes, without the robot."""

    class Pickler(pickle.Pickler):
        def persistent_id(self, each: Any) -> str | None:
            return ROBOT if each is robot else None

    buffer = io.BytesIO()
    Pickler(buffer, pickle.HIGHEST_PROTOCOL).dump(content)
    return buffer.getvalue()


def unpacked(content: bytes, robot: fp.Robot) -> Any:
    """What was packed on the other side, with the robot of this one."""

    class Unpickler(pickle.Unpickler):
        def persistent_load(self, _: str) -> fp.Robot:
            return robot

    return Unpickler(io.BytesIO(content)).load()
