"""Summaries of the commands' results for reading: problem, result, how good it is, where the files are."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, product
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

NONE = "not given"  # of a range


@dataclass(frozen=True)
class Shown:
    """How much of a result a terminal shows."""

    joints: int = 6  # rows of a table
    warnings: int = 3  # lines
    findings: int = 20  # rows of a table
    explanation: int = 800  # characters


SHOWN = Shown()
REACHABLE_TITLES = {
    "angular_momentum": "h, kg m^2/s",
    "horizontal_velocity": "horizontal, m/s",
    "vertical_velocity": "vertical, m/s",
}
COLOURS: Mapping[Tone, str] = {"good": "green", "open": "yellow", "bad": "red"}


def plan_summary(
    plan: fp.Plan, files: Sequence[Path], program: str = "floatplan", stances: Sequence[Row] = ()
) -> RenderableType:
    """Return at most 25 lines about a plan and the files that were written of it.

    ``program`` is what users type; ``stances`` is the rows about those before and after the flight.
    """
    problem, (word, tone), (status, *results) = plan.problem, plan_verdict(plan), result_rows(plan)
    obstacles = [_counted(len(problem.obstacles), "obstacle")] if problem.obstacles else []
    words = [
        problem.robot.name,
        _counted(len(problem.robot.joints), "joint"),
        f"{problem.flight.duration:g} s of flight",
    ]
    rows = [Row("problem", ", ".join([*words, *obstacles]))]
    for name, end in (("start", problem.initial), ("goal", problem.final)):
        turned = end.attitude or f"{math.degrees(end.orientation):z.6g}"
        rows.append(Row(name, f"{turned}; {shortened(np.degrees(end.positions), 6)} deg"))
    places: dict[str, Path] = {}  # by kind: pictures by their folder
    for path in files:
        is_picture = path.suffix in (".png", ".svg")
        places["figures" if is_picture else path.stem] = path.parent if is_picture else path
    written = [Row(name, escaped(str(path))) for name, path in places.items()]
    if "plan" in places and "report" not in places:
        written.append(Row("next", f"{program} show {shlex.quote(str(places['plan']))}"))
    warnings = plan.warnings[: SHOWN.warnings]
    warned = {warning.kind for warning in warnings}  # these say more of takeoff and landing than their rows
    results = [row for row in results if row.name not in warned]
    titles, cells = utilisation_table(plan.utilisation)
    explained = plan.explanation
    if len(explained) > SHOWN.explanation:
        explained = f"{explained[: SHOWN.explanation - 4]} ..."
    return Group(
        Text(f"{problem.name}: {word} ({status.text})", f"bold {COLOURS[tone]}"),
        _named([*rows, *results, *stances, *proof_rows(plan), *written]),
        _table(titles, cells[: SHOWN.joints], whole=True),
        *_more(len(cells) - SHOWN.joints),
        *([Text(explained, "" if plan.ok else "yellow")] if explained else []),
        *(Text(f"warning: {warning.message}", "yellow") for warning in warnings),
        *_more(len(plan.warnings) - SHOWN.warnings, " warnings"),
    )


def facts_summary(facts: Mapping[str, Any], frames: bool = False, shapes: bool = False) -> RenderableType:
    """Return the result of ``floatplan info``, for reading: joints first, frames and shapes on request."""
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
    carried = []
    for payload in facts["payload"]:
        position = shortened(payload["at"])
        carried.append(f"{payload['mass']:g} kg on {payload['link']} at {position} m")
    rows = [
        *([("payload", "; ".join(carried))] if carried else []),
        *_rotors(facts),
        (
            "locked, rad or m",
            ", ".join(f"{joint} = {position:.6g}" for joint, position in facts["locked"].items()) or "none",
        ),
        ("frames", ", ".join(facts["frames"]) if frames else f"{len(facts['frames'])}; --frames has them"),
        *([] if plane is None else _named_in_plane(facts, shapes)),
    ]
    warnings = [Text(f"warning: {warning}", "yellow") for warning in facts["warnings"]]
    titles = ("joint", "range, rad", "rad/s", "N m", *([] if plane is None else ["momentum by rate, kg m^2"]))
    open_limits = {NONE, short(None)} & set(chain.from_iterable(joints))
    note = [Text(f'{short(None)} or "{NONE}": the robot\'s file has no limit there, or 0, which counts as none')]
    return Group(
        table,
        _table(titles, joints),
        *(note if open_limits else []),
        *follows,
        _named(rows),
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
    rows = [
        ("shapes", (", ".join(capsules) or "none") if shapes else f"{len(capsules)}; --shapes has them"),
        ("out of plane", f"{facts['out_of_plane_leak']:.3g} times as much momentum out of the plane as in it"),
    ]
    if facts["tilt"]:
        rows.append(("tilt", f"axes turned onto the plane's normal by up to {facts['tilt']:.2g} rad"))
    inertia = f"{_span(facts['D_min'][0], facts['D_max'][0], 6)} kg m^2 about the centre of mass, by the posture"
    return [*rows, ("inertia", inertia)]


def _span(low: float, high: float, digits: int) -> str:
    """From one number to another, or the one that both are."""
    ends = dict.fromkeys(f"{end:z.{digits}g}" for end in (low, high))
    return " to ".join(ends)


def momentum_summary(problem: fp.Problem, facts: Mapping[str, Any]) -> RenderableType:
    """Return the result of ``floatplan bounds``, for reading: by directions and by rates of the joints."""
    low, high = facts["angular_momentum_bounds"]
    momentum = problem.flight.angular_momentum
    outside = not isinstance(momentum, str) and not low <= momentum <= high
    text = momentum if isinstance(momentum, str) else f"{momentum} kg m^2/s"
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
    rows: list[list[str | Text]] = [[*row] for row in cells[: SHOWN.findings]]
    for row, (_, word, *_) in zip(rows, cells, strict=False):
        row[1] = Text(word, colours[word])
    reasons = [f"goal.orientation: {reason}" for reason in certificate.reasons]
    return Group(verdict, *reasons, _table(titles, rows), *_more(len(cells) - SHOWN.findings))


def replay_summary(replay: fp.Replay) -> RenderableType:
    """Return the result of ``floatplan replay``, for reading."""
    landed = "landed" if replay.landed else "landed elsewhere, disturbed" if replay.disturbed else "missed the goal"
    tone: Tone = "good" if replay.landed else "open" if replay.disturbed else "bad"
    titles = {"times": "after, s", "orientation": "orientation, rad", "joints": "joints, rad", "com": "CM, m"}
    errors = zip(*(map(short, getattr(replay.growth, name)) for name in titles), strict=True)
    unstable = not replay.landed and not replay.disturbed and replay.feedback is None
    # 30 rad, bandwidth times duration, let a feedback track the paths of the joints
    tracked = short(30.0 / float(replay.growth.times[-1]))
    advice = f"with --feedback {tracked} an unstable motion lands all the same, a wrong plan does not"
    return Group(
        Text(f"{landed} in {replay.seconds:.3g} s", f"bold {COLOURS[tone]}"),
        _named(replay.rows()),
        _table(titles.values(), errors),
        *([Text(advice, "dim")] if unstable else []),
    )


def replays_summary(replays: Sequence[fp.Replay], requested: int) -> RenderableType:
    """Return the result of ``floatplan replay --runs``, for reading."""
    from floatplan.simulation.replay import landing_rows

    count = sum(flight.landed for flight in replays)
    landed = f"{count} of {len(replays)} landed"
    landed += f", of {requested} asked for" if len(replays) < requested else ""
    table = _table(("at landing", "median", "worst"), landing_rows(replays))
    return Group(Text(landed, "bold"), _named(replays[0].rows()[:1]), table)


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
        rows.append(
            ("each alone, by joint rates", *(_interval(facts[f"{end}_{key}_bounds"]) for key in REACHABLE_TITLES))
        )
    bounds = [facts[f"{end}_{key}_bounds"] or () for end, key in product(ends, REACHABLE_TITLES)]
    unlimited = all(None in ends_of_interval for ends_of_interval in bounds)
    note = "joints without velocity limits reach anything: limits.velocity sets them"
    return Group(_table(("", *REACHABLE_TITLES.values()), rows), *([Text(note, "dim")] if unlimited else []))


def _interval(bounds: Sequence[float | None] | None) -> str:
    if bounds is None:
        return "nothing"
    low, high = bounds
    if low is None or high is None:
        if low is not None:
            return f"above {low:z.5g}"
        return "no limit" if high is None else f"below {high:z.5g}"
    return _span(low, high, 5)


def jump_summary(jump: fp.Jump, files: Sequence[Path], seconds: float, program: str) -> RenderableType:
    """Return the result of ``floatplan jump``, for reading; ``program`` is what users type."""
    from floatplan.view.report.data import PHASES, STANCES, check_lines, phase_lines

    name = jump.problem.name
    took = f"in {seconds:.3g} s"
    if jump.flight is None:
        return Group(Text(f"{name}: {jump.verdict} {took}", "bold red"), Text(jump.explanation, "yellow"))
    broken, stance_rows = check_lines(jump.check, jump.request)
    written = [Row(path.stem, escaped(str(path))) for path in files]
    path = shlex.quote(str(files[0]))
    following = f"show {path} --scene    # the jump in 3-D"
    return Group(
        Text(f"{name}: jump found {took} ({jump.verdict})", f"bold {COLOURS[jump.tone]}"),
        _table(PHASES, phase_lines(jump)),
        *([Text(jump.explanation)] if jump.ok and jump.request.objective == "limits" else []),
        *(Text(", ".join(words), "red") for words in broken),
        *(Text(f"warning: {warning.message}", "yellow") for warning in jump.warnings[: SHOWN.warnings]),
        *_more(len(jump.warnings) - SHOWN.warnings, " warnings"),
        _table(STANCES, stance_rows),
        _named([*written, Row("next", f"{program} {following}")]),
        Text(CHECKED, "dim"),
    )


def clip_summary(check: fp.ClipCheck, page: Path | None = None) -> RenderableType:
    """Return what ``floatplan clip check`` reports of one clip, for reading: a line for each flight, and the page."""
    clip = check.clip
    rows: list[Sequence[str | Text]] = []
    faults: list[Text] = []
    for judged in check.flights:
        flight = judged.flight
        when = f"{flight.begin:.2f}..{flight.end:.2f} s"
        rotation = "too few frames" if judged.rotation is None else f"{math.degrees(judged.rotation.rms):.2f}"
        shares = list(map(_clip_share, (judged.torque_share, judged.rate_share)))
        fall = (
            f"{judged.fall.fall:.2f} +- {judged.fall.interval:.2f}" if math.isfinite(judged.fall.interval) else "open"
        )
        colour = {"physical": "green", "unphysical": "red"}.get(judged.verdict, "yellow")
        verdict = Text(judged.verdict, colour)
        rows.append((when, verdict, fall, rotation, *shares, f"{1e3 * judged.sliding:.0f}"))
        faults += [Text(f"{when}: {fault}", "red") for fault in judged.faults[: SHOWN.warnings]]
    titles = ("flight", "verdict", "fall, m/s^2", "turn off, deg", "torque", "rate", "slide, mm")
    words = f"{clip.path.name}: {clip.frames} frames at {clip.fps:g} Hz, {_counted(len(check.flights), 'flight')}"
    return Group(
        Text(escaped(words), f"bold {COLOURS['good' if check.ok else 'bad']}"),
        *(Text(remark, "dim") for remark in check.remarks),
        *([_table(titles, rows)] if rows else []),
        *faults[: SHOWN.findings],
        *_more(len(faults) - SHOWN.findings, " faults"),
        *([] if page is None else [Text(escaped(str(page)))]),
    )


def _clip_share(share: tuple[float, str] | None) -> str:
    return "" if share is None else f"{100 * share[0]:.0f} %"


def repair_summary(repair: fp.ClipRepair, path: Path, page: Path | None = None) -> RenderableType:
    """Return what ``floatplan clip repair`` did: a line for each unphysical flight, the file, and the page."""
    clip = repair.before.clip
    titles = ("flight", "done", "duration, s", "joints, deg rms", "most", "base", "feet, mm", "rate", "torque")
    rows: list[Sequence[str | Text]] = []
    reasons: list[Text] = []
    for flight_repair in repair.flights:
        repaired, flight = flight_repair.repaired, flight_repair.flight
        if repaired is None:
            continue
        when = f"{flight.begin:.2f} to {flight.end:.2f} s"
        shares = list(map(_clip_share, (repaired.rate_share, repaired.torque_share)))
        changes = np.degrees([repaired.joints_rms, repaired.joints_largest, repaired.base_largest])
        degrees = [f"{value:.2f}" for value in changes]
        word = Text(str(repaired.choice), "green") if repaired.repairable else Text("left", "red")
        rows.append(
            (
                when,
                word,
                f"{flight.duration:.3f} to {repaired.duration:.3f}",
                *degrees,
                f"{1e3 * flight_repair.seam_foot:.1f}",
                *shares,
            )
        )
        if not repaired.repairable:
            reasons.append(Text(f"{when}: not repairable: {repaired.reason}", "red"))
        reasons += [
            Text(f"{when}, {stance.sentence}", COLOURS["good" if stance.planned else "open"])
            for stance in flight_repair.stances
        ]
        if repaired.repairable and flight_repair.is_adhesive and not flight_repair.stances:
            reasons.append(
                Text(
                    f"{when}: a stance beside it would have to pull at the ground: stances are bent, not planned",
                    "yellow",
                )
            )
    reasons += [
        Text(
            f"{judged.flight.begin:.2f} to {judged.flight.end:.2f} s of the result is unphysical: "
            f"{'; '.join(judged.faults)}",
            "red",
        )
        for judged in repair.after.flights
        if judged.verdict == "unphysical"
    ]
    words = f"{clip.path.name}: {_counted(len(rows), 'flight')} of {len(repair.flights)} to repair"
    return Group(
        Text(escaped(words), f"bold {COLOURS['good' if repair.ok else 'bad']}"),
        *([_table(titles, rows)] if rows else []),
        *reasons[: SHOWN.findings],
        _named([Row("clip", escaped(str(path))), *([] if page is None else [Row("page", escaped(str(page)))])]),
    )


def clips_summary(checks: Sequence[fp.ClipCheck], page: Path | None = None) -> RenderableType:
    """Return a table of several clips, in their order, and the page."""
    titles = ("clip", "flights", "physical", "unphysical", "worst fall, m/s^2", "most off a flight, deg")
    rows = []
    for check in checks:
        falls = [flight.fall.fall for flight in check.flights if math.isfinite(flight.fall.interval)]
        turns = [math.degrees(flight.rotation.rms) for flight in check.flights if flight.rotation is not None]
        unphysical = sum(flight.verdict == "unphysical" for flight in check.flights)
        worst = f"{max(falls, key=lambda fall: abs(fall - check.gravity)):.2f}" if falls else ""
        name = Text(escaped(check.clip.path.name), COLOURS["good" if check.ok else "bad"])
        most = f"{max(turns):.2f}" if turns else ""
        rows.append((name, str(len(check.flights)), str(check.physical), str(unphysical), worst, most))
    return Group(_table(titles, rows, whole=True), *([] if page is None else [Text(escaped(str(page)))]))


def bench_summary(results: Sequence[fp.Bench]) -> RenderableType:
    """Return a table of motions that robots tracked, in their order, and of what differed."""
    titles = ("motion", "robot", "landed", "on feet only", "attitude, deg rms", "over torque limits", "torques")
    rows: list[tuple[str | Text, ...]] = []
    for result in results:
        facts = result.to_dict()
        name = Text(escaped(result.source), COLOURS["good" if result.ok else "bad"])
        of_flights = f" of {result.flights}"
        counts = [f"{count}{of_flights}" for count in (result.landed, result.clean)]
        pitch = result.landings.pitch_rms
        degrees = f"{math.degrees(pitch):.1f}" if math.isfinite(pitch) else ""
        over = f"{facts['torque_over_limits']}{of_flights}"
        rows.append((name, escaped(result.robot), *counts, degrees, over, result.torques))
    world = f"friction {results[0].friction:g}, {', '.join(results[0].perturbation.in_words())}"
    return Group(_table(titles, rows, whole=True), Text(f"MuJoCo with contact, {world}", "dim"))


def pack_summary(rows: Sequence[Mapping[str, str]]) -> RenderableType:
    """Return a table of the motions that come with floatplan."""
    titles = ("motion", "flight, s", "height, m", "torque", "rate", "landed", "on feet only")
    keys = ("name", "flight_s", "height_m", "torque_share", "rate_share")
    lines: list[tuple[str, ...]] = []
    for row in rows:
        landed = [f"{row[key]} of {row['flights']}" if row[key] else "" for key in ("landed", "on_feet_alone")]
        lines.append((*(row[key] for key in keys), *landed))
    robots = {row["robot"] for row in rows}
    words = f"{len(rows)} motions of {len(robots)} robots; floatplan motions get NAME writes one, for mjlab or with -f"
    return Group(_table(titles, lines, whole=True), Text(words, "dim"))


def launch_summary(launch: fp.Launch) -> RenderableType:
    """Return the result of ``floatplan launch``, for reading."""
    verdict, *sentences = launch.sentences
    unproved = "" if launch.impossible else "That none was found does not prove that none exists."
    remark = CHECKED if launch.ok else unproved
    lines = [Text(f"  {sentence}") for sentence in sentences]
    tone: Tone = "good" if launch.ok else "bad"
    return Group(Text(verdict, f"bold {COLOURS[tone]}"), *lines, Text(remark, "dim"))


def jump_replay_summary(replay: fp.JumpReplay, files: Sequence[Path]) -> RenderableType:
    """Return the result of ``floatplan replay`` of a jump, for reading."""
    from floatplan.view.report.flights import LANDING_TITLES, jump_rows, summary

    stands = int(replay.landings.stands.sum())
    verdict = (
        "stands in the end" if replay.landed else f"falls in {replay.flights - stands} of {replay.flights} flights"
    )
    return Group(
        Text(verdict, f"bold {COLOURS['good' if replay.landed else 'bad']}"),
        Text(summary(replay)),
        Text(replay.control),
        _table(LANDING_TITLES, jump_rows(replay)) if replay.corrected is not None else _named(jump_rows(replay)),
        *(Text(escaped(str(path)), overflow="fold") for path in files),
    )


def flights_summary(
    closed_loop: fp.ClosedLoop | None, authority: fp.Authority | None, page: Path | None
) -> RenderableType:
    """Return the result of ``floatplan replay`` with --replan and --authority, for reading."""
    from floatplan.view.report.flights import LANDING_TITLES, landing_rows, summary

    parts: list[RenderableType] = []
    if closed_loop is not None:
        parts += [Text(summary(closed_loop), "bold"), _table(LANDING_TITLES, landing_rows(closed_loop))]
    if authority is not None:
        in_plane = authority.momentum.ndim == 2
        of_momentum = ("momentum",) if in_plane else ("momentum x", "momentum y", "momentum z")
        titles = ("corrections begin at", *of_momentum, "inertia")
        parts.append(_table(titles, authority_rows(authority)))
    if page is not None:
        parts.append(Text(escaped(str(page)), overflow="fold"))
    return Group(*parts)


def authority_rows(authority: fp.Authority) -> list[Sequence[str]]:
    """Return rows of (begin, momentum, in space each of its components, inertia), for reading."""
    rows: list[Sequence[str]] = []
    for time, momentum, inertia in zip(authority.times.tolist(), authority.momentum, authority.inertia, strict=True):
        components = [_errors(*component) for component in momentum.reshape(-1, 2).tolist()]
        rows.append((f"{time:.3g} s", *components, _errors(*inertia.tolist())))
    return rows


def _errors(low: float, high: float) -> str:
    """From which to which relative errors, in words."""
    if math.isnan(low):
        return "none"
    return " to ".join(f"{100 * end:+.1f} %" if abs(end) >= 5e-4 else "0 %" for end in (low, high))


def _table(titles: Iterable[str], rows: Iterable[Sequence[str | Text]], whole: bool = False) -> Table:
    """A table without lines, its cells without markup; where it would not fit the terminal, its columns stand closer.

    Nothing is cut short; where ``whole``, names, which come first, are broken into lines before anything else is.
    """
    cells = []
    for row in ([*titles], *rows):
        texts = [cell if isinstance(cell, Text) else Text(cell) for cell in row]
        cells.append(texts)
    first, *others = (max(map(len, column)) for column in zip(*cells, strict=True))
    width = Console().width
    whole = whole and sum(others) + len(others) < width
    columns = [Column(cell.plain, no_wrap=whole and index > 0, overflow="fold") for index, cell in enumerate(cells[0])]
    close = first + sum(others) + 2 * len(others) > width
    table = Table(*columns, box=None, header_style="dim", pad_edge=False, collapse_padding=close)
    for row in cells[1:]:
        table.add_row(*row)
    return table


def _named(rows: Iterable[Row | Sequence[str]]) -> Table:
    """Names and what stands under them, broken where it is too long; what is not good is coloured."""
    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim", no_wrap=True)
    table.add_column()
    for row in map(Row._make, ((*row, "good")[:3] for row in rows)):
        table.add_row(row.name, Text(row.text, "" if row.tone == "good" else COLOURS[row.tone], overflow="fold"))
    return table


def _counted(count: int, what: str) -> str:
    return f"1 {what}" if count == 1 else f"{count} {what}s"


def _more(count: int, of: str = "") -> list[Text]:
    """The line about rows that are left out."""
    return [Text(f"and {count} more{of}; --json has all", "dim")] if count > 0 else []
