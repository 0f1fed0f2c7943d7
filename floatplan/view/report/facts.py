"""The report's words: what was asked, what was found, and what was proved. Plain text; the page escapes it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.plans.measures import Utilisation, told_limits
from floatplan.plans.plan import Plan
from floatplan.problem.parts import (
    JointState,
    Obstacle,
)
from floatplan.problem.problem import Problem

Row = tuple[str, str]

LONGEST_LIST = 12  # joints listed one by one


def sections(plan: Plan) -> list[dict[str, Any]]:
    """Return the tables of the report: title, rows of (name, text), and a tone: good, bad or open."""
    proved, tone = _proved(plan)
    found: list[dict[str, Any]] = [
        {"title": "Asked", "rows": _asked(plan.problem)},
        {"title": "Found", "rows": _found(plan), "tone": "good" if plan.ok else "bad", "note": plan.explanation},
        {"title": "Proved", "rows": proved, "tone": tone, "findings": _findings(plan)},
        {"title": "Use of limits", "rows": [], **_motors(plan)},
    ]
    if plan.warnings:
        warned = [(f"{warning.kind} {warning.subject}", warning.message) for warning in plan.warnings]
        found.append({"title": "Warnings", "rows": warned, "tone": "open"})
    return found


def verdict(plan: Plan) -> tuple[str, str]:
    """Return the plan's standing in a word or two, and its tone."""
    certificate = plan.record.certificate
    if not plan.ok:
        return "no plan found", "bad"
    if certificate is None:
        return "planned, not proved yet", "open"
    words = {"proved": ("proved", "good"), "refuted": ("refuted", "bad")}
    if plan.warnings and certificate.get("verdict") == "proved":
        return "proved, with warnings", "open"
    return words.get(str(certificate.get("verdict")), ("planned, proof undecided", "open"))


def _asked(problem: Problem) -> list[Row]:
    flight, robot = problem.flight, problem.robot
    asked = flight.angular_momentum
    rows = [
        ("robot", f"{robot.name}, {len(robot.joints)} planned joints, {robot.mass:.4g} kg"),
        ("start", _posture(problem.initial, robot.joints)),
        ("goal", _posture(problem.final, robot.joints)),
        ("duration", f"{flight.duration:g} s"),
        ("takes off", f"{problem.takeoff.frame} at {_pair(problem.takeoff.position)} m"),
        ("lands", f"{problem.landing.frame} at height {problem.landing_height:g} m"),
        ("speed", f"{flight.horizontal_velocity:g} m/s horizontally, gravity {flight.gravity:g} m/s²"),
        ("momentum", asked if isinstance(asked, str) else f"{asked:g} kg m²/s"),
        ("motion", f"sine polynomials of degree {_degrees(problem)}, least {problem.motion.objective}"),
    ]
    if problem.ground:
        rows.append(("ground", "no link below the line on which it took off"))
    return rows + [("obstacle", _obstacle(obstacle)) for obstacle in problem.obstacles]


def _found(plan: Plan) -> list[Row]:
    record = plan.record
    low, high = record.angular_momentum_bounds
    ends = record.orientation
    inside = "in" if low <= record.angular_momentum <= high else "outside"
    rows = [
        ("status", record.status),
        ("orientation", f"off by {abs(ends['end'] - ends['goal']):.1e} rad at the end"),
        ("momentum", f"{record.angular_momentum:.6g} kg m²/s, {inside} [{low:.5g}, {high:.5g}], eq. (9)"),
        ("objective", f"{record.objective['name']}: {float(record.objective['value']):.6g}"),
    ]
    if record.clearance_min is not None:
        rows.append(("least clearance", f"{record.clearance_min:.5g} m"))
    seconds = record.solver.get("seconds")
    return rows if seconds is None else [*rows, ("found in", f"{float(seconds):.3g} s")]


def _motors(plan: Plan) -> dict[str, list[Any]]:
    """Peaks, limits and shares of each motor, worst first: titles and cells of a table."""
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
    certificate, replay = plan.record.certificate, plan.record.replay
    rows: list[Row] = []
    tone = "open"
    if certificate is None:
        rows.append(("certificate", "none in the plan file; floatplan certify --save makes one"))
    else:
        tone = {"proved": "good", "refuted": "bad"}.get(str(certificate.get("verdict")), "open")
        rows += _certificate_rows(certificate)
    if replay is None:
        rows.append(("replay", "none in the plan file; floatplan replay --save makes one"))
    else:
        landed = "lands at the goal" if replay.get("landed") else "lands elsewhere"
        error = _number(replay.get("orientation_error"))
        rows.append(("replay", f"{replay.get('engine')}: {landed}, orientation off by {error} rad"))
    return rows, tone


def _certificate_rows(certificate: Mapping[str, Any]) -> list[Row]:
    findings = certificate.get("findings") or ()
    many = sum(finding.get("verdict") == "proved" for finding in findings)
    rows = [
        ("certificate", f"{certificate.get('verdict')}: {many} of {len(findings)} constraints hold at every instant")
    ]
    if certificate.get("clearance_min") is not None:
        rows.append(("clearance above", f"{_number(certificate['clearance_min'])} m"))
    return rows


def _findings(plan: Plan) -> list[list[str]]:
    """What the certificate says of each constraint: label, verdict, bound, limit, instant; unproved ones first."""
    findings = (plan.record.certificate or {}).get("findings") or ()
    ordered = sorted(findings, key=lambda finding: finding.get("verdict") == "proved")
    return [
        [
            str(finding.get("label")),
            str(finding.get("verdict")),
            *(_number(finding.get(key)) for key in ("bound", "limit", "instant")),
        ]
        for finding in ordered
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


def _percent(share: float | None) -> str:
    return "" if share is None else f"{100 * share:.0f} %"


def _number(value: Any) -> str:
    return "none" if value is None or not math.isfinite(value) else f"{float(value) + 0.0:.5g}"
