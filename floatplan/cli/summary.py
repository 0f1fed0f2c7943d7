"""Summaries of the commands' results for reading: problem, result, how good it is, where the files are."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.markup import escape
from rich.table import Column, Table
from rich.text import Text

from floatplan.errors import escaped
from floatplan.plans.contact import Contact
from floatplan.plans.measures import told_limits
from floatplan.plans.plan import Plan
from floatplan.plans.verdicts import Certificate, verdict_in_words
from floatplan.problem.problem import Problem
from floatplan.robot.leak import WORTH_A_WARNING
from floatplan.tables import OBJECTIVE_TABLE

if TYPE_CHECKING:
    from floatplan.inflight.authority import Authority
    from floatplan.simulation.closed_loop import ClosedLoop

MOST_JOINTS_SHOWN = 6  # [-] rows of a table
MOST_WARNINGS_SHOWN = 3  # [-] lines
MOST_FINDINGS_SHOWN = 20  # [-] rows of a table


def plan_summary(plan: Plan, files: Sequence[Path], program: str = "floatplan") -> RenderableType:
    """Return at most 25 lines about a plan and the files that were written of it; ``program`` is what users type."""
    record, problem = plan.record, plan.problem
    table = _two_columns()
    table.add_row("problem", _problem(problem))
    for name, end in (("start", problem.initial), ("goal", problem.final)):
        joints = _listed(np.degrees(end.positions), digits=6)
        table.add_row(name, f"{math.degrees(end.orientation):.6g}; {joints} deg")
    table.add_row("result" if plan.ok else "nearest", _result(plan))
    low, high = record.angular_momentum_bounds
    inside = "inside" if low <= record.angular_momentum <= high else "outside"
    momentum = f"{record.angular_momentum:.6g} kg m^2/s, {inside} [{low:.5g}, {high:.5g}] of monotonic joints"
    table.add_row("momentum", momentum)
    if record.clearance_min is not None:
        table.add_row("clearance", f"{record.clearance_min:.4g} m at least")
    if record.out_of_plane_leak is not None and record.out_of_plane_leak > WORTH_A_WARNING:
        leak = f"{record.out_of_plane_leak:.2g} times as much angular momentum out of the plane as in it"
        table.add_row("warning", Text(f"the motion makes {leak}; see floatplan info", "yellow"))
    if plan.certificate is not None:
        table.add_row(plan.certificate.verdict, _proof(plan.certificate, record.orientation["goal"]))
    if plan.contacts:
        table.add_row("contact", "; ".join(escape(contact.brief) for contact in plan.contacts))
    places: dict[str, Path] = {}  # by kind: pictures by their folder
    for path in files:
        drawn = path.suffix in (".png", ".svg")
        places["figures" if drawn else path.stem] = path.parent if drawn else path
    for name, path in places.items():
        table.add_row(name, Text(escaped(str(path)), overflow="fold"))
    if "plan" in places and "report" not in places:
        table.add_row("next", Text(f"{program} show {shlex.quote(str(places['plan']))}", overflow="fold"))
    parts: list[RenderableType] = [_verdict(plan), table, _utilisation(plan)]
    if record.explanation:
        parts.append(Text(_shortened(record.explanation), style="" if plan.ok else "yellow"))
    parts += [Text(f"warning: {warning.message}", "yellow") for warning in plan.warnings[:MOST_WARNINGS_SHOWN]]
    return Group(*parts, *_more(len(plan.warnings) - MOST_WARNINGS_SHOWN, " warnings"))


def _utilisation(plan: Plan) -> RenderableType:
    """How much of its limits each motor uses, worst first."""
    rows = plan.utilisation
    limits = told_limits(rows)
    of_limits = [title for limit in limits for title in (limit.unit, "limit", "%")]
    titles = ("joint", *of_limits, "range, deg", "% of it", "at, s")
    cells = []
    for row in rows[:MOST_JOINTS_SHOWN]:
        of_limits = []
        for limit in limits:
            peak, most, share = (getattr(row, f"{limit.key}_{name}") for name in ("peak", "limit", "utilisation"))
            of_limits += [_number(peak), _number(most), _percent(share)]
        moved = f"{math.degrees(row.position_low):.0f} to {math.degrees(row.position_high):.0f}"
        cells.append((escape(row.joint), *of_limits, moved, _percent(row.range_used), f"{row.instant:.3g}"))
    return Group(_table(titles, cells, whole=True), *_more(len(rows) - MOST_JOINTS_SHOWN))


def _more(count: int, of: str = "") -> list[Text]:
    """What is said of rows that are left out."""
    return [Text(f"and {count} more{of}; --json has all", "dim")] if count > 0 else []


def facts_summary(facts: Mapping[str, Any], frames: bool = False, shapes: bool = False) -> RenderableType:
    """Return the result of ``floatplan info``, for reading: joints first, frames and shapes where asked for."""
    table = _two_columns()
    plane = facts["plane"]
    table.add_row("robot", f"{escape(facts['name'])}, {facts['mass']:.6g} kg")
    table.add_row("plane", f"{plane['name']}, normal {_listed(plane['normal'])}")
    follows = [Text(f"{joint} follows {_leader(coupling)}") for joint, coupling in facts["coupled"].items()]
    rest = _two_columns()
    rest.add_row("locked, rad", _pairs({joint: f"{position:.6g}" for joint, position in facts["locked"].items()}))
    rest.add_row(
        "frames", escape(", ".join(facts["frames"])) if frames else f"{len(facts['frames'])}; --frames has them"
    )
    listed = escape(", ".join(_shape(shape) for shape in facts["shapes"])) or "none"
    rest.add_row("shapes", listed if shapes else f"{len(facts['shapes'])}; --shapes has them")
    rest.add_row("leak", f"{facts['out_of_plane_leak']:.3g} times as much momentum out of the plane as in it")
    if facts["tilt"]:
        rest.add_row("tilt", f"axes turned onto the plane's normal by up to {facts['tilt']:.2g} rad")
    rest.add_row("D_0", f"{facts['D_min'][0]:.6g} to {facts['D_max'][0]:.6g} kg m^2")
    warnings = [Text(f"warning: {warning}", "yellow") for warning in facts["warnings"]]
    return Group(table, _joint_table(facts), *follows, rest, *warnings)


def momentum_summary(problem: Problem, facts: Mapping[str, Any]) -> RenderableType:
    """Return the result of ``floatplan bounds``, for reading."""
    low, high = facts["angular_momentum_bounds"]
    table = _two_columns()
    table.add_row("problem", escape(problem.name))
    table.add_row("interval for monotonic joints", f"{low:.6g} to {high:.6g} kg m^2/s")
    table.add_row("midpoint", f"{facts['angular_momentum_midpoint']:.6g} kg m^2/s")
    given = problem.flight.angular_momentum
    outside = not isinstance(given, str) and not low <= given <= high
    text = given if isinstance(given, str) else f"{given} kg m^2/s"
    table.add_row("given", f"{text}, outside the interval: a joint or the base has to turn back" if outside else text)
    extremes = enumerate(zip(facts["D_min"], facts["D_max"], strict=True))
    rows = ((f"D_{index}", f"{least:.6g}", f"{largest:.6g} kg m^2") for index, (least, largest) in extremes)
    return Group(table, _table(("", "least", "largest"), rows))


def certificate_summary(certificate: Certificate) -> RenderableType:
    """Return the result of ``floatplan certify``, for reading: what is not proved comes first."""
    colour = {"proved": "bold green", "refuted": "bold red", "undecided": "bold yellow"}
    findings = sorted(certificate.findings, key=lambda finding: finding.verdict == "proved")
    verdict = Text(f"{certificate.verdict} in {certificate.seconds:.3g} s", colour[certificate.verdict])
    verdict.append(f", {certificate.subintervals} intervals of time, {len(findings)} constraints", "default")
    table = _table(("constraint", "", "bound", "limit", "at, s"))
    for finding in findings[:MOST_FINDINGS_SHOWN]:
        numbers = map(_number, (finding.bound, finding.limit, finding.instant))
        table.add_row(escape(finding.label), Text(finding.verdict, colour[finding.verdict]), *numbers)
    return Group(verdict, table, *_more(len(findings) - MOST_FINDINGS_SHOWN))


def replay_summary(facts: Mapping[str, Any]) -> RenderableType:
    """Return the result of ``floatplan replay``, for reading."""
    disturbance = {name: error for name, error in facts["disturbance"].items() if error}
    disturbed = ", ".join(f"{name} ±{abs(error):.3g}" for name, error in disturbance.items())
    landed = "landed" if facts["landed"] else "landed elsewhere, disturbed" if disturbed else "missed the goal"
    colour = "bold green" if facts["landed"] else "bold yellow" if disturbed else "bold red"
    control = "open loop" if facts["feedback"] is None else f"joints tracked at {facts['feedback']:g} rad/s"
    table = _two_columns()
    table.add_row("how", f"{facts['engine']}, {control}" + (f", {disturbed}" if disturbed else ""))
    table.add_row("orientation", f"off by {_number(facts['orientation_error'])} rad")
    table.add_row("joints", f"off by {_listed(facts['position_error'])} rad")
    table.add_row("CM", f"off by {_number(facts['com_error'])} m")
    table.add_row("momentum", f"drifts by {_number(facts['momentum_drift'])} kg m^2/s")
    table.add_row("sensitivity", f"{_number(facts['orientation_sensitivity'])} rad per kg m^2/s of h")
    if facts["spatial"] is not None:
        table.add_row("in space", _spatial(facts["spatial"]))
    titles = {"times": "after, s", "orientation": "orientation, rad", "joints": "joints, rad", "com": "CM, m"}
    errors = zip(*(map(_number, facts["growth"][name]) for name in titles), strict=True)
    unstable = not facts["landed"] and not disturbed and facts["feedback"] is None
    advice = "with --feedback 30 an unstable motion lands all the same, a wrong plan does not"
    hint = [Text(advice, "dim")] if unstable else []
    return Group(Text(f"{landed} in {facts['seconds']:.3g} s", colour), table, _table(titles.values(), errors), *hint)


def _spatial(landing: Mapping[str, Any]) -> str:
    """What the free joint did, in a line."""
    off = max([landing["orientation_error"] or 0.0, *(error or 0.0 for error in landing["position_error"])])
    held = len(landing["held"])
    gains = f", {held} joint{'s' if held > 1 else ''} held by gains" if held else ""
    turned = f"roll {math.degrees(landing['roll']):+.3g} deg, yaw {math.degrees(landing['yaw']):+.3g} deg"
    return f"{turned}; in the plane off by {_number(off)} rad{gains}"


def contact_summary(ends: Sequence[Contact], disagreement: str | None) -> RenderableType:
    """Return the result of ``floatplan takeoff``, for reading; ``disagreement`` of the ends about a free h."""
    parts: list[RenderableType] = []
    for contact in ends:
        verdict, *advice = contact.sentences
        parts.append(Text(verdict, "dim" if contact.found is None else "bold green" if contact.ok else "bold red"))
        if contact.found is not None and contact.found.exist:
            parts += [f"  angular momentum {contact.angular_momentum:.6g} kg m^2/s", _rates(contact)]
        parts += [Text(f"  {sentence}") for sentence in advice]
    return Group(*parts, *([] if disagreement is None else [Text(disagreement, "bold red")]))


def _rates(contact: Contact) -> Table:
    table = _table(("  joint", "rad/s", "limit", "%"), whole=True)
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
    table = _table(("", *REACHED.values()))
    for end in ends:
        table.add_row(f"{end}, asked", *(f"{value:.5g}" for value in facts[f"{end}_asked"]))
        table.add_row("each alone, by joint rates", *(_interval(facts[f"{end}_{key}_bounds"]) for key in REACHED))
    unlimited = all(None in (facts[f"{end}_{key}_bounds"] or ()) for end in ends for key in REACHED)
    note = "joints without velocity limits reach anything: limits.velocity sets them"
    return Group(table, *([Text(note, "dim")] if unlimited else []))


def _interval(bounds: Sequence[float | None] | None) -> str:
    if bounds is None:
        return "none"
    low, high = (None if end is None else f"{end:.5g}" for end in bounds)
    if low is None and high is None:
        return "any"
    return f"above {low}" if high is None else f"below {high}" if low is None else f"{low} to {high}"


def flights_summary(flown: ClosedLoop | None, found: Authority | None, page: Path | None) -> RenderableType:
    """Return the result of ``floatplan replay`` with --replan and --authority, for reading."""
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


def print_summary(content: RenderableType, stderr: bool = False) -> None:
    """Print for people, without colours where nobody sees them."""
    Console(stderr=stderr, highlight=False, soft_wrap=False).print(content)


def _table(titles: Iterable[str], rows: Iterable[Sequence[RenderableType]] = (), whole: bool = False) -> Table:
    """A table without lines; where ``whole``, no cell is broken into lines."""
    table = Table(*(Column(title, no_wrap=whole) for title in titles), box=None, header_style="dim", pad_edge=False)
    for row in rows:
        table.add_row(*row)
    return table


def _two_columns() -> Table:
    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim", no_wrap=True)
    table.add_column()
    return table


def _verdict(plan: Plan) -> Text:
    seconds = plan.record.solver.get("seconds")
    took = "" if seconds is None else f" in {float(seconds):.3g} s"
    if plan.ok:
        warned = bool(plan.warnings)
        proved = plan.certificate is not None and plan.certificate.proved
        word = verdict_in_words(True, plan.certificate, warned) if proved else "with warnings" if warned else ""
        parts = ", ".join(filter(None, (plan.status, word)))
        return Text(f"{plan.problem.name}: planned{took} ({parts})", style="bold yellow" if warned else "bold green")
    word = verdict_in_words(False, None, False)
    return Text(f"{plan.problem.name}: {word}{took} ({plan.status})", style="bold red")


def _problem(problem: Problem) -> str:
    joints = "1 joint" if len(problem.robot.joints) == 1 else f"{len(problem.robot.joints)} joints"
    many = len(problem.obstacles)
    extras = ["1 obstacle" if many == 1 else f"{many} obstacles"] if many else []
    return escape(", ".join([f"{problem.robot.name}, {joints}", f"{problem.flight.duration:g} s of flight", *extras]))


def _result(plan: Plan) -> str:
    reached, objective = plan.record.orientation, plan.record.objective
    unit = OBJECTIVE_TABLE[objective["name"]].unit.replace("mixed", "")
    value = f"{objective['name']} {float(objective['value']):.6g} {unit}".rstrip()
    return f"orientation off by {abs(reached['end'] - reached['goal']):.1e} rad, {value}"


def _proof(certificate: Certificate, goal: float) -> Text:
    """Bounds proved for all times, in a line; or the constraints that are not proved."""
    low, high = certificate.orientation_end
    unproved = [finding.label for finding in certificate.unproved]
    took = f"{certificate.seconds:.2g} s, {certificate.subintervals} intervals"
    if unproved:
        return Text(f"not proved: {_shortened(', '.join(unproved), 200)} ({took})", style="yellow")
    parts = [] if math.isinf(low) else [f"orientation within {max(abs(low - goal), abs(high - goal)):.1e} rad"]
    parts.append(f"torque at most {max(certificate.motor_torque_peak.values(), default=0.0):.4g} N m")
    if certificate.clearance_min is not None:
        parts.append(f"clearance at least {certificate.clearance_min:.4g} m")
    return Text(f"for all times, {', '.join(parts)} ({took})")


def _joint_table(facts: Mapping[str, Any]) -> Table:
    table = _table(("joint", "range, rad", "rad/s", "N m", "D_i, kg m^2"))
    for index, joint in enumerate(facts["joints"]):
        low, high = facts["position_limits"][index]
        table.add_row(
            escape(joint),
            "not given" if low is None or high is None else f"{low:.4g} to {high:.4g}",
            _number(facts["velocity_limits"][index]),
            _number(facts["torque_limits"][index]),
            f"{facts['D_min'][index + 1]:.4g} to {facts['D_max'][index + 1]:.4g}",
        )
    return table


def _listed(values: Any, digits: int = 4) -> str:
    shown = [f"{float(value) + 0.0:.{digits}g}" for value in values]
    if len(shown) > MOST_JOINTS_SHOWN:
        shown = [*shown[:MOST_JOINTS_SHOWN], f"... ({len(shown)} in all)"]
    return ", ".join(shown)


def _percent(fraction: float | None) -> str:
    return "-" if fraction is None else f"{100 * fraction:.0f}"


def _number(value: float | None) -> str:
    return "-" if value is None or not math.isfinite(value) else f"{value:.4g}"


def _pairs(values: Mapping[str, str]) -> str:
    return escape(", ".join(f"{name} = {value}" for name, value in values.items())) or "none"


def _leader(coupling: Mapping[str, Any]) -> str:
    ratio = {1.0: "", -1.0: "-"}.get(coupling["ratio"], f"{coupling['ratio']:g} ")
    offset = f" {coupling['offset']:+g} rad" if coupling["offset"] else ""
    return f"{ratio}{coupling['leader']}{offset}"


def _shape(shape: Mapping[str, Any]) -> str:
    return f"{shape['link']} {shape['length']:.3g} m" + (f", radius {shape['radius']:.3g} m" if shape["radius"] else "")


def _shortened(text: str, longest: int = 800) -> str:
    return text if len(text) <= longest else f"{text[: longest - 4]} ..."
