"""What is said and drawn of a jump beside what is of a flight: its phases, forces, and what its check found."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from floatplan.plans.presentation import CHECKED, Row
from floatplan.plans.verdicts import Certificate, Tone, verdict_in_words
from floatplan.stance.check import judged
from floatplan.view.jumps import CheckedJump, JumpView
from floatplan.view.outlines import pairs
from floatplan.view.report.data import proved, rounded, warned

PHASES = ("phase", "s", "from", "to", "on the ground")
STANCES = ("stances", "limit")

Lines = list[list[str]]


def jump_tone(jump: CheckedJump) -> Tone:
    """Whether a jump's verdict is good, bad or open."""
    if jump.flight is None or not jump.ok:
        return "bad"
    return verdict_in_words(jump.flight.ok, jump.flight.certificate, bool(jump.flight.warnings))[1]


def phase_lines(jump: CheckedJump) -> Lines:
    """Cells of a jump's phases, under ``PHASES``."""
    return [
        [
            phase.kind,
            *(f"{at:.3f}" for at in (phase.end - phase.begin, phase.begin, phase.end)),
            ", ".join(phase.contacts) or "nothing",
        ]
        for phase in jump.phases
    ]


def check_lines(jump: CheckedJump) -> tuple[Lines, Lines]:
    """Cells of what a jump's check found, under ``STANCES``: what does not hold, and what does."""
    figures = {name: value for name, value in jump.check.figures.items() if name != "torque_speed" or value > 0}
    broken, held = judged(jump.request, figures)
    return [[f"not within limits: {words}", limit] for words, limit in broken], [list(words) for words in held]


def jump_sections(view: JumpView) -> list[dict[str, Any]]:
    """Return the tables of a jump's report, as those of a plan's."""
    jump, flight, margin = view.jump, view.flight, view.jump.request.margin
    broken, held = check_lines(jump)
    height, force = view.largest
    weight = view.robot.mass * jump.problem.flight.gravity
    problem = [
        *jump.problem.rows(),
        Row("friction", f"{jump.request.friction:g}"),
        Row("margins", f"stances may use {margin['torque']:.0%} of torques, {margin['velocity']:.0%} of rates"),
    ]
    result = [
        Row("verdict", jump.verdict),
        Row("duration", f"{jump.duration:.3f} s, {flight.duration:.3f} s of it in flight"),
        Row("height", f"centre of mass up to {height:.3g} m above the ground"),
        Row("largest force", f"{force:.4g} N, {force / weight:.2g} times the weight"),
    ]
    tone = "bad" if broken else "good"
    return [
        {"title": "Problem", "rows": problem},
        {"title": "Result", "rows": result, "tone": jump_tone(jump), "note": jump.explanation},
        {"title": "Flight", **proved(flight, _since_start(flight.certificate, jump.takeoff_time))},
        {"title": "Stances", "rows": [], "motors": (STANCES, [*broken, *held]), "tone": tone, "note": CHECKED},
        {"title": "Phases", "rows": [], "phases": (PHASES, phase_lines(jump))},
        *warned(flight),
    ]


def _since_start(certificate: Certificate | None, takeoff: float) -> Certificate | None:
    """The same certificate, its instants on the jump's clock."""
    if certificate is None:
        return None
    findings = (
        each if each.instant is None else replace(each, instant=each.instant + takeoff) for each in certificate.findings
    )
    return replace(certificate, findings=tuple(findings))


def jump_data(view: JumpView) -> dict[str, Any]:
    """Return what the picture of a jump has beside a flight's.

    ``frames``, the points that stand, each with the columns of its ``force``; ``phases`` as :attr:`Jump.phases`; a
    friction ``cone`` and the ``metres_per_newton`` of forces as drawn.
    """
    frames = [
        {
            "name": name,
            "role": "stands",
            "colour": colour,
            "body": contact.spots[0][0],
            "at": rounded(pairs(contact.spots[0][1])),
            "force": [f"force_x.{index}", f"force_z.{index}"],
        }
        for index, ((name, contact), colour) in enumerate(zip(view.contacts.items(), view.colours, strict=True))
    ]
    stands = [
        [name for name, each in view.contacts.items() if each.names[0] in phase.contacts] for phase in view.jump.phases
    ]
    return {
        "frames": frames,
        "phases": [{**vars(phase), "contacts": names} for phase, names in zip(view.jump.phases, stands, strict=True)],
        "friction": view.jump.request.friction,
        "cone": rounded(pairs(view.cone)),
        "metres_per_newton": view.metres_per_newton,
    }
