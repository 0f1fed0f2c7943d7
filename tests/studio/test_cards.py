"""What the page says, of hostile names and extreme numbers too."""

from dataclasses import replace
from io import StringIO
from itertools import product

import pytest
from places import ROOT
from rich.console import Console

import floatplan as fp
from floatplan.cli.summary import plan_summary
from floatplan.plans.measures import PlanWarning, limits_shown
from floatplan.plans.presentation import plan_verdict
from floatplan.studio import cards
from floatplan.studio.curves import curves_card
from floatplan.studio.session import View
from floatplan.studio.tasks import ShownPlan

HOSTILE = "<img src=x onerror='window.broken = 1'>&\"'"


@pytest.fixture(scope="module")
def present():
    return ShownPlan.of(fp.plan(fp.load_problem(ROOT / "problems" / "obstacle.toml"), prove=True), settled=True)


def test_the_verdict_is_said_as_summary_and_report_say_it(present):
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


def test_names_are_text(present):
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
