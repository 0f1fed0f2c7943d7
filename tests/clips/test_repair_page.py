"""The page of a repair plays the clip and what became of it side by side."""

from __future__ import annotations

from pathlib import Path

import clip_samples as samples
import numpy as np
import pytest
from browser import Browser

import floatplan as fp
from floatplan.clips.repair_page import write_repair_page


@pytest.fixture
def page(robot: fp.Robot, browser: Browser, tmp_path: Path) -> tuple[Path, fp.Clip, fp.Clip]:
    sample = samples.hops(60, (0.5,), gravity=6.0)
    path = samples.write_csv(sample, tmp_path / "clip.csv", digits=9)
    clip = fp.load_clip(path, model=robot, fps=60.0, quaternion="xyzw")
    repaired, told = fp.repair_clip(clip)
    written = write_repair_page(repaired, told, tmp_path / "report.html")
    browser.open(written)
    return written, clip, repaired


def test_both_robots_are_where_the_clips_have_them(
    page: tuple[Path, fp.Clip, fp.Clip], robot: fp.Robot, browser: Browser
) -> None:
    written, *clips = page
    for index, clip in enumerate(clips):
        begin = max(clip.flights[0].begin - 0.5, 0.0)
        script = f"""
            const {{ motion }} = floatplan.stages[{index}];
            const posture = motion.posture(0.4);
            return posture.bodies.map((_, body) => motion.place(posture, {{ body, at: [0, 0, 0] }}));
        """
        expected = clip.curve.poses(np.array([begin + 0.4])).places[0, 1:]
        np.testing.assert_allclose(browser.run(script), expected, atol=1e-4)
    assert browser.complaints() == []
    assert browser.requests() == [written.as_uri()]


def test_both_play_and_turn_as_one(page: tuple[Path, fp.Clip, fp.Clip], browser: Browser) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    browser.run("floatplan.player.seek(0.3)")
    assert browser.run("return floatplan.stages.map(stage => stage.time)") == [0.3, 0.3]
    browser.run("floatplan.player.seek(1e9)")
    ends = browser.run("return floatplan.stages.map(stage => [stage.time, stage.motion.duration])")
    assert all(time == pytest.approx(duration) for time, duration in ends)
    assert ends[1][1] < ends[0][1]
    first = browser.driver.find_element("id", "stage")
    ActionChains(browser.driver).move_to_element(first).click_and_hold().move_by_offset(-40, 20).release().perform()
    one, other = browser.run("return floatplan.stages.map(stage => stage.camera.angles)")
    assert one == other
    assert one[0] != pytest.approx(np.radians(-62))


def test_it_says_when_each_is_in_the_air(page: tuple[Path, fp.Clip, fp.Clip], browser: Browser) -> None:
    _, *clips = page
    flies = "return [...document.querySelectorAll('.title')].map(title => title.classList.contains('flies'))"
    begins = [max(clip.flights[0].begin - 0.5, 0.0) for clip in clips]
    for time in (0.1, 0.6, 0.9, 1.4):
        browser.run(f"floatplan.player.seek({time})")
        expected = []
        for clip, begin in zip(clips, begins, strict=True):
            flight = clip.flights[0]
            expected.append(flight.begin < begin + time < flight.end)
        assert browser.run(flies) == expected


def test_curves_show_what_falls_at_g(page: tuple[Path, fp.Clip, fp.Clip], browser: Browser) -> None:
    script = """
        const [before, after] = document.querySelectorAll(".charts svg:last-child polyline");
        const none = document.querySelector(".charts svg:last-child polyline[stroke-dasharray]").points[0].y;
        const middle = (line) => none - line.points[Math.floor(line.points.length / 2)].y;
        return [middle(before), middle(after)];
    """
    before, after = browser.run(script)
    assert before > 5.0  # [px] above the line of no force: it falls at 6 m/s^2
    assert after == pytest.approx(0.0, abs=0.5)
    assert browser.run("return [...document.querySelectorAll('.badge')].map(one => one.textContent)") == [
        "unphysical",
        "physical",
    ]
