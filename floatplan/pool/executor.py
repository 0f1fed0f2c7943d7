"""An executor whose processes end at once, amid their work too.

It is written upon the public members of multiprocessing. ``concurrent.futures.ProcessPoolExecutor`` waits for what its
processes are doing, and offers no other end before Python 3.14. loky starts each process as a new interpreter, which
loads floatplan's modules for seconds where the fork server takes milliseconds. Here each process has a pipe of its own,
so that one that dies while it answers leaves nothing behind that another waits for.
"""

from __future__ import annotations

import atexit
import os
import pickle
import threading
import traceback
from collections import deque
from collections.abc import Callable
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any

Start = Callable[[Connection], BaseProcess]
DIED = "a process ended unexpectedly: the system killed it, or it crashed"
LET_GO = "the processes were let go"


@dataclass
class Task:
    """A call as bytes, and the future of its result."""

    content: bytes
    future: Future[Any]


@dataclass(eq=False)
class Worker:
    """A process, this one's end of its pipe, whether it takes tasks, and the task that it does, if any."""

    process: BaseProcess
    pipe: Connection
    takes_tasks: bool = False
    task: Task | None = None


class WorkerPool(Executor):
    """Up to ``count`` processes, each started when a task waits and every other one is at work.

    Parameters
    ----------
    count : int
    start : callable
        Starts a process that calls :func:`serve` with its end of a pipe.
    on_start : callable
        Called with the process ID of a process's parent, when the process takes tasks.
    """

    def __init__(self, count: int, start: Start, on_start: Callable[[int], None]) -> None:
        self._count, self._start, self._on_start = count, start, on_start
        self._lock = threading.Lock()  # for all that follows
        self._workers: list[Worker] = []
        self._waiting: deque[Task] = deque()
        self._over = ""  # why no more tasks are taken
        self._is_woken = False
        self._wake_reader, self._wake_writer = Pipe(duplex=False)
        self._manager = threading.Thread(target=self._manage, name="processes", daemon=True)
        self._manager.start()
        atexit.register(self.shutdown)  # else multiprocessing would wait there for processes that wait for tasks

    @property
    def process_ids(self) -> list[int]:
        """Of the processes that were started, and have not ended as far as is known."""
        with self._lock:
            return [worker.process.pid for worker in self._workers if worker.process.pid is not None]

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Let a process call a function.

        Raises
        ------
        BrokenProcessPool
            A process died, or the pool was shut down.
        OSError
            The system allows no further process.
        """
        future: Future[Any] = Future()
        try:
            task = Task(pickle.dumps((fn, args, kwargs), pickle.HIGHEST_PROTOCOL), future)
        except Exception as error:  # what cannot be pickled raises whatever it likes
            future.set_exception(error)
            return future
        with self._lock:
            if self._over:
                raise BrokenProcessPool(self._over)
            idle = sum(worker.task is None for worker in self._workers)
            if idle <= len(self._waiting) and len(self._workers) < self._count:
                self._workers.append(self._started())
            self._waiting.append(task)
            self._wake()
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End all processes at once, whatever they do; what is not done raises BrokenProcessPool.

        Parameters
        ----------
        wait : bool
            Whether to return when they are gone.
        cancel_futures : bool
            Nothing else than what happens anyway.
        """
        atexit.unregister(self.shutdown)
        with self._lock:  # not amid a start: a fork server ends that is sent what is closed
            self._over = self._over or LET_GO
            for worker in self._workers:
                worker.process.kill()  # also frees the thread that sends to it, or hears from it
            self._wake()
        if wait and threading.current_thread() is not self._manager:
            self._manager.join()

    def _started(self) -> Worker:
        """Start a process, under the lock."""
        here, there = Pipe()
        with there:
            try:
                return Worker(self._start(there), here)
            except BaseException:
                here.close()
                raise

    def _wake(self) -> None:
        """Let the manager look at what has changed, under the lock; once is enough."""
        if not self._is_woken and not self._wake_writer.closed:
            self._is_woken = True
            self._wake_writer.send_bytes(b"")

    def _manage(self) -> None:
        """Hand out tasks and take their results, until a process dies or the pool is shut down."""
        with suppress(OSError, EOFError):  # so says the pipe of a process that is gone
            while not self._over:
                for worker in self._handed_out():
                    worker.pipe.send_bytes(worker.task.content)  # type: ignore[union-attr]
                with self._lock:
                    workers = {worker.pipe: worker for worker in self._workers}
                for readable in wait([self._wake_reader, *workers]):
                    if readable is self._wake_reader:
                        with self._lock:
                            self._is_woken = False
                            self._wake_reader.recv_bytes()
                    else:
                        self._hear(workers[readable])  # type: ignore[index]
        self._end()

    def _handed_out(self) -> list[Worker]:
        """Workers that were idle, each with a task that waited; none that would not read it yet."""
        handed_out = []
        with self._lock:
            for worker in self._workers:
                while worker.takes_tasks and worker.task is None and self._waiting:
                    task = self._waiting.popleft()
                    if task.future.set_running_or_notify_cancel():
                        worker.task = task
                        handed_out.append(worker)
        return handed_out

    def _hear(self, worker: Worker) -> None:
        """Take what a process sends: that it takes tasks, or the result of its task."""
        content = worker.pipe.recv_bytes()
        try:
            result, error = pickle.loads(content)
        except Exception as failure:  # what cannot be unpickled raises whatever it likes
            result, error = None, failure
        task = worker.task
        if isinstance(result, Started):
            worker.takes_tasks = True
            self._on_start(result.parent)
        elif task is not None:
            with self._lock:
                worker.task = None
            if error is None:
                task.future.set_result(result)
            else:
                task.future.set_exception(error)

    def _end(self) -> None:
        """End all processes, and say so to whoever waits for a result."""
        with self._lock:
            self._over = self._over or DIED
            workers, self._workers = self._workers, []
            left = [worker.task for worker in workers if worker.task is not None]
            left += [task for task in self._waiting if task.future.set_running_or_notify_cancel()]
            self._waiting.clear()
            self._wake_reader.close()
            self._wake_writer.close()
        for worker in workers:
            worker.process.kill()
        for task in left:
            task.future.set_exception(BrokenProcessPool(self._over))
        for worker in workers:
            worker.process.join()
            worker.pipe.close()


@dataclass(frozen=True)
class Started:
    """What a process sends when it takes tasks: the process ID of its parent."""

    parent: int


def serve(pipe: Connection) -> None:
    """Do the tasks that come through a pipe, until that ends."""
    pipe.send((Started(os.getppid()), None))
    with suppress(EOFError, OSError):
        while True:
            pipe.send_bytes(_result_of(pipe.recv_bytes()))


def _result_of(content: bytes) -> bytes:
    """The result of a task and None, or None and the error that it raised, as bytes."""
    try:
        function, arguments, options = pickle.loads(content)
        return pickle.dumps((function(*arguments, **options), None), pickle.HIGHEST_PROTOCOL)
    except BaseException as error:  # a task that ends its process by SystemExit would look like one that crashed it
        with suppress(Exception):
            error.add_note("".join(traceback.format_exception(error)))  # which would stay here
            content = pickle.dumps((None, error), pickle.HIGHEST_PROTOCOL)
            pickle.loads(content)
            return content
        return pickle.dumps((None, RuntimeError(f"{type(error).__name__}: {error}")))
