"""Answers that are frozen, to be compared with those of changed code: plans, studies, flights in space, jumps.

``python scripts/benchmark.py guard`` compares with ``benchmarks/guard.npz``; ``python benchmarks/guard.py`` freezes
what the code answers now. An answer is a status, an angular momentum, a value of the objective, and a digest of its
coefficients, bit for bit.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
import numpy.typing as npt
from many_section import family
from measuring import PROBLEMS, Counts, heading, table
from space_sections import CLASSES

import floatplan as fp
from floatplan.arrays import Array, IntArray
from floatplan.studies.file import load_study_file

FROZEN = Path(__file__).with_name("guard.npz")
SEEDS = (0, 1, 2)  # of each problem file
PLAIN = {2: 7000, 5: 2500, 10: 500}  # [-] rows without limits, by joints
STUDIES = ("pole", "weak_motors")
IN_SPACE = 200  # [-] problems of each class
PLANS_FOR_A_JUMP = 20  # [-] which take about as long: where fewer of each set are compared, so many fewer jumps are
SAME = 1e-6  # [-] relative difference of objectives that is none
SOLVED = ("optimal", "feasible")


@dataclass(frozen=True, eq=False)
class Answers:
    """What N problems are answered with.

    Attributes
    ----------
    problem : (N,) of str
        Names: a file and a seed, or the number in its set.
    status : (N,) of str
    momentum : (N, 3) kg m^2/s; in a plane the first alone
    objective : (N,)
    digest : (N,) uint64, of the coefficients
    seconds : of the processor, for all of them
    """

    problem: npt.NDArray[np.str_]
    status: npt.NDArray[np.str_]
    momentum: Array
    objective: Array
    digest: npt.NDArray[np.uint64]
    seconds: float

    def of(self, rows: IntArray) -> Answers:
        """Those to some of the problems; their time is a share of all."""
        return Answers(
            problem=self.problem[rows],
            status=self.status[rows],
            momentum=self.momentum[rows],
            objective=self.objective[rows],
            digest=self.digest[rows],
            seconds=self.seconds * len(rows) / len(self.problem),
        )


def _digest(coefficients: Array) -> int:
    """Eight bytes that tell coefficients apart; those that are missing count as none."""
    known = coefficients[np.isfinite(coefficients)]
    return int.from_bytes(hashlib.sha256(known.tobytes()).digest()[:8], "big")


def _of_plans(problems: Sequence[str], plans: Sequence[fp.Plan], seconds: float) -> Answers:
    momentum = np.zeros((len(plans), 3))
    for row, plan in zip(momentum, plans, strict=True):
        of_plan = np.atleast_1d(plan.angular_momentum)
        row[: len(of_plan)] = of_plan
    return Answers(
        problem=np.array(problems),
        status=np.array([plan.status for plan in plans]),
        momentum=momentum,
        objective=np.array([plan.objective_value for plan in plans], dtype=np.float64),
        digest=np.array([_digest(plan.coefficients) for plan in plans], dtype=np.uint64),
        seconds=seconds,
    )


def _planned(problems: Iterator[tuple[str, fp.Problem, int]]) -> Answers:
    """Plan problems one by one, each by its name and with its seed."""
    names = list[str]()
    plans = list[fp.Plan]()
    seconds = 0.0
    for name, problem, seed in problems:
        began = time.process_time()
        plans.append(fp.plan(problem, seed=seed))
        seconds += time.process_time() - began
        names.append(name)
    return _of_plans(names, plans, seconds)


def _of_batch(flights: fp.Family) -> Answers:
    began = time.process_time()
    plans = fp.plan_many(flights)
    seconds = time.process_time() - began
    momentum = np.zeros((len(flights), 3))
    momentum[:, 0] = plans.angular_momentum
    digests = np.array([_digest(row) for row in plans.coefficients], dtype=np.uint64)
    return Answers(
        problem=np.arange(len(flights)).astype(str),
        status=plans.status,
        momentum=momentum,
        objective=plans.objective,
        digest=digests,
        seconds=seconds,
    )


def problem_files() -> list[Path]:
    """Files of problems, those of jumps as the flights that they are, in their order."""
    return sorted(path for path in PROBLEMS.rglob("*.toml") if path.parent.name != "studies")


def _files(count: int) -> Answers:
    files = ((_name(path), fp.load_problem(path), seed) for path in problem_files() for seed in SEEDS)
    return _planned((f"{name}, seed {seed}", problem, seed) for name, problem, seed in islice(files, count))


def _name(path: Path) -> str:
    """Name of a problem file, by its folder."""
    return path.relative_to(PROBLEMS).with_suffix("").as_posix()


def _study(name: str) -> Callable[[int], Answers]:
    def answers(count: int) -> Answers:
        study = load_study_file(PROBLEMS / "studies" / f"{name}.toml")
        return _of_batch(study.family(0, min(count, len(study))))

    return answers


def _plain(joints: int) -> Callable[[int], Answers]:
    def answers(count: int) -> Answers:
        return _of_batch(family(joints, PLAIN[joints], seed=11)[: min(count, PLAIN[joints])])

    return answers


def _space(draw: Callable[[int], Iterator[fp.Problem]]) -> Callable[[int], Answers]:
    def answers(count: int) -> Answers:
        return _planned((str(number), problem, 0) for number, problem in enumerate(draw(min(count, IN_SPACE))))

    return answers


def _jumps(count: int) -> Answers:
    """Whole jumps, as their flights are planned; what is not found has no coefficients."""
    found, seconds = list[fp.Jump](), 0.0
    paths = sorted((PROBLEMS / "jumps").glob("*.toml"))[: max(count // PLANS_FOR_A_JUMP, 1)]
    for path in paths:
        began = time.process_time()
        found.append(fp.jump(path, starts=1))
        seconds += time.process_time() - began
    flights = [jump.flight for jump in found]
    momentum = np.zeros((len(found), 3))
    momentum[:, 0] = [flight.angular_momentum if flight else np.nan for flight in flights]
    return Answers(
        problem=np.array([_name(path) for path in paths]),
        status=np.array([jump.status if jump.ok else "not_found" for jump in found]),
        momentum=momentum,
        objective=np.array([flight.objective_value if flight else np.nan for flight in flights]),
        digest=np.array([_digest(flight.coefficients) if flight else 0 for flight in flights], dtype=np.uint64),
        seconds=seconds,
    )


SETS: dict[str, Callable[[int], Answers]] = {
    "problem files, seeds 0 to 2": _files,
    **{f"study {name}": _study(name) for name in STUDIES},
    **{f"plain, {joints} joints": _plain(joints) for joints in PLAIN},
    **{f"space: {name}": _space(draw) for name, draw in CLASSES.items()},
    "jumps": _jumps,
}


def freeze() -> None:
    """Write what the code answers now."""
    arrays: dict[str, npt.NDArray[np.generic]] = {}
    for name, answers in SETS.items():
        of_set = answers(10**9)
        for key, values in vars(of_set).items():
            arrays[f"{name}/{key}"] = np.asarray(values)
        print(f"{name}: {len(of_set.status)} in {of_set.seconds:.1f} s of the processor", flush=True)
    np.savez_compressed(FROZEN, **arrays)  # type: ignore[arg-type]  # NumPy's stub wants a keyword's type


def guard(counts: Counts) -> None:
    """How far answers are those that were frozen; the times beside them are of another run, maybe another machine.

    Problems are compared by their names; those that were not there when it was frozen are counted.
    """
    heading(f"guard: answers against {FROZEN.name}; objectives are the same to {SAME:g}")
    rows = list[list[object]]()
    with np.load(FROZEN) as frozen:
        for name, answers in SETS.items():
            keys = Answers.__dataclass_fields__
            before = Answers(**{key: frozen[f"{name}/{key}"] for key in keys})
            now = answers(counts.guarded)
            _, of_before, of_now = np.intersect1d(before.problem, now.problem, return_indices=True)
            new = len(now.problem) - len(of_now)
            rows.append([name, new, *_compared(before.of(of_before), now.of(of_now))])
    header = [
        "",
        "not frozen",
        "of",
        "status differs",
        "lost",
        "won",
        "bits differ",
        "worse",
        "better",
        "most worse",
        "s",
        "s then",
    ]
    table(header, rows)


def _compared(before: Answers, now: Answers) -> list[object]:
    solved_before = np.isin(before.status, SOLVED) | (before.status == "found")
    solved_now = np.isin(now.status, SOLVED) | (now.status == "found")
    both = solved_before & solved_now
    change = (now.objective[both] - before.objective[both]) / np.maximum(np.abs(before.objective[both]), SAME)
    return [
        len(now.status),
        int((before.status != now.status).sum()),
        int((solved_before & ~solved_now).sum()),
        int((~solved_before & solved_now).sum()),
        int((before.digest != now.digest).sum()),
        int((change > SAME).sum()),
        int((change < -SAME).sum()),
        f"{change.max(initial=0.0):.1e}",
        f"{now.seconds:.1f}",
        f"{float(before.seconds):.1f}",
    ]


if __name__ == "__main__":
    freeze()
