"""The report and the scene in a browser: they play, they hold the plan's numbers, and they ask nothing of a network."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import Browser
from long_cases import cases
from needed import skip_or_fail

import floatplan as fp
from floatplan.robot.urdf.tree import robots_folder
from floatplan.view.report.report import write_report
from floatplan.view.scene.scene import write_scene
from floatplan.view.style import palette

ROOT = Path(__file__).parents[2]
PROBLEMS = sorted(path for path in (ROOT / "problems").glob("**/*.toml") if path.parent.name != "studies")
EVERY_TIME = (  # each kind of obstacle, limit and robot; and one in space, in test_space_view.py
    *("falling_cat_apart", "handstand_ground", "high_jump", "moving_hoop", "new_configuration_moving"),
    *("somersault_motors", "torque_limited", "gallery/go2", "gallery/talos", "jumps/solo12"),
)
LONG = {*PROBLEMS} - {ROOT / "problems" / f"{name}.toml" for name in EVERY_TIME}
PATIENCE = 60.0  # s for what takes a fraction of one
SLOWLY = "floatplan.player.speed = 0.01"  # on a busy machine too a flight is paused before it ends
HOSTILE = "</script><script>window.broken = 1</script><img src=x onerror='window.broken = 1'>"

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


@pytest.mark.parametrize("path", cases(PROBLEMS, LONG), ids=lambda path: path.stem)
def test_every_report_plays_and_scrubs_without_complaint_or_network(
    browser: Browser, path: Path, tmp_path: Path, planned: Callable[[str], fp.Plan]
) -> None:
    from selenium.webdriver.common.by import By

    if (path.parent.name == "gallery" or path.stem.startswith("go2")) and robots_folder() is None:
        skip_or_fail("example-robot-data is not installed: the extra robots")
    plan = planned(path.relative_to(ROOT / "problems").with_suffix("").as_posix())
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


@pytest.fixture(scope="module")
def crowd(tmp_path_factory: pytest.TempPathFactory) -> tuple[fp.Plan, Path]:
    """A chain of ten joints, each with a torque limit of its own."""
    robot = fp.Robot.from_urdf(ROOT / "urdf" / "chain10.urdf")
    flight = fp.Flight(1.3, angular_momentum="free")
    plan = fp.plan(fp.Problem(robot, fp.Posture(1.2, 0.15), fp.Posture(-1.5, -0.1), flight, name="ten"))
    limits = (1.0 + 0.05 * np.arange(10)) * plan.peaks.motor_torque
    torque = dict(zip(robot.joints, limits.tolist(), strict=True))
    plan = replace(plan, problem=replace(plan.problem, limits=fp.Limits(torque=torque)))
    return plan, write_report(plan, tmp_path_factory.mktemp("crowd") / "report.html")


def media(browser: Browser, scheme: str) -> None:
    """Let the browser prefer light or dark pages."""
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})


CHART = """
    const chart = [...document.querySelectorAll('.chart')].find(one => one.textContent.startsWith(arguments[0]));
    const shown = [...chart.querySelectorAll('.curve')].filter(one => getComputedStyle(one).display !== 'none');
    return shown.map(one => one.innerText.replace(/\\s+/g, ' ').trim());
"""


def test_many_joints_are_told_one_at_a_time(browser: Browser, crowd: tuple[fp.Plan, Path]) -> None:
    """Names are in the legend alone; the one that is pointed at or chosen shows its value and its limits."""
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.by import By

    plan, page = crowd
    browser.open(page)
    browser.run("floatplan.player.seek(0.5)")
    names = [element.text for element in browser.driver.find_elements(By.CSS_SELECTOR, "#key [data-segment]")]
    assert names == ["base", *plan.robot.joints]
    assert browser.run(CHART, "Torques") == []
    lines = (
        "return floatplan.charts.find(one => one.spec.title === 'Torques')"
        ".plot.series.filter(one => one.dash && one.show).length"
    )
    assert browser.run(lines) == 0
    fourth = browser.driver.find_element(By.CSS_SELECTOR, '#key [data-segment="4"]')
    ActionChains(browser.driver).move_to_element(fourth).perform()
    torque = plan.at(0.5).motor_torques[3]
    for pointed in (True, False):
        (told,) = browser.run(CHART, "Torques")
        name, value, limit = told.replace("\u2212", "-").split(" ", 2)
        assert name == plan.robot.joints[3]
        assert float(value) == pytest.approx(torque, rel=1e-2, abs=1e-3)
        assert limit == f"of {plan.problem.motor_torque_limits[3]:.4g} N m"
        assert browser.run(lines) == 2
        (angle,) = browser.run(CHART, "Angles")
        assert angle.startswith(plan.robot.joints[3])
        if pointed:
            fourth.click()
            ActionChains(browser.driver).move_to_element(browser.driver.find_element(By.ID, "name")).perform()
    assert fourth.get_attribute("aria-pressed") == "true"
    fourth.click()
    ActionChains(browser.driver).move_to_element(browser.driver.find_element(By.ID, "name")).perform()
    assert browser.run(CHART, "Torques") == []
    assert browser.complaints() == []


def test_inertia_and_the_interval_of_h_are_drawn(browser: Browser, crowd: tuple[fp.Plan, Path]) -> None:
    plan, page = crowd
    browser.open(page)
    scrub(browser, 0.5)
    row = plan.dynamics.momentum_map(plan.at([0.5]).positions)[0]
    agree(numbers(browser), {f"inertia.{index}": value for index, value in enumerate(row)})
    find = "const chart = floatplan.charts.find(one => one.spec.title === 'Angular momentum');"
    drawn = browser.run(f"{find} return chart.spec.lines.map(one => one.value)")
    said = browser.run(f"{find} return chart.spec.beyond || ''")
    low, high = plan.angular_momentum_bounds
    assert drawn == pytest.approx([low, high]) or f"{low:.4g} to {high:.4g}" in said


@pytest.mark.parametrize("size", [(1300, 900), (390, 844)])
def test_dark_and_light(browser: Browser, crowd: tuple[fp.Plan, Path], size: tuple[int, int]) -> None:
    """The page follows the reader's preference, also while it is open, and every curve can be told from the paper."""
    _, page = crowd
    paper = "return getComputedStyle(document.body).backgroundColor"
    shades = """
        const painter = new OffscreenCanvas(1, 1).getContext("2d", { willReadFrequently: true });
        const seen = (colour) => {
            painter.fillStyle = painted("var(--shade)", colour);
            painter.fillRect(0, 0, 1, 1);
            return [...painter.getImageData(0, 0, 1, 1).data];
        };
        return floatplan.charts.flatMap((one) => one.spec.series.map(({ colour }) => seen(colour)));
    """
    width, height = size
    metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500}
    browser.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    try:
        media(browser, "light")
        browser.open(page)
        assert browser.run(paper) == "rgb(255, 255, 255)"
        media(browser, "dark")
        wait_for(browser, "DARK.matches")
        assert browser.run(paper) == "rgb(21, 24, 28)"
        red, green, blue = stage_pixels(browser)[8, 8]
        assert max(red, green, blue) < 60
        for shade in browser.run(shades):
            red, green, blue = (part / 255 for part in shade[:3])
            assert 0.2126 * red**2.2 + 0.7152 * green**2.2 + 0.0722 * blue**2.2 > 0.21, shade
        assert browser.run("return document.documentElement.scrollWidth <= innerWidth")
        assert browser.complaints() == []
    finally:
        media(browser, "")
        browser.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


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


def test_scrubbing_shows_the_plan_s_values_at_mid_flight(page: Browser, handstand: fp.Plan) -> None:
    middle = handstand.duration / 2
    scrub(page, middle)
    found = numbers(page)
    agree(found, expected(handstand, middle))
    assert found["clearance.0"] == pytest.approx(handstand.clearances([middle])[0], abs=1e-6)


def test_values_between_samples_are_the_plan_s(page: Browser, handstand: fp.Plan) -> None:
    for share in (0.0, 0.1234, 0.987, 1.0):
        page.run("floatplan.player.seek(arguments[0])", share * handstand.duration)
        agree(numbers(page), expected(handstand, share * handstand.duration))


def test_dragging_along_a_curve_seeks(page: Browser, handstand: fp.Plan) -> None:
    from selenium.webdriver import ActionChains
    from selenium.webdriver.common.by import By

    curve = page.driver.find_element(By.CSS_SELECTOR, ".u-over")
    quarter = -round(curve.size["width"] / 4)
    ActionChains(page.driver).move_to_element(curve).click_and_hold().move_by_offset(quarter, 0).release().perform()
    assert page.run("return floatplan.player.time") == pytest.approx(handstand.duration / 4, abs=0.02)


def test_the_page_places_links_as_the_robot_has_them(page: Browser, handstand: fp.Plan) -> None:
    from floatplan.view.outlines import postures

    placed = postures(handstand, np.array([0.5]))
    script = (
        "const m = floatplan.motion, p = m.posture(0.5);"
        "return m.data.robot.links.map(l => l.points.map(at => m.place(p, { body: l.body, at })))"
    )
    found = np.array(page.run(script)) @ [1, 1j]
    np.testing.assert_allclose(found, placed.corners[0], atol=1e-6)


def stage_pixels(browser: Browser) -> Any:
    """Red, green and blue (height, width, 3) of the picture of the flight, as it is on the screen."""
    from io import BytesIO

    from PIL import Image
    from selenium.webdriver.common.by import By

    content = browser.driver.find_element(By.ID, "stage").screenshot_as_png
    return np.array(Image.open(BytesIO(content)).convert("RGB"))


def test_the_robot_is_painted(page: Browser, handstand: fp.Plan) -> None:
    page.run("floatplan.player.seek(0.5)")
    seen = {tuple(pixel) for pixel in stage_pixels(page).reshape(-1, 3).tolist()}
    for colour in palette(len(handstand.robot.joints) + 1):
        assert tuple(np.rint(255 * colour).astype(int).tolist()) in seen


def test_ticks_take_out_of_the_picture_what_they_name(page: Browser) -> None:
    for name, element in (("ghosts", ".ghosts"), ("trails", ".trail"), ("margins", ".margin"), ("goal", ".goal")):
        hidden = f"return [...document.querySelectorAll('{element}')].map(e => getComputedStyle(e).display === 'none')"
        for wanted in (False, True, False):
            assert set(page.run(hidden)) == {wanted}, name
            page.run("document.getElementById(arguments[0]).click()", name)
        page.run("document.getElementById(arguments[0]).click()", name)


def test_a_frame_moves_the_robot_and_paints_no_curve(page: Browser) -> None:
    """What is costly is done once: what stays and the curves are drawn when the page opens."""
    script = """
        const prototype = CanvasRenderingContext2D.prototype, clear = prototype.clearRect;
        const painted = new Set(), watch = new MutationObserver(() => {});
        prototype.clearRect = function(...box) { painted.add("a curve"); clear.apply(this, box); };
        watch.observe(document.getElementById("stage"), { subtree: true, attributes: true, childList: true });
        for (let k = 0; k < 10; k++) floatplan.player.seek(k / 10 * floatplan.motion.duration);
        prototype.clearRect = clear;
        for (const { type, target } of watch.takeRecords()) painted.add(`${type} of ${target.closest("svg").id}`);
        return [...painted];
    """
    assert page.run(script) == ["attributes of robot"]


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


def test_names_from_files_stay_text(browser: Browser, handstand: fp.Plan, tmp_path: Path) -> None:
    plan = replace(handstand, problem=replace(handstand.problem, name=HOSTILE), explanation=HOSTILE)
    browser.open(write_report(plan, tmp_path / "report.html"))
    assert browser.run("return document.getElementById('name').textContent") == HOSTILE
    assert browser.run("return window.broken") is None
    assert browser.complaints() == []


def test_the_scene_opens_without_a_network(browser: Browser, handstand: fp.Plan, tmp_path: Path) -> None:
    """Its clock and speed have names for screen readers, as all that can be operated."""
    if importlib.util.find_spec("viser") is None:
        skip_or_fail("viser is not installed: the extra view")
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
