"""Planning in the background: the newest problem counts, a quick result comes first, then the one with its proof.

Two processes plan: the page stays quick, and what is out of date ends at once.
"""

import contextlib
import io
import logging
import os
import pickle
import threading
import time
from collections.abc import Callable
from concurrent.futures import CancelledError, ThreadPoolExecutor, wait
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import Pipe
from typing import Any

import floatplan as fp
from floatplan.jumps.jump import Jump
from floatplan.pool import processes
from floatplan.studio.tasks import Failure, LaunchTask, Map, MapTask, PlanTask, ShownPlan

LAST = 10  # [-] niceness of proofs and maps: the page has priority
LOST = "the planner ended unexpectedly; change something to try again"
LOG = logging.getLogger(__name__)
LOADED = (  # modules that are imported before a process begins
    *("floatplan.certificate.certificate", "floatplan.kernel.library", "floatplan.planning.many"),
    *("floatplan.planning.planner", "floatplan.planning.repair", __name__),
)


class Actions:
    """Actions by their subjects, in a thread of their own, in the order in which they were begun."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._actions: dict[str, Callable[[], object]] = {}
        self._lock = threading.Lock()
        self._thread = ThreadPoolExecutor(1, name)

    def do(self, about: str, action: Callable[[], object]) -> None:
        """Do something soon, instead of an earlier action about the same that still waits. Nothing after closing."""
        with self._lock, contextlib.suppress(RuntimeError):
            if about not in self._actions:
                self._thread.submit(self._work, about)
            self._actions[about] = action

    def wait(self, patience: float) -> bool:
        """Wait until all actions so far are done; return whether that came within so many seconds."""
        done, _ = wait([self._thread.submit(lambda: None)], patience)
        return bool(done)

    def close(self) -> None:
        """Do no more."""
        self._thread.shutdown(cancel_futures=True)

    def _work(self, about: str) -> None:
        with self._lock:
            action = self._actions.pop(about)
        try:
            action()
        except Exception:  # the page goes on whatever happens; it is an error of the program
            LOG.exception("%s: %s", self._name, about)


class StoppedError(RuntimeError):
    """The process was stopped, or has died, before it had a result."""


class Worker:
    """A process that does tasks about one robot, which stays there: only what changes is sent.

    It starts with a task, and again after it was stopped.
    """

    def __init__(self, robot: fp.Robot, niceness: int = 0) -> None:
        self._robot = robot
        self._niceness = niceness
        self._lock = threading.Lock()
        self._running = contextlib.ExitStack()
        self._executor: Any = None
        self._progress, self._progress_end = Pipe(duplex=False)  # words about the progress; None after the last
        self._closed = False

    def ask(self, task: PlanTask | LaunchTask | MapTask, say: Callable[[str], object] = str) -> Any:
        """Return the result, or a :class:`Failure`; for one thread at a time, which hears of the progress by ``say``.

        Raises
        ------
        StoppedError
            :meth:`stop` was called meanwhile, or the process has died.
        """
        try:
            future = self._started().submit(_run, packed(task, self._robot))
            future.add_done_callback(lambda _: self._progress_end.send(None))
            while (words := self._progress.recv()) is not None:
                say(words)
            result = future.result()
        except (CancelledError, RuntimeError):  # so a pool says that it was stopped, or has lost its process
            self.stop()
            raise StoppedError from None
        except Exception as error:  # whatever the system says: the page goes on and says it
            self.stop()
            return Failure(f"the process that plans cannot be started: {Failure.of(error).words}")
        return unpacked(result, self._robot)

    def stop(self) -> threading.Thread:
        """Let go of the process, whatever it does, from any thread; return the one that waits for its end."""
        with self._lock:
            running = self._running
            self._running = contextlib.ExitStack()
            self._executor = None
        ending = threading.Thread(target=running.close)  # a hundred milliseconds where processors are busy
        ending.start()
        return ending

    def close(self) -> None:
        """Stop for good."""
        self._closed = True
        self.stop().join()

    def _started(self) -> Any:
        with self._lock:
            if self._closed:
                raise StoppedError
            if self._executor is None:
                pool = processes(1, ("__main__", *LOADED), _prepare, self._robot, self._niceness, self._progress_end)
                self._executor = self._running.enter_context(pool)
            return self._executor


_shared: list[Any] = []  # in a process: the robot of all its tasks, and the pipe to which progress is sent


def _prepare(robot: fp.Robot, niceness: int, progress_end: Any) -> None:
    """Prepare a process for tasks about a robot, with so much less priority."""
    _shared[:] = robot, progress_end
    if hasattr(os, "nice"):
        os.nice(niceness)


def _run(content: bytes) -> bytes:
    robot, progress_end = _shared
    try:
        task = unpacked(content, robot)
        return packed(task.run(progress_end.send) if isinstance(task, PlanTask) else task.run(), robot)
    except Exception as error:  # whatever it is, the page goes on and says it
        return packed(Failure.of(error), robot)


def packed(content: object, robot: fp.Robot) -> bytes:
    """Content as bytes, without the robot."""

    class Pickler(pickle.Pickler):
        def persistent_id(self, obj: Any) -> str | None:
            return "robot" if obj is robot else None

    buffer = io.BytesIO()
    Pickler(buffer, pickle.HIGHEST_PROTOCOL).dump(content)
    return buffer.getvalue()


def unpacked(content: bytes, robot: fp.Robot) -> Any:
    """What was packed on the other side, with the robot of this one."""

    class Unpickler(pickle.Unpickler):
        def persistent_load(self, pid: Any) -> fp.Robot:
            return robot

    return Unpickler(io.BytesIO(content)).load()


@dataclass(frozen=True, eq=False)
class Request:
    """A problem to plan, with a number that grows, and the time of the request, s of the monotonic clock."""

    number: int
    problem: fp.Problem
    with_map: bool
    since: float


class Planning:
    """Two processes: one plans at once, the other proves, searches on, and computes the map.

    Parameters
    ----------
    robot : Robot
    on_plan : callable
        Takes the number of a problem, and its plan or why there is none; from a thread of its own. Quick results
        come in the order of their problems, those that newer ones overtook are left out.
    on_map : callable
        Takes the number of a problem, and the map as far as it is complete.
    on_words : callable
        Takes the number of a problem, and words about the progress.
    """

    def __init__(
        self,
        robot: fp.Robot,
        on_plan: Callable[[int, ShownPlan | Failure], None],
        on_map: Callable[[int, Map], None],
        on_words: Callable[[int, str], None],
    ) -> None:
        self._on_plan = on_plan
        self._on_map = on_map
        self._on_words = on_words
        self._quick = Worker(robot)
        self._thorough = Worker(robot, LAST)
        self._plans = Actions("plans")
        self._proofs = Actions("proofs")
        self._newest: Request | None = None
        self._near: fp.Plan | Jump | None = None  # the newest, from which the next search begins
        self._dropped = 0  # number of the newest problem whose result nobody needs any more
        self._settling = False  # whether the second process is at work
        self._closed = False

    def submit(self, problem: fp.Problem, with_map: bool) -> int:
        """Begin to plan a problem; return its number. Older problems that still wait are dropped."""
        number = self._newest.number + 1 if self._newest else 1
        request = self._newest = Request(number, problem, with_map, time.monotonic())
        if self._settling:
            self._thorough.stop()
        self._plans.do("plan", lambda: self._plan(request))  # after that: it would stop what settles this problem
        return number

    def drop(self) -> None:
        """Give no result of the problems so far."""
        self._dropped = self._newest.number if self._newest else 0
        self._newest = copy(self._newest)
        self._quick.stop()
        self._thorough.stop()

    def close(self) -> None:
        """End both processes."""
        self._closed = True
        self._quick.close()
        self._thorough.close()
        self._plans.close()
        self._proofs.close()

    def _deliver(self, request: Request, result: ShownPlan | Failure) -> None:
        if isinstance(result, ShownPlan) and (result.jump or result.plan).ok:
            self._near = result.jump or result.plan
        self._on_plan(request.number, result)

    def _is_newest(self, request: Request) -> bool:
        return self._newest is request and not self._closed

    def _plan(self, request: Request) -> None:
        if request.problem.jump is None or self._near is None:  # else the last jump is shown until there is another
            try:
                # 0.3 s: a hand that waits longer for the best motion so far feels held up
                result = self._quick.ask(PlanTask(request.problem, 0.3, self._near))
            except StoppedError:
                result = Failure(LOST)
            if request.number > self._dropped and not self._closed:
                self._deliver(request, result)
        if not self._closed:
            self._proofs.do("proof", lambda: self._settle(request))

    def _settle(self, request: Request) -> None:
        # the whole search and the proof begin 0.2 s after the last change: a drag sends one every 50 ms
        time.sleep(max(request.since + 0.2 - time.monotonic(), 0.0))
        self._settling = True  # before the look at what is newest: a new request looks in the other order
        try:
            if not self._is_newest(request):
                return
            say = partial(self._on_words, request.number)
            result = self._thorough.ask(PlanTask(request.problem, near=self._near), say)
            if self._is_newest(request):
                self._deliver(request, result)
                if isinstance(result, ShownPlan) and request.problem.jump is None:
                    launched = self._thorough.ask(LaunchTask(result))
                    if self._is_newest(request) and isinstance(launched, ShownPlan) and launched.stances:
                        self._deliver(request, launched)
                    if request.with_map:
                        self._draw_map(request, result)
        except StoppedError:
            if self._is_newest(request):
                self._on_plan(request.number, Failure(LOST))
        finally:
            self._settling = False

    def _draw_map(self, request: Request, present: ShownPlan) -> None:
        chart = Map.centred_at(present)
        for cells, task in chart.tasks(request.problem):
            if not self._is_newest(request):
                return
            points = self._thorough.ask(task)
            if isinstance(points, Failure) or not self._is_newest(request):
                return
            chart = replace(chart, points={**chart.points, **dict(zip(cells, points, strict=True))})
            self._on_map(request.number, chart)
