"""Planning beside the page: the newest question wins, a quick answer comes first, then the one that is proved.

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
from floatplan.studio.answers import Failure, LaunchTask, Map, MapTask, PlanTask, ShownPlan

QUICK = 0.3  # [s] of search, before the best motion so far is shown
QUIET = 0.2  # [s] without another question, before the whole search and the proof begin
LAST = 10  # [-] niceness of proofs and maps: the page is drawn first
LOST = "the planner ended unexpectedly; change something to try again"
ROBOT = "robot"
LOG = logging.getLogger(__name__)
LOADED = (  # before a process begins
    *("floatplan.certificate.certificate", "floatplan.kernel.library", "floatplan.planning.many"),
    *("floatplan.planning.planner", "floatplan.planning.repair", __name__),
)


class Actions:
    """Actions by what they are about, done in a thread of their own in the order in which they were begun."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._actions: dict[str, Callable[[], object]] = {}
        self._lock = threading.Lock()
        self._thread = ThreadPoolExecutor(1, name)

    def do(self, about: str, action: Callable[[], object]) -> None:
        """Do something soon; in place of what was to be done about the same before. Nothing where it is closed."""
        with self._lock, contextlib.suppress(RuntimeError):
            if about not in self._actions:
                self._thread.submit(self._work, about)
            self._actions[about] = action

    def wait(self, patience: float) -> bool:
        """Wait until all that was begun is done; return whether that came within so many seconds."""
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
    """The process was stopped, or has died, before it answered."""


class Worker:
    """A process that answers questions about one robot, which stays there: only what changes is sent.

    It is started when it is asked something, and again after it was stopped.
    """

    def __init__(self, robot: fp.Robot, niceness: int = 0) -> None:
        self._robot = robot
        self._niceness = niceness
        self._lock = threading.Lock()
        self._running = contextlib.ExitStack()
        self._executor: Any = None
        self._heard, self._told = Pipe(duplex=False)  # words about the progress; None after the last
        self._closed = False

    def ask(self, task: PlanTask | LaunchTask | MapTask, say: Callable[[str], object] = str) -> Any:
        """Return the answer, or a :class:`Failure`; one thread at a time may ask, and is told what is done.

        Raises
        ------
        StoppedError
            :meth:`stop` was called meanwhile, or the process has died.
        """
        try:
            answering = self._started().submit(_answer, packed(task, self._robot))
            answering.add_done_callback(lambda _: self._told.send(None))
            while (words := self._heard.recv()) is not None:
                say(words)
            answer = answering.result()
        except (CancelledError, RuntimeError):  # so a pool says that it was stopped, or has lost its process
            self.stop()
            raise StoppedError from None
        except Exception as error:  # whatever the system says: the page goes on and says it
            self.stop()
            return Failure(f"the process that plans cannot be started: {Failure.of(error).words}")
        return unpacked(answer, self._robot)

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
                pool = processes(1, ("__main__", *LOADED), _prepare, self._robot, self._niceness, self._told)
                self._executor = self._running.enter_context(pool)
            return self._executor


_given: list[Any] = []  # to a process that answers: the robot that it is asked about, and where it says what it does


def _prepare(robot: fp.Robot, niceness: int, told: Any) -> None:
    """Make a process ready to answer about a robot, with so much less priority."""
    _given[:] = robot, told
    if hasattr(os, "nice"):
        os.nice(niceness)


def _answer(content: bytes) -> bytes:
    robot, told = _given
    try:
        task = unpacked(content, robot)
        return packed(task.answer(told.send) if isinstance(task, PlanTask) else task.answer(), robot)
    except Exception as error:  # whatever it is, the page goes on and says it
        return packed(Failure.of(error), robot)


def packed(content: object, robot: fp.Robot) -> bytes:
    """Content as bytes, without the robot."""

    class Pickler(pickle.Pickler):
        def persistent_id(self, obj: Any) -> str | None:
            return ROBOT if obj is robot else None

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
class Question:
    """A problem to plan, with a number that grows, and when it was asked, s of the monotonic clock."""

    number: int
    problem: fp.Problem
    with_map: bool
    since: float


class Planning:
    """Two processes: one plans at once, the other proves, searches on, and draws the map.

    Parameters
    ----------
    robot : Robot
    on_plan : callable
        Told the number of a question, and its plan or why there is none; from a thread of its own. Quick answers
        come in the order of their questions, those that newer ones overtook are left out.
    on_map : callable
        Told the number of a question, and the map as far as it is known.
    on_words : callable
        Told the number of a question, and what is done about it.
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
        self._newest: Question | None = None
        self._near: fp.Plan | Jump | None = None  # the newest, from which the next search begins
        self._dropped = 0  # number of the newest question that is not to be answered any more
        self._settling = False  # whether the second process is at work
        self._closed = False

    def ask(self, problem: fp.Problem, with_map: bool) -> int:
        """Ask for a plan; return the question's number. What older questions still wait for is dropped."""
        number = self._newest.number + 1 if self._newest else 1
        question = self._newest = Question(number, problem, with_map, time.monotonic())
        if self._settling:
            self._thorough.stop()
        self._plans.do("plan", lambda: self._plan(question))  # after that: it would stop what settles this question
        return number

    def drop(self) -> None:
        """Answer nothing that was asked so far."""
        self._dropped = self._newest.number if self._newest else 0
        self._newest = copy(self._newest)
        for each in (self._quick, self._thorough):
            each.stop()

    def close(self) -> None:
        """End both processes."""
        self._closed = True
        for each in (self._quick, self._thorough, self._plans, self._proofs):
            each.close()

    def _tell(self, question: Question, answer: ShownPlan | Failure) -> None:
        if isinstance(answer, ShownPlan) and (answer.jump or answer.plan).ok:
            self._near = answer.jump or answer.plan
        self._on_plan(question.number, answer)

    def _is_newest(self, question: Question) -> bool:
        return self._newest is question and not self._closed

    def _plan(self, question: Question) -> None:
        if question.problem.jump is None or self._near is None:  # else the last jump is shown until there is another
            try:
                answer = self._quick.ask(PlanTask(question.problem, QUICK, self._near))
            except StoppedError:
                answer = Failure(LOST)
            if question.number > self._dropped and not self._closed:
                self._tell(question, answer)
        if not self._closed:
            self._proofs.do("proof", lambda: self._settle(question))

    def _settle(self, question: Question) -> None:
        time.sleep(max(question.since + QUIET - time.monotonic(), 0.0))
        self._settling = True  # before the look at what is newest: who asks anew looks in the other order
        try:
            if not self._is_newest(question):
                return
            say = partial(self._on_words, question.number)
            answer = self._thorough.ask(PlanTask(question.problem, near=self._near), say)
            if self._is_newest(question):
                self._tell(question, answer)
                if isinstance(answer, ShownPlan) and question.problem.jump is None:
                    launched = self._thorough.ask(LaunchTask(answer))
                    if self._is_newest(question) and isinstance(launched, ShownPlan) and launched.stances:
                        self._tell(question, launched)
                    if question.with_map:
                        self._draw_map(question, answer)
        except StoppedError:
            if self._is_newest(question):
                self._on_plan(question.number, Failure(LOST))
        finally:
            self._settling = False

    def _draw_map(self, question: Question, present: ShownPlan) -> None:
        chart = Map.centred_at(present)
        for places, task in chart.questions(question.problem):
            if not self._is_newest(question):
                return
            points = self._thorough.ask(task)
            if isinstance(points, Failure) or not self._is_newest(question):
                return
            chart = replace(chart, points={**chart.points, **dict(zip(places, points, strict=True))})
            self._on_map(question.number, chart)
