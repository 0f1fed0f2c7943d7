"""Rows of a study: planned, measured, and put into a table. It depends on its index what a row is, not on its chunk."""

from __future__ import annotations

import pickle
import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from floatplan.arguments import LARGEST_SEED
from floatplan.arrays import Array, IntArray
from floatplan.errors import FloatplanError, printable
from floatplan.kernel.peaks import many_peaks
from floatplan.kernel.rows import is_plain_family
from floatplan.planning.many import plan_many
from floatplan.plans.measures import Utilisation
from floatplan.plans.plans import GOAL_MET, SOLVED, Answer, Plans
from floatplan.pool.threads import one_thread
from floatplan.problem.family import Family
from floatplan.problem.problem import Problem
from floatplan.studies.columns import arrow, as_column, chosen, read_table, taken, written
from floatplan.studies.file import StudyFile, family, versions
from floatplan.studies.sampling import Values
from floatplan.tables import OBJECTIVE_TABLE

STATUSES = (*SOLVED, "not_found", "impossible", "error")
VERDICTS = ("", "proved", "undecided", "refuted")
LONGEST_EXPLANATION = 400  # characters


@dataclass(frozen=True, eq=False)
class Work:
    """What is the same for all rows: the base problem, how to plan, and by whom."""

    base: Problem
    factors: Mapping[str, float]
    units: Mapping[str, str]
    starts: int
    seed: int
    search: bool
    prove: bool
    versions: Mapping[str, str]

    @classmethod
    def of(cls, study: StudyFile) -> Work:
        """Of a study as asked for."""
        plan = study.plan
        return cls(
            study.base, study.factors, study.units, plan.starts, study.samples.seed, plan.search, plan.prove, versions()
        )


@dataclass(frozen=True)
class Planned:
    """A chunk that is done: its rows as a Parquet file, and the seconds that they took."""

    content: bytes
    seconds: float


@lru_cache(maxsize=4)
def _unpacked(work: bytes) -> Work:
    """The work, unpacked once in each process."""
    unpacked: Work = pickle.loads(work)
    if unpacked.versions != versions():
        here, there = (" ".join(each.values()) for each in (versions(), unpacked.versions))
        raise FloatplanError(f"a worker has {here}, the study {there}: install the same everywhere")
    return unpacked


@one_thread
def planned_rows(packed: bytes, first: int, values: Values) -> Planned:
    """Plan the rows that begin with ``first``, in any process on any machine; whatever is wrong is a row's status."""
    began = time.perf_counter()
    work = _unpacked(packed)
    problems = family(work.base, work.factors, values)
    columns = _together(work, problems) if is_plain_family(problems) else None
    if columns is None:
        columns = _one_by_one(work, problems, first)
    content = written(_table(work, first, values, columns))
    return Planned(content, time.perf_counter() - began)


@dataclass(eq=False)
class _Columns:
    """What was found of N rows; ``peaks`` (N, m) N m, words as pyarrow's arrays, ``verdict`` None without proofs.

    ``coefficients`` are (N, n, k+1), NaN where there is none; or a list (n) of lists for each, or None.
    """

    status: Any
    objective: Array
    angular_momentum: Array
    peaks: Array
    utilisation: Array
    clearance: Array
    explanation: Any
    starts: IntArray
    milliseconds: Array
    coefficients: list[list[list[float]] | None] | Array
    verdict: Any


def _together(work: Work, problems: Family) -> _Columns | None:
    """Plan rows in one batch and measure them in blocks; None where that fails, so that the bad row is to be found."""
    began = time.perf_counter()
    try:
        plans = plan_many(problems, starts=work.starts, search=work.search, prove=work.prove, seed=work.seed)
        found = np.flatnonzero(plans.ok)
        peaks, use = _measured_together(problems, plans, found)
    except Exception:
        return None
    spent = np.maximum(plans.evaluations, 1)
    milliseconds = 1e3 * (time.perf_counter() - began) * spent / spent.sum()
    return _Columns(
        status=_statuses(plans),
        objective=np.where(plans.ok, plans.objective, np.nan),
        angular_momentum=plans.angular_momentum,
        peaks=peaks,
        utilisation=use,
        clearance=np.full(len(plans), np.nan),
        explanation=_explanations(plans),
        starts=plans.starts,
        milliseconds=milliseconds,
        coefficients=plans.coefficients,
        verdict=chosen(VERDICTS, plans.verdict) if work.prove else None,
    )


def _measured_together(problems: Family, plans: Plans, found: IntArray) -> tuple[Array, Array]:
    """Peaks (N, m) of the motors' torques and utilisation (N,) of the URDF's limits: a plain problem has no others."""
    base = problems.base
    peaks, use = np.full((len(plans), len(base.robot.motors)), np.nan), np.full(len(plans), np.nan)
    if not found.size:
        return peaks, use
    velocity_limits = np.asarray(base.robot.motor_velocity_limits)
    limits_rates = bool(np.isfinite(velocity_limits).any())
    duration = problems.arrays.get("flight.duration", np.full(len(plans), base.flight.duration))
    measured = many_peaks(
        base, duration[found], plans.angular_momentum[found], plans.coefficients[found], velocities=limits_rates
    )
    peaks[found] = measured.motor_torque
    shares = [measured.motor_torque / base.robot.motor_torque_limits]
    if measured.velocity is not None:
        of_motors = measured.velocity @ np.abs(base.robot.motor_ratios).T
        shares.append(of_motors / velocity_limits)
    most = np.concatenate(shares, axis=1).max(axis=1)
    use[found] = np.where(most > 0, most, np.nan)
    return peaks, use


def _one_by_one(work: Work, problems: Family, first: int) -> _Columns:
    """Plan rows by the whole search, each with a seed of its own; an error of any kind is the row's alone."""
    pa, _ = arrow()
    rows = [_alone(work, problems[index : index + 1], first + index) for index in range(len(problems))]
    peaks = [peaks for _, peaks, _ in rows]
    answers = [answer for answer, _, _ in rows]
    missing = np.full(len(work.base.robot.motors), np.nan)

    def measured(name: str) -> Array:
        return np.array([getattr(peak, name) if peak else np.nan for peak in peaks], dtype=np.float64)

    return _Columns(
        status=pa.array([_status(answer) for answer in answers]),
        objective=np.array([answer.objective if peak else np.nan for answer, peak, _ in rows]),
        angular_momentum=np.array([answer.angular_momentum for answer in answers]),
        peaks=np.array([peak.torque if peak else missing for peak in peaks]).reshape(len(rows), len(missing)),
        utilisation=measured("utilisation"),
        clearance=measured("clearance"),
        explanation=pa.array([printable(answer.message or GOAL_MET, LONGEST_EXPLANATION) for answer in answers]),
        starts=np.array([answer.starts for answer in answers]),
        milliseconds=np.array([milliseconds for _, _, milliseconds in rows]),
        coefficients=[answer.coefficients.tolist() if answer.coefficients.size else None for answer in answers],
        verdict=pa.array([answer.verdict for answer in answers]),
    )


@dataclass(frozen=True, eq=False)
class _Peaks:
    """Of one plan: torques (m,) N m; utilisation; clearance, m; NaN where there is none."""

    torque: Array
    utilisation: float
    clearance: float


def _alone(work: Work, problem: Family, index: int) -> tuple[Answer, _Peaks | None, float]:
    """Plan one row: the answer, what was measured where a plan was found, and the milliseconds it took."""
    began = time.perf_counter()
    measured = None
    try:
        plans = plan_many(
            problem, starts=work.starts, search=work.search, prove=work.prove, seed=row_seed(work.seed, index)
        )
        answer = plans.answer(0)
        if plans.ok[0]:
            measured = _measured(plans)
    except Exception as error:  # a row that no code foresaw loses no other
        answer = Answer("error", message=f"{type(error).__name__}: {error}")
    return answer, measured, 1e3 * (time.perf_counter() - began)


def _measured(plans: Plans) -> _Peaks:
    plan = plans[0]
    peaks = plan.peaks
    used = [_used(use) for use in plan.utilisation]
    clearance = np.nan if peaks.clearance is None else peaks.clearance
    return _Peaks(peaks.motor_torque, max((use for use in used if use is not None), default=np.nan), clearance)


def _used(use: Utilisation) -> float | None:
    """The largest share of a limit, None where a motor has no limit."""
    return use.worst if any(getattr(use, f"{key}_limit") for key in ("torque", "velocity", "acceleration")) else None


def row_seed(seed: int, index: int) -> int:
    """The seed of a row that has a search of its own: of the study's and the row's index."""
    return int(np.random.SeedSequence((seed, index)).generate_state(1, np.uint64)[0]) & LARGEST_SEED


def _statuses(plans: Plans) -> Any:
    refuted = plans.verdict == "refuted"
    return chosen(STATUSES, np.where(refuted & np.isin(plans.status, SOLVED), "not_found", plans.status))


def _explanations(plans: Plans) -> Any:
    """Explanations of N rows: few differ."""
    numbers = {GOAL_MET: 0}
    which = np.zeros(len(plans), dtype=np.int64)
    for index, message in plans.messages.items():
        which[index] = numbers.setdefault(message, len(numbers))
    return taken([printable(each, LONGEST_EXPLANATION) for each in numbers], which)


def _status(answer: Answer) -> str:
    """A plan that its proof refutes was not found."""
    return "not_found" if answer.verdict == "refuted" and answer.status in SOLVED else answer.status


def lost_row(work: bytes, index: int, values: Values, reason: str) -> Planned:
    """A row that ends the process which plans it, as a chunk."""
    unpacked = _unpacked(work)
    return Planned(written(_table(unpacked, index, values, _nothing(unpacked, reason))), 0.0)


def _nothing(work: Work, reason: str) -> _Columns:
    """What is known of a row that was never planned."""
    pa, _ = arrow()
    return _Columns(
        status=pa.array(["error"]),
        **{name: np.full(1, np.nan) for name in ("objective", "angular_momentum", "utilisation", "clearance")},
        peaks=np.full((1, len(work.base.robot.motors)), np.nan),
        explanation=pa.array([reason]),
        starts=np.zeros(1, dtype=np.int64),
        milliseconds=np.full(1, np.nan),
        coefficients=[None],
        verdict=pa.array([""]),
    )


class Rows:
    """What chunks of a study must hold."""

    def __init__(self, study: StudyFile) -> None:
        self._samples, work = study.samples, Work.of(study)
        one = _table(work, 0, self._samples.values(0, 1), _nothing(work, ""))
        self._schema = read_table(written(one)).schema

    def are_in(self, table: Any, first: int, stop: int) -> bool:
        """Whether a table holds these rows and no others, in their order, each with a status that there is."""
        if not table.schema.equals(self._schema, check_metadata=True) or len(table) != stop - first:
            return False
        given = {"index": np.arange(first, stop), **self._samples.values(first, stop)}
        said = {"status": STATUSES, **({"verdict": VERDICTS} if "verdict" in table.column_names else {})}
        never_missing = [*given, *said, "explanation", "starts"]
        if any(table[name].null_count for name in never_missing):
            return False
        solved = table.filter(np.isin(table["status"].to_numpy(), SOLVED))
        return (
            not any(solved[name].null_count for name in ("objective", "coefficients"))
            and all(np.array_equal(table[name].to_numpy(), values) for name, values in given.items())
            and all(np.isin(table[name].to_numpy(), words).all() for name, words in said.items())
        )


def _table(work: Work, first: int, values: Values, columns: _Columns) -> Any:
    """The rows as a pyarrow table; no number is NaN: what there is not is null."""
    pa, _ = arrow()
    count = len(columns.status)
    objective = OBJECTIVE_TABLE[work.base.motion.objective].unit
    number = pa.float64()
    there = np.isfinite(columns.peaks).all(axis=1)
    largest = np.where(there, columns.peaks.max(axis=1, initial=-np.inf), np.nan)
    given: list[tuple[str, Any, Any, str]] = [("index", np.arange(first, first + count), pa.int64(), "")]
    given += [(path, column, None, work.units[path]) for path, column in values.items()]
    given += [
        ("status", columns.status, None, ""),
        ("objective", columns.objective, number, objective),
        ("angular_momentum", columns.angular_momentum, number, "kg m^2/s"),
        ("torque_peak", largest, number, "N m"),
    ]
    motors = zip(work.base.robot.motors, columns.peaks.T, strict=True)
    given += [(f"torque_peak.{motor}", column, number, "N m") for motor, column in motors]
    given += [
        ("utilisation", columns.utilisation, number, ""),
        ("clearance", columns.clearance, number, "m"),
        ("explanation", columns.explanation, None, ""),
        ("starts", columns.starts, pa.int32(), ""),
        ("milliseconds", columns.milliseconds, number, "ms"),
        ("coefficients", columns.coefficients, pa.list_(pa.list_(number)), "rad/s^k"),
    ]
    if work.prove:
        given.append(("verdict", columns.verdict, None, ""))
    arrays = [as_column(pa, values, kind) for _, values, kind, _ in given]
    fields = [
        pa.field(name, array.type, metadata={"unit": unit} if unit else None)
        for (name, _, _, unit), array in zip(given, arrays, strict=True)
    ]
    return pa.Table.from_arrays(arrays, schema=pa.schema(fields))
