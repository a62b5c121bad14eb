"""The page to choose from in Chromium, without a network: a hover tells, a click takes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from anytraverse.html_page import document
from anytraverse.plots import Axis, Curve, curves, installed
from companion.desk.tuning.choice import STYLE, parts
from tests.companion.desk.tuning.test_choice import CHOICE

playwright = pytest.importorskip("playwright.sync_api")
CHROMIUM = Path("/usr/bin/chromium")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not installed() or not CHROMIUM.exists(), reason="the extra plots or Chromium is not installed"
    ),
]


@pytest.fixture(params=[(1280, 800), (390, 844)], ids=["desk", "phone"])
def tab(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Any]:
    """The open page. Errors of its code, and requests, fail the test."""
    line = Curve("all calls", "--green", [{"x": 0, "y": 0}, {"x": 96, "y": 4}])
    rising = curves("Calls up to each frame", "Of 96 frames.", [line], Axis("frame"), Axis("calls"))
    file = tmp_path / "page.html"
    file.write_text(document("Tuning", STYLE, parts(CHOICE, rising)))
    with playwright.sync_playwright() as browsers:
        browser = browsers.chromium.launch(executable_path=str(CHROMIUM), args=["--no-sandbox"])
        width, height = request.param
        context = browser.new_context(viewport={"width": width, "height": height}, offline=True)
        tab, wrong = context.new_page(), list[str]()
        tab.on("pageerror", lambda error: wrong.append(str(error)))
        tab.on("request", lambda one: wrong.append(one.url) if one.url != file.as_uri() else None)
        tab.goto(file.as_uri())
        tab.wait_for_selector("#choice svg")
        yield tab
        browser.close()
        assert wrong == []


def point(tab: Any, number: int) -> Any:
    """The point of a setting."""
    return tab.locator(f'#choice path[aria-label*="; setting: {number};"]')


def test_a_hover_tells_and_a_click_takes(tab: Any) -> None:
    assert "tune --take 2" in tab.locator("#command").inner_text()
    assert tab.locator("#warnings").inner_text() == "WARNING: <less>"
    point(tab, 0).hover()
    told = tab.locator("#vg-tooltip-element")
    tab.wait_for_function("document.querySelector('#vg-tooltip-element')?.innerText.includes('96 frames')")
    said = " ".join(told.inner_text().split())
    for figure in ("setting 0", "things noticed 1", "roi 0.3", "tile off", "region 0.3 0.5 0.7 0.9"):
        assert figure in said
    point(tab, 4).click()
    assert tab.locator("#command").inner_text() == "tune --take 4 --from {b}"
    assert tab.locator("#take").input_value() == "4"
    assert "calls a minute: 4.0; things noticed: 2; scene: 0.9" in tab.locator("#figures").inner_text()
    assert tab.locator("#warnings").inner_text() == ""
    tab.select_option("#take", "0")
    assert tab.locator("#command").inner_text() == "tune --take 0 --from {b}"
    assert tab.locator("#toml").inner_text().strip() == "roi = 0.3"


def test_what_is_shown_can_be_copied(tab: Any) -> None:
    tab.context.grant_permissions(["clipboard-read", "clipboard-write"])
    tab.get_by_role("button", name="Copy the command").click()
    tab.wait_for_function("document.getElementById('copied').textContent === 'Copied.'")
    assert tab.evaluate("navigator.clipboard.readText()") == "tune --take 2 --from {b}"


def test_no_text_is_clipped(tab: Any) -> None:
    assert tab.evaluate("document.documentElement.scrollWidth <= innerWidth")
    clipped = """[...document.querySelectorAll(".plot svg")].flatMap((svg) => {
      const whole = svg.getBoundingClientRect();
      return [...svg.querySelectorAll("text")].filter((text) => {
        const own = text.getBoundingClientRect();
        return own.left < whole.left - 1 || own.right > whole.right + 1 || own.bottom > whole.bottom + 1;
      }).map((text) => text.textContent);
    })"""
    assert tab.evaluate(clipped) == []
    assert tab.locator(".plot svg text").count() > 10


def test_ctrl_and_the_wheel_zoom_and_the_wheel_alone_scrolls(tab: Any) -> None:
    labels = "[...document.querySelectorAll('#choice .role-axis-label text')]"
    ticks = f"{labels}.map((one) => one.textContent).sort().join()"
    before = tab.evaluate(ticks)
    tab.locator("#choice svg").hover()
    tab.mouse.wheel(0, 60)
    tab.wait_for_function("scrollY > 0")
    assert tab.evaluate(ticks) == before
    tab.locator("#choice svg").hover()
    tab.keyboard.down("Control")
    tab.mouse.wheel(0, -300)
    tab.keyboard.up("Control")
    tab.wait_for_function(f"{ticks} !== {before!r}")
    tab.locator("#choice svg").dblclick()
    tab.wait_for_function(f"{ticks} === {before!r}")
