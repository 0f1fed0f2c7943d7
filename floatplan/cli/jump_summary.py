"""Summaries, for reading, of whole jumps, and of stances that reach a flight."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from floatplan.errors import escaped
from floatplan.stance.check import judged
from floatplan.stance.jump import Jump
from floatplan.stance.launch import Launch

CHECKED = "Stances are checked 2000 times a second, not proved; the figures are the worst of them."


def jump_summary(jump: Jump, files: Sequence[Path], seconds: float, program: str) -> RenderableType:
    """Return the result of ``floatplan jump``, for reading; ``program`` is what users type."""
    name, took = escape(jump.problem.name), f"in {seconds:.3g} s"
    if jump.flight is None:
        return Group(Text(f"{name}: {jump.verdict} {took}", "bold red"), Text(jump.explanation, "yellow"))
    told = {name: value for name, value in jump.check.figures.items() if name != "torque_speed" or value > 0}
    broken, held = judged(jump.request, told)
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
