"""The page in a browser: Debian's chromium and chromium-driver, without a display."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
from base64 import b64decode
from collections.abc import Callable, Iterator
from pathlib import Path
from time import monotonic, sleep
from typing import Any, TypeVar

import pytest

pytest.importorskip("aiohttp", reason="needs the extra 'view'")

from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement

MURK = [sys.executable, "-c", "from node.cli import main; main()", "run"]
WORLD = ["--radar", "world", "--camera", "world", "--duration", "600", "--seed", "3"]
INJECTABLE = ["--inject", "camera:noise:0", "--inject", "radar:snr:0"]
SWITCH = """
name = "highway"

[[switches]]
name = "detector"
default = "camera_first"

[[switches.rules]]
sensor = "camera"
stale_s = 5.0
model = "radar_only"

[[switches.rules]]
sensor = "camera"
above = 40
hysteresis = 10
model = "radar_only"
"""
PATIENCE_S = 60.0
PICTURES = os.environ.get("MURK_PICTURES")
"""A folder; where it is set, the screenshots are kept there."""

T = TypeVar("T")


@pytest.fixture(scope="module")
def browser() -> Iterator[webdriver.Chrome]:
    binary, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if binary is None or driver is None:
        pytest.skip("no chromium and chromedriver (Debian: chromium, chromium-driver)")
    options = webdriver.ChromeOptions()
    options.binary_location = binary
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"):
        options.add_argument(argument)
    options.add_argument("--disable-dev-shm-usage")
    chrome = webdriver.Chrome(options=options, service=Service(driver))
    yield chrome
    chrome.quit()


class Node:
    """``murk run --view`` in a process of its own, at the same port each time it is started."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = str(free.getsockname()[1])
        self.url = f"http://127.0.0.1:{port}/"
        self._command = [*MURK, *WORLD, *arguments, "--view", "--port", port, "--json"]
        self._written = folder / "written.jsonl"
        self.start()

    def start(self) -> None:
        with self._written.open("w") as written:  # a pipe that nobody reads would hold it up
            self._process = subprocess.Popen(
                self._command, stdout=written, stderr=subprocess.PIPE, text=True
            )
        assert self._process.stderr is not None
        said = self._process.stderr.readline()
        if said != f"murk: page at {self.url}\n":
            self.kill()
            pytest.fail(f"the node said {said!r}")

    def stop(self) -> list[dict[str, Any]]:
        """End it by Ctrl-C; return the lines that it wrote."""
        self._process.send_signal(signal.SIGINT)
        _, errors = self._process.communicate(timeout=PATIENCE_S)
        assert self._process.returncode == 0, errors
        return [json.loads(line) for line in self._written.read_text().splitlines()]

    def kill(self) -> None:
        self._process.kill()
        self._process.communicate()


@pytest.fixture
def node(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Node]:
    scene = tmp_path / "scene.toml"
    scene.write_text(SWITCH)
    running = Node(tmp_path, *getattr(request, "param", INJECTABLE), str(scene))
    yield running
    running.kill()


def until(question: Callable[[], T]) -> T:
    """Return the first answer that is true."""
    end_s = monotonic() + PATIENCE_S
    while not (answer := question()):
        assert monotonic() < end_s, "the page does not show it"
        sleep(0.1)
    return answer


def shown(browser: webdriver.Chrome, selector: str) -> str:
    script = "return document.querySelector(arguments[0])?.innerText ?? ''"
    return str(browser.execute_script(script, selector)).replace("\xa0", " ")


def level(browser: webdriver.Chrome, sensor: str) -> float:
    """Return the level that is shown; −1 where none is."""
    text = shown(browser, f"[data-sensor={sensor}] [data-value=level]")
    return float(text) if text.isdigit() else -1.0


def press(browser: webdriver.Chrome, sensor: str, kind: str, pressed: bool = True) -> None:
    """Press a kind's button until the node does what it asks; where the page lags, it is off."""
    place = f"[data-sensor={sensor}] button[data-kind={kind}]"
    button = browser.find_element(By.CSS_SELECTOR, place)

    def done() -> bool:
        if button.get_attribute("aria-pressed") == str(pressed).lower():
            return True
        if button.is_enabled():
            browser.execute_script("arguments[0].click()", button)
            sleep(1.0)
        return False

    until(done)


def slide_to(slider: WebElement, level: int) -> bool:
    """Move a slider a step to the right; tell whether it was there before."""
    if slider.get_attribute("value") == str(level):
        return True
    if slider.is_enabled():
        slider.send_keys(Keys.ARROW_RIGHT)
    return False


def link(browser: webdriver.Chrome) -> str:
    return str(browser.execute_script("return document.body.dataset.link"))


def colours_of(browser: webdriver.Chrome, selector: str) -> int:
    """Return how many colours a canvas shows."""
    script = """
        const canvas = document.querySelector(arguments[0]);
        if (!canvas?.width) return 0;
        const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext("2d");
        copy.drawImage(canvas, 0, 0);
        const image = copy.getImageData(0, 0, canvas.width, canvas.height);
        return new Set(new Uint32Array(image.data.buffer)).size;
    """
    return int(browser.execute_script(script, selector))


def look(browser: webdriver.Chrome, width: int, height: int, scheme: str, name: str | None) -> None:
    """Resize, check that nothing is wider than the window, and keep a picture where asked to."""
    metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
    assert browser.execute_script("return document.documentElement.scrollWidth") <= width
    clipped = """
        return [...document.querySelectorAll("main *, nav *")].filter((one) =>
          one.clientWidth && one.scrollWidth > one.clientWidth + 1
          && getComputedStyle(one).textOverflow !== "ellipsis").map(
            (one) => [one.tagName, one.className, one.scrollWidth, one.clientWidth])
    """
    until(lambda: browser.execute_script(clipped) == [])
    if PICTURES and name:
        sleep(1.0)
        whole = browser.execute_script("return document.documentElement.scrollHeight")
        clip = {"x": 0, "y": 0, "width": width, "height": max(height, whole), "scale": 1}
        shot = {"captureBeyondViewport": True, "clip": clip}
        picture = browser.execute_cdp_cmd("Page.captureScreenshot", shot)
        Path(PICTURES, f"{name}.png").write_bytes(b64decode(picture["data"]))


def has_text(browser: webdriver.Chrome, selector: str, text: str) -> Callable[[], bool]:
    return lambda: text in shown(browser, selector)


def fill_a_minute(browser: webdriver.Chrome) -> None:
    """Inject this and that, so that the pictures have something to show."""
    for sensor, kind, pressed in (
        ("camera", "noise", False),
        ("radar", "snr", False),
        ("camera", "blur", True),
        ("camera", "blur", False),
        ("radar", "ghosts", True),
        ("camera", "noise", True),
        ("radar", "ghosts", False),
        ("radar", "snr", True),
    ):
        sleep(6.0)
        press(browser, sensor, kind, pressed)
    sleep(6.0)
    browser.execute_script("document.activeElement.blur()")


def test_the_page_shows_injects_and_comes_back(browser: webdriver.Chrome, node: Node) -> None:
    browser.get(node.url)
    until(lambda: level(browser, "camera") >= 0 and level(browser, "radar") >= 0)
    until(lambda: level(browser, "camera") in range(20))
    until(lambda: link(browser) == "live")
    until(lambda: colours_of(browser, "[data-sensor=camera] .view canvas") > 200)
    until(lambda: colours_of(browser, "[data-sensor=radar] .view canvas") > 20)
    until(has_text(browser, "[data-sensor=camera] [data-value=rate]", "Hz"))
    until(has_text(browser, "#models b", "camera_first"))
    until(has_text(browser, "#node", "active"))
    until(has_text(browser, "[data-sensor=radar] [data-value=p99]", "ms"))

    press(browser, "camera", "noise")
    until(has_text(browser, "[data-sensor=camera] .words", "injected: noise 50 %"))
    until(lambda: abs(level(browser, "camera") - 50) <= 15)
    slider = browser.find_element(By.CSS_SELECTOR, "input[data-kind=noise]")
    until(lambda: slide_to(slider, 80))
    until(has_text(browser, "[data-sensor=camera] .words", "injected: noise 80 %"))
    until(has_text(browser, "#models b", "radar_only"))
    until(has_text(browser, "#models .reason", "camera"))
    until(has_text(browser, "#log", "radar_only"))
    until(lambda: abs(level(browser, "camera") - 80) <= 15)
    until(has_text(browser, "[data-sensor=camera] .likeliest", "noise"))
    press(browser, "radar", "snr")
    until(lambda: level(browser, "radar") >= 25)

    if PICTURES:
        fill_a_minute(browser)
    for width, height, scheme, name in (
        (1280, 800, "dark", "page"),
        (390, 844, "light", "page-phone"),
        (768, 1024, "dark", None),
        (1920, 1080, "light", "page-light"),
    ):
        look(browser, width, height, scheme, name)

    off = browser.find_element(By.XPATH, "//*[@data-sensor='camera']//button[.='All off']")
    until(off.is_enabled)
    off.click()
    until(lambda: level(browser, "camera") in range(20))

    lines = node.stop()
    until(lambda: link(browser) == "disconnected")
    until(lambda: level(browser, "camera") == -1)  # an old value is not shown as if it were live
    assert "No connection to the node" in shown(browser, "#banner")
    look(browser, 1280, 800, "dark", "page-disconnected")
    injected = [line["injected"] for line in lines if line.get("sensor") == "camera"]
    assert {"noise": 50} in injected
    assert {"noise": 80} in injected
    assert injected[-1] is None
    assert lines[-1]["outputs"]["view"]["injections"] >= 4

    node.start()
    until(lambda: link(browser) == "live")
    until(lambda: level(browser, "camera") >= 0)
    until(lambda: shown(browser, "#banner:not([hidden])") == "")
    press(browser, "camera", "blur")
    until(has_text(browser, "[data-sensor=camera] .words", "injected: blur 50 %"))

    faults = [line for line in browser.get_log("browser") if line["level"] == "SEVERE"]
    known = ("net::ERR_", "WebSocket connection")  # while the node is away
    assert [line for line in faults if not any(one in line["message"] for one in known)] == []


@pytest.mark.parametrize("node", [["--token", "correct horse"]], indirect=True)
def test_a_token_is_typed_once_and_a_scene_without_injections_has_no_buttons(
    browser: webdriver.Chrome, node: Node
) -> None:
    browser.get(node.url)
    browser.find_element(By.ID, "token").send_keys("wrong one" + Keys.ENTER)
    until(lambda: "token=wrong" in browser.current_url)
    browser.find_element(By.ID, "token").send_keys("correct horse" + Keys.ENTER)
    until(lambda: level(browser, "radar") >= 0)
    assert browser.current_url == node.url
    assert browser.find_elements(By.CLASS_NAME, "inject") == []
    node.stop()
    node.start()
    until(lambda: link(browser) == "disconnected" or level(browser, "radar") == -1)
    until(lambda: link(browser) == "live" and level(browser, "radar") >= 0)
