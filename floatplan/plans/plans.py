"""Many plans at once, as arrays; each a :class:`~floatplan.Plan` on access."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, overload

import numpy as np
import numpy.typing as npt

from floatplan.arguments import Outlined, html_table, short
from floatplan.arrays import Array, IntArray, read_only
from floatplan.errors import InputError
from floatplan.plans.plan import Plan
from floatplan.problem.problem import Problem

SOLVED = ("optimal", "feasible")
GOAL_MET = "The goal is met."
ALL_HOLDS = "Every constraint holds at all times."
NUMBERS = ("objective", "angular_momentum", "residual")
COUNTS = ("evaluations", "iterations", "starts", "solved")
MOST_SHOWN = 20  # [-] rows of the table that notebooks show
COLUMNS = ("status", "verdict", *NUMBERS, *COUNTS)  # what Plans has an array of, and a PlanEntry one of


@dataclass(frozen=True, eq=False)
class PlanEntry:
    """The result of one problem; as of :class:`Plans`, ``coefficients`` (n, k+1)."""

    status: str
    objective: float = np.nan
    angular_momentum: float = np.nan
    residual: float = np.nan
    coefficients: Array = field(default_factory=lambda: np.empty((0, 0)))
    evaluations: int = 0
    iterations: int = 0
    starts: int = 0
    solved: int = 0
    verdict: str = ""
    message: str = ""
    certificate: Mapping[str, Any] | None = None

    @classmethod
    def of_plan(cls, plan: Plan, status: str) -> PlanEntry:
        """Of a plan, with its certificate where it has one."""
        certificate = plan.certificate
        return cls(
            status=status,
            objective=plan.objective_value if plan.ok else np.nan,
            angular_momentum=plan.angular_momentum,
            residual=plan.whole.missed,
            coefficients=plan.coefficients,
            **{name: plan.solver[name] for name in COUNTS},
            verdict="" if certificate is None else certificate.verdict,
            message=plan.explanation,
            certificate=None if certificate is None else plan.record.certificate,  # a record is measured
        )

    def plan(self, problem: Problem, seed: int, seconds: float = np.nan) -> Plan:
        """Return the entry as a plan; ``seconds`` is what it took, NaN where that was not measured."""
        low, high = problem.position_limits.T
        ok = self.status in SOLVED and self.verdict != "refuted"
        plan = Plan(
            problem=problem,
            centre=read_only((low + high) / 2),
            amplitude=read_only((high - low) / 2),
            coefficients=read_only(self.coefficients),
            angular_momentum=self.angular_momentum,
            ballistics=problem.path,
            angular_momentum_bounds=problem.angular_momentum_bounds,
            status=self.status if ok else "infeasible",
            ok=ok,
            explanation=self.message or GOAL_MET,
            solver={
                "iterations": self.iterations,
                "evaluations": self.evaluations,
                "seconds": seconds,
                "seed": seed,
                "starts": self.starts,
                "solved": self.solved,
            },
        )
        if self.certificate is None:
            return plan
        return plan.with_record(plan.record.with_checks(certificate=self.certificate))


@dataclass(frozen=True, eq=False, repr=False)
class Plans(Outlined, Sequence[Plan]):
    """Answers to N problems, in their order: what :func:`floatplan.plan_many` returns.

    ``plans[i]`` is a :class:`~floatplan.Plan`, made on access; of a problem that is wrong it raises what is.

    Attributes
    ----------
    problems : sequence of N
    status : (N,) of str
        "optimal" or "feasible", where there is a plan; "not_found"; "impossible", where no motion whatever meets the
        problem; "error", where the problem is wrong.
    objective : (N,)
        Value of the problem's objective; NaN where there is no plan.
    angular_momentum : (N,) kg m^2/s
    residual : (N,) rad
        By how much the orientation at landing misses the goal, with twice as many nodes as the search had.
    coefficients : (N, n, k+1)
        b of (12), of the nearest motion where there is no plan; NaN where a problem has fewer joints, or a lower
        degree, than another, or is wrong.
    evaluations, iterations : (N,) int
        Motions evaluated, and iterations of the search.
    starts, solved : (N,) int
        Starts that were tried, and those that led to a plan.
    verdict : (N,) of str
        "proved", "undecided" or "refuted" with ``prove``; else empty.
    seed : int
    messages : index -> str
        Why there is no plan, where there is none.
    certificates : index -> what :meth:`~floatplan.Certificate.to_dict` gives
    """

    problems: Sequence[Problem]
    status: npt.NDArray[np.str_]
    objective: Array
    angular_momentum: Array
    residual: Array
    coefficients: Array
    evaluations: IntArray
    iterations: IntArray
    starts: IntArray
    solved: IntArray
    verdict: npt.NDArray[np.str_]
    seed: int = 0
    messages: dict[int, str] = field(default_factory=dict)
    certificates: dict[int, Mapping[str, Any]] = field(default_factory=dict)

    @classmethod
    def of(cls, problems: Sequence[Problem], joints: int, columns: int, seed: int) -> Plans:
        """Return arrays for plans of so many joints and coefficients, all of them "not_found" yet."""
        count = len(problems)
        arrays: dict[str, Any] = {name: np.full(count, np.nan) for name in NUMBERS}
        arrays |= {name: np.zeros(count, np.int64) for name in COUNTS}
        arrays |= {"status": np.full(count, "not_found", "<U10"), "verdict": np.full(count, "", "<U10")}
        return cls(problems, coefficients=np.full((count, joints, columns), np.nan), seed=seed, **arrays)

    def keep(self, index: int, entry: PlanEntry) -> None:
        """Store the entry of one problem."""
        for name in COLUMNS:
            getattr(self, name)[index] = getattr(entry, name)
        n, columns = entry.coefficients.shape
        missing = columns - self.coefficients.shape[2]
        if missing > 0:  # a degree that was raised
            wider = np.pad(self.coefficients, ((0, 0), (0, 0), (0, missing)), constant_values=np.nan)
            object.__setattr__(self, "coefficients", wider)
        self.coefficients[index] = np.nan
        self.coefficients[index, :n, :columns] = entry.coefficients
        self.messages.pop(index, None)
        if entry.message:
            self.messages[index] = entry.message
        if entry.certificate is not None:
            self.certificates[index] = entry.certificate

    def _repr_html_(self) -> str:
        """A table of the first plans, as notebooks show it."""
        statuses, counts = np.unique(self.status, return_counts=True)
        counted = ", ".join(f"{count} {status}" for status, count in zip(statuses, counts, strict=True))
        titles = ["problem", "status", "proof", "objective", "angular momentum, kg m²/s", ""]
        rows = []
        for index in range(min(len(self), MOST_SHOWN)):
            entry = self.answer(index)
            numbers = [short(number, 5) for number in (entry.objective, entry.angular_momentum)]
            rows.append([str(index), entry.status, entry.verdict, *numbers, entry.message])
        if len(self) > MOST_SHOWN:
            rows.append(["...", f"{len(self) - MOST_SHOWN} more", "", "", "", ""])
        return html_table(f"{len(self)} plans: {counted}", rows, titles)

    @property
    def ok(self) -> npt.NDArray[np.bool_]:
        """Whether (N,) there is a plan, and none that is refuted."""
        return np.asarray(np.isin(self.status, SOLVED) & (self.verdict != "refuted"))

    def __len__(self) -> int:
        return len(self.status)

    @overload
    def __getitem__(self, index: int) -> Plan: ...
    @overload
    def __getitem__(self, index: slice) -> list[Plan]: ...
    def __getitem__(self, index: int | slice) -> Plan | list[Plan]:
        if isinstance(index, slice):
            return [self[position] for position in range(*index.indices(len(self)))]
        index = range(len(self))[index]
        problem = self.problems[index]
        if self.status[index] == "error":
            raise InputError(self.messages[index], element=f"problem {index}")
        return self.answer(index).plan(problem, self.seed)

    def __iter__(self) -> Iterator[Plan]:
        return (self[index] for index in range(len(self)))

    def answer(self, index: int) -> PlanEntry:
        """Return the entry of one problem."""
        coefficients = self.coefficients[index]
        there = np.isfinite(coefficients)
        return PlanEntry(
            **{name: getattr(self, name)[index].item() for name in COLUMNS},
            coefficients=coefficients[there.any(axis=1)][:, there.any(axis=0)],
            message=self.messages.get(index, ""),
            certificate=self.certificates.get(index),
        )
