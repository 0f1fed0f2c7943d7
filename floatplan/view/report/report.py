"""The report: a plan as one page that plays, works without a network, and carries everything that it shows.

What comes from files (names of joints, frames and problems) is untrusted. It enters the page as escaped HTML, or as
JSON whose ``<``, ``>`` and ``&`` are escaped, which the page writes as text, never as markup. On top of that the page's
security policy admits no script but its own, identified by their hashes, and no address of any kind.
"""

import base64
import hashlib
import html
import json
import re
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import quote

from floatplan.arguments import html_table
from floatplan.errors import InputError
from floatplan.files import json_value, write_atomically
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.plans.plan import Plan
from floatplan.plans.presentation import Row, plan_verdict, raised
from floatplan.plans.trajectory import Trajectory
from floatplan.plans.verdicts import Tone
from floatplan.problem.file import problem_text
from floatplan.problem.problem import Problem
from floatplan.view.charts import charts
from floatplan.view.jumps import CheckedJump
from floatplan.view.report.data import chart_data, jump_data, jump_sections, motion_data, sample_grid, sections
from floatplan.view.sampled import SampledPlan


def report(
    plan: Trajectory,
    path: str | Path | None = None,
    stances: Sequence[Row] = (),
    verdict: tuple[str, Tone] | None = None,
) -> str:
    """Return the page of a plan or a jump, as HTML.

    Parameters
    ----------
    plan : Plan, Jump or a simulated jump
    path : path, optional
        Where the page will be: the problem file in it names the URDF from there.
    stances : sequence of Row
        About the stances before and after the flight, or about a simulated jump, if anything.
    verdict : words and their tone, optional
        Of a simulated jump; others have their own.
    """
    data = report_data(plan, path, stances, verdict)
    shown = {key: data[key] for key in ("name", "question", "version", "motion", "charts")}
    parts = {**data["verdict"], "facts": "".join([*map(section, data["sections"]), problem_section(data)])}
    return page(
        "report.html",
        f"{data['name']}: {parts['word']}",
        ("uplot/uPlot.min.css", "report.css"),
        (
            "uplot/uPlot.iife.min.js",
            "theme.js",
            "motion.js",
            "camera.js",
            "stage.js",
            "charts.js",
            "player.js",
            "report.js",
        ),
        shown,
        parts,
    ).decode()


def page(
    body: str,
    title: str,
    styles: Sequence[str],
    scripts: Sequence[str],
    data: Mapping[str, Any],
    parts: Mapping[str, str] | None = None,
    numbers: bytes = b"",
) -> bytes:
    """Return a page, as HTML.

    Parameters
    ----------
    body : file of the template of what is on the page
    title : of the page
    styles, scripts : files
    data : what JSON holds; ``name``, ``question`` and ``version`` are on the page, too
    parts : other HTML of the body, by its names there
    numbers : bytes for the body's mark ``{{numbers}}``, which are not searched
    """
    licence = f"/*\n{asset('uplot/LICENSE')}\n*/\n"  # of uPlot 1.6.32, which is to be passed on with it
    texts = [licence * name.startswith("uplot") + asset(name) for name in scripts]
    template = asset("page.html").replace("{{body}}", asset(body)).replace("{{player}}", asset("player.html"))
    elements = [f'<script type="application/json" id="data">{escaped_json(data)}</script>']
    elements += [f"<script>{script}</script>" for script in texts]
    content = {
        **(parts or {}),
        **{key: html.escape(data[key]) for key in ("name", "question", "version")},
        "title": html.escape(title),
        "policy": policy(texts),
        "style": "\n".join(map(asset, styles)),
        "scripts": "\n".join(elements),
    }
    return numbers.join(filled(text, content).encode() for text in template.split("{{numbers}}"))


def section(content: Mapping[str, Any]) -> str:
    """Return a section of :func:`report_data` as HTML."""
    rows = "".join(f"<dt>{html.escape(name)}</dt><dd>{html.escape(text)}</dd>" for name, text in content["rows"])
    note = f'<p class="note">{html.escape(content["note"])}</p>' if content.get("note") else ""
    motors = _wide_table(content["motors"]) if "motors" in content else ""
    findings = content.get("findings", ((), []))
    folded = f"<summary>All {len(findings[1])} constraints</summary>{_wide_table(findings)}"
    more = note + motors + (f"<details>{folded}</details>" if findings[1] else "")
    look = content.get("tone", "") + " motors" * ("motors" in content)
    return f'<article class="{look}"><h2>{html.escape(content["title"])}</h2><dl>{rows}</dl>{more}</article>'


def _wide_table(table: tuple[Sequence[str], Sequence[Sequence[str]]]) -> str:
    return f'<div class="wide">{html_table("", table[1], table[0])}</div>'


def problem_section(data: Mapping[str, Any]) -> str:
    """Return the problem file of :func:`report_data` as HTML, to read and to save."""
    summary = "The problem file, as written" if data["own_problem"] else "The problem, as a file"
    name = re.sub(r"[^\w.-]+", "_", data["name"]) or "problem"
    content = data["problem"]
    link = f'<a class="download" download="{name}.toml" href="data:application/toml,{quote(content)}">Save it</a>'
    text = f"<summary>{summary}</summary><pre>\n{html.escape(content)}</pre>{link}"
    return f'<article class="file"><details>{text}</details></article>'


def write_report(
    plan: Trajectory, path: str | Path, stances: Sequence[Row] = (), verdict: tuple[str, Tone] | None = None
) -> Path:
    """Write the page of a plan, whole or not at all; arguments as of :func:`report`."""
    return write_atomically(path, report(plan, path, stances, verdict))


def notebook_frame(plan: Trajectory) -> str:
    """Return the page as an element of another page, such as a notebook: it keeps to its own frame."""
    content = html.escape(report(plan))
    style = "width: 100%; height: 860px; border: 1px solid #ddd"
    return f'<iframe srcdoc="{content}" style="{style}" title="flight"></iframe>'


def report_data(
    plan: Trajectory,
    path: str | Path | None = None,
    stances: Sequence[Row] = (),
    verdict: tuple[str, Tone] | None = None,
) -> dict[str, Any]:
    """Return all that the page shows, as what JSON holds; arguments as of :func:`report`."""
    sampled = SampledPlan.of(plan, sample_grid(plan.duration))
    motion = motion_data(sampled)
    problem = plan.problem
    if isinstance(plan, Plan):
        flight = plan
        tables = sections(plan, stances)
        word, tone = plan_verdict(plan)
        question = f"{plan.duration:g} s of flight"
    else:
        assert isinstance(plan, JumpMotion)
        assert plan.flight is not None
        flight = plan.flight
        word, tone = (plan.verdict, plan.tone) if isinstance(plan, CheckedJump) else verdict or ("", "open")
        tables = jump_sections(plan, tone, stances)
        motion |= jump_data(plan)
        in_flight = sum(own.duration for own in plan.flights)
        begin = "a running start" if plan.request.takeoff.in_motion else "standing"
        span = "of one period" if plan.request.is_periodic else f"from {begin} to standing"
        question = f"{plan.duration:.3g} s {span}, {in_flight:.3g} s of it in flight"
    for table in tables:
        table["rows"] = [(row[0], raised(row[1])) for row in table["rows"]]
    data: dict[str, Any] = json_value(
        {
            "name": problem.name,
            "verdict": {"word": word, "tone": tone},
            "question": f"{problem.robot.name}, {question}",
            "motion": motion,
            "charts": [chart_data(chart, sampled) for chart in charts(sampled)],
            "sections": tables,
            "problem": _problem_file(problem, path),
            "own_problem": problem.file_text is not None,
            "version": flight.record.floatplan,
        }
    )
    return data


def escaped_json(content: Any) -> str:
    """Return JSON that can stand inside ``<script>``: no text in it can end the element, or begin one."""
    return json.dumps(content, allow_nan=False, separators=(",", ":")).translate(
        {ord(letter): f"\\u{ord(letter):04x}" for letter in "<>&\u2028\u2029"}
    )


def filled(template: str, parts: Mapping[str, str]) -> str:
    """Replace the marks ``{{name}}`` of a template in one pass: what is put in is not searched again."""
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], template)


def policy(scripts: Sequence[str]) -> str:
    """Return the security policy of a page with no other scripts than these, and no address of any kind."""
    hashes = []
    for script in scripts:
        digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
        hashes.append(f"'sha256-{digest}'")
    allowed = " ".join(hashes) or "'none'"
    return f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src {allowed}"


def asset(name: str) -> str:
    """Return a file that the pages are made of."""
    return files("floatplan.view.report").joinpath("assets", *name.split("/")).read_text(encoding="utf-8")


def _problem_file(problem: Problem, path: str | Path | None) -> str:
    """The problem file as its user wrote it; else the problem as it was resolved."""
    if problem.file_text is not None:
        return problem.file_text
    try:
        return problem_text(problem, Path("problem.toml") if path is None else Path(path))
    except InputError as error:
        return f"# {error}\n"
