"""What the page says, of hostile names and extreme numbers too."""

from __future__ import annotations

from dataclasses import replace
from io import StringIO
from itertools import product
from pathlib import Path

import pytest
from rich.console import Console

import floatplan as fp
from floatplan.cli.summary import plan_summary
from floatplan.plans.measures import PlanWarning, limits_shown
from floatplan.plans.presentation import Row, plan_verdict
from floatplan.studio import cards, tasks
from floatplan.studio.curves import curves_card
from floatplan.studio.session import View
from floatplan.studio.tasks import COLUMNS, ROWS, LaunchTask, Map, MapPoint, ShownPlan

ROOT = Path(__file__).parents[2]
HOSTILE = "<img src=x onerror='window.broken = 1'>&\"'"


@pytest.fixture(scope="module")
def present() -> ShownPlan:
    return ShownPlan.of(fp.plan(fp.load_problem(ROOT / "problems" / "obstacle.toml"), prove=True), settled=True)


def test_a_verdict_for_each_stage(present: ShownPlan) -> None:
    view = View(present.plan.problem)
    assert view.verdict == "waiting"
    answered = replace(view, result=present)
    assert answered.verdict == "proved"
    assert replace(answered, number=3).verdict == "waiting"
    assert replace(answered, fault="no").verdict == "failed"
    quick = replace(present, settled=False, plan=replace(present.plan))
    assert replace(view, result=quick).verdict == "planned"
    missed = replace(quick, plan=replace(quick.plan, ok=False))
    assert replace(view, result=missed).verdict == "waiting"
    assert replace(view, result=replace(missed, settled=True)).verdict == "not found"
    for word in ("refuted", "undecided"):
        certificate = {**present.plan.record.certificate, "verdict": word}
        plan = present.plan.with_record(replace(present.plan.record, certificate=certificate))
        judged = replace(present, plan=plan)
        assert replace(view, result=judged).verdict == word
        assert word in cards.status_card(replace(view, result=judged)).lower()


def test_stances_are_told_of_the_present_answer_alone(present: ShownPlan, monkeypatch: pytest.MonkeyPatch) -> None:
    found = (Row("takeoff stance", f"Takeoff: {HOSTILE}", "good"), Row("landing stance", "Landing: none.", "open"))
    monkeypatch.setattr(tasks, "launches", lambda plan, starts: (found, {}))
    assert LaunchTask(present).run() is present  # nothing is limited
    limited = replace(present.plan.problem, limits=fp.Limits(torque=1e3))
    answer = LaunchTask(replace(present, plan=replace(present.plan, problem=limited))).run()
    view = View(limited, result=answer)
    card = cards.warning_card(view)
    assert [tone in card for tone in ('data-stance="good"', 'data-stance="open"', "Landing: none.")] == [True] * 3
    assert HOSTILE not in card
    assert "data-stance" not in cards.warning_card(replace(view, number=1))


def test_the_verdict_is_said_as_summary_and_report_say_it(present: ShownPlan) -> None:
    certificate = present.plan.certificate
    assert certificate is not None
    warning = PlanWarning("ground", "hand", 0.1, 0.0, "m", 0.2, "hand goes into the ground")
    refuted = replace(certificate, verdict="refuted")
    undecided = replace(certificate, verdict="undecided")
    for judged, warned in product((certificate, refuted, undecided), (False, True)):
        warnings = (warning,) if warned else ()
        plan = present.plan.with_record(
            replace(present.plan.record, certificate=judged.to_dict(), warnings=[each.to_dict() for each in warnings])
        )
        vars(plan)["warnings"] = warnings
        word, _ = plan_verdict(plan)
        card = cards.status_card(View(present.plan.problem, result=replace(present, plan=plan, warnings=warnings)))
        assert f"<b>{word.capitalize()}</b>" in card
        if judged.proved:
            assert word == ("flight proved, with warnings" if warned else "flight proved")
            console = Console(file=StringIO(), width=200)
            console.print(plan_summary(plan, []))
            assert f": {word} (" in console.file.getvalue()


def test_a_search_is_told_where_it_lasts_and_all_else_at_once(present: ShownPlan) -> None:
    told = View(present.plan.problem, number=1, result_number=1, result=present)
    assert cards.is_news(None, told)
    asked = replace(told, number=2)
    assert not cards.is_news(told, asked)
    assert cards.is_news(told, replace(asked, result_number=2))
    assert cards.is_news(told, replace(asked, result=replace(present, settled=False)))
    assert cards.is_news(told, replace(asked, fault="no"))
    assert cards.is_news(told, replace(asked, doing="start 2 of 4"))
    assert cards.is_news(told, replace(told, refusal="no"))
    assert cards.is_news(replace(told, refusal="no"), asked), "the refusal is over"


def test_names_are_text(present: ShownPlan) -> None:
    row = replace(present.utilisation[0], joint=HOSTILE)
    plan = replace(present.plan, explanation=HOSTILE, ok=False)
    view = View(present.plan.problem, result=replace(present, plan=plan), refusal=HOSTILE)
    for card in (
        cards.status_card(view),
        cards.status_card(replace(view, fault=HOSTILE)),
        cards.saved_card([HOSTILE]),
        cards._motor(row, limits_shown([row])),
        curves_card(present.plan, [replace(each, names=(HOSTILE,) * len(each.names)) for each in present.shares]),
    ):
        assert HOSTILE not in card
        assert "<img" not in card
        assert "&lt;img" in card


@pytest.mark.parametrize(
    ("use", "colour"), [(0.0, cards.GREEN), (0.95, cards.AMBER), (1.0, cards.AMBER), (1.01, cards.RED)]
)
def test_bars_turn_red_beyond_a_limit(use: float, colour: str) -> None:
    assert cards.colour_of(use) == colour
    assert colour in cards._bar(use)


@pytest.mark.parametrize("use", [0.0, 1e-300, 1e300, float("inf")])
@pytest.mark.parametrize("relative", [True, False])
def test_the_map_shows_any_number(present: ShownPlan, use: float, relative: bool) -> None:
    chart = Map.centred_at(present)
    cells = {(0, 0): MapPoint("optimal", use), (1, 1): MapPoint("optimal", 1.0), (2, 2): MapPoint("impossible", None)}
    chart = replace(chart, points=cells, relative=relative)
    card = cards.map_card(chart, True)
    assert card.count('class="point') == ROWS * COLUMNS
    assert "nan" not in card


def test_two_plans_are_compared_number_by_number(present: ShownPlan) -> None:
    assert "side by side" in cards.comparison_card(present, None)
    other = replace(present, clearance=None)
    card = cards.comparison_card(present, other)
    assert card.count("<tr>") == 1 + len(cards.COMPARED)
    assert "<td>-</tr>" in card
