"""Planning with proof: where a plan misses its proof by a hair, planner and certificate close the gap together.

The search is given a problem that is tighter by what was missing, begins where it ended, and the new motion is proved
against the problem that was asked. The plan's record holds the latter alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from floatplan.arrays import Array, read_only
from floatplan.certificate.certificate import Certificate
from floatplan.certificate.certify import certify
from floatplan.certificate.findings import Finding
from floatplan.planning.planner import Planned, alternatives, planned, polished
from floatplan.plans.plan import Plan
from floatplan.problem.parts import Motor
from floatplan.problem.problem import Problem
from floatplan.tables import JOINT_LIMITS

ROUNDS = 3
BEYOND = 1.5  # times the missing amount is what the problem is tightened by
HAIR = 1e-3  # of a limit, m or rad: what misses its proof by more is refused, not mended
CONSEQUENCE = "landing.height"  # is missed where the orientation is, and met again with it
VERDICTS = ("proved", "undecided", "refuted")  # from the best on
CLAIM = "recorded "  # begins the labels of what the file itself claims
OBSTACLE = "obstacles["


def plan_and_prove(
    problem: Problem,
    *,
    seed: int = 0,
    starts: int = 1,
    budget: float | None = None,
    jobs: int = 1,
    progress: Callable[[str], None] | None = None,
) -> Plan:
    """Plan a flight and prove the plan; parameters as those of :func:`floatplan.plan`.

    Where the best motion found is not proved, the next best is tried.

    Returns
    -------
    Plan
        Its ``certificate`` is None where no plan was found. ``ok`` is False where none was found, or the one found was
        refuted; a plan that the certificate cannot decide stays ``ok``; ``explanation`` says what is not proved.
    """
    found = planned(problem, seed=seed, starts=starts, budget=budget, jobs=jobs, progress=progress)
    if not found.plan.ok:
        return found.plan
    return judged(*best_proved(found))


def best_proved(found: Planned) -> tuple[Plan, Certificate]:
    """Prove the best plan, or the next best where that is not proved; what is proved goes before what is undecided.

    The best plan proved may have lost by being mended: then the next best ones may be better still.
    """
    plan, certificate = proved(found)
    for other in alternatives(found):
        if certificate.proved and plan.objective_value <= other.best.objective_value:
            break
        answer = proved(other)
        plan, certificate = min((plan, certificate), answer, key=_rank)
    return plan, certificate


def _rank(answer: tuple[Plan, Certificate]) -> tuple[int, float]:
    plan, certificate = answer
    return VERDICTS.index(certificate.verdict), plan.objective_value


def proved(found: Planned) -> tuple[Plan, Certificate]:
    """Prove a plan, mending it where little is missing; the best plan and its certificate."""
    asked = tighter = found.plan.problem
    plan, certificate = _claims_proved(found.plan, certify(found.plan))
    for _ in range(ROUNDS):
        if certificate.proved:
            break
        missing = shortfalls(certificate)
        mended = None
        if missing is not None:
            tighter = tightened(tighter, missing, asked.final.orientation - sum(certificate.orientation_end) / 2)
            mended = polished(found, tighter)
        if mended is None:
            break
        found = mended
        plan, certificate = _claims_proved(found.plan, certify(found.plan))
    return plan, certificate


def judged(plan: Plan, certificate: Certificate) -> Plan:
    """Return the plan with its certificate, and with what that means for its being one."""
    record = plan.record.with_checks(certificate=certificate.to_dict())
    failed = [finding for finding in certificate.findings if finding.verdict == certificate.verdict]
    if certificate.proved:
        return plan.with_record(replace(record, explanation="Everything is proved to hold at all times."))
    said = "; ".join(_sentence(finding) for finding in failed)
    if certificate.verdict == "refuted":
        return plan.with_record(replace(record, ok=False, status="infeasible", explanation=f"Refuted: {said}."))
    return plan.with_record(replace(record, explanation=f"{plan.explanation} Not proved: {said}."))


def shortfalls(certificate: Certificate) -> dict[str, float] | None:
    """What each finding that is not proved lacks, by label; None where one lacks much, or the search cannot mend it."""
    missing = {}
    for finding in certificate.findings:
        if finding.verdict == "proved" or finding.label.startswith((CLAIM, CONSEQUENCE)):
            continue
        if finding.bound is None or finding.limit is None or not finding.label.startswith(_MENDED):
            return None
        lacking = abs(finding.bound - finding.limit)
        scale = finding.limit if finding.label.startswith(_RELATIVE) else 1.0
        if not lacking <= HAIR * scale:
            return None
        missing[finding.label] = lacking
    return missing or None


_OF_JOINTS = tuple(f"{row.key} " for row in JOINT_LIMITS)
_RELATIVE = (*_OF_JOINTS, "torque ", "generalized_torque ", "motor ", "orientation_rate")
_MENDED = (*_RELATIVE, OBSTACLE, "self_clearance ", "goal.orientation")


def tightened(problem: Problem, missing: Mapping[str, float], turn: float) -> Problem:
    """Return the problem with limits and margins tighter by what is missing, and the goal shifted by ``turn``, rad."""
    more = {label: BEYOND * value for label, value in missing.items()}
    robot, limits = problem.robot, problem.limits

    def less(kind: str, names: Sequence[str], values: Array) -> dict[str, float]:
        return {name: value - more.get(f"{kind} {name}", 0.0) for name, value in zip(names, values, strict=True)}

    torque: Any = less("torque", robot.motors, problem.motor_torque_limits)
    if not np.isfinite(problem.motor_torque_limits).any():
        torque = list(less("generalized_torque", robot.joints, problem.torque_limits).values())
    of_joints: dict[str, Any] = {
        key: list(less(key, robot.joints, values).values()) for key, values in problem.joint_limits.items()
    }
    rate = limits.orientation_rate
    return replace(
        problem,
        goal=replace(
            problem.goal, orientation=problem.goal.orientation + (turn if "goal.orientation" in missing else 0.0)
        ),
        limits=replace(
            limits,
            **of_joints,
            torque=torque,
            motor={
                name: Motor(stall, slope)
                for (name, stall), slope in zip(
                    less("motor", robot.motors, problem.motor_stall).items(), problem.motor_slope, strict=True
                )
                if math.isfinite(stall)
            },
            orientation_rate=None if rate is None else rate - more.get("orientation_rate", 0.0),
        ),
        obstacles=tuple(
            replace(obstacle, margin=obstacle.margin + more.get(f"{OBSTACLE}{index}] {obstacle.kind}", 0.0))
            for index, obstacle in enumerate(problem.obstacles)
        ),
        self_clearances=tuple(
            replace(pair, margin=pair.margin + more.get(f"self_clearance {pair.links[0]} {pair.links[1]}", 0.0))
            for pair in problem.self_clearances
        ),
    )


def _claims_proved(plan: Plan, certificate: Certificate) -> tuple[Plan, Certificate]:
    """Where the record's own claims alone are not proved, claim what was proved, and have that proved."""
    failed = [finding for finding in certificate.findings if finding.verdict != "proved"]
    if not failed or not all(finding.label.startswith(CLAIM) for finding in failed):
        return plan, certificate
    record = plan.record
    claims = replace(
        record,
        torque_peak=read_only(certificate.torque_peak),
        velocity_peak=read_only(certificate.velocity_peak),
        clearance_min=certificate.clearance_min,
        orientation={**record.orientation, "end": sum(certificate.orientation_end) / 2},
    )
    if not np.isfinite([*claims.torque_peak, *claims.velocity_peak, claims.clearance_min or 0.0]).all():
        return plan, certificate
    corrected = plan.with_record(claims)
    return corrected, certify(corrected)


def _sentence(finding: Finding) -> str:
    at = "" if finding.instant is None else f" at {finding.instant:.4g} s"
    against = "" if finding.limit is None else f" against {finding.limit:.6g}"
    value = "unbounded" if finding.bound is None or not math.isfinite(finding.bound) else f"{finding.bound:.6g}"
    return f"{finding.label} {value}{against}{at}"
