"""The studio in a browser: dragged, made impossible, taken back, saved, and planned again from the command line."""

import json
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from places import ROOT
from studio_insides import logged_errors
from studio_page import Page

import floatplan as fp
from floatplan.studio.edits import phase_ends
from floatplan.studio.page import Studio
from floatplan.studio.tasks import COLUMNS, ROWS


@pytest.mark.long
def test_a_flight_is_made_by_hand(browser, tmp_path, floatplan):
    folder = tmp_path / "made"
    problem = fp.load_problem(ROOT / "problems" / "new_configuration.toml")
    with logged_errors() as errors, closing(Studio(problem, folder=str(folder), port=0, with_map=False)) as studio:
        page = Page(browser, studio)
        number = page.wait_for("proved", after=0)
        assert studio.session.view.problem is problem, "showing a problem does not change it"
        first = studio.session.view.result
        studio.player.playing = False

        page.drag_grip("goal", 2, 0.35)
        number = page.wait_for("proved", after=number)
        view = studio.session.view
        turned = view.problem.final.positions - problem.final.positions
        assert abs(turned[1]) > 0.05, "the dragged joint"
        assert turned[0] == 0
        assert not np.array_equal(view.result.plan.coefficients, first.plan.coefficients)

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
            page.click_until(button, lambda file=file: file in page.text("floatplan-saved"))
        assert page.complaints() == []
        assert errors == []
    assert floatplan("plan", folder / "problem.toml", "-o", "again", "--no-figures", "--quiet").code == 0
    made = json.loads((folder / "plan.json").read_text())
    again = json.loads(Path("again/plan.json").read_text())
    for key in ("coefficients", "angular_momentum", "orientation", "centre", "amplitude", "status"):
        assert made[key] == again[key], key


@pytest.mark.long
def test_a_click_on_a_point_of_the_map_goes_there(browser):
    """By a button that nobody sees."""
    problem = fp.load_problem(ROOT / "problems" / "new_configuration.toml")
    with logged_errors() as errors, closing(Studio(problem, port=0)) as studio:
        page = Page(browser, studio)
        page.tab("Map")
        page.wait(lambda: len(browser.run("return [...document.querySelectorAll('[data-status=optimal]')]")) > 3)
        shown = "return [...document.querySelectorAll('button')].filter(e => e.textContent.startsWith('map point')"
        assert browser.run(f"{shown}).length") == ROWS * COLUMNS
        page.wait(lambda: browser.run(f"{shown} && e.offsetParent).length") == 0)
        chart = studio.session.view.map
        row, column = next(place for place in chart.points if place != (ROWS // 2, COLUMNS // 2))
        before = studio.session.view.number

        def arrived():
            """A click on the point, which the page may be drawing anew meanwhile."""
            if studio.session.view.number == before:
                browser.run(f"document.querySelector('[data-point=\"{row},{column}\"]')?.click()")
            return bool(studio.session.view.number > before)

        page.wait(arrived)
        flight = studio.session.view.problem.flight
        assert flight.duration == pytest.approx(chart.durations[row])
        assert flight.momentum_in_plane == pytest.approx(chart.momenta[column])
        assert page.complaints() == []
        assert errors == []


@pytest.mark.long
def test_the_border_of_two_phases_is_dragged(browser):
    """On a page whose title and names are its own."""
    from selenium.webdriver.common.action_chains import ActionChains

    problem = fp.load_problem(ROOT / "problems" / "jumps" / "go2.toml")
    with logged_errors() as errors, closing(Studio(problem, port=0)) as studio:
        studio.player.playing = False  # software draws it slowly
        page = Page(browser, studio)
        assert browser.driver.title == "floatplan: go2_backflip"
        number = page.wait_for("proved", after=0)
        borders = browser.driver.find_elements("css selector", ".multi-slider-thumb")
        answer = studio.session.view.result
        found = [phase.end for phase in answer.jump.phases]
        assert len(borders) == len(found)
        ActionChains(browser.driver).click_and_hold(borders[1]).move_by_offset(-3, 0).pause(0.2).release().perform()
        page.wait(lambda: studio.session.view.number > number)
        asked = phase_ends(studio.session.view.problem)
        assert np.delete(asked, 1) == pytest.approx(np.delete(found, 1), abs=1e-3)
        assert -0.06 < asked[1] - found[1] < -0.01
        page.click("Undo")
        page.wait(lambda: studio.session.view.problem is problem)
        plots = browser.run("return [...document.querySelectorAll('#floatplan-curves .plot')].map(e => e.ariaLabel)")
        assert [label.partition(":")[0] for label in plots] == ["torque / limit", "rate / limit"]
        unnamed = browser.run(
            "return [...document.querySelectorAll('canvas, button, input, [role=slider]')]"
            ".filter(e => e.getClientRects().length && !e.ariaHidden)"
            ".filter(e => !e.ariaLabel && !e.textContent.trim() && !e.labels?.length).map(e => e.outerHTML)"
        )
        assert unnamed == []
        assert page.complaints() == []
        assert errors == []
