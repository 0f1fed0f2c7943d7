"""Photographs pages of reports and scenes into docs/images/, by Chromium. It plans what it shows."""

from __future__ import annotations

import io
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

from PIL import Image

import floatplan as fp
from floatplan.certificate.certificate import certify
from floatplan.files import write_atomically
from floatplan.plans.trajectory import Trajectory
from floatplan.studio.page import Studio
from floatplan.view.report.report import write_report
from floatplan.view.scene.scene import write_scene

ROOT = Path(__file__).resolve().parents[1]
IMAGES, JUMPS = ROOT / "docs" / "images", ROOT / "problems" / "jumps"
sys.path.insert(0, str(ROOT / "tests" / "helpers"))
SLOWER = 20  # a scene that is to be photographed: without a graphics card a picture takes a second
PATIENCE = 120  # s that a scene has to load and to be in mid-flight
MAPPED = 40  # points of a studio's map, before it is photographed
CLEAR = "for (const one of document.querySelectorAll('[class*=Notification]')) one.remove()"
PAUSE = """
    const [low, high] = arguments;
    const watch = setInterval(() => {
      const time = Number(document.querySelectorAll('input')[1]?.value);
      if (time < low || time > high) return;
      document.querySelector('button[class*=ActionIcon]').click();
      clearInterval(watch);
      window.paused = true;
    }, 4);
"""


def main() -> None:
    from browser import started

    example, backflip = checked("obstacle.toml"), checked("gallery/go2.toml")
    with tempfile.TemporaryDirectory() as folder:
        for browser in started():
            for plan in (example, backflip):
                name = f"report_{plan.problem.name}.png"
                photograph_report(browser, plan, Path(folder) / "report.html", IMAGES / name)
            twist, stunt = checked("space/diver_full_twist.toml"), checked("space/go2_half_twist.toml")
            photograph_report(browser, twist, Path(folder) / "report.html", IMAGES / "report_space.png", 0.45)
            photograph_scene(browser, stunt, Path(folder) / "scene.html", IMAGES / "scene_space.png")
            photograph_report(browser, jumped("go2"), Path(folder) / "report.html", IMAGES / "report_jump.png", 0.31)
            for plan in (backflip, example):
                photograph_scene(browser, plan, Path(folder) / "scene.html", IMAGES / f"scene_{plan.problem.name}.png")
            photograph_studio(browser, backflip.problem, IMAGES / "studio_go2.png")
            photograph_studio(browser, fp.load_problem(JUMPS / "go2.toml"), IMAGES / "studio_jump.png", 0.26)
            roll = fp.load_problem(JUMPS / "space" / "go2_roll.toml")
            photograph_studio(browser, roll, IMAGES / "studio_jump_in_space.png", 0.36)


def checked(name: str) -> fp.Plan:
    """Plan a problem, and put what the proof and a replay, in space in MuJoCo, say into its record."""
    plan = fp.plan(fp.load_problem(ROOT / "problems" / name))
    if not plan.ok:
        raise SystemExit(f"{name}: {plan.explanation}")
    replay = fp.replay(plan, engine="pinocchio" if plan.robot.in_plane else "mujoco")
    return plan.with_record(plan.record.with_checks(certificate=certify(plan).to_dict(), replay=replay.to_dict()))


def jumped(name: str) -> Trajectory:
    """Plan a jump, and prove its flight."""
    jump = fp.jump(JUMPS / f"{name}.toml")
    if not jump.ok or jump.flight is None:
        raise SystemExit(f"{name}: {jump.explanation}")
    view: Trajectory = jump.with_certificate(certify(jump.flight))
    return view


def photograph_report(browser: Any, plan: Trajectory, page: Path, path: Path, share: float = 0.55) -> None:
    browser.driver.set_window_size(1400, 1240)
    browser.open(write_report(plan, page))
    browser.run("floatplan.player.seek(arguments[0] * floatplan.motion.duration)", share)
    browser.run("document.documentElement.style.overflow = 'hidden'")  # no scroll bar
    time.sleep(0.5)
    save(browser.driver.get_screenshot_as_png(), path)


def photograph_scene(browser: Any, plan: fp.Plan, page: Path, path: Path) -> None:
    browser.driver.set_window_size(1000, 800)
    with slow_motion():
        browser.open(write_scene(plan, page))
    time.sleep(3.0)
    browser.run(CLEAR)
    browser.run(PAUSE, 0.4 * SLOWER * plan.duration, 0.6 * SLOWER * plan.duration)
    deadline = time.monotonic() + PATIENCE
    while not browser.run("return window.paused === true"):
        if time.monotonic() > deadline:
            raise SystemExit(f"{page}: never seen in mid-flight")
        time.sleep(0.2)
    time.sleep(1.5)
    save(browser.driver.find_element("tag name", "canvas").screenshot_as_png, path)


def photograph_studio(browser: Any, problem: fp.Problem, path: Path, share: float = 0.4) -> None:
    """With its map, in mid-flight; a jump with its phases, where a share of it is over."""
    from studio_page import Page

    browser.driver.set_window_size(1300, 900)
    with closing(Studio(problem, port=0)) as studio:
        page = Page(browser, studio)
        page.wait_for("proved", after=0)
        answer = studio.session.view.result
        assert answer is not None
        studio.player.seek(share * answer.motion.duration)
        if problem.jump is None:
            page.tab("Map")
            studio.session.wait(lambda view: view.map is not None and len(view.map.points) > MAPPED, PATIENCE)
        browser.run(CLEAR)
        time.sleep(3.0)
        save(browser.driver.get_screenshot_as_png(), path)


@contextmanager
def slow_motion() -> Iterator[None]:
    from viser.infra import StateSerializer

    at_speed = StateSerializer.insert_sleep

    def slowly(serializer: StateSerializer, duration: float) -> None:
        at_speed(serializer, SLOWER * duration)

    with mock.patch.object(StateSerializer, "insert_sleep", slowly):
        yield


def save(content: bytes, path: Path) -> None:
    """Write a picture as it was taken: flat colours pack well until they are scaled."""
    picture = Image.open(io.BytesIO(content)).convert("RGB")
    stream = io.BytesIO()
    picture.quantize(256, method=Image.Quantize.MAXCOVERAGE, kmeans=4, dither=Image.Dither.NONE).save(
        stream, format="PNG", optimize=True
    )
    write_atomically(path, stream.getvalue())
    print(f"{path.relative_to(ROOT)}: {path.stat().st_size // 1000} kB")


if __name__ == "__main__":
    main()
