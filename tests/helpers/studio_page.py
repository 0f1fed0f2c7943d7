"""The studio's page, driven as a hand does: grips are dragged, sliders moved, buttons clicked."""

import contextlib
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from browser import Browser

from floatplan.studio.page import Studio
from floatplan.studio.stage import end_poses
from floatplan.view.scene.scene import world_points

PATIENCE = 600.0  # s for what takes a fraction of one, and lets others go first
NOTICED = 1.0  # s until what was done is done again
FIND = "return document.getElementById(arguments[0])?.textContent || ''"
OF_VISER = (
    "THREE.Clock",
    "GPU stall",
    "favicon",
    "Software WebGL",
    "SwiftShader",
    "GroupMarkerNotSet",
    "Unable to preventDefault",
)


def grip_places(studio: Studio, end: str, part: int, angles: Any) -> Any:
    """Where a hand that turns a part of the posture at an end by angles (K,), rad, has its grip, m."""
    view = studio.session.view
    problem = view.problem
    poses, grip, plane = end_poses(view, end), studio.stage.grips[end][part], problem.robot.plane
    body, at = int(grip.name.split("/")[-2]), grip.position @ (plane.horizontal + 1j * plane.vertical)
    place = poses.places[0, body] + problem.robot.tree.rotations(poses.angles)[0, body] * at
    pivot, _ = studio.stage.pivot(view, end, part)
    return pivot + (place - pivot) * np.exp(1j * angles)


class Page:
    """The page of a studio in a browser."""

    def __init__(self, browser: Browser, studio: Studio) -> None:
        self.browser, self.studio = browser, studio
        browser.driver.get("about:blank")  # the page before asks for its server no more
        browser.driver.get_log("browser")
        browser.driver.get(studio.address)
        self.wait(lambda: self.text("floatplan-status"))

    def wait(self, done: Callable[[], Any], patience: float = PATIENCE) -> None:
        """Wait until something is true."""
        end = time.monotonic() + patience
        while not done():
            assert time.monotonic() < end, self.text("floatplan-status")
            time.sleep(0.02)

    def until(self, act: Callable[[], Any], done: Callable[[], Any]) -> None:
        """Do something until something is true: a page that is drawn anew, or far behind, may miss it."""

        def is_done() -> bool:
            act()
            with contextlib.suppress(AssertionError):
                self.wait(done, NOTICED)
            return bool(done())

        self.wait(is_done)

    def text(self, name: str) -> str:
        return str(self.browser.run(FIND, name))

    def status(self) -> str:
        return self.text("floatplan-status")

    def verdict(self) -> tuple[str, int]:
        """The verdict that the page shows, and the number of the question."""
        script = "const e = document.querySelector('[data-verdict]'); return [e.dataset.verdict, +e.dataset.number]"
        word, number = self.browser.run(script)
        return str(word), int(number)

    def wait_for(self, verdict: str, after: int) -> int:
        """Wait for a verdict on a question after the one of a number; return its number."""
        self.wait(lambda: self.verdict()[0] == verdict and self.verdict()[1] > after)
        return self.verdict()[1]

    def complaints(self) -> list[str]:
        """What the console complains of, viser's own habits left out."""
        return [each for each in self.browser.complaints() if not any(word in each for word in OF_VISER)]

    def tab(self, name: str) -> None:
        """Open a tab of the panel."""
        self._named("[role=tab]", name).click()

    def click(self, name: str) -> None:
        """Click a button."""
        self._named("button", name).click()

    def choose(self, label: str, word: str) -> None:
        """Choose a word of a dropdown."""
        self._input(label).click()
        self.wait(lambda: self._all("[role=option]", word))
        self._all("[role=option]", word)[0].click()

    def press(self, label: str, key: str) -> None:
        """Press a key on a slider."""
        from selenium.webdriver.common.keys import Keys

        self.slider(label).send_keys(getattr(Keys, key))

    def slider(self, label: str) -> Any:
        """The handle of a slider that can be seen."""
        self.wait(lambda: self._labelled(label, "[role=slider]"))
        return self._labelled(label, "[role=slider]")

    def click_until(self, name: str, done: Callable[[], Any]) -> None:
        """Click a button until something is true."""
        self.until(lambda: self.click(name), done)

    def drag_grip(self, end: str, part: int, turn: float) -> None:
        """Drag the grip of a part of a posture around its joint, by an angle, rad."""
        before = self.studio.session.view.number
        self.wait(lambda: self.studio.server.get_clients())
        self.until(lambda: self._drag_once(end, part, turn), lambda: self.studio.session.view.number > before)

    def _drag_once(self, end: str, part: int, turn: float) -> None:
        from selenium.webdriver.common.action_chains import ActionChains

        robot = self.studio.session.view.problem.robot
        places = grip_places(self.studio, end, part, np.linspace(0.0, turn, 6))
        points = [self._pixel(each) for each in world_points(robot.plane, places)]
        canvas = self.browser.driver.find_elements("css selector", "canvas")[0]
        corner = canvas.rect
        middle = np.array([corner["width"] / 2, corner["height"] / 2])
        chain = ActionChains(self.browser.driver, duration=30)
        offsets = [np.rint(point - middle).astype(int).tolist() for point in points]
        chain.move_to_element_with_offset(canvas, *offsets[0]).pause(0.2).click_and_hold()
        for offset in offsets[1:]:
            chain.move_to_element_with_offset(canvas, *offset).pause(0.1)
        chain.release().perform()

    def _pixel(self, point: Any) -> Any:
        """Where a place in space is on the canvas."""
        (camera,) = [client.camera for client in self.studio.server.get_clients().values()]
        w, x, y, z = camera.wxyz
        turn = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        seen = turn.T @ (point - camera.position)
        height, width = camera.image_height, camera.image_width
        focal = height / 2 / np.tan(camera.fov / 2)
        return np.array([width / 2 + focal * seen[0] / seen[2], height / 2 + focal * seen[1] / seen[2]])

    def _named(self, selector: str, name: str) -> Any:
        self.wait(lambda: self._all(selector, name))
        return self._all(selector, name)[0]

    def _all(self, selector: str, name: str) -> list[Any]:
        script = (
            "return [...document.querySelectorAll(arguments[0])]"
            ".filter(e => e.textContent.trim() === arguments[1] && e.getClientRects().length)"
        )
        found: list[Any] = self.browser.run(script, selector, name)
        return found

    def _input(self, label: str) -> Any:
        self.wait(lambda: self._labelled(label, "input"))
        return self._labelled(label, "input")

    def _labelled(self, label: str, selector: str) -> Any:
        """What stands beside a label, if it can be seen."""
        script = (
            "const label = [...document.querySelectorAll('label')].find(e => e.textContent === arguments[0]"
            " && e.getClientRects().length); if (!label) return null;"
            "let e = label; while (e && !e.querySelector(arguments[1])) e = e.parentElement;"
            "return e && e.querySelector(arguments[1])"
        )
        return self.browser.run(script, label, selector)
