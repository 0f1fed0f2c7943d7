"""Summaries, for reading, of how flights begin and end: by joint rates there, by stances, and in whole jumps."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Column, Table
from rich.text import Text

from floatplan.errors import escaped
from floatplan.plans.contact import Contact

if TYPE_CHECKING:
    from floatplan.stance.jump import Jump
    from floatplan.stance.launch import Launch

CHECKED = "Stances are checked 2000 times a second, not proved; the figures are the worst of them."


def contact_summary(ends: Sequence[Contact], disagreement: str | None) -> RenderableType:
    """Return the result of ``floatplan takeoff``, for reading; ``disagreement`` of the ends about a free h."""
    parts = [part for contact in ends for part in _contact(contact)]
    return Group(*parts, *([] if disagreement is None else [Text(disagreement, "bold red")]))


def _contact(contact: Contact) -> list[RenderableType]:
    verdict, *help_ = contact.sentences
    colour = "dim" if contact.found is None else "bold green" if contact.ok else "bold red"
    parts: list[RenderableType] = [Text(verdict, colour)]
    if contact.found is not None and contact.found.exist:
        parts.append(f"  angular momentum {contact.angular_momentum:.6g} kg m^2/s")
        parts.append(_rates(contact))
    return [*parts, *(Text(f"  {sentence}") for sentence in help_)]


def _rates(contact: Contact) -> Table:
    titles = ("  joint", "rad/s", "limit", "%")
    table = Table(*(Column(title, no_wrap=True) for title in titles), box=None, header_style="dim", pad_edge=False)
    table.add_row("  base", f"{contact.orientation_rate:.4g}", "-", "-")
    joints = contact.problem.robot.joints
    for joint, rate, limit in zip(joints, contact.rates.tolist(), contact.limits.tolist(), strict=True):
        limited = math.isfinite(limit)
        share = f"{100 * abs(rate) / limit:.0f}" if limited else "-"
        table.add_row(f"  {escape(joint)}", f"{rate + 0.0:.4g}", f"{limit:.4g}" if limited else "-", share)
    return table


REACHED = {
    "angular_momentum": "h, kg m^2/s",
    "horizontal_velocity": "horizontal, m/s",
    "vertical_velocity": "vertical, m/s",
}


def reachable_summary(facts: Mapping[str, Any]) -> RenderableType:
    """Return what rates within the limits reach at both ends, of ``floatplan bounds``; empty where none stands."""
    ends = [end for end in ("takeoff", "landing") if facts[f"{end}_asked"] is not None]
    if not ends:
        return Text("no frame stands on the ground, so none has to be at rest", "dim")
    table = Table("", *REACHED.values(), box=None, header_style="dim", pad_edge=False)
    for end in ends:
        table.add_row(f"{end}, asked", *(f"{value:.5g}" for value in facts[f"{end}_asked"]))
        table.add_row("each alone, by joint rates", *(_interval(facts[f"{end}_{key}_bounds"]) for key in REACHED))
    unlimited = all(None in (facts[f"{end}_{key}_bounds"] or ()) for end in ends for key in REACHED)
    note = (
        [Text("joints without velocity limits reach anything: limits.velocity sets them", "dim")] if unlimited else []
    )
    return Group(table, *note)


def _interval(bounds: Sequence[float | None] | None) -> str:
    if bounds is None:
        return "none"
    low, high = (None if end is None else f"{end:.5g}" for end in bounds)
    if low is None and high is None:
        return "any"
    return f"above {low}" if high is None else f"below {high}" if low is None else f"{low} to {high}"


def jump_summary(jump: Jump, files: Sequence[Path], seconds: float, program: str) -> RenderableType:
    """Return the result of ``floatplan jump``, for reading; ``program`` is what users type."""
    name, took = escape(jump.problem.name), f"in {seconds:.3g} s"
    if jump.flight is None:
        return Group(Text(f"{name}: {jump.verdict} {took}", "bold red"), Text(jump.explanation, "yellow"))
    from floatplan.stance.check import judged

    broken, held = judged(jump.request, jump.check.figures)
    proved = jump.flight.certificate is not None and jump.flight.certificate.proved
    colour = "bold red" if not (jump.ok and proved) else "bold yellow" if jump.flight.warnings else "bold green"
    table = Table("phase", "s", "from", "to", "on the ground", box=None, header_style="dim", pad_edge=False)
    for phase in jump.phases:
        times = (f"{at:.3f}" for at in (phase.end - phase.begin, phase.begin, phase.end))
        table.add_row(phase.kind, *times, escape(", ".join(phase.contacts)) or "nothing")
    rest = Table.grid(padding=(0, 2))
    rest.add_row(Text("stances", "dim"), Text("; ".join(held)))
    for path in files:
        rest.add_row(Text(path.stem, "dim"), Text(escaped(str(path)), overflow="fold"))
    plan = next(path for path in files if path.stem == "plan")
    rest.add_row(Text("next", "dim"), Text(f"{program} show {shlex.quote(str(plan))}    # the flight", overflow="fold"))
    notes = [Text(f"not within limits: {sentence}", "red") for sentence in broken]
    notes += [Text(f"warning: {warning.message}", "yellow") for warning in jump.flight.warnings]
    return Group(Text(f"{name}: jump found {took} ({jump.verdict})", colour), table, *notes, rest, Text(CHECKED, "dim"))


def launch_summary(launch: Launch, friction: float) -> RenderableType:
    """Return the result of ``floatplan launch``, for reading."""
    verdict, *rest = launch.sentences
    told = f"Friction {friction:g}. " + (
        CHECKED if launch.ok else "That none was found does not prove that none exists."
    )
    lines = [Text(f"  {sentence}") for sentence in rest]
    return Group(Text(verdict, "bold green" if launch.ok else "bold red"), *lines, Text(told, "dim"))
