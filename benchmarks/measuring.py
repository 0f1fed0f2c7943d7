"""What the sections share: how much is measured, runs that take turns, and tables.

Times are medians of runs that take turns, each turn begun by another, so that what disturbs the machine disturbs all
alike; ratios are medians of the ratios within each turn.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import free_problems
import long_chains
from generated_problems import random_problem
from independent import INSTANTS

import floatplan as fp

ROOT = Path(__file__).resolve().parents[1]
PROBLEMS = ROOT / "problems"
CHAINS = (5, 8, 12, 20)
CALLS = 5  # of a function in its turn
LONG = 0.1  # s, after which there are no more of them
HOLDS = 1e-6  # of the natural unit: a constraint violated by no more holds


@dataclass(frozen=True)
class Counts:
    """How much is measured."""

    turns: int = 31
    slow_turns: int = 5
    generated: int = 300
    compared: int = 50
    many: int = 2000
    across: int = 400
    witnesses: int = 400
    starts: int = 12
    repeated: int = 100
    free: int = 50
    scanned: int = free_problems.SCANNED
    subprocesses: int = 5
    flights: int = 100
    instants: int = INSTANTS
    guesses: int = 20
    guesses_in_space: int = 10  # of each jump
    hops: int = 50
    takeoffs: int = 50
    landings: int = 20
    stunts: int = 100  # jumps in space that are simulated: all of them
    in_space: int = 100
    peers_in_space: int = 1
    proofs: int = 40  # of each class
    clips: int = 300
    repairs: int = 300
    clip_landings: int = 6  # hops of each robot
    clip_stances: int = 20  # the same
    guarded: int = 10**9  # of each set: all of them
    chains: tuple[int, ...] = CHAINS
    long_chains: tuple[int, ...] = long_chains.JOINTS


FULL = Counts()
QUICK = Counts(
    turns=5,
    slow_turns=2,
    generated=30,
    compared=6,
    many=100,
    across=8,
    witnesses=30,
    repeated=12,
    free=6,
    scanned=7,
    subprocesses=2,
    flights=10,
    instants=4000,
    guesses=4,
    guesses_in_space=1,
    hops=3,
    takeoffs=6,
    landings=5,
    stunts=1,
    in_space=6,
    peers_in_space=0,
    proofs=4,
    clips=18,
    repairs=12,
    clip_landings=1,
    clip_stances=1,
    guarded=60,
)


def table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Print rows in columns; numbers to the right."""
    texts = [list(header), *([_text(cell) for cell in row] for row in rows)]
    widths = [max(len(row[column]) for row in texts) for column in range(len(header))]
    numeric = [all(_is_number(row[column]) for row in texts[1:]) for column in range(len(header))]
    for row in texts:
        cells = (
            text.rjust(width) if right else text.ljust(width)
            for text, width, right in zip(row, widths, numeric, strict=True)
        )
        print("  " + "  ".join(cells).rstrip())
    print()


def _text(cell: object) -> str:
    return f"{cell:.4g}" if isinstance(cell, float) else str(cell)


def _is_number(text: str) -> bool:
    return text in ("", "-") or text.lstrip("-")[:1].isdigit() or text in ("inf", "nan")


def heading(text: str) -> None:
    """Print a section's title."""
    print(f"{text}\n{'-' * len(text)}", flush=True)


@dataclass(frozen=True)
class Timed:
    """What runs that took turns gave: seconds per turn and the last result, by name."""

    seconds: dict[str, list[float]]
    results: dict[str, Any]

    def median_ms(self, name: str) -> float:
        """Median, ms."""
        return 1e3 * statistics.median(self.seconds[name])

    def ratio(self, name: str, other: str) -> float:
        """Median of the ratios within each turn."""
        pairs = zip(self.seconds[name], self.seconds[other], strict=True)
        return statistics.median(one / another for one, another in pairs)


def in_turns(runs: Mapping[str, Callable[[], object]], turns: int) -> Timed:
    """Time functions by turns, each turn begun by another: what runs after a big one finds the caches full of that.

    In its turn a function runs once without counting, then up to ``CALLS`` times; their median counts.
    """
    results: dict[str, Any] = {}
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    order = list(runs)
    for _ in range(turns):
        for name in order:
            runs[name]()
            calls = []
            for _ in range(CALLS):
                began = time.perf_counter()
                results[name] = runs[name]()
                calls.append(time.perf_counter() - began)
                if sum(calls) > LONG:
                    break
            seconds[name].append(statistics.median(calls))
        order.append(order.pop(0))
    return Timed(seconds, results)


FILES = {"A": "new_configuration", "B": "handstand", "B, obstacle": "obstacle", "B, hard": "obstacle_hard"}


@cache
def example(name: str) -> fp.Problem:
    """Return a problem of ``problems/``, or a chain drawn at random."""
    if name in FILES:
        return fp.load_problem(PROBLEMS / f"{FILES[name]}.toml")
    return random_problem(0, int(name.split()[-1]))


@contextmanager
def stopwatch(
    holder: object, names: Sequence[str], clock: Callable[[], float] = time.perf_counter
) -> Iterator[dict[str, float]]:
    """Add up the seconds spent within functions of a module while the context lasts."""
    total = {"seconds": 0.0}

    def timed(function: Callable[..., object]) -> Callable[..., object]:
        def run(*args: object, **kwargs: object) -> object:
            began = clock()
            try:
                return function(*args, **kwargs)
            finally:
                total["seconds"] += clock() - began

        return run

    kept = {name: getattr(holder, name) for name in names}
    for name, function in kept.items():
        setattr(holder, name, timed(function))
    try:
        yield total
    finally:
        for name, function in kept.items():
            setattr(holder, name, function)


def planner(problem: fp.Problem, turns: int) -> Callable[[], fp.Plan]:
    """Return a function that plans a copy of the problem at each call, so that nothing is remembered of an earlier one.

    For so many turns of :func:`in_turns`.
    """
    copies = iter([replace(problem) for _ in range((CALLS + 1) * turns)])
    return lambda: fp.plan(next(copies))


def timed_plans(problems: Sequence[fp.Problem]) -> list[tuple[fp.Plan, float]]:
    """Plan each problem once by default settings: plans and seconds."""
    answers = []
    for problem in problems:
        began = time.perf_counter()
        plan = fp.plan(problem)
        answers.append((plan, time.perf_counter() - began))
    return answers


def list_unsolved(answers: Sequence[tuple[fp.Plan, float]]) -> None:
    """Print the problems without a plan, and why."""
    for plan, spent in answers:
        if not plan.ok:
            print(f"  not solved, after {spent:.1f} s: {plan.problem.name}: {plan.explanation}")
    print()
