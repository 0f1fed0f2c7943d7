"""Planning with proof: where a plan misses its proof by little, planner and certificate close the gap together.

A search of a problem that is tighter by the shortfall begins where the first one ended, and the new motion is proved
against the problem as it was. The plan's record holds the latter only.
"""

import logging
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np

from floatplan.arrays import Array, read_only
from floatplan.certificate.certificate import certify
from floatplan.kernel.tolerances import EXCHANGE
from floatplan.planning.options import SearchOptions
from floatplan.planning.result import AttemptResult, SearchedPlan
from floatplan.planning.search import Search
from floatplan.planning.spec import FlightSpec
from floatplan.planning.variables import Start
from floatplan.plans.plan import Plan
from floatplan.plans.verdicts import Certificate, Finding, Kind, Subject
from floatplan.pool import one_thread
from floatplan.problem.parts import Motor
from floatplan.problem.problem import Problem
from floatplan.tables import LIMIT_TABLE

LOG = logging.getLogger(__name__)
RELATIVE: tuple[Kind, ...] = (*LIMIT_TABLE, "generalized_torque", "motor")
ORIENTATION: tuple[Kind, Subject] = ("goal", ("orientation",))
Shortfalls: TypeAlias = Mapping[tuple[Kind, Subject], float]


@one_thread
def proved_plan(searched: SearchedPlan) -> Plan:
    """Prove the plan of a search, or the next best one, and return it with its certificate.

    What is proved goes before what is undecided.

    Returns
    -------
    Plan
        Its ``certificate`` is None where no plan was found. ``ok`` is False where none was found, or the one found was
        refuted; a plan that the certificate cannot decide stays ``ok``; ``explanation`` says what is not proved.
    """
    if not searched.plan.ok:
        return searched.plan
    plan, certificate = proved(searched)
    LOG.info("proof: %s, %d intervals of time", certificate.verdict, certificate.subintervals)
    if any(finding.kind == "robot" for finding in certificate.findings):
        return judged(plan, certificate)  # whatever it does, the certificate does not read what moves
    for other in alternatives(
        searched
    ):  # a plan proved may have lost by being corrected: then these may be better still
        if certificate.proved and plan.objective_value <= other.best.objective_value:
            break
        answers = (plan, certificate), proved(other)
        verdicts = ("proved", "undecided", "refuted")  # the best first
        plan, certificate = min(answers, key=lambda one: (verdicts.index(one[1].verdict), one[0].objective_value))
    return judged(plan, certificate)


def proved(searched: SearchedPlan) -> tuple[Plan, Certificate]:
    """Prove a plan, correcting it where little is missing; the best plan and its certificate."""
    requested = tighter = searched.plan.problem
    plan, certificate = _claims_proved(searched.plan, certify(searched.plan))
    for _ in range(3):  # tightened problems at most
        if certificate.proved:
            break
        missing = shortfalls(certificate)
        corrected = None
        if missing is not None:
            LOG.info("proof: %s, tightened by the shortfalls of %d constraints", certificate.verdict, len(missing))
            rotation = 0.0
            if ORIENTATION in missing:
                rotation = requested.final.orientation - sum(certificate.orientation_end) / 2
            tighter = tightened(tighter, missing, rotation)
            corrected = polished(searched, tighter)
        if corrected is None:
            break
        searched = corrected
        plan, certificate = _claims_proved(searched.plan, certify(searched.plan))
    return plan, certificate


def alternatives(searched: SearchedPlan) -> Iterator[SearchedPlan]:
    """Yield the plans that the other solutions would make."""
    for result in searched.others or _other_solutions(searched):
        moved = searched.plan.moving_as(*result.motion, result.coefficients)
        yield SearchedPlan(replace(moved, status=result.status), result)


def _other_solutions(searched: SearchedPlan) -> tuple[AttemptResult, ...]:
    """Solutions worse than the best, of starts of one call of the kernel: now one by one."""
    solver = searched.plan.solver
    best = searched.best
    if not best.is_exhaustive or solver["solved"] < 2:
        return ()
    options = SearchOptions(solver["seed"], solver["solved"])
    again = Search(searched.plan.problem, options).run(solver["starts"])
    most = best.objective_value * (1 + EXCHANGE.same)
    return tuple(result for result in again.holding if result.objective_value > most)


def polished(searched: SearchedPlan, tighter: Problem) -> SearchedPlan | None:
    """Search from the motion of a plan for the nearest one that meets a tighter problem; None where there is none.

    The plan answers the problem that it answered before.
    """
    plan = searched.plan
    best = searched.best
    search = Search(tighter, SearchOptions(plan.solver["seed"]), FlightSpec(tighter, best.variables.momentum))
    result = search.follow(Start(best.variables, best.x, at_once=True))
    if not result.holds:
        return None
    more = {name: plan.solver[name] + getattr(result, name) for name in ("iterations", "evaluations")}
    return SearchedPlan(
        replace(plan.moving_as(*result.motion, result.coefficients), solver={**plan.solver, **more}), result
    )


def judged(plan: Plan, certificate: Certificate) -> Plan:
    """Return the plan with its certificate, and with what that means for its being one."""
    record = plan.record.with_checks(certificate=certificate.to_dict())
    failed = [finding for finding in certificate.findings if finding.verdict == certificate.verdict]
    if certificate.proved:
        sentence = "The flight is proved: all that is asked of it holds at all times."
        return plan.with_record(replace(record, explanation=sentence))
    sentence = "; ".join(map(_sentence, failed))
    if certificate.verdict == "refuted":
        return plan.with_record(replace(record, ok=False, status="infeasible", explanation=f"Refuted: {sentence}."))
    return plan.with_record(replace(record, explanation=f"{plan.explanation} Not proved: {sentence}."))


def shortfalls(certificate: Certificate) -> Shortfalls | None:
    """The shortfall of each finding that is not proved; None where one is large, or the search cannot correct it."""
    missing = {}
    for finding in certificate.unproved:
        if finding.kind in ("landing", "recorded"):  # hold again where what they follow from does
            continue
        is_goal = (finding.kind, finding.subject) == ORIENTATION
        correctable = finding.kind in (*RELATIVE, "obstacle", "self_clearance") or (
            is_goal and certificate.attitude_bound is None
        )
        if finding.bound is None or finding.limit is None or not correctable:
            return None
        shortfall = abs(finding.bound - finding.limit)
        scale = finding.limit if finding.kind in RELATIVE else 1.0
        if not shortfall <= 1e-3 * scale:  # of a limit, [m] or [rad]: beyond that a plan is refused, not corrected
            return None
        missing[finding.kind, finding.subject] = shortfall
    return missing or None


def tightened(problem: Problem, missing: Shortfalls, rotation: float) -> Problem:
    """Return the problem with limits and margins tighter by the shortfalls, and the goal ``rotation``, rad, further."""

    def more(kind: Kind, *subject: str | int) -> float:
        return 1.5 * missing.get((kind, subject), 0.0)

    def less(kind: Kind, names: Sequence[str], values: Array) -> dict[str, float]:
        tighter = {}
        for name, value in zip(names, values, strict=True):
            tighter[name] = value - more(kind, name)
        return tighter

    robot = problem.robot
    limits = problem.limits
    torque: Any = less("torque", robot.motors, problem.motor_torque_limits)
    if not np.isfinite(problem.motor_torque_limits).any():
        torque = list(less("generalized_torque", robot.joints, problem.torque_limits).values())
    of_joints: dict[str, Any] = {}
    for key, values in problem.joint_limits.items():
        of_joints[key] = list(less(key, robot.joints, values).values())
    motors = {}
    stalls = less("motor", robot.motors, problem.motor_stall)
    for (name, stall), slope in zip(stalls.items(), problem.motor_slope, strict=True):
        if math.isfinite(stall):
            motors[name] = Motor(stall, slope)
    obstacles = []
    for index, obstacle in enumerate(problem.obstacles):
        margin = obstacle.margin + more("obstacle", index, obstacle.kind)
        obstacles.append(replace(obstacle, margin=margin))
    pairs = []
    for pair in problem.self_clearances:
        margin = pair.margin + more("self_clearance", *pair.links)
        pairs.append(replace(pair, margin=margin))
    rate = limits.orientation_rate
    goal = problem.goal
    if ORIENTATION in missing:
        goal = replace(goal, orientation=goal.angle + rotation)
    return replace(
        problem,
        goal=goal,
        limits=replace(
            limits,
            **of_joints,
            torque=torque,
            motor=motors,
            orientation_rate=None if rate is None else rate - more("orientation_rate"),
        ),
        obstacles=tuple(obstacles),
        self_clearances=tuple(pairs),
    )


def _claims_proved(plan: Plan, certificate: Certificate) -> tuple[Plan, Certificate]:
    """Where nothing but the record's own claims is not proved, claim what was proved, and have that proved."""
    if {finding.kind for finding in certificate.unproved} != {"recorded"}:
        return plan, certificate
    record = plan.record
    end = {} if record.in_space else {"end": sum(certificate.orientation_end) / 2}
    claims = replace(
        record,
        torque_peak=read_only(certificate.torque_peak),
        velocity_peak=read_only(certificate.velocity_peak),
        clearance_min=certificate.clearance_min,
        orientation={**record.orientation, **end},
    )
    if not np.isfinite([*claims.torque_peak, *claims.velocity_peak, claims.clearance_min or 0.0]).all():
        return plan, certificate
    corrected = plan.with_record(claims)
    return corrected, certify(corrected)


def _sentence(finding: Finding) -> str:
    at = "" if finding.instant is None else f" at {finding.instant:.4g} s"
    against = "" if finding.limit is None else f" against {finding.limit:.6g}"
    value = "" if finding.bound is None else f" {finding.bound:.6g}" if math.isfinite(finding.bound) else " unbounded"
    return f"{finding.label}{value}{against}{at}"
