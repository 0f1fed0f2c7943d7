"""Rows of a study: planned, measured, and put into a table. A row depends on its index, and not on its chunk."""

import pickle
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from floatplan.arguments import without
from floatplan.arrays import Array, IntArray
from floatplan.certificate.certificate import certify
from floatplan.errors import FloatplanError, InputError, printable
from floatplan.jumps.check import RATE
from floatplan.jumps.planner import jump
from floatplan.planning.kernel_input.numbers import Numbers, is_batchable_family, is_unconstrained_family
from floatplan.planning.many import plan_batches
from floatplan.planning.options import SearchOptions
from floatplan.plans.measures import largest_use, limits_of_motors, momentum_in_one_number
from floatplan.plans.plans import GOAL_MET, SOLVED, PlanEntry, Plans
from floatplan.pool import one_thread
from floatplan.problem.family import Family
from floatplan.problem.problem import Problem
from floatplan.robot.robot import Robot
from floatplan.studies.file import OF_JUMPS, StudyFile, Values, versions
from floatplan.studies.folder import read_table, table_of, written
from floatplan.studies.peaks import ORDERS, ManyPeaks, can_measure, many_peaks
from floatplan.studies.schema import PlanTable
from floatplan.tables import LARGEST_SEED, OBJECTIVE_TABLE

STATUSES = (*SOLVED, "not_found", "impossible", "error")
LONGEST_EXPLANATION = 400  # [-] characters


@dataclass(frozen=True)
class PlannedChunk:
    """A chunk that is done: its rows as a Parquet file, and the seconds that they took."""

    content: bytes
    seconds: float


def packed(study: StudyFile) -> bytes:
    """A study as the processes that plan its rows need it: without the values of rows, which come with each chunk."""
    axes = [replace(axis, values=axis.values[:0]) for axis in study.samples.axes]
    return pickle.dumps((replace(study, samples=replace(study.samples, axes=axes)), versions()))


@lru_cache(maxsize=4)
def _unpacked(content: bytes) -> StudyFile:
    """The study, unpacked once in each process."""
    study: StudyFile
    study, own_versions = pickle.loads(content)
    if own_versions != versions():
        own = " ".join(versions().values())
        of_study = " ".join(own_versions.values())
        raise FloatplanError(f"a worker has {own}, the study {of_study}: install the same everywhere")
    return study


@one_thread
def planned_rows(content: bytes, first: int, values: Values) -> PlannedChunk:
    """Plan the rows that begin with ``first``, in any process on any machine; every error is a row's status."""
    start = time.perf_counter()
    study = _unpacked(content)
    problems = study.problems(values)
    columns = _planned(study, problems, first)
    return PlannedChunk(written(_table(study, first, values, columns)), time.perf_counter() - start)


def lost_row(content: bytes, index: int, values: Values, reason: str) -> PlannedChunk:
    """A row that ends the process which plans it, as a chunk."""
    return PlannedChunk(written(_unplanned(_unpacked(content), index, values, reason)), 0.0)


def row_seed(seed: int, index: int) -> int:
    """The seed of a row with a search of its own: of the study's and the row's index."""
    return int(np.random.SeedSequence((seed, index)).generate_state(1, np.uint64)[0]) & LARGEST_SEED


def _planned(study: StudyFile, problems: Family, first: int) -> dict[str, Any]:
    """Plan rows; an error of any kind, which no code foresaw, belongs to one row."""
    try:
        return (_planned_jumps if study.plan.jump else _planned_batch)(study, problems, first)
    except Exception as error:
        if len(problems) == 1:
            row = _row(study, PlanEntry("error", message=f"{type(error).__name__}: {error}"), np.nan)
            return {name: [value] for name, value in row.items()}
        middle = len(problems) // 2
        columns = _planned(study, problems[:middle], first)
        others = _planned(study, problems[middle:], first + middle)
        return {name: [*_as_list(columns[name]), *_as_list(others[name])] for name in columns}


def _as_list(values: Any) -> Any:
    return values.tolist() if isinstance(values, np.ndarray) else values


def _planned_batch(study: StudyFile, problems: Family, first: int) -> dict[str, Any]:
    """Plan rows in batches and measure them in blocks."""
    start = time.perf_counter()
    plan = study.plan
    seed = study.samples.seed
    options = SearchOptions(seed, starts=plan.starts, attempts=plan.attempts, near_miss=False)
    is_plain = is_unconstrained_family(problems)  # then one search is for all rows, with one seed

    def seeds(row: int) -> int:
        return seed if is_plain else row_seed(seed, first + row)

    plans = plan_batches(problems, options, seeds, plan.search, plan.prove)
    peaks, use, clearance = _measured(problems, plans, np.flatnonzero(plans.ok))
    spent = np.maximum(plans.evaluations, 1)
    milliseconds = 1e3 * (time.perf_counter() - start) * spent / spent.sum()
    shown = {text: printable(text, LONGEST_EXPLANATION) for text in {GOAL_MET, *plans.messages.values()}}
    explanation = np.full(len(plans), shown[GOAL_MET], dtype=object)
    for index, message in plans.messages.items():
        explanation[index] = shown[message]
    refuted = (plans.verdict == "refuted") & np.isin(plans.status, SOLVED)  # then it is no solution
    return {
        "status": np.where(refuted, "not_found", plans.status).tolist(),
        "objective": np.where(plans.ok, plans.objective, np.nan),
        "angular_momentum": plans.angular_momentum,
        "peaks": peaks,
        "utilisation": use,
        "clearance": clearance,
        "explanation": explanation,
        "starts": plans.starts,
        "milliseconds": milliseconds,
        "coefficients": plans.coefficients if np.isfinite(plans.coefficients).all() else _without_gaps(plans),
        "verdict": plans.verdict.tolist(),
    }


def _without_gaps(plans: Plans) -> list[list[list[float]] | None]:
    """Coefficients of each plan, of as many joints and powers as it has."""
    rows = []
    for index in range(len(plans)):
        b = plans.answer(index).coefficients
        rows.append(b.tolist() if b.size else None)
    return rows


def _measured(problems: Family, plans: Plans, rows: IntArray) -> tuple[Array, Array, Array]:
    """Peaks (N, m) of the motors' torques, utilisation (N,) of limits, and distances (N,) to obstacles, m.

    By the kernel where it can measure all of that.
    """
    base = problems.base
    peaks = np.full((len(plans), len(base.robot.motors)), np.nan)
    use = np.full(len(plans), np.nan)
    clearance = np.full(len(plans), np.nan)
    of: Problem | Sequence[Problem] | Numbers = base
    if is_batchable_family(problems):
        numbers = Numbers.of_family(problems, rows)
        of = numbers if numbers.obstacles else base
        durations = numbers.values["duration"]
        limits = limits_of_motors(numbers.limits or base)
    else:
        of = [problems[index] for index in rows.tolist()]
        durations = np.array([problem.flight.duration for problem in of])
        of_each = list(map(limits_of_motors, of))
        limits = {}
        for name in limits_of_motors(base):
            limits[name] = np.array([own[name] for own in of_each])
    limits = without(limits, [name for name, values in limits.items() if not np.isfinite(values).any()])
    by_kernel = base.robot.in_plane and limits.keys() <= {"torque", *ORDERS} and can_measure(base)
    if by_kernel and rows.size:
        orders = 0  # of the derivatives that have a limit
        for order, name in enumerate(ORDERS, start=1):
            if name in limits:
                orders = order
        measured = many_peaks(of, durations, plans.angular_momentum[rows], plans.coefficients[rows], orders)
        peaks[rows] = measured.motor_torque
        use[rows] = _use(base.robot, measured, limits)
        clearance[rows] = np.where(np.isfinite(measured.clearance), measured.clearance, np.nan)
        return peaks, use, clearance
    for index in rows.tolist():
        plan = replace(plans.answer(index), certificate=None).plan(problems[index], plans.seed)
        share = largest_use(plan.utilisation)
        peaks[index] = plan.peaks.motor_torque
        use[index] = np.nan if share is None else share
        clearance[index] = np.nan if plan.peaks.clearance is None else plan.peaks.clearance
    return peaks, use, clearance


def _use(robot: Robot, measured: ManyPeaks, limits: Mapping[str, Array]) -> Array:
    """The largest share (N,) of a limit, (m,) or (N, m), that a motor uses; NaN where none has a limit."""
    of_motors = {name: peaks @ np.abs(robot.motor_ratios).T for name, peaks in measured.joints.items()}
    of_motors["torque"] = measured.motor_torque
    most = np.zeros(len(measured.clearance))
    for name, values in limits.items():
        most = np.maximum(most, (of_motors[name] / values).max(axis=1, initial=0))
    return np.where(most > 0, most, np.nan)


def _planned_jumps(study: StudyFile, problems: Family, first: int) -> dict[str, Any]:
    """Plan a whole jump for each row."""
    rows = []
    for index in range(len(problems)):
        start = time.perf_counter()
        measured: dict[str, Any] = {}
        try:
            result, measured = _planned_jump(problems[index], row_seed(study.samples.seed, first + index), study.plan)
        except InputError as error:
            result = PlanEntry("error", message=str(error))
        rows.append(_row(study, result, 1e3 * (time.perf_counter() - start)) | measured)
    columns = {}
    for name in rows[0]:
        columns[name] = [row[name] for row in rows]
    return columns


def _planned_jump(problem: Problem, seed: int, plan: PlanTable) -> tuple[PlanEntry, dict[str, Any]]:
    """A whole jump, and measures of it 2000 times a second: the check's figures, and those of the motors."""
    binds_at_once = problem.robot.base == "free-flyer"  # limits that bind there take no other program
    planned = jump(problem, seed=seed, starts=plan.starts, helps=binds_at_once)
    if not planned.ok or planned.flight is None:
        return PlanEntry("not_found", starts=plan.starts, message=planned.explanation), {}
    verdict = certify(planned.flight).verdict if plan.prove else ""
    figures = planned.check.figures
    times = np.linspace(0.0, planned.duration, int(planned.duration * RATE) + 2)
    torques = planned.state(times).motor_torques
    result = PlanEntry(
        "feasible",
        objective=float(np.trapezoid((torques**2).sum(axis=1), times)),
        angular_momentum=momentum_in_one_number(planned.flight),
        starts=plan.starts,
        verdict=verdict,
        message=planned.explanation,
    )
    measured = {
        "objective": result.objective,
        "peaks": np.abs(torques).max(axis=0),
        "utilisation": max(figures["torque"], figures["torque_speed"], figures["velocity"]),
        "clearance": figures.get("obstacles", np.nan),
        "height": planned.height,
        "jump_duration": planned.duration,
        "friction_used": figures["friction"],
    }
    return result, measured


def _row(study: StudyFile, result: PlanEntry, milliseconds: float) -> dict[str, Any]:
    """A row of a result without measures."""
    return {
        "status": result.status,
        **dict.fromkeys(("objective", "utilisation", "clearance", *OF_JUMPS), np.nan),
        "angular_momentum": result.angular_momentum,
        "peaks": np.full(len(study.base.robot.motors), np.nan),
        "explanation": printable(result.message or GOAL_MET, LONGEST_EXPLANATION),
        "starts": result.starts,
        "milliseconds": milliseconds,
        "coefficients": None,
        "verdict": result.verdict,
    }


def _unplanned(study: StudyFile, index: int, values: Values, reason: str) -> Any:
    """The table of a row that was never planned."""
    row = _row(study, PlanEntry("error", message=reason), np.nan)
    return _table(study, index, values, {name: [value] for name, value in row.items()})


def _table(study: StudyFile, first: int, values: Values, results: Mapping[str, Any]) -> Any:
    """The rows as a table; missing numbers are null, and none is NaN."""

    def number(name: str) -> Array:
        return np.asarray(results[name], dtype=np.float64)

    motors = [f"torque_peak.{motor}" for motor in study.base.robot.motors]
    peaks = number("peaks").reshape(-1, len(motors))
    is_measured = np.isfinite(peaks).all(axis=1)
    columns = {
        "index": np.arange(first, first + len(peaks)),
        **values,
        "status": results["status"],
        "objective": number("objective"),
        "angular_momentum": number("angular_momentum"),
        "torque_peak": np.where(is_measured, peaks.max(axis=1, initial=-np.inf), np.nan),
        **dict(zip(motors, peaks.T, strict=True)),
        "utilisation": number("utilisation"),
        "clearance": number("clearance"),
        **{name: number(name) for name in OF_JUMPS if study.plan.jump},
        "explanation": results["explanation"],
        "starts": np.asarray(results["starts"], dtype=np.int32),
        "milliseconds": number("milliseconds"),
        "coefficients": results["coefficients"],
    }
    if study.plan.prove:
        columns["verdict"] = results["verdict"]
    units = {
        **study.units,
        **OF_JUMPS,
        "objective": OBJECTIVE_TABLE["torque" if study.plan.jump else study.base.motion.objective].unit,
        "angular_momentum": "kg m^2/s",
        **dict.fromkeys(("torque_peak", *motors), "N m"),
        "clearance": "m",
        "milliseconds": "ms",
        "coefficients": "rad/s^k",
    }
    return table_of(columns, units)


def row_check(study: StudyFile) -> Callable[[Any, int, int], bool]:
    """Return a function that tells whether a table has a range of rows and no others, in order, each with a status."""
    schema = read_table(written(_unplanned(study, 0, study.samples.values(0, 1), ""))).schema
    of_solved = ["objective"] if study.plan.jump else ["objective", "coefficients"]

    def are_in(table: Any, first: int, stop: int) -> bool:
        if not table.schema.equals(schema, check_metadata=True) or len(table) != stop - first:
            return False
        expected = {"index": np.arange(first, stop), **study.samples.values(first, stop)}
        for name, values in expected.items():
            if table[name].null_count or not np.array_equal(table[name].to_numpy(), values):
                return False
        allowed: dict[str, tuple[str, ...]] = {"status": STATUSES}
        if "verdict" in table.column_names:
            allowed["verdict"] = ("", "proved", "undecided", "refuted")
        for name, words in allowed.items():
            if table[name].null_count or not np.isin(table[name].to_numpy(), words).all():
                return False
        solved = table.filter(np.isin(table["status"].to_numpy(), SOLVED))
        if any(solved[name].null_count for name in of_solved):
            return False
        return not (table["explanation"].null_count or table["starts"].null_count)

    return are_in
