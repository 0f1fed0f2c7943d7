"""Debian's Chromium, driven by Selenium: pages are opened from files, and all that they ask for is written down."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from needed import skip_or_fail

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
SIZE = 1000, 640
SWITCHES = (
    "--headless=new",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    f"--window-size={SIZE[0]},{SIZE[1]}",
)


class Browser:
    """One browser with one page at a time."""

    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def open(self, path: Path) -> None:
        self.driver.get_log("performance")
        self.driver.get_log("browser")
        self.driver.get(path.resolve().as_uri())

    def reset(self) -> None:
        """Leave the page, and forget what it was told of sizes, media and complaints."""
        self.driver.get("about:blank")
        self.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": []})
        self.driver.set_window_size(*SIZE)
        self.complaints()

    def run(self, script: str, *arguments: Any) -> Any:
        return self.driver.execute_script(script, *arguments)

    def requests(self) -> list[str]:
        """Addresses that the page asked for since it was opened, its own included, data in the page left out."""
        messages = [json.loads(entry["message"])["message"] for entry in self.driver.get_log("performance")]
        sent = [message["params"] for message in messages if message["method"] == "Network.requestWillBeSent"]
        sockets = [message["params"]["url"] for message in messages if message["method"] == "Network.webSocketCreated"]
        found = [each["request"]["url"] for each in sent] + sockets
        return [url for url in found if not url.startswith(("data:", "blob:"))]

    def complaints(self, least: str = "WARNING") -> list[str]:
        levels = ("SEVERE",) if least == "SEVERE" else ("SEVERE", "WARNING")
        return [entry["message"] for entry in self.driver.get_log("browser") if entry["level"] in levels]


def started() -> Iterator[Browser]:
    """Start the browser, and end it; skip where there is none, unless continuous integration is to have one."""
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    driver = shutil.which("chromedriver")
    if program is None or driver is None:
        skip_or_fail("no Chromium with its driver: apt-get install chromium chromium-driver")
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = program
    for switch in SWITCHES:
        options.add_argument(switch)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    session = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    try:
        yield Browser(session)
    finally:
        session.quit()
