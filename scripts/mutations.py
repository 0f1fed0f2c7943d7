"""Tamper with plans at random and count what the certificate says: no false proof is allowed.

Usage: ``python scripts/mutations.py [COUNT] [SEED] [PROCESSES] [plane|space]`` (default: 10000 mutations, seed 1, one
process, in a plane). The judge (``tests/helpers/proof_judge.py``) evaluates each motion at 20 001 instants and shares
no code with the proof: doubles decide where a violation is beyond 1e-9 of its unit, 50 digits near it. In space
(``tests/helpers/space_mutations.py``) Pinocchio and DOP853 fly the motion. Exit 1 where a violated plan was proved, or
fewer than 99 % of the valid ones were.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).parents[1] / name) for name in ("tests/helpers", "benchmarks")]

from proof_judge import Judge  # noqa: E402
from proof_mutations import base_plans, mutate  # noqa: E402
from proof_records import certify_record  # noqa: E402
from space_mutations import base_plans as space_plans  # noqa: E402
from space_mutations import certificate_of, shape_plans  # noqa: E402
from space_mutations import judge as judge_in_space  # noqa: E402
from space_mutations import mutate as mutate_in_space  # noqa: E402

from floatplan.errors import InputError  # noqa: E402
from floatplan.plans.record import PlanRecord  # noqa: E402

BATCH = 50
KEPT = 0.99
WRONG = {("invalid", "proved"), *(("valid", said) for said in ("refuted", "undecided", "refused"))}


@cache
def _bases() -> list[PlanRecord]:
    return base_plans()


def batch(seed: int, number: int, size: int, _robots: str) -> tuple[Counter[tuple[str, str, str]], int]:
    """Counts by kind of mutation, judge's verdict and certificate's; and how many values took 50 digits."""
    rng = np.random.default_rng([seed, number])
    bases, judge = _bases(), Judge()
    counts: Counter[tuple[str, str, str]] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        for index in range(size):
            case = mutate(rng, bases[index % len(bases)], Path(folder))
            truth, said = judge(case.robot, case.record), certify_record(case.record).verdict
            counts[case.kind, truth, said] += 1
            if (truth, said) in WRONG:
                print(f"batch {number}, mutation {index}: {case.kind} is {truth} and was {said}", flush=True)
    return counts, judge.sharp_values


def batch_in_space(seed: int, number: int, size: int, robots: str) -> tuple[Counter[tuple[str, str, str]], int]:
    """The same of flights in space, without 50 digits; files of robots that are made go to the folder ``robots``."""
    rng = np.random.default_rng([seed, number])
    counts: Counter[tuple[str, str, str]] = Counter()
    own = Path(robots, str(os.getpid()))  # so that no process reads what another one is writing
    own.mkdir(exist_ok=True)
    bases = [*space_plans(str(own)), *shape_plans(str(own))]
    with tempfile.TemporaryDirectory() as folder:
        for index in range(size):
            case = mutate_in_space(rng, bases[index % len(bases)], Path(folder))
            truth = judge_in_space(case.record)
            try:
                said: str = certificate_of(case.record).verdict
            except InputError:
                said = "refused"
            counts[case.kind, truth, said] += 1
            if (truth, said) in WRONG:
                print(f"batch {number}, mutation {index}: {case.kind} is {truth} and was {said}", flush=True)
    return counts, 0


def main(count: int = 10_000, seed: int = 1, processes: int = 1, where: str = "plane") -> int:
    """Print the counts of all batches."""
    began, counts, sharp = time.perf_counter(), Counter[tuple[str, str, str]](), 0
    sizes = [min(BATCH, count - first) for first in range(0, count, BATCH)]
    of_batch = {"plane": batch, "space": batch_in_space}[where]
    with tempfile.TemporaryDirectory() as robots, ProcessPoolExecutor(processes) as pool:
        work = pool.map(of_batch, [seed] * len(sizes), range(len(sizes)), sizes, [robots] * len(sizes))
        for number, (some, values) in enumerate(work):
            counts, sharp = counts + some, sharp + values
            print(f"{sum(sizes[: number + 1])} in {time.perf_counter() - began:.0f} s", file=sys.stderr, flush=True)
    for (kind, truth, said), times in sorted(counts.items()):
        print(f"{kind:12s} {truth:8s} {said:10s} {times:6d}")
    false_proofs = sum(times for (_, truth, said), times in counts.items() if (truth, said) == ("invalid", "proved"))
    valid = sum(times for (_, truth, _), times in counts.items() if truth == "valid")
    kept = sum(times for (_, truth, said), times in counts.items() if (truth, said) == ("valid", "proved"))
    print(f"{count} mutations in {time.perf_counter() - began:.0f} s; {sharp} values took 50 digits")
    print(f"{false_proofs} false proofs; {kept} of {valid} valid plans proved")
    return 1 if false_proofs or kept < KEPT * valid else 0


if __name__ == "__main__":
    numbers = dict(zip(("count", "seed", "processes"), map(int, sys.argv[1:4]), strict=False))
    sys.exit(main(**numbers, where=sys.argv[4] if len(sys.argv) > 4 else "plane"))
