"""What the page says, as HTML: pure functions of what is to be shown."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from html import escape

from floatplan.arguments import short
from floatplan.plans.measures import Utilisation, limits_shown
from floatplan.plans.presentation import Row, raised
from floatplan.plans.verdicts import Tone, verdict_in_words
from floatplan.studio.answers import COLUMNS, ROWS, Map, MapPoint, ShownPlan
from floatplan.studio.curves import AMBER, BLUE, GREEN, RED, colour_of
from floatplan.studio.session import Verdict, View
from floatplan.tables import LimitRow

GREY = "#7a7f87"
BLACK = "#3a3f45"
MOST_WARNINGS = 6  # [-] listed; the others are counted
WIDEST = 1.25  # [-] share of a limit at the end of a bar

BEFORE_THE_END: Mapping[Verdict, tuple[str, str]] = {  # of a search or a proof
    "waiting": (GREY, "Searching …"),
    "planned": (BLUE, "Planned; proving …"),
    "failed": (RED, "Not possible"),
    "stopped": (GREY, "Stopped"),
}
COLOURS: Mapping[Tone, str] = {"good": GREEN, "open": AMBER, "bad": RED}


def is_news(drawn: View | None, view: View) -> bool:
    """Whether a view is to be drawn at once: that a search has begun matters only where it lasts."""
    if drawn is None or view.is_current or view.fault or view.refusal != drawn.refusal:
        return True
    return view.answer is not drawn.answer or view.doing not in ("", drawn.doing)


def status_card(view: View) -> str:
    """The verdict in a colour, why, and the numbers that count."""
    answer = view.answer
    known = BEFORE_THE_END.get(view.verdict)
    colour, headline = known or BEFORE_THE_END["waiting"]
    if known is None and answer is not None:
        words, tone = _verdict(answer)
        colour = COLOURS[tone]
        headline = words.capitalize()
    parts = []
    if view.refusal:
        parts.append(f'<div class="band refusal"><b>Not changed</b><p>{escape(view.refusal)}</p></div>')
    attributes = f'data-verdict="{view.verdict}" data-number="{view.number}" data-answers="{view.answered}"'
    band = f'<div class="band" style="--c:{colour}" {attributes}><b>{headline}</b>{_paragraphs(*_words(view))}</div>'
    parts.append(band)
    if view.answer is not None:
        facts = "".join(f"<div><span>{name}</span>{value}</div>" for name, value in _facts(view.answer))
        parts.append(f'<div class="facts">{facts}</div>')
    return f'<div class="fp status" id="floatplan-status" role="status">{"".join(parts)}</div>'


def warning_card(view: View) -> str:
    """What is said beside the verdict: of stances before and after the flight, and what the plan does unasked."""
    answer = view.answer
    parts = list[str]()
    if answer is not None and view.is_current:
        parts += map(_stance, answer.stances)
    if answer is not None and answer.plan.ok and answer.warnings:
        warnings = [warning.message for warning in answer.warnings]
        more = [f"and {len(warnings) - MOST_WARNINGS} more"] if len(warnings) > MOST_WARNINGS else []
        listed = _paragraphs(*warnings[:MOST_WARNINGS], *more)
        parts.append(f'<div class="band warning"><b>Beside the verdict</b>{listed}</div>')
    return f'<div class="fp beside" id="floatplan-beside" role="status">{"".join(parts)}</div>'


def _verdict(answer: ShownPlan) -> tuple[str, Tone]:
    """The verdict in a few words, and its tone."""
    if answer.jump is not None:
        return answer.jump.verdict, "bad" if answer.found_jump is None else answer.found_jump.tone
    return verdict_in_words(answer.plan.ok, answer.plan.certificate, bool(answer.warnings))


def _stance(row: Row) -> str:
    return f'<div class="band" style="--c:{COLOURS[row.tone]}" data-stance="{row.tone}">{_paragraphs(row.text)}</div>'


def _words(view: View) -> list[str]:
    answer = view.answer
    if view.fault:
        return [view.fault]
    doing = [f"{view.doing[0].upper()}{view.doing[1:]} …"] if view.doing else []
    if answer is None or not view.is_current:
        return doing and [*doing, *(["Shown is what was found before."] if answer else [])]
    if answer.jump is not None:
        return [answer.jump.explanation, *([] if answer.found_jump else ["Shown is a flight alone."])]
    if view.verdict == "not found":
        return [answer.plan.explanation, "Shown is the nearest motion found."]
    if view.verdict == "waiting":
        return [*doing, f"Shown is {'the nearest motion so far' if view.problem.jump is None else 'a flight alone'}."]
    if answer.plan.certificate is None:
        return []
    if view.verdict == "proved":
        count = len(answer.plan.certificate.findings)
        return [f"All {count} constraints hold at every instant, from takeoff to landing."]
    return [f"{finding.verdict}: {finding.label}" for finding in answer.plan.certificate.unproved[:MOST_WARNINGS]]


def _paragraphs(*words: str) -> str:
    return "".join(f"<p>{escape(each)}</p>" for each in words)


def _facts(answer: ShownPlan) -> list[tuple[str, str]]:
    plan = answer.plan
    use = answer.largest_use
    jump = answer.found_jump
    height = [] if jump is None else [("height", f"{jump.height:.3g} m"), ("of it in flight", f"{plan.duration:.4g} s")]
    facts = [
        ("duration", f"{answer.motion.duration:.4g} s"),
        *reversed(height),
        ("angular momentum", f"{short(plan.angular_momentum, 3)} kg m²/s"),
    ]
    if use is not None:
        facts.append(("most used limit", f'<b style="color:{colour_of(use)}">{use:.0%}</b>'))
    if jump is not None:
        facts.append(("friction used", f"{jump.check.figures['friction']:.2f}"))
    if answer.clearance is not None and jump is None:
        facts.append(("least clearance", f"{1e3 * answer.clearance:.4g} mm"))
    return facts


def limits_card(answer: ShownPlan | None) -> str:
    """A row for each motor: what it reaches, and how much of its limits that is; of a jump, over all of it."""
    if answer is None:
        return ""
    if answer.found_jump is not None:
        peaks = [
            (f"{escape(name)}, {each.title}", float(most), each.limited)
            for each in answer.shares
            for name, most in zip(each.names, each.values.max(axis=1), strict=True)
        ]
        rows = "".join(f"<tr><td>{name}<td>{use:.0%}<td>{_bar(use)}</tr>" for name, use, limited in peaks if limited)
        return f'<div class="fp"><table><tr><th>of limits<th>most<th></tr>{rows}</table></div>'
    limits = limits_shown(answer.utilisation)
    motors = answer.plan.robot.motors
    titles = "".join(f"<th>{limit.title.lower()}, {raised(limit.unit)}<th>" for limit in limits)
    ordered = sorted(answer.utilisation, key=lambda row: motors.index(row.joint))
    rows = "".join(_motor(row, limits) for row in ordered)
    return f'<div class="fp"><table><tr><th>motor{titles}</tr>{rows}</table></div>'


def _motor(row: Utilisation, limits: Iterable[LimitRow]) -> str:
    cells = []
    for key in (limit.key for limit in limits):
        peak, most, use = (getattr(row, f"{key}_{name}") for name in ("peak", "limit", "utilisation"))
        cells.append(f"<td>{short(peak, 3)}{'' if most is None else f' / {short(most, 3)}'}<td>{_bar(use)}")
    return f"<tr><td>{escape(row.joint)}{''.join(cells)}</tr>"


def _bar(use: float | None) -> str:
    if use is None:
        return ""
    return (
        f'<div class="bar" title="{use:.0%}">'
        f'<i style="width:{100 * min(use / WIDEST, 1.0):.1f}%;background:{colour_of(use)}"></i>'
        f'<u style="left:{100 / WIDEST:.1f}%"></u></div>'
    )


def map_card(chart: Map | None, wanted: bool) -> str:
    """The map; page.js lets a click on a point press the button that jumps there."""
    if chart is None:
        words = "Drawn when the plan is proved." if wanted else "Switched off."
        return f'<div class="fp"><p>{words}</p></div>'
    cells = []
    for row in reversed(range(ROWS)):
        cells.append(f'<span class="axis">{chart.durations[row]:.3g} s</span>')
        cells += [_point(chart, row, column) for column in range(COLUMNS)]
    cells.append("<span></span>")
    for index, value in enumerate(chart.momenta):
        cells.append(f'<span class="axis">{short(value, 2) if index % 2 == 0 else ""}</span>')
    unit = "share of the limits used" if chart.relative else "largest torque, N m"
    return (
        '<div class="fp" id="floatplan-map">'
        "<p>Duration (up) and angular momentum, kg m²/s (right). Click a point to go there.</p>"
        f'<div class="map" style="grid-template-columns:3.6em repeat({COLUMNS},1fr)">{"".join(cells)}</div>'
        f'<p class="key">In a point: {unit}. <i style="background:{GREY}"></i>none found quickly '
        f'<i style="background:{BLACK}"></i>impossible</p></div>'
    )


def _point(chart: Map, row: int, column: int) -> str:
    point = chart.points.get((row, column))
    here = " here" if (row, column) == (ROWS // 2, COLUMNS // 2) else ""
    colour, text = _point_look(chart, point)
    where = f"T = {chart.durations[row]:.4g} s, h = {short(chart.momenta[column], 3)} kg m²/s"
    status = "not planned yet" if point is None else point.status.replace("_", " ")
    attributes = f'title="{where}: {status}" data-point="{row},{column}" data-status="{status}"'
    return f'<span class="point{here}" style="background:{colour}" {attributes}>{text}</span>'


def _point_look(chart: Map, point: MapPoint | None) -> tuple[str, str]:
    """Colour and text of a point."""
    if point is None:
        return "#e8eaed", ""
    use = point.use
    if use is None:
        return (BLACK if point.status == "impossible" else GREY), ""
    if chart.relative:
        return colour_of(use), f"{use:.0%}".rstrip("%")
    logs = [math.log(each.use) for each in chart.points.values() if each.use is not None and 0 < each.use < math.inf]
    width = max(logs, default=0.0) - min(logs, default=0.0)
    share = (math.log(use) - min(logs)) / width if width > 0 and 0 < use < math.inf else 0.0
    return f"hsl({150 - 120 * share:.0f} 60% 29%)", f"{use:.0f}" if 10 <= use < 1e4 else short(use, 2)


def comparison_card(answer: ShownPlan | None, kept: ShownPlan | None) -> str:
    """Two plans side by side."""
    if kept is None or answer is None:
        words = "Keep the present plan, change something, and both fly side by side."
        return f'<div class="fp"><p>{words}</p></div>'
    rows = "".join(
        f"<tr><td>{name}<td>{_compared(get(kept), unit)}<td>{_compared(get(answer), unit)}</tr>"
        for name, unit, get in COMPARED
    )
    head = "<tr><th><th>kept (violet)<th>present</tr>"
    return f'<div class="fp" id="floatplan-comparison"><table>{head}{rows}</table></div>'


def _compared(value: str | float | None, unit: str) -> str:
    return value if isinstance(value, str) else short(value, 3) + ("" if value is None else unit)


def _of_flight(get: Callable[[ShownPlan], float | None]) -> Callable[[ShownPlan], float | None]:
    """What is known of flights alone, not of jumps around them."""
    return lambda each: get(each) if each.found_jump is None else None


COMPARED: Sequence[tuple[str, str, Callable[[ShownPlan], str | float | None]]] = (
    ("plan", "", lambda each: "found" if (each.jump or each.plan).ok else "not found"),
    ("duration", " s", lambda each: each.motion.duration),
    ("angular momentum", " kg m²/s", lambda each: each.plan.angular_momentum),
    ("objective", "", _of_flight(lambda each: each.plan.objective_value)),
    ("most used limit", "%", lambda each: None if each.largest_use is None else 100 * each.largest_use),
    (
        "largest torque",
        " N m",
        _of_flight(lambda each: max((row.torque_peak for row in each.utilisation), default=None)),
    ),
    (
        "largest rate",
        " rad/s",
        _of_flight(lambda each: max((row.velocity_peak for row in each.utilisation), default=None)),
    ),
    ("least clearance", " mm", _of_flight(lambda each: None if each.clearance is None else 1e3 * each.clearance)),
)


def saved_card(lines: Iterable[str]) -> str:
    """What was saved, or why not."""
    return f'<div class="fp" id="floatplan-saved">{_paragraphs(*lines)}</div>'
