"""What the search finds: more starts, a free angular momentum, random flights without constraints."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from itertools import islice, pairwise

import free_problems
import numpy as np
from generated_problems import random_problems
from independent import Worst, violations
from measuring import Counts, heading, list_unsolved, table, timed_plans
from rest_problems import frame_speeds, rest_problems
from starts_problems import starts_problems

import floatplan as fp

SCAN_BUDGET = 2.0  # s for each given h, most of which have no plan
WITHIN = 1.001  # of the scan's best objective
NUMBERS_OF_STARTS = (1, 2, 4, 8)
SAME_NUMBER = 1e-9  # relative difference of objectives that are the same


def starts_section(counts: Counts) -> None:
    """More starts are never worse."""
    heading(f"starts: {counts.repeated} problems planned with {', '.join(map(str, NUMBERS_OF_STARTS))} starts")
    rows = []
    for problem in islice(starts_problems(), counts.repeated):
        plans = [fp.plan(problem, starts=starts) for starts in NUMBERS_OF_STARTS]
        values = [plan.objective_value if plan.ok else np.inf for plan in plans]
        worse = any(more > less * (1 + SAME_NUMBER) for less, more in pairwise(values))
        rows.append((problem.motion.objective, worse, plans[-1].ok and values[-1] < values[0] * (1 - 1e-6)))
    names = list(dict.fromkeys(name for name, _, _ in rows))
    table(
        ["objective", "problems", "worse with more starts", f"better with {NUMBERS_OF_STARTS[-1]} than with 1"],
        [[name, *(sum(column) for column in zip(*[(1, *row[1:]) for row in rows if row[0] == name], strict=True))]
         for name in names],
    )  # fmt: skip
    print("  Bar: none worse.\n")


def free_section(counts: Counts) -> None:
    """A free h beside a scan of given ones."""
    heading(f"free: {counts.free} problems that {counts.scanned} given h solve, planned with h free")
    compared: list[tuple[free_problems.Scan, free_problems.Timed]] = []
    unsolved = 0
    for problem in free_problems.free_problems():
        given = free_problems.scan(problem, counts.scanned, SCAN_BUDGET)
        unsolved += not given.solved
        if given.solved:
            compared.append((given, free_problems.timed(problem)))
        if len(compared) == counts.free:
            break
    lost = sum(not free.plan.ok for _, free in compared)
    as_good = sum(free.plan.ok and free.plan.objective_value <= WITHIN * given.best for given, free in compared)
    ratio = statistics.median(free.seconds / given.seconds for given, free in compared)
    print(f"  {unsolved} more problems have no solution that the scan finds")
    print(f"  not solved with h free: {lost} of {len(compared)}")
    print(f"  objective within 0.1 % of the scan's best, or better: {as_good} of {len(compared)}")
    print(f"  processor time over that of the median given-h plan: {ratio:.2f} (median)\n")
    print("  Bar: 0; 47 of 50; 3.\n")


def random_section(counts: Counts) -> None:
    """Random flights without constraints, all of which should be solved."""
    heading(f"random: {counts.generated} random flights by default settings")
    answers = timed_plans(random_problems(counts.generated))
    checks = [violations(plan, 2) for plan, _ in answers if plan.ok]
    boundary = _worst_of(checks, "boundary")
    orientation = _worst_of(checks, "orientation")
    print(f"  solved {len(checks)} of {len(answers)}")
    print(f"  worst boundary error     {boundary.amount:.1e} {boundary.unit} ({boundary.label})")
    print(f"  worst orientation error  {orientation.amount:.1e} rad, by an independent integration\n")
    rows = []
    for n in sorted({len(plan.robot.joints) for plan, _ in answers}):
        seconds = [1e3 * spent for plan, spent in answers if len(plan.robot.joints) == n]
        solved = sum(plan.ok for plan, _ in answers if len(plan.robot.joints) == n)
        rows.append([n, f"{solved}/{len(seconds)}", statistics.median(seconds), max(seconds)])
    table(["n", "solved", "median ms", "worst ms"], rows)
    list_unsolved(answers)


def rest_section(counts: Counts) -> None:
    """Flights from a foot at rest to a hand at rest."""
    heading(f"rest: {counts.repeated} flights drawn around a motion with frames at rest, every third with h free")
    answers = timed_plans(list(islice(rest_problems(), counts.repeated)))
    solved = [plan for plan, _ in answers if plan.ok]
    fastest = max((float(frame_speeds(plan).max()) for plan in solved), default=0.0)
    print(f"  solved {len(solved)} of {len(answers)}")
    print(f"  frames at takeoff and landing move at {fastest:.1e} m/s at most, by Pinocchio")
    print(f"  {1e3 * statistics.median(spent for _, spent in answers):.1f} ms (median)\n")
    print("  Bar: 95 %; 1e-9 m/s.\n")
    list_unsolved(answers)


def _worst_of(checks: Sequence[Sequence[Worst]], label: str) -> Worst:
    chosen = (worst for check in checks for worst in check if worst.label.startswith(label))
    return max(chosen, key=lambda worst: worst.amount, default=Worst("none", 0.0, "", 0.0))
