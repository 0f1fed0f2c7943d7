"""Summaries, for reading, of what joint rates make at the ends of a flight."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Column, Table
from rich.text import Text

from floatplan.plans.contact import Contact


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
