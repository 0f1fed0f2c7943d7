"""Tables of the report: the problem, the result, and what is proved of it. Plain text; the page escapes it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.plans.measures import Utilisation, told_limits
from floatplan.plans.plan import Plan
from floatplan.plans.verdicts import Certificate, Verdict, verdict_in_words
from floatplan.problem.parts import (
    JointState,
    Obstacle,
)
from floatplan.problem.problem import Problem

Row = tuple[str, str]

TONES: dict[Verdict, str] = {"proved": "good", "refuted": "bad", "undecided": "open"}
LONGEST_LIST = 12  # [-] joints listed one by one


def sections(plan: Plan) -> list[dict[str, Any]]:
    """Return the tables of the report: title, rows of (name, text), and a tone: good, bad or open."""
    proved, tone = _proved(plan)
    tables: list[dict[str, Any]] = [
        {"title": "Problem", "rows": _problem(plan.problem)},
        {"title": "Result", "rows": _result(plan), "tone": "good" if plan.ok else "bad", "note": plan.explanation},
        {"title": "Proved", "rows": proved, "tone": tone, "findings": _findings(plan)},
        {"title": "Use of limits", "rows": [], **_motors(plan)},
    ]
    if plan.warnings:
        warned = [(f"{warning.kind} {warning.subject}", warning.message) for warning in plan.warnings]
        tables.append({"title": "Warnings", "rows": warned, "tone": "open"})
    return tables


def verdict(plan: Plan) -> tuple[str, str]:
    """Return the plan's verdict in a word or two, and its tone."""
    certificate, warned = plan.certificate, bool(plan.warnings)
    word = verdict_in_words(plan.ok, certificate, warned)
    if certificate is None or not plan.ok:
        return word, "open" if plan.ok else "bad"
    return word, "open" if certificate.proved and warned else TONES[certificate.verdict]


def _problem(problem: Problem) -> list[Row]:
    flight, robot = problem.flight, problem.robot
    momentum = flight.angular_momentum
    rows = [
        ("robot", f"{robot.name}, {len(robot.joints)} planned joints, {robot.mass:.4g} kg"),
        ("start", _posture(problem.initial, robot.joints)),
        ("goal", _posture(problem.final, robot.joints)),
        ("duration", f"{flight.duration:g} s"),
        ("takes off", f"{problem.takeoff.frame} at {_pair(problem.takeoff.position)} m"),
        ("lands", f"{problem.landing.frame} at height {problem.landing_height:g} m"),
        ("speed", f"{flight.horizontal_velocity:g} m/s horizontally, gravity {flight.gravity:g} m/s²"),
        ("momentum", momentum if isinstance(momentum, str) else f"{momentum:g} kg m²/s"),
        ("motion", f"sine polynomials of degree {_degrees(problem)}, least {problem.motion.objective}"),
    ]
    if problem.ground:
        rows.append(("ground", "no link below the line on which it took off"))
    return rows + [("obstacle", _obstacle(obstacle)) for obstacle in problem.obstacles]


def _result(plan: Plan) -> list[Row]:
    record = plan.record
    low, high = record.angular_momentum_bounds
    ends = record.orientation
    place = "inside" if low <= record.angular_momentum <= high else "outside"
    rows = [
        ("status", record.status),
        ("orientation", f"off by {abs(ends['end'] - ends['goal']):.1e} rad at the end"),
        ("momentum", f"{record.angular_momentum:.6g} kg m²/s, {place} [{low:.5g}, {high:.5g}] of monotonic joints"),
        ("objective", f"{record.objective['name']}: {float(record.objective['value']):.6g}"),
    ]
    if record.clearance_min is not None:
        rows.append(("least clearance", f"{record.clearance_min:.5g} m"))
    rows += [(contact.end, contact.brief) for contact in plan.contacts]
    seconds = record.solver.get("seconds")
    return rows if seconds is None else [*rows, ("found in", f"{float(seconds):.3g} s")]


def _motors(plan: Plan) -> dict[str, list[Any]]:
    """Peaks, limits and utilisation of each motor, worst first: titles and cells of a table."""
    rows = told_limits(plan.utilisation)
    titles = [title for row in rows for title in (row.unit, "limit", "used")]
    cells = [
        [
            use.joint,
            *(cell for row in rows for cell in _use(use, row.key)),
            _percent(use.range_used),
            f"{use.instant:.3f}",
        ]
        for use in plan.utilisation
    ]
    return {"titles": ["joint", *titles, "of range", "at, s"], "motors": cells}


def _use(use: Utilisation, key: str) -> tuple[str, str, str]:
    """Peak, limit and the share of it, of one limit."""
    peak, limit, share = (getattr(use, f"{key}_{name}") for name in ("peak", "limit", "utilisation"))
    return _number(peak), _number(limit), _percent(share)


def _proved(plan: Plan) -> tuple[list[Row], str]:
    certificate, replay = plan.certificate, plan.record.replay
    rows: list[Row] = []
    tone = "open"
    if certificate is None:
        rows.append(("certificate", "none in the plan file; floatplan certify --save makes one"))
    else:
        tone = TONES[certificate.verdict]
        rows += _certificate_rows(certificate)
    if replay is None:
        rows.append(("replay", "none in the plan file; floatplan replay --save makes one"))
    else:
        landed = "lands at the goal" if replay.get("landed") else "lands elsewhere"
        error = _number(replay.get("orientation_error"))
        rows.append(("replay", f"{replay.get('engine')}: {landed}, orientation off by {error} rad"))
    return rows, tone


def _certificate_rows(certificate: Certificate) -> list[Row]:
    total = len(certificate.findings)
    many = total - len(certificate.unproved)
    rows = [("certificate", f"{certificate.verdict}: {many} of {total} constraints hold at every instant")]
    if certificate.clearance_min is not None:
        rows.append(("clearance above", f"{_number(certificate.clearance_min)} m"))
    return rows


def _findings(plan: Plan) -> list[list[str]]:
    """The certificate's findings: label, verdict, bound, limit, instant; unproved ones first."""
    findings = () if plan.certificate is None else plan.certificate.findings
    return [
        [finding.label, finding.verdict, *map(_number, (finding.bound, finding.limit, finding.instant))]
        for finding in sorted(findings, key=lambda finding: finding.verdict == "proved")
    ]


def _posture(state: JointState, joints: Sequence[str]) -> str:
    angles = np.rad2deg([state.orientation, *state.positions])
    if len(joints) > LONGEST_LIST:
        return f"orientation {angles[0]:.5g}°, joints {_listed(angles[1:])}°"
    named = zip(("orientation", *joints), angles, strict=True)
    return ", ".join(f"{name} {angle + 0.0:.5g}°" for name, angle in named)


def _degrees(problem: Problem) -> str:
    degrees = set(problem.degrees)
    return str(degrees.pop()) if len(degrees) == 1 else ", ".join(map(str, problem.degrees))


def _obstacle(obstacle: Obstacle) -> str:
    text = f"{obstacle.kind} {obstacle.where}, margin {obstacle.margin:g} m"
    if any(obstacle.velocity):
        text += f", moving at {_pair(obstacle.velocity)} m/s"
    if obstacle.window is not None:
        text += f", from {obstacle.window[0]:g} to {obstacle.window[1]:g} s"
    return text


def _pair(values: Iterable[float]) -> str:
    return "(" + ", ".join(f"{value:g}" for value in values) + ")"


def _listed(values: Sequence[Any] | Array) -> str:
    shown = [_number(value) for value in values[:LONGEST_LIST]]
    return ", ".join(shown) + (f", … ({len(values)} in all)" if len(values) > LONGEST_LIST else "")


def _percent(fraction: float | None) -> str:
    return "" if fraction is None else f"{100 * fraction:.0f} %"


def _number(value: Any) -> str:
    return "none" if value is None or not math.isfinite(value) else f"{float(value) + 0.0:.5g}"
