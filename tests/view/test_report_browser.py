"""The report and the scene in a browser: they play, they hold the plan's numbers, and they ask nothing of a network."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import Browser
from long_cases import cases

import floatplan as fp
from floatplan.view.report.report import write_report
from floatplan.view.scene.scene import write_scene

ROOT = Path(__file__).parents[2]
DAILY = (  # each kind of obstacle, limit and robot; and one in space, in test_space_view.py
    *("falling_cat_apart", "high_jump", "moving_hoop", "somersault_motors", "gallery/go2"),
)
LONG = (  # each objective and kind of end, robots of few and of many joints, and all kinds in space
    *("backflip", "handstand_ground", "new_configuration_moving", "obstacle_hard", "torque_limited"),
    *("gallery/double_pendulum", "gallery/talos", "jumps/gymnast", "jumps/solo12", "jumps/boxes/go2_box"),
    *("jumps/space/g1_side", "jumps/space/go2_roll", "space/cat", "space/free_panda", "space/go2_half_twist_clear"),
)
PATIENCE = 60.0  # s for what takes a fraction of one
SLOWLY = "floatplan.player.speed = 0.01"  # on a busy machine too a flight is paused before it ends

CONTROLS = "input, button, [role=slider]"  # of a scene


@pytest.fixture(scope="module")
def handstand() -> fp.Plan:
    plan = fp.plan(fp.load_problem(ROOT / "problems" / "handstand.toml"))
    bar = fp.Circle(center=(1.485, 3.342), radius=0.2, margin=0.02, velocity=(0.1, 0.0), window=(0.2, 1.2))
    return replace(plan, problem=replace(plan.problem, obstacles=(bar, fp.HalfPlane())))


@pytest.fixture(scope="module")
def report(handstand: fp.Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_report(handstand, tmp_path_factory.mktemp("report") / "report.html")


@pytest.fixture
def page(browser: Browser, report: Path) -> Browser:
    if browser.driver.current_url != report.as_uri():
        browser.open(report)
    browser.run("floatplan.player.pause(); floatplan.player.seek(0)")
    return browser


def numbers(browser: Browser) -> dict[str, float]:
    """What the page says beside its curves, SI."""
    script = "return [...document.querySelectorAll('.value')].map(e => [e.dataset.key, e.dataset.value])"
    return {key: float(value) for key, value in browser.run(script) if value}


def expected(plan: fp.Plan, instant: float) -> dict[str, float]:
    state = plan.at(instant)
    if plan.robot.in_plane:
        found = {"orientation": state.orientation, "orientation_rate": state.orientation_rate}
        found["angular_momentum"] = plan.angular_momentum
    else:
        found = {"orientation_rate": float(np.linalg.norm(state.orientation_rate))}
    for name in ("positions", "velocities", "motor_torques"):
        leaders = getattr(state, name)[: len(plan.robot.joints)]  # mirrored followers have no curve of their own
        found |= {f"{name}.{index}": value for index, value in enumerate(leaders)}
    return found


def agree(found: dict[str, float], wanted: dict[str, float]) -> None:
    assert {key: found[key] for key in wanted} == pytest.approx(wanted, rel=1e-6, abs=1e-6)


def scrub(browser: Browser, instant: float) -> None:
    """Move the slider, as a hand does."""
    browser.run(
        "const scrub = document.getElementById('scrub'); scrub.value = arguments[0];"
        "scrub.dispatchEvent(new Event('input'))",
        instant,
    )


def wait_for(browser: Browser, condition: str) -> None:
    """Wait until an expression of the page is true."""
    from selenium.webdriver.support.wait import WebDriverWait

    WebDriverWait(browser.driver, PATIENCE, 0.02).until(lambda _: browser.run(f"return {condition}"), condition)


@pytest.mark.parametrize("name", cases([*DAILY, *LONG], LONG))
def test_every_report_plays_and_scrubs_without_complaint_or_network(
    browser: Browser, name: str, tmp_path: Path, planned: Callable[[str], fp.Plan]
) -> None:
    from selenium.webdriver.common.by import By

    plan = planned(name)
    report = write_report(plan, tmp_path / "report.html")
    browser.open(report)
    play = browser.driver.find_element(By.ID, "play")
    browser.run(SLOWLY)
    play.click()
    wait_for(browser, "floatplan.player.time > 0")
    play.click()
    middle = plan.duration / 2
    scrub(browser, middle)
    wanted = expected(plan, middle)
    for index, obstacle in enumerate(plan.problem.obstacles):
        distance = plan.clearances(middle, [obstacle])[0]
        if np.isfinite(distance):
            wanted[f"clearance.{index}"] = distance
    agree(numbers(browser), wanted)
    assert browser.complaints() == []
    assert browser.requests() == [report.as_uri()]


def test_it_offers_the_user_s_own_problem_file(browser: Browser, tmp_path: Path) -> None:
    file = ROOT / "problems" / "new_configuration.toml"
    plan = fp.plan(fp.load_problem(file))
    browser.open(write_report(fp.load_plan(plan.save(tmp_path / "plan.json")), tmp_path / "report.html"))
    assert browser.run("return document.querySelector('.file pre').textContent") == file.read_text()
    assert browser.run("return document.querySelector('.file summary').textContent").endswith("as written")
    assert browser.run("return document.querySelector('.download').download") == "new_configuration.toml"
    saved = (
        "return fetch(document.querySelector('.download').href).then(answer => answer.text()).catch(() => 'refused')"
    )
    assert browser.run(saved) == "refused"  # the page's policy admits no request, not even this one
    folder = {"behavior": "allow", "downloadPath": str(tmp_path)}
    browser.driver.execute_cdp_cmd("Page.setDownloadBehavior", folder)
    browser.run("document.querySelector('.file details').open = true; document.querySelector('.download').click()")
    path = tmp_path / "new_configuration.toml"
    from selenium.webdriver.support.wait import WebDriverWait

    WebDriverWait(browser.driver, PATIENCE, 0.02).until(lambda _: path.is_file() and path.stat().st_size)
    assert path.read_text() == file.read_text()


def test_it_plays_pauses_and_steps(page: Browser, handstand: fp.Plan) -> None:
    from selenium.webdriver.common.by import By

    find = lambda name: page.driver.find_element(By.ID, name)  # noqa: E731
    page.run(SLOWLY)
    find("play").click()
    wait_for(page, "floatplan.player.time > 0")
    find("play").click()
    assert not page.run("return floatplan.player.playing")
    assert page.run("return floatplan.player.time") > 0
    page.run("floatplan.player.seek(arguments[0])", handstand.duration / 2)
    paused = page.run("return floatplan.player.time")
    find("step").click()
    stepped = page.run("return floatplan.player.time")
    assert stepped == pytest.approx(paused + 0.01)
    assert find("clock").text == f"{stepped:.3f} s"
    agree(numbers(page), expected(handstand, stepped))
    find("home").click()
    assert page.run("return floatplan.player.time") == 0


def test_a_phone_needs_no_sideways_scrolling_and_has_room_for_curves(page: Browser) -> None:
    page.driver.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride", {"width": 360, "height": 740, "deviceScaleFactor": 2, "mobile": True}
    )
    try:
        assert page.run("return document.documentElement.scrollWidth") <= 360
        page.run("document.querySelector('#charts figure:last-child').scrollIntoView({block: 'end'})")
        at = "return document.elementFromPoint(180, arguments[0]).closest(arguments[1]) !== null"
        assert page.run(at, 100, "#stage")  # the robot stays in sight beside its curves
        assert page.run(at, 740 / 2, "#charts")
    finally:
        page.run("window.scrollTo(0, 0)")
        page.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


@pytest.mark.long
def test_the_scene_opens_without_a_network(browser: Browser, handstand: fp.Plan, tmp_path: Path) -> None:
    """Its clock and speed have names for screen readers, as all that can be operated."""
    scene = write_scene(handstand, tmp_path / "scene.html")
    browser.driver.set_window_size(300, 250)
    browser.open(scene)
    wait_for(browser, "document.querySelector('canvas') !== null")
    assert browser.requests() == [scene.as_uri()]
    wait_for(browser, "document.querySelectorAll('input[aria-label]').length > 1")
    found = browser.driver.find_elements("css selector", CONTROLS)
    told = [(each.aria_role, each.accessible_name) for each in found if each.is_displayed()]
    assert {("textbox", "time, s"), ("combobox", "speed"), ("button", "player pause filled")} <= set(told)
    assert [each for each in told if not each[1].strip()] == []
    assert browser.complaints("SEVERE") == []
    browser.driver.get("about:blank")
    browser.driver.set_window_size(1000, 640)


def test_a_notebook_shows_the_report_in_a_frame(browser: Browser, handstand: fp.Plan, tmp_path: Path) -> None:
    cell: Any = handstand._repr_html_()
    notebook = tmp_path / "notebook.html"
    notebook.write_text(f"<!DOCTYPE html><meta charset='utf-8'><link rel='icon' href='data:,'>{cell}")
    browser.open(notebook)
    browser.driver.switch_to.frame(0)
    assert browser.run("return floatplan.motion.duration") == handstand.duration
    browser.driver.switch_to.default_content()
    assert browser.complaints() == []
