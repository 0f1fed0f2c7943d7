"""Plans per second of batches beside a loop of ``fp.plan``, and what both reach."""

from __future__ import annotations

import math
import statistics
import time
from functools import partial

import numpy as np
from generated_problems import random_chain
from measuring import Counts, heading, in_turns, table

import floatplan as fp
from floatplan.kernel.library import description

BARS = {2: 40_000, 5: 6_000, 10: 1_500}  # plans/s, one core
SAME = 1e-6  # relative, of |b|


def family(joints: int, count: int, seed: int = 7) -> fp.Family:
    """One chain of links, and flights between random states inside its ranges, by the shorter turn."""
    rng = np.random.default_rng([seed, joints])
    robot = random_chain(rng, joints)
    still = fp.Posture(0.0, np.zeros(joints))
    base = fp.Problem(robot, still, still, fp.Flight(duration=1.0))
    varied = {
        "flight.duration": rng.uniform(0.8, 1.6, count),
        "start.orientation": rng.uniform(-math.pi, math.pi, count),
    }
    varied["goal.orientation"] = varied["start.orientation"] + rng.uniform(-math.pi, math.pi, count)
    for end in ("start", "goal"):
        for joint in robot.joints:
            varied[f"{end}.positions.{joint}"] = rng.uniform(-0.85 * math.pi, 0.85 * math.pi, count)
    return fp.Family(base, varied)


def many(counts: Counts) -> None:
    """Batches beside a loop of ``fp.plan``."""
    heading(f"many: {description()}, one robot of n joints, random flights without limits, one core")
    rows = []
    for joints, bar in BARS.items():
        flights = family(joints, counts.many)
        fp.plan_many(flights[:2])
        timed = in_turns({"plan_many": partial(fp.plan_many, flights)}, counts.slow_turns)
        batch: fp.Plans = timed.results["plan_many"]
        seconds = statistics.median(timed.seconds["plan_many"])
        looped = list(flights[: counts.compared])
        began = time.perf_counter()
        plans = [fp.plan(problem) for problem in looped]
        each = (time.perf_counter() - began) / len(plans)
        ok = np.array([plan.ok for plan in plans])
        both = ok & batch.ok[: len(plans)]
        norms = np.array([plan.objective_value for plan in plans])
        lower = batch.objective[: len(plans)][both] <= norms[both] * (1 + SAME)
        quick = batch.starts == 1
        rows.append(
            [
                joints,
                f"{len(flights) / seconds:.0f}",
                bar,
                f"{each * len(flights) / seconds:.0f}",
                f"{100 * batch.ok[: len(plans)].mean():.1f}",
                f"{100 * ok.mean():.1f}",
                f"{100 * lower.mean():.1f}" if both.any() else "-",
                f"{100 * quick.mean():.1f}",
                f"{batch.evaluations.mean():.0f}",
            ]
        )
    table(
        ["n", "plans/s", "bar", "x fp.plan", "solved %", "by fp.plan %", "|b| <= %", "one start %", "evaluations"],
        rows,
    )
