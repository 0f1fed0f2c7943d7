"""Cards of the page, as HTML: pure functions of the view."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from html import escape

from floatplan.arguments import short
from floatplan.plans.measures import Utilisation, limits_shown, momentum_in_one_number
from floatplan.plans.presentation import Row, raised
from floatplan.plans.verdicts import Tone, verdict_in_words
from floatplan.studio.curves import Colour, colour_of
from floatplan.studio.session import Verdict, View
from floatplan.studio.tasks import COLUMNS, ROWS, Map, MapPoint, ShownPlan
from floatplan.tables import LimitRow

MOST_WARNINGS = 6  # [-] in a list; others are counted

IN_PROGRESS: Mapping[Verdict, tuple[str, str]] = {  # of a search or a proof
    "waiting": (Colour.GREY, "Searching …"),
    "planned": (Colour.BLUE, "Planned; proving …"),
    "failed": (Colour.RED, "Not possible"),
    "stopped": (Colour.GREY, "Stopped"),
}
COLOURS: Mapping[Tone, str] = {"good": Colour.GREEN, "open": Colour.AMBER, "bad": Colour.RED}


def is_news(shown: View | None, view: View) -> bool:
    """Whether to show a view at once; the beginning of a search need only be shown if the search lasts."""
    if shown is None or view.is_current or view.fault or view.refusal != shown.refusal:
        return True
    return view.result is not shown.result or view.doing not in ("", shown.doing)


def status_card(view: View) -> str:
    """The verdict in a colour, why, and the numbers that count."""
    result = view.result
    colour, headline = IN_PROGRESS.get(view.verdict, IN_PROGRESS["waiting"])
    if view.verdict not in IN_PROGRESS and result is not None:
        words, tone = _verdict(result)
        colour = COLOURS[tone]
        headline = words.capitalize()
    parts = []
    if view.refusal:
        parts.append(f'<div class="band refusal"><b>Not changed</b><p>{escape(view.refusal)}</p></div>')
    attributes = f'data-verdict="{view.verdict}" data-number="{view.number}" data-answers="{view.result_number}"'
    band = (
        f'<div class="band" style="--c:{colour}" {attributes}><b>{headline}</b>{_paragraphs(_status_words(view))}</div>'
    )
    parts.append(band)
    if view.result is not None:
        facts = "".join(f"<div><span>{name}</span>{value}</div>" for name, value in _facts(view.result))
        parts.append(f'<div class="facts">{facts}</div>')
    return f'<div class="fp status" id="floatplan-status" role="status">{"".join(parts)}</div>'


def warning_card(view: View) -> str:
    """Warnings: about the stances before and after the flight, and about side effects of the plan."""
    result = view.result
    parts = list[str]()
    if result is not None and view.is_current:
        parts += map(_stance, result.stances)
    if result is not None and result.plan.ok and result.warnings:
        warnings = [warning.message for warning in result.warnings]
        if len(warnings) > MOST_WARNINGS:
            warnings[MOST_WARNINGS:] = [f"and {len(warnings) - MOST_WARNINGS} more"]
        parts.append(f'<div class="band warning"><b>Beside the verdict</b>{_paragraphs(warnings)}</div>')
    return f'<div class="fp beside" id="floatplan-beside" role="status">{"".join(parts)}</div>'


def _verdict(result: ShownPlan) -> tuple[str, Tone]:
    """The verdict in a few words, and its tone."""
    if result.jump is not None:
        return result.jump.verdict, "bad" if result.solved_jump is None else result.solved_jump.tone
    return verdict_in_words(result.plan.ok, result.plan.certificate, bool(result.warnings))


def _stance(row: Row) -> str:
    return f'<div class="band" style="--c:{COLOURS[row.tone]}" data-stance="{row.tone}">{_paragraphs([row.text])}</div>'


def _status_words(view: View) -> list[str]:
    """What the status card explains, a paragraph each."""
    result = view.result
    if view.fault:
        return [view.fault]
    words = list[str]()
    if view.doing:
        words.append(f"{view.doing[0].upper()}{view.doing[1:]} …")
    if result is None or not view.is_current:
        if words and result:
            words.append("Shown is what was found before.")
        return words
    if result.jump is not None:
        return (
            [result.jump.explanation] if result.solved_jump else [result.jump.explanation, "Shown is a flight alone."]
        )
    if view.verdict == "not found":
        return [result.plan.explanation, "Shown is the nearest motion found."]
    if view.verdict == "waiting":
        shown = "the nearest motion so far" if view.problem.jump is None else "a flight alone"
        return [*words, f"Shown is {shown}."]
    if result.plan.certificate is None:
        return []
    if view.verdict == "proved":
        count = len(result.plan.certificate.findings)
        return [f"All {count} constraints hold at every instant, from takeoff to landing."]
    return [f"{finding.verdict}: {finding.label}" for finding in result.plan.certificate.unproved[:MOST_WARNINGS]]


def _paragraphs(texts: Iterable[str]) -> str:
    return "".join(f"<p>{escape(text)}</p>" for text in texts)


def _facts(result: ShownPlan) -> list[tuple[str, str]]:
    plan = result.plan
    use = result.largest_use
    jump = result.solved_jump
    facts = [("duration", f"{result.motion.duration:.4g} s")]
    if jump is not None:
        facts.append(("of it in flight", f"{plan.duration:.4g} s"))
        facts.append(("height", f"{jump.height:.3g} m"))
    facts.append(("angular momentum", f"{short(momentum_in_one_number(plan), 3)} kg m²/s"))
    if use is not None:
        facts.append(("most used limit", f'<b style="color:{colour_of(use)}">{use:.0%}</b>'))
    if jump is not None:
        facts.append(("friction used", f"{jump.check.figures['friction']:.2f}"))
    if result.clearance is not None and jump is None:
        facts.append(("least clearance", f"{1e3 * result.clearance:.4g} mm"))
    return facts


def limits_card(result: ShownPlan | None) -> str:
    """A row for each motor: its peaks, and their shares of its limits; of a jump, over all of it."""
    if result is None:
        return ""
    rows = list[str]()
    if result.solved_jump is not None:
        for shares in result.shares:
            if shares.limited:
                for name, use in zip(shares.names, shares.values.max(axis=1).tolist(), strict=True):
                    rows.append(f"<tr><td>{escape(name)}, {shares.title}<td>{use:.0%}<td>{_bar(use)}</tr>")
        return f'<div class="fp"><table><tr><th>of limits<th>most<th></tr>{"".join(rows)}</table></div>'
    limits = limits_shown(result.utilisation)
    motors = result.plan.robot.motors
    titles = "".join(f"<th>{limit.title.lower()}, {raised(limit.unit)}<th>" for limit in limits)
    for row in sorted(result.utilisation, key=lambda row: motors.index(row.joint)):
        rows.append(_motor(row, limits))
    return f'<div class="fp"><table><tr><th>motor{titles}</tr>{"".join(rows)}</table></div>'


def _motor(row: Utilisation, limits: Iterable[LimitRow]) -> str:
    cells = []
    for limit in limits:
        peak = getattr(row, f"{limit.key}_peak")
        most = getattr(row, f"{limit.key}_limit")
        bound = "" if most is None else f" / {short(most, 3)}"
        cells.append(f"<td>{short(peak, 3)}{bound}<td>{_bar(getattr(row, f'{limit.key}_utilisation'))}")
    return f"<tr><td>{escape(row.joint)}{''.join(cells)}</tr>"


def _bar(use: float | None) -> str:
    if use is None:
        return ""
    widest = 1.25  # [-] share of a limit at the end of a bar: a limit that is broken is seen to be
    return (
        f'<div class="bar" title="{use:.0%}">'
        f'<i style="width:{100 * min(use / widest, 1.0):.1f}%;background:{colour_of(use)}"></i>'
        f'<u style="left:{100 / widest:.1f}%"></u></div>'
    )


def map_card(chart: Map | None, enabled: bool) -> str:
    """The map; page.js lets a click on a point press the button that jumps there."""
    if chart is None:
        words = "Drawn when the plan is proved." if enabled else "Switched off."
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
        f'<p class="key">In a point: {unit}. <i style="background:{Colour.GREY}"></i>none found quickly '
        f'<i style="background:{Colour.BLACK}"></i>impossible</p></div>'
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
        return (Colour.BLACK if point.status == "impossible" else Colour.GREY), ""
    if chart.relative:
        return colour_of(use), f"{use:.0%}".rstrip("%")
    # without limits torques are compared with one another, by their logarithms
    uses = [other.use for other in chart.points.values() if other.use is not None]
    logs = [math.log(value) for value in uses if 0 < value < math.inf]
    width = max(logs, default=0.0) - min(logs, default=0.0)
    share = (math.log(use) - min(logs)) / width if width > 0 and 0 < use < math.inf else 0.0
    return f"hsl({150 - 120 * share:.0f} 60% 29%)", f"{use:.0f}" if 10 <= use < 1e4 else short(use, 2)


def comparison_card(result: ShownPlan | None, compared: ShownPlan | None) -> str:
    """Two plans side by side."""
    if compared is None or result is None:
        words = "Keep the present plan, change something, and both fly side by side."
        return f'<div class="fp"><p>{words}</p></div>'
    rows = list[str]()
    for name, unit, get in COMPARED:
        rows.append(f"<tr><td>{name}<td>{_compared(get(compared), unit)}<td>{_compared(get(result), unit)}</tr>")
    head = "<tr><th><th>kept (violet)<th>present</tr>"
    return f'<div class="fp" id="floatplan-comparison"><table>{head}{"".join(rows)}</table></div>'


def _compared(value: str | float | None, unit: str) -> str:
    return value if isinstance(value, str) else short(value, 3) + ("" if value is None else unit)


def _of_flight(get: Callable[[ShownPlan], float | None]) -> Callable[[ShownPlan], float | None]:
    """A quantity of flights; None of jumps around them."""
    return lambda solved: get(solved) if solved.solved_jump is None else None


def _largest_torque(solved: ShownPlan) -> float | None:
    return max((row.torque_peak for row in solved.utilisation), default=None)


def _largest_rate(solved: ShownPlan) -> float | None:
    return max((row.velocity_peak for row in solved.utilisation), default=None)


COMPARED: Sequence[tuple[str, str, Callable[[ShownPlan], str | float | None]]] = (
    ("plan", "", lambda solved: "found" if (solved.jump or solved.plan).ok else "not found"),
    ("duration", " s", lambda solved: solved.motion.duration),
    ("angular momentum", " kg m²/s", lambda solved: momentum_in_one_number(solved.plan)),
    ("objective", "", _of_flight(lambda solved: solved.plan.objective_value)),
    ("most used limit", "%", lambda solved: None if solved.largest_use is None else 100 * solved.largest_use),
    ("largest torque", " N m", _of_flight(_largest_torque)),
    ("largest rate", " rad/s", _of_flight(_largest_rate)),
    ("least clearance", " mm", _of_flight(lambda solved: None if solved.clearance is None else 1e3 * solved.clearance)),
)


def saved_card(lines: Iterable[str]) -> str:
    """Messages about saved files."""
    return f'<div class="fp" id="floatplan-saved">{_paragraphs(lines)}</div>'
