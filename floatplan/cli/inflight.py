"""``floatplan replay --replan`` and ``--authority``: flights that are corrected in the air, for people and programs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from floatplan.cli.common import print_json
from floatplan.cli.results import check_directory
from floatplan.cli.summary import print_summary
from floatplan.errors import escaped
from floatplan.inflight.authority import Authority, authority
from floatplan.plans.plan import Plan
from floatplan.simulation.closed_loop import ClosedLoop, closed_loop

PAGE = "flights.html"


def fly_many(
    plan: Plan,
    rate: float | None,
    with_authority: bool,
    output: Path | None,
    json_output: bool,
    **options: Any,
) -> None:
    """Fly with and without corrections where there is a rate, tell how much can be corrected where asked, and print.

    ``options`` are those of :func:`floatplan.closed_loop`; None is left to it.
    """
    if output is not None:
        check_directory(output)
    flown = None
    if rate is not None:
        flown = closed_loop(plan, rate, **{name: value for name, value in options.items() if value is not None})
    found = authority(plan) if with_authority else None
    page = None if output is None else _write(plan, output / PAGE, flown, found)
    if json_output:
        facts: dict[str, Any] = {} if flown is None else flown.to_dict()
        print_json(facts if found is None else {**facts, "authority": found.to_dict()})
        return
    print_summary(_summary(flown, found, page))


def _write(plan: Plan, path: Path, flown: ClosedLoop | None, found: Authority | None) -> Path:
    from floatplan.view.report.flights import write_flights_page

    return write_flights_page(plan, path, flown, found)


def _summary(flown: ClosedLoop | None, found: Authority | None, page: Path | None) -> RenderableType:
    from floatplan.view.report.flights import authority_rows, landing_rows, summary

    parts: list[RenderableType] = []
    if flown is not None:
        parts.append(Text(summary(flown), "bold"))
        parts.append(_table(("", "with corrections", "without"), landing_rows(flown)))
    if found is not None:
        parts.append(_table(("corrections begin at", "momentum", "inertia"), authority_rows(found)))
    if page is not None:
        parts.append(Text(escaped(str(page)), overflow="fold"))
    return Group(*parts)


def _table(titles: tuple[str, ...], rows: Any) -> Table:
    table = Table(*titles, box=None, header_style="dim", pad_edge=False)
    for row in rows:
        table.add_row(*row)
    return table
