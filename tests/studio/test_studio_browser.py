"""The studio in a browser: dragged, made impossible, taken back, saved, and planned again from the command line."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import Browser, started
from studio_page import Page

import floatplan as fp
from floatplan.studio.page import opened

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    yield from started()


def test_a_flight_is_made_by_hand(browser: Browser, tmp_path: Path, floatplan: Callable[..., Any]) -> None:
    folder = tmp_path / "made"
    problem = fp.load_problem(ROOT / "problems" / "new_configuration.toml")
    with opened(problem, folder=str(folder), port=0, with_map=False) as studio:
        page = Page(browser, studio)
        page.wait_for("proved", after=0)
        assert studio.session.view.problem is problem, "showing a problem does not change it"
        first = studio.session.view.flown
        sent = studio.player.frames
        page.wait(lambda: studio.player.frames > sent + 5)
        studio.player.play(False)

        page.drag_grip("goal", 2, 0.35)
        number = page.wait_for("proved", after=1)
        view = studio.session.view
        turned = view.problem.final.positions - problem.final.positions
        assert abs(turned[1]) > 0.05, "the dragged joint"
        assert turned[0] == 0
        assert first is not None
        assert view.flown is not None
        assert not np.array_equal(view.flown.plan.coefficients, first.plan.coefficients)

        page.tab("Limits")
        page.choose("velocity limit", "by hand")
        number = page.wait_for("proved", after=number)
        page.press("q1, rad/s", "HOME")
        number = page.wait_for("not found", after=number)
        assert "velocity limit" in page.status()
        page.click("Undo")
        number = page.wait_for("proved", after=number)
        page.click("Undo")
        page.wait_for("proved", after=number)

        page.tab("Save")
        for button, file in (("Save problem", "problem.toml"), ("Save plan", "plan.json")):
            page.click(button)
            page.wait(lambda file=file: file in page.text("floatplan-saved"))
        assert page.complaints() == []
        assert studio.errors == []
    assert floatplan("plan", folder / "problem.toml", "-o", "again", "--no-figures", "--quiet").code == 0
    made = json.loads((folder / "plan.json").read_text())
    again = json.loads(Path("again/plan.json").read_text())
    for key in ("coefficients", "angular_momentum", "orientation", "centre", "amplitude", "status"):
        assert made[key] == again[key], key
