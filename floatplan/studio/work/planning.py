"""Planning beside the page: the newest question wins, a quick answer comes first, then the one that is proved."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import floatplan as fp
from floatplan.studio.work.around import Map
from floatplan.studio.work.flown import Flown
from floatplan.studio.work.tasks import Failure, Quick, Settle
from floatplan.studio.work.worker import StoppedError, Worker

QUICK = 0.3  # [s] of search, before the best motion so far is shown
QUIET = 0.2  # [s] without another question, before the whole search and the proof begin
MAP_BUDGET = 30.0  # [s] of planning for a map
LAST = 10  # [-] niceness of proofs and maps: the page is drawn first
LOST = "the planner ended unexpectedly; change something to try again"


@dataclass(frozen=True, eq=False)
class Question:
    """What is asked, with a number that grows."""

    number: int
    problem: fp.Problem
    with_map: bool
    asked: float


class Planning:
    """Two processes: one plans at once, the other proves, searches on, and draws the map.

    Parameters
    ----------
    robot : Robot
    on_flown : callable
        Told the number of a question, and what is flown or why nothing is; from a thread of its own. Quick answers
        come in the order of their questions, those that newer ones overtook are left out.
    on_map : callable
        Told the number of a question, and the map as far as it is known.
    """

    def __init__(
        self,
        robot: fp.Robot,
        on_flown: Callable[[int, Flown | Failure], None],
        on_map: Callable[[int, Map], None],
    ) -> None:
        self._on_flown, self._on_map = on_flown, on_map
        self._quick, self._thorough = Worker(robot), Worker(robot, LAST)
        self._change = threading.Condition()
        self._newest: Question | None = None
        self._near: fp.Plan | None = None  # the newest plan, from which the next quick one begins
        self._answered = 0  # number of the newest question that has a quick answer
        self._settled = 0  # number of the newest question that the other process was given
        self._settling = False  # whether it is at work
        self._closed = False
        self._threads = [threading.Thread(target=work, daemon=True) for work in (self._plan_all, self._settle_all)]
        for thread in self._threads:
            thread.start()

    def ask(self, problem: fp.Problem, with_map: bool) -> int:
        """Ask for a plan; return the question's number. What older questions still wait for is dropped."""
        with self._change:
            number = self._newest.number + 1 if self._newest else 1
            self._newest = Question(number, problem, with_map, time.monotonic())
            self._change.notify_all()
        if self._settling:
            self._thorough.stop()
        return number

    def close(self) -> None:
        """End both processes."""
        with self._change:
            self._closed = True
            self._change.notify_all()
        self._quick.close()
        self._thorough.close()
        for thread in self._threads:
            thread.join()

    @property
    def process_ids(self) -> list[int]:
        """Of the processes that run."""
        return [number for worker in (self._quick, self._thorough) if (number := worker.process_id) is not None]

    def _tell(self, question: Question, answer: Flown | Failure) -> None:
        if isinstance(answer, Flown) and answer.plan.ok:
            self._near = answer.plan
        self._on_flown(question.number, answer)

    def _is_newest(self, question: Question) -> bool:
        return self._newest is question and not self._closed

    def _plan_all(self) -> None:
        while question := self._next(lambda newest: newest.number > self._answered):
            try:
                answer: Flown | Failure = self._quick.ask(Quick(question.problem, QUICK, self._near))
            except StoppedError:
                answer = Failure(LOST)
            if not self._closed:
                self._tell(question, answer)
            with self._change:
                self._answered = question.number
                self._change.notify_all()

    def _settle_all(self) -> None:
        while question := self._next(lambda newest: self._answered == newest.number > self._settled):
            self._settled = question.number
            if not self._stays_quiet(question):
                continue
            self._settling = True
            try:
                answer: Flown | Failure = self._thorough.ask(Settle(question.problem))
                if self._is_newest(question):
                    self._tell(question, answer)
                    if question.with_map and isinstance(answer, Flown):
                        self._draw_map(question, answer)
            except StoppedError:
                if self._is_newest(question):
                    self._on_flown(question.number, Failure(LOST))
            finally:
                self._settling = False

    def _draw_map(self, question: Question, present: Flown) -> None:
        chart, until = Map.around(present), time.monotonic() + MAP_BUDGET
        for points, task in chart.questions(question.problem):
            if not self._is_newest(question) or time.monotonic() > until:
                return
            cells = self._thorough.ask(task)
            if isinstance(cells, Failure) or not self._is_newest(question):
                return
            chart = Map(**{**vars(chart), "cells": {**chart.cells, **dict(zip(points, cells, strict=True))}})
            self._on_map(question.number, chart)

    def _next(self, wanted: Callable[[Question], bool]) -> Question | None:
        """Wait for a newest question of which something is wanted; None where there will be no more."""
        with self._change:
            self._change.wait_for(lambda: self._closed or (self._newest is not None and wanted(self._newest)))
            return None if self._closed else self._newest

    def _stays_quiet(self, question: Question) -> bool:
        """Wait until a question is old enough; return whether it is still the newest then."""
        with self._change:
            left = question.asked + QUIET - time.monotonic()
            return not self._change.wait_for(lambda: not self._is_newest(question), max(left, 0.0))
