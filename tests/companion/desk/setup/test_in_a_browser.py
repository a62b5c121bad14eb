"""A rover is set up in a real browser, from an empty folder to a file that passes the checks."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from anytraverse.ground import GroundCamera
from companion.config import load_config
from companion.desk.setup.parameters import read, set_one
from companion.sim.field.lens import FIELD_OF_VIEW, HEIGHT, PITCH
from tests.waiting import wait_for

playwright = pytest.importorskip("playwright.sync_api")
CHROMIUM = Path("/usr/bin/chromium")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not CHROMIUM.exists(), reason="Chromium is not installed"),
]
PATIENCE = 60_000
MOST_CLICKS, MOST_SECONDS = 25, 300.0
VIEW, TILT = math.degrees(FIELD_OF_VIEW), math.degrees(PITCH)
FRONT = 0.6
SIZES = {"desktop": (1280, 900), "phone": (390, 844)}
PAGES = ("camera", "mount", "vehicle", "region", "words", "link", "autopilot", "policy", "review", "settings")


@contextmanager
def running(*command: str, folder: Path) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(
        [sys.executable, "-m", *command], stdout=subprocess.PIPE, text=True, cwd=folder
    )
    try:
        yield process
    finally:
        process.terminate()
        process.wait(20.0)


@pytest.fixture(scope="module")
def field(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Any]]:
    """A simulated rover's addresses."""
    options = ("--seed", "1", "--speed", "0.5", "--fps", "4")
    with running("companion.sim.field", *options, folder=tmp_path_factory.mktemp("field")) as process:
        assert process.stdout is not None
        yield json.loads(process.stdout.readline())


@pytest.fixture
def url(tmp_path: Path) -> Iterator[str]:
    """The address of a set-up that begins in an empty folder."""
    with running("companion", "setup", folder=tmp_path) as process:
        assert process.stdout is not None
        yield next(line.split()[1] for line in process.stdout if line.startswith("Open "))


@pytest.fixture(params=SIZES)
def tab(request: pytest.FixtureRequest, url: str) -> Iterator[Any]:
    """The open page. Errors in it fail the test."""
    width, height = SIZES[request.param]
    with playwright.sync_playwright() as browsers:
        browser = browsers.chromium.launch(executable_path=str(CHROMIUM), args=["--no-sandbox"])
        context = browser.new_context(viewport={"width": width, "height": height}, bypass_csp=True)
        made, errors = context.new_page(), list[str]()
        made.set_default_timeout(PATIENCE)
        made.on("pageerror", lambda error: errors.append(str(error)))
        made.add_init_script(
            "window.clicks = 0; addEventListener('click', (one) => one.isTrusted && window.clicks++, true)"
        )
        made.goto(url)
        made.locator("h2").first.wait_for()
        yield made
        browser.close()
        assert errors == []


def fill(tab: Any, label: str, value: str) -> None:
    """Type a value, as with Tab from one field to the next: no click."""
    tab.get_by_label(label, exact=True).fill(value)
    tab.keyboard.press("Tab")


def looks_right(tab: Any) -> None:
    """The page does not scroll sideways, and axe finds nothing."""
    assert tab.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    try:
        from axe_playwright_python.sync_playwright import Axe
    except ImportError:
        return
    tab.wait_for_timeout(300)
    found = Axe().run(tab)
    assert found.violations_count == 0, found.generate_report()


def drag(tab: Any, handle: str, row: float) -> None:
    """Drag a line to a row, a fraction of the picture's height."""
    tab.evaluate("scrollTo(0, 0)")
    picture = tab.locator(".live img").bounding_box()
    circle = tab.get_by_role("slider", name=handle).locator("circle").bounding_box()
    x = circle["x"] + circle["width"] / 2
    tab.mouse.move(x, circle["y"] + circle["height"] / 2)
    tab.mouse.down()
    tab.mouse.move(x, picture["y"] + row * picture["height"], steps=5)

    with tab.expect_response(
        lambda one: one.url.endswith("/drag") and '"final":true' in one.request.post_data
    ):
        tab.mouse.up()


def close(field: Any, value: float, within: float) -> None:
    """Wait until a field has about this value."""
    wait_for(lambda: abs(float(field.input_value() or "nan") - value) < within, 30.0, field.input_value)


def forward(tab: Any, name: str) -> None:
    looks_right(tab)
    tab.get_by_role("button", name=f"Next: {name}").click()
    tab.locator("h2").first.wait_for()


def set_the_picture(tab: Any, field: dict[str, Any]) -> None:
    """Pages 1 and 2."""
    tab.get_by_label("Another source").fill(f"field:{field['frames']}")
    tab.get_by_role("button", name="Use it").click()
    tab.locator(".live img").wait_for()
    fill(tab, "Horizontal view, degrees", f"{VIEW:g}")
    fill(tab, "Frames a second to judge", "4")
    tab.locator(".findings").get_by_text("frames", exact=True).wait_for()
    forward(tab, "Mount")
    fill(tab, "Lens to the vehicle's front, m", f"{FRONT:g}")
    seen = GroundCamera.pinhole(HEIGHT, TILT, VIEW, 4 / 3, FRONT)
    drag(tab, "Horizon line", seen.row(1e6))
    close(tab.get_by_label("Tilt, degrees"), TILT, 0.3)
    drag(tab, "Line 2 m ahead", seen.row(2.0))
    height, tilt = tab.get_by_label("Height of the lens, m"), tab.get_by_label("Tilt, degrees")
    close(height, HEIGHT, 0.05)
    tab.get_by_role("slider", name="Horizon line").focus()
    for _ in range(2):  # the line keeps the focus
        before = float(tilt.input_value())
        tab.keyboard.press("ArrowDown")
        close(tilt, before - 0.3, 0.29)
    fill(tab, "Height of the lens, m", f"{HEIGHT:g}")
    fill(tab, "Tilt, degrees", f"{TILT:g}")
    forward(tab, "Vehicle")


def set_the_vehicle_and_words(tab: Any) -> None:
    """Pages 3 to 5."""
    fill(tab, "Width, m", "0.9")
    fill(tab, "Fastest speed by itself, m/s", "0.5")
    tab.get_by_text("fits up to").wait_for()
    forward(tab, "Region")
    tab.get_by_text("It is computed from mount, width and speed").wait_for()
    assert tab.locator(".marks .region").count() == 1
    forward(tab, "Words")
    tab.locator("img[alt^='The picture with the judgement']").wait_for()
    facts = tab.locator("dl.facts dd").first
    before = facts.inner_text()
    tab.get_by_label("grass", exact=True).uncheck()
    wait_for(lambda: facts.inner_text() != before)
    tab.get_by_label("grass", exact=True).check()
    forward(tab, "Link")


def set_link_and_policy(tab: Any, field: dict[str, Any]) -> None:
    """Pages 6 to 8."""
    tab.get_by_label("Another address", exact=True).last.fill(field["companion"])
    tab.get_by_role("button", name="Listen").click()
    tab.get_by_role("button", name=f"Use {field['companion']}").click()
    assert "ArduPilot" in tab.locator("table").inner_text()
    forward(tab, "Autopilot")
    tab.get_by_role("button", name="Read its settings").click()
    tab.get_by_role("button", name="Set MIS_RESTART from 1 to 0").click()
    tab.get_by_text("Nothing is to change.").wait_for()
    forward(tab, "Policy")
    hold = tab.locator(".policy").filter(has=tab.locator("#policy-hold"))
    hold.wait_for()
    assert "stopping" not in hold.inner_text(), hold.inner_text()
    tab.locator("#policy-hold").check()
    forward(tab, "Review")


def command(*words: str) -> subprocess.CompletedProcess[str]:
    ran = [sys.executable, "-m", "companion", *words]
    return subprocess.run(ran, capture_output=True, text=True, check=False)


def test_from_an_empty_folder_to_a_rover_that_may_hold(
    tab: Any, field: dict[str, Any], tmp_path: Path
) -> None:
    file, began = tmp_path / "companion.toml", time.monotonic()
    config = load_config(file)
    config = replace(config, link=replace(config.link, url=field["companion"]))
    set_one(config, read(config), "MIS_RESTART", 0.0, 1.0)
    set_the_picture(tab, field)
    set_the_vehicle_and_words(tab)
    set_link_and_policy(tab, field)
    assert "call.policy" in tab.locator("section").first.inner_text(), "it is said to be guarded"
    looks_right(tab)
    assert load_config(file).camera.source == "folder:pictures", "nothing is written before the click"
    tab.get_by_role("button", name="Write the file").click()
    tab.get_by_text("is written; what stood there before").wait_for()
    clicks, seconds = tab.evaluate("window.clicks"), time.monotonic() - began
    print(f"{clicks} clicks, {seconds:.0f} s")
    assert clicks <= MOST_CLICKS
    assert seconds <= MOST_SECONDS

    written = load_config(file)
    assert (written.call.policy, written.mount.width, written.stopping.speed) == ("hold", 0.9, 0.5)
    assert written.words["grass"] == 1.0
    assert command("config", "check", str(file)).returncode == 0
    said = json.loads(command("check", "--json", str(file)).stdout.splitlines()[-1])
    rows = {row["check"]: row for row in said["checks"]}
    for name in ("config", "camera", "exposure", "link", "autopilot", "stopping", "tile"):
        assert rows[name]["verdict"] != "fail", rows[name]

    tab.get_by_role("link", name="All settings").click()
    tab.get_by_label("Search").fill("votes")
    assert tab.get_by_label("votes", exact=True).input_value() == "2"
    looks_right(tab)
    fill(tab, "votes", "1")
    tab.get_by_text("1 changed, not written").wait_for()


def test_a_set_up_without_camera_and_autopilot_says_what_is_wrong_on_each_page(tab: Any) -> None:
    for name in PAGES:
        tab.evaluate(f"location.hash = '{name}'")
        tab.locator("h2").first.wait_for()
        if name == "camera":
            tab.locator(".note").get_by_text("cannot be read").wait_for()
        if name == "words":
            tab.get_by_text("no picture has come").first.wait_for()
        if name == "policy":
            tab.locator(".policy").last.wait_for()
        looks_right(tab)


NOISE = "import os, time\nwhile True:\n    os.write(1, os.urandom(320 * 240 * 3))\n    time.sleep(0.1)\n"


def test_settings_that_go_together_are_typed_one_after_the_other(tab: Any, tmp_path: Path) -> None:
    program = tmp_path / "noise.py"
    program.write_text(NOISE)
    tab.get_by_label("Another source").fill(f"pipe:{sys.executable} {program}")
    tab.get_by_role("button", name="Use it").click()
    tab.get_by_text("a pipe needs [camera] width, height and pixel_format").first.wait_for()
    fill(tab, "Width, pixels", "320")
    refused = tab.locator("#f-camera-width-problem").get_by_text("give both")
    refused.wait_for()
    tab.locator("#summary").get_by_text("not taken: camera.source, camera.width").wait_for()
    fill(tab, "Height, pixels", "240")
    refused.wait_for(state="hidden")
    tab.get_by_label("Pixel format", exact=True).select_option("rgb24")
    tab.locator(".measured").get_by_text("320 x 240").wait_for()
    forward(tab, "Mount")
    fill(tab, "Height of the lens, m", "1.5")
    tab.locator("#f-mount-height-problem").get_by_text("give both").wait_for()
    drag(tab, "Horizon line", 0.3)
    tab.get_by_text("Height 1.5 m, tilt").wait_for()
    fill(tab, "Height of the lens, m", "")
    fill(tab, "Tilt, degrees", "")
    tab.get_by_text("Not set yet").wait_for()
    fill(tab, "Roll, degrees", "500")
    fill(tab, "Height of the lens, m", "1")  # typed on, without a look at what was refused
    fill(tab, "Tilt, degrees", "7")
    tab.get_by_text("Height 1 m, tilt 7 degrees").wait_for()
    looks_right(tab)
