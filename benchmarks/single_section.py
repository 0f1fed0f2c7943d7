"""Single plans and proofs beside their bars, all in one run."""

from __future__ import annotations

import dataclasses
import statistics
import time
from collections.abc import Callable
from functools import partial

from measuring import Counts, example, heading, in_turns, table

import floatplan as fp
from floatplan.kernel.library import description

TORQUE_SHARE = 0.8  # [-] of what the plan without limits needs
MOST_STARTS = 64
BARS = {  # [ms], one quiet core
    "A": 0.5,
    "B": 0.5,
    "B, obstacle": 8.0,
    "A, torque at 80 %": 6.0,
    "A, 64 starts": 3.0,
    "proof of A": 5.0,
    "proof of B, obstacle": 15.0,
}


def single(counts: Counts) -> None:
    """Single plans: median time by the clock and of the processor, and what they reach."""
    heading(f"single: {description()}, in process, after the first")
    plain, obstacle = example("A"), example("B, obstacle")
    runs: dict[str, Callable[[], object]] = {
        "A": partial(fp.plan, plain),
        "B": partial(fp.plan, example("B")),
        "B, obstacle": partial(fp.plan, obstacle),
        "A, torque at 80 %": partial(fp.plan, _limited(plain)),
        "A, 64 starts": partial(fp.plan, plain, starts=MOST_STARTS),
        "proof of A": partial(fp.certify, fp.plan(plain)),
        "proof of B, obstacle": partial(fp.certify, fp.plan(obstacle)),
    }
    timed = in_turns(runs, counts.turns)
    reference = statistics.median(timed.seconds["A"])
    rows = []
    for name, bar in BARS.items():
        result, seconds = timed.results[name], statistics.median(timed.seconds[name])
        if isinstance(result, fp.Plan):
            reached = f"{result.objective_value:.6g}" if result.ok else result.status
        else:
            reached = result.verdict
        rows.append([name, 1e3 * seconds, 1e3 * _processor_time(runs[name], counts), bar, seconds / reference, reached])
    table(["", "ms", "processor ms", "bar ms", "x A", "|b|, verdict"], rows)


def _limited(problem: fp.Problem) -> fp.Problem:
    limits = (TORQUE_SHARE * fp.plan(problem).record.torque_peak).tolist()
    return dataclasses.replace(problem, limits=dataclasses.replace(problem.limits, torque=limits))


def _processor_time(run: Callable[[], object], counts: Counts) -> float:
    spent = []
    for _ in range(counts.turns):
        began = time.process_time()
        run()
        spent.append(time.process_time() - began)
    return statistics.median(spent)
