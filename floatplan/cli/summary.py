"""Summaries of the commands' results for reading: problem, result, how good it is, where the files are."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.table import Column, Table
from rich.text import Text

import floatplan as fp
from floatplan.arguments import percent, short, shortened
from floatplan.errors import escaped
from floatplan.plans.presentation import CHECKED, Row, plan_verdict, proof_rows, result_rows, utilisation_table
from floatplan.plans.verdicts import TONES, Tone

AUTHORITY_TITLES = ("corrections begin at", "momentum", "inertia")
NONE = "not given"  # of a range
MOST_JOINTS_SHOWN = 6  # [-] rows of a table
MOST_WARNINGS_SHOWN = 3  # [-] lines
MOST_FINDINGS_SHOWN = 20  # [-] rows of a table
LONGEST_EXPLANATION = 800  # [-] characters
FOLLOWED = 30.0  # [rad] bandwidth times duration with which joints are held to their paths
REACHED = {
    "angular_momentum": "h, kg m^2/s",
    "horizontal_velocity": "horizontal, m/s",
    "vertical_velocity": "vertical, m/s",
}
COLOURS: Mapping[Tone, str] = {"good": "green", "open": "yellow", "bad": "red"}


def plan_summary(
    plan: fp.Plan, files: Sequence[Path], program: str = "floatplan", stances: Sequence[Row] = ()
) -> RenderableType:
    """Return at most 25 lines about a plan and the files that were written of it.

    ``program`` is what users type; ``stances`` is what is said of those before and after the flight, if anything.
    """
    problem, (word, tone), (status, *results) = plan.problem, plan_verdict(plan), result_rows(plan)
    obstacles = [_counted(len(problem.obstacles), "obstacle")] if problem.obstacles else []
    asked = [
        problem.robot.name,
        _counted(len(problem.robot.joints), "joint"),
        f"{problem.flight.duration:g} s of flight",
    ]
    rows = [Row("problem", ", ".join([*asked, *obstacles]))]
    for name, end in (("start", problem.initial), ("goal", problem.final)):
        turned = end.attitude or f"{math.degrees(end.orientation):z.6g}"
        rows.append(Row(name, f"{turned}; {shortened(np.degrees(end.positions), 6)} deg"))
    places: dict[str, Path] = {}  # by kind: pictures by their folder
    for path in files:
        drawn = path.suffix in (".png", ".svg")
        places["figures" if drawn else path.stem] = path.parent if drawn else path
    written = [Row(name, escaped(str(path))) for name, path in places.items()]
    if "plan" in places and "report" not in places:
        written.append(Row("next", f"{program} show {shlex.quote(str(places['plan']))}"))
    warnings = plan.warnings[:MOST_WARNINGS_SHOWN]
    warned = {warning.kind for warning in warnings}  # these say more of takeoff and landing than their rows
    results = [row for row in results if row.name not in warned]
    titles, cells = utilisation_table(plan.utilisation)
    explained = plan.explanation
    if len(explained) > LONGEST_EXPLANATION:
        explained = f"{explained[: LONGEST_EXPLANATION - 4]} ..."
    return Group(
        Text(f"{problem.name}: {word} ({status.text})", f"bold {COLOURS[tone]}"),
        _named([*rows, *results, *stances, *proof_rows(plan), *written]),
        _table(titles, cells[:MOST_JOINTS_SHOWN], whole=True),
        *_more(len(cells) - MOST_JOINTS_SHOWN),
        *([Text(explained, "" if plan.ok else "yellow")] if explained else []),
        *(Text(f"warning: {warning.message}", "yellow") for warning in warnings),
        *_more(len(plan.warnings) - MOST_WARNINGS_SHOWN, " warnings"),
    )


def facts_summary(facts: Mapping[str, Any], frames: bool = False, shapes: bool = False) -> RenderableType:
    """Return the result of ``floatplan info``, for reading: joints first, frames and shapes where asked for."""
    plane = facts.get("plane")
    flies = (
        ("base", facts["base"]) if plane is None else ("plane", f"{plane['name']}, normal {shortened(plane['normal'])}")
    )
    table = _named([("robot", f"{facts['name']}, {facts['mass']:.6g} kg"), flies])
    joints = []
    for index, joint in enumerate(facts["joints"]):
        low, high = facts["position_limits"][index]
        limits = [short(facts[f"{limit}_limits"][index]) for limit in ("velocity", "torque")]
        inertia = [] if plane is None else [_span(facts["D_min"][index + 1], facts["D_max"][index + 1], 4)]
        ranges = NONE if low is None or high is None else f"{low:.4g} to {high:.4g}"
        joints.append((joint, ranges, *limits, *inertia))
    follows = []
    for joint, coupling in facts["coupled"].items():
        ratio = {1.0: "", -1.0: "-"}.get(coupling["ratio"], f"{coupling['ratio']:g} ")
        offset = f" {coupling['offset']:+g} rad" if coupling["offset"] else ""
        follows.append(Text(f"{joint} follows {ratio}{coupling['leader']}{offset}"))
    carried = [
        f"{payload['mass']:g} kg on {payload['link']} at {shortened(payload['at'])} m" for payload in facts["payload"]
    ]
    rest = [
        *([("payload", "; ".join(carried))] if carried else []),
        *_rotors(facts),
        ("locked, rad or m", ", ".join(f"{joint} = {place:.6g}" for joint, place in facts["locked"].items()) or "none"),
        ("frames", ", ".join(facts["frames"]) if frames else f"{len(facts['frames'])}; --frames has them"),
        *([] if plane is None else _named_in_plane(facts, shapes)),
    ]
    warnings = [Text(f"warning: {warning}", "yellow") for warning in facts["warnings"]]
    titles = ("joint", "range, rad", "rad/s", "N m", *([] if plane is None else ["momentum by rate, kg m^2"]))
    open_limits = any(cell in (NONE, short(None)) for row in joints for cell in row)
    note = [Text(f'{short(None)} or "{NONE}": the robot\'s file has no limit there, or 0, which counts as none')]
    return Group(
        table,
        _table(titles, joints),
        *(note if open_limits else []),
        *follows,
        _named(rest),
        *map(Text, facts["wheels"]),
        *warnings,
    )


def _rotors(facts: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The row about rotors that an SRDF file gives."""
    if facts["rotor_file"] is None:
        return []
    of_joints = ", ".join(f"{joint} = {inertia:.4g}" for joint, inertia in facts["armature"].items())
    source = f"{of_joints or 'none of joints that are planned'}; rotor_params of {Path(facts['rotor_file']).name}"
    return [("armature, kg m^2", f"{source}, unless armature is given")]


def _named_in_plane(facts: Mapping[str, Any], shapes: bool) -> list[tuple[str, str]]:
    capsules = []
    for shape in facts["shapes"]:
        radius = f", radius {shape['radius']:.3g} m" if shape["radius"] else ""
        capsules.append(f"{shape['link']} {shape['length']:.3g} m{radius}")
    rest = [
        ("shapes", (", ".join(capsules) or "none") if shapes else f"{len(capsules)}; --shapes has them"),
        ("out of plane", f"{facts['out_of_plane_leak']:.3g} times as much momentum out of the plane as in it"),
    ]
    if facts["tilt"]:
        rest.append(("tilt", f"axes turned onto the plane's normal by up to {facts['tilt']:.2g} rad"))
    inertia = f"{_span(facts['D_min'][0], facts['D_max'][0], 6)} kg m^2 about the centre of mass, by the posture"
    return [*rest, ("inertia", inertia)]


def _span(low: float, high: float, digits: int) -> str:
    """From one number to another, or the one that both are."""
    ends = dict.fromkeys(f"{end:z.{digits}g}" for end in (low, high))
    return " to ".join(ends)


def momentum_summary(problem: fp.Problem, facts: Mapping[str, Any]) -> RenderableType:
    """Return the result of ``floatplan bounds``, for reading: of joints that do not turn back, and of their rates."""
    low, high = facts["angular_momentum_bounds"]
    given = problem.flight.angular_momentum
    outside = not isinstance(given, str) and not low <= given <= high
    text = given if isinstance(given, str) else f"{given} kg m^2/s"
    table = _named(
        [
            ("problem", problem.name),
            ("without turning back", f"{low:.6g} to {high:.6g} kg m^2/s"),
            ("midpoint", f"{facts['angular_momentum_midpoint']:.6g} kg m^2/s"),
            ("given", f"{text}, outside the interval: a joint or the base has to turn back" if outside else text),
        ]
    )
    turning = ("base", *problem.robot.joints)
    extremes = zip(turning, facts["D_min"], facts["D_max"], strict=True)
    rows = ((name, f"{least:z.6g}", f"{largest:z.6g}") for name, least, largest in extremes)
    titles = ("momentum by rate, kg m^2", "least", "largest")
    return Group(table, _table(titles, rows), _reachable(facts))


def certificate_summary(certificate: fp.Certificate) -> RenderableType:
    """Return the result of ``floatplan certify``, for reading: what is not proved comes first."""
    titles, cells = certificate.table()
    colours = {str(verdict): f"bold {COLOURS[tone]}" for verdict, tone in TONES.items()}
    verdict = Text(f"{certificate.verdict} in {certificate.seconds:.3g} s", colours[certificate.verdict])
    verdict.append(f", {certificate.subintervals} intervals of time, {len(cells)} constraints", "default")
    rows: list[list[str | Text]] = [[*row] for row in cells[:MOST_FINDINGS_SHOWN]]
    for row, (_, word, *_) in zip(rows, cells, strict=False):
        row[1] = Text(word, colours[word])
    return Group(verdict, _table(titles, rows), *_more(len(cells) - MOST_FINDINGS_SHOWN))


def replay_summary(flown: fp.Replay) -> RenderableType:
    """Return the result of ``floatplan replay``, for reading."""
    landed = "landed" if flown.landed else "landed elsewhere, disturbed" if flown.disturbed else "missed the goal"
    tone: Tone = "good" if flown.landed else "open" if flown.disturbed else "bad"
    titles = {"times": "after, s", "orientation": "orientation, rad", "joints": "joints, rad", "com": "CM, m"}
    errors = zip(*(map(short, getattr(flown.growth, name)) for name in titles), strict=True)
    unstable = not flown.landed and not flown.disturbed and flown.feedback is None
    tracked = short(FOLLOWED / float(flown.growth.times[-1]))
    advice = f"with --feedback {tracked} an unstable motion lands all the same, a wrong plan does not"
    return Group(
        Text(f"{landed} in {flown.seconds:.3g} s", f"bold {COLOURS[tone]}"),
        _named(flown.rows()),
        _table(titles.values(), errors),
        *([Text(advice, "dim")] if unstable else []),
    )


def replays_summary(flown: Sequence[fp.Replay], requested: int) -> RenderableType:
    """Return the result of ``floatplan replay --runs``, for reading."""
    from floatplan.simulation.replay import landing_rows

    landed = f"{sum(flight.landed for flight in flown)} of {len(flown)} landed"
    landed += f", of {requested} asked for" if len(flown) < requested else ""
    table = _table(("at landing", "median", "worst"), landing_rows(flown))
    return Group(Text(landed, "bold"), _named(flown[0].rows()[:1]), table)


def contact_summary(ends: Sequence[fp.Contact], disagreement: str | None) -> RenderableType:
    """Return the result of ``floatplan takeoff``, for reading; ``disagreement`` of the ends about a free h."""
    parts: list[RenderableType] = []
    for contact in ends:
        tone = "dim" if contact.found is None else "bold green" if contact.ok else "bold red"
        parts.append(Text(contact.verdict, tone))
        if contact.found is not None and contact.found.exist:
            rows = [("  base", short(contact.orientation_rate), "-", "-")]
            of_joints = zip(contact.problem.robot.joints, contact.rates.tolist(), contact.limits.tolist(), strict=True)
            for joint, rate, limit in of_joints:
                share = abs(rate) / limit if math.isfinite(limit) else None
                rows.append((f"  {joint}", short(rate), short(limit), percent(share)))
            parts.append(f"  angular momentum {contact.angular_momentum:.6g} kg m^2/s")
            parts.append(_table(("  joint", "rad/s", "limit", "%"), rows, whole=True))
    return Group(*parts, *([] if disagreement is None else [Text(disagreement, "bold red")]))


def _reachable(facts: Mapping[str, Any]) -> RenderableType:
    """What rates within the limits reach at both ends."""
    ends = [end for end in ("takeoff", "landing") if facts[f"{end}_asked"] is not None]
    if not ends:
        return Text("no frame stands on the ground, so none has to be at rest", "dim")
    rows = []
    for end in ends:
        rows.append((f"{end}, desired", *(f"{value:.5g}" for value in facts[f"{end}_asked"])))
        rows.append(("each alone, by joint rates", *(_interval(facts[f"{end}_{key}_bounds"]) for key in REACHED)))
    unlimited = all(None in (facts[f"{end}_{key}_bounds"] or ()) for end in ends for key in REACHED)
    note = "joints without velocity limits reach anything: limits.velocity sets them"
    return Group(_table(("", *REACHED.values()), rows), *([Text(note, "dim")] if unlimited else []))


def _interval(bounds: Sequence[float | None] | None) -> str:
    if bounds is None:
        return "nothing"
    low, high = bounds
    if low is None or high is None:
        ends = [f"{word} {end:z.5g}" for word, end in (("above", low), ("below", high)) if end is not None]
        return ends[0] if ends else "no limit"
    return _span(low, high, 5)


def jump_summary(jump: fp.Jump, files: Sequence[Path], seconds: float, program: str) -> RenderableType:
    """Return the result of ``floatplan jump``, for reading; ``program`` is what users type."""
    from floatplan.view.report.data import PHASES, STANCES, check_lines, phase_lines

    name = jump.problem.name
    took = f"in {seconds:.3g} s"
    if jump.flight is None:
        return Group(Text(f"{name}: {jump.verdict} {took}", "bold red"), Text(jump.explanation, "yellow"))
    broken, held = check_lines(jump.check, jump.request)
    written = [Row(path.stem, escaped(str(path))) for path in files]
    return Group(
        Text(f"{name}: jump found {took} ({jump.verdict})", f"bold {COLOURS[jump.tone]}"),
        _table(PHASES, phase_lines(jump)),
        *([Text(jump.explanation)] if jump.ok and jump.request.objective == "limits" else []),
        *(Text(", ".join(words), "red") for words in broken),
        *(Text(f"warning: {warning.message}", "yellow") for warning in jump.warnings[:MOST_WARNINGS_SHOWN]),
        *_more(len(jump.warnings) - MOST_WARNINGS_SHOWN, " warnings"),
        _table(STANCES, held),
        _named([*written, Row("next", f"{program} show {shlex.quote(str(files[0]))} --scene    # the jump in 3-D")]),
        Text(CHECKED, "dim"),
    )


CLIP_COLUMNS = ("flight", "verdict", "fall, m/s^2", "turn off, deg", "torque", "rate", "slide, mm")
CLIP_COLOURS = {"physical": "green", "unphysical": "red", "undecided": "yellow", "afloat": "yellow"}


def clip_summary(check: fp.ClipCheck, page: Path | None = None) -> RenderableType:
    """Return what ``floatplan clip check`` found of one clip, for reading: a line for each flight, and the page."""
    clip = check.clip
    rows: list[Sequence[str | Text]] = []
    faults: list[Text] = []
    for judged in check.flights:
        flight = judged.flight
        when = f"{flight.begin:.2f}..{flight.end:.2f} s"
        turn = "too few frames" if judged.turn is None else f"{math.degrees(judged.turn.rms):.2f}"
        shares = [_clip_share(each) for each in (judged.torque_share, judged.rate_share)]
        fall = (
            f"{judged.fall.fall:.2f} +- {judged.fall.interval:.2f}" if math.isfinite(judged.fall.interval) else "open"
        )
        verdict = Text(judged.verdict, CLIP_COLOURS[judged.verdict])
        rows.append((when, verdict, fall, turn, *shares, f"{1e3 * judged.sliding:.0f}"))
        faults += [Text(f"{when}: {fault}", "red") for fault in judged.faults[:MOST_WARNINGS_SHOWN]]
    words = f"{clip.path.name}: {clip.frames} frames at {clip.fps:g} Hz, {_counted(len(check.flights), 'flight')}"
    return Group(
        Text(escaped(words), f"bold {COLOURS['good' if check.ok else 'bad']}"),
        *(Text(remark, "dim") for remark in check.remarks),
        *([_table(CLIP_COLUMNS, rows)] if rows else []),
        *faults[:MOST_FINDINGS_SHOWN],
        *_more(len(faults) - MOST_FINDINGS_SHOWN, " faults"),
        *([] if page is None else [Text(escaped(str(page)))]),
    )


def _clip_share(found: tuple[float, str] | None) -> str:
    return "" if found is None else f"{100 * found[0]:.0f} %"


def repair_summary(repair: fp.ClipRepair, path: Path, page: Path | None = None) -> RenderableType:
    """Return what ``floatplan clip repair`` did: a line for each unphysical flight, the file, and the page."""
    clip = repair.before.clip
    titles = ("flight", "done", "duration, s", "joints, deg rms", "most", "base", "feet, mm", "rate", "torque")
    rows: list[Sequence[str | Text]] = []
    reasons: list[Text] = []
    for each in repair.flights:
        found, flight = each.repaired, each.flight
        if found is None:
            continue
        when = f"{flight.begin:.2f} to {flight.end:.2f} s"
        shares = [_clip_share(share) for share in (found.rate_share, found.torque_share)]
        degrees = [
            f"{math.degrees(value):.2f}" for value in (found.joints_rms, found.joints_largest, found.base_largest)
        ]
        word = Text(str(found.choice), "green") if found.repairable else Text("left", "red")
        rows.append(
            (
                when,
                word,
                f"{flight.duration:.3f} to {found.duration:.3f}",
                *degrees,
                f"{1e3 * each.seam_foot:.1f}",
                *shares,
            )
        )
        if not found.repairable:
            reasons.append(Text(f"{when}: not repairable: {found.reason}", "red"))
        elif each.stance is not None and each.stance.vertical_least < 0:
            reasons.append(
                Text(
                    f"{when}: a stance beside it would have to pull at the ground: stances are bent, not planned",
                    "yellow",
                )
            )
    words = f"{clip.path.name}: {_counted(len(rows), 'flight')} of {len(repair.flights)} to repair"
    return Group(
        Text(escaped(words), f"bold {COLOURS['good' if repair.ok else 'bad']}"),
        *([_table(titles, rows)] if rows else []),
        *reasons[:MOST_FINDINGS_SHOWN],
        _named([Row("clip", escaped(str(path))), *([] if page is None else [Row("page", escaped(str(page)))])]),
    )


def clips_summary(checks: Sequence[fp.ClipCheck], page: Path | None = None) -> RenderableType:
    """Return a table of several clips, in their order, and the page."""
    titles = ("clip", "flights", "physical", "unphysical", "worst fall, m/s^2", "most off a flight, deg")
    rows = []
    for check in checks:
        falls = [each.fall.fall for each in check.flights if math.isfinite(each.fall.interval)]
        turns = [math.degrees(each.turn.rms) for each in check.flights if each.turn is not None]
        unphysical = sum(each.verdict == "unphysical" for each in check.flights)
        worst = f"{max(falls, key=lambda fall: abs(fall - check.gravity)):.2f}" if falls else ""
        name = Text(escaped(check.clip.path.name), COLOURS["good" if check.ok else "bad"])
        most = f"{max(turns):.2f}" if turns else ""
        rows.append((name, str(len(check.flights)), str(check.physical), str(unphysical), worst, most))
    return Group(_table(titles, rows, whole=True), *([] if page is None else [Text(escaped(str(page)))]))


def launch_summary(launch: fp.Launch) -> RenderableType:
    """Return the result of ``floatplan launch``, for reading."""
    verdict, *rest = launch.sentences
    unproved = "" if launch.impossible else "That none was found does not prove that none exists."
    remark = CHECKED if launch.ok else unproved
    lines = [Text(f"  {sentence}") for sentence in rest]
    tone: Tone = "good" if launch.ok else "bad"
    return Group(Text(verdict, f"bold {COLOURS[tone]}"), *lines, Text(remark, "dim"))


def flown_jump_summary(flown: fp.JumpReplay, files: Sequence[Path]) -> RenderableType:
    """Return the result of ``floatplan replay`` of a jump, for reading."""
    from floatplan.view.report.flights import LANDING_TITLES, jump_rows, summary

    stands = int(flown.landings.stands.sum())
    verdict = "stands in the end" if flown.landed else f"falls in {flown.flights - stands} of {flown.flights} flights"
    return Group(
        Text(verdict, f"bold {COLOURS['good' if flown.landed else 'bad']}"),
        Text(summary(flown)),
        Text(flown.control),
        _table(LANDING_TITLES, jump_rows(flown)) if flown.corrected is not None else _named(jump_rows(flown)),
        *(Text(escaped(str(path)), overflow="fold") for path in files),
    )


def flights_summary(flown: fp.ClosedLoop | None, authority: fp.Authority | None, page: Path | None) -> RenderableType:
    """Return the result of ``floatplan replay`` with --replan and --authority, for reading."""
    from floatplan.view.report.flights import LANDING_TITLES, landing_rows, summary

    parts: list[RenderableType] = []
    if flown is not None:
        parts += [Text(summary(flown), "bold"), _table(LANDING_TITLES, landing_rows(flown))]
    if authority is not None:
        parts.append(_table(AUTHORITY_TITLES, authority_rows(authority)))
    if page is not None:
        parts.append(Text(escaped(str(page)), overflow="fold"))
    return Group(*parts)


def authority_rows(found: fp.Authority) -> list[Sequence[str]]:
    """Return rows of (begin, momentum, inertia), for reading."""
    rows: list[Sequence[str]] = []
    for time, momentum, inertia in zip(found.times.tolist(), found.momentum, found.inertia, strict=True):
        rows.append((f"{time:.3g} s", _errors(*momentum.tolist()), _errors(*inertia.tolist())))
    return rows


def _errors(low: float, high: float) -> str:
    """From which to which relative errors, in words."""
    if math.isnan(low):
        return "none"
    return " to ".join(f"{100 * end:+.1f} %" if abs(end) >= 5e-4 else "0 %" for end in (low, high))


def _table(titles: Iterable[str], rows: Iterable[Sequence[str | Text]], whole: bool = False) -> Table:
    """A table without lines, all of it plain text; where it would not fit the terminal, its columns stand closer.

    Nothing is cut short; where ``whole``, names, which come first, are broken into lines before anything else is.
    """
    cells = [[cell if isinstance(cell, Text) else Text(cell) for cell in row] for row in ([*titles], *rows)]
    first, *others = (max(map(len, column)) for column in zip(*cells, strict=True))
    width = Console().width
    whole = whole and sum(others) + len(others) < width
    columns = [Column(cell.plain, no_wrap=whole and place > 0, overflow="fold") for place, cell in enumerate(cells[0])]
    close = first + sum(others) + 2 * len(others) > width
    table = Table(*columns, box=None, header_style="dim", pad_edge=False, collapse_padding=close)
    for row in cells[1:]:
        table.add_row(*row)
    return table


def _named(rows: Iterable[Row | Sequence[str]]) -> Table:
    """Names and what is said under them, broken where it is too long; what is not good is coloured."""
    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim", no_wrap=True)
    table.add_column()
    for row in map(Row._make, ((*row, "good")[:3] for row in rows)):
        table.add_row(row.name, Text(row.text, "" if row.tone == "good" else COLOURS[row.tone], overflow="fold"))
    return table


def _counted(count: int, what: str) -> str:
    return f"1 {what}" if count == 1 else f"{count} {what}s"


def _more(count: int, of: str = "") -> list[Text]:
    """What is said of rows that are left out."""
    return [Text(f"and {count} more{of}; --json has all", "dim")] if count > 0 else []
