"""What a drag over the picture leaves, however it ends: the band shows what waits among the settings."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.companion.observers.page import played
from tests.companion.observers.page.browser import PHONE, needs_browser, opened_tab
from tests.companion.observers.page.played_settings import FILE, SettingsStage

pytestmark = [pytest.mark.slow, needs_browser]
SIDES = ("left", "top", "right", "bottom")


@pytest.fixture(autouse=True)
def _picture(monkeypatch: pytest.MonkeyPatch) -> None:
    pixels = np.full((424, 480, 3), 120, np.uint8)
    monkeypatch.setattr(played, "JPEG", cv2.imencode(".jpg", pixels)[1].tobytes())


class Drawing:
    """The settings of a page, where the region is being drawn."""

    def __init__(self, stage: SettingsStage, tab: Any) -> None:
        self.stage, self.tab = stage, tab
        self.toggle = tab.get_by_role("button", name="Draw the region")
        stage.until(tab.locator("#settings").is_visible)
        tab.get_by_role("button", name="Show settings").click()
        stage.until(self.toggle.is_visible)
        stage.until(tab.locator("#picture").is_visible)

    def to(self, x: float, y: float) -> None:
        """Move the mouse to a place in fractions of the picture."""
        box = self.tab.locator("#picture").bounding_box()
        self.tab.mouse.move(box["x"] + x * box["width"], box["y"] + y * box["height"])

    def press(self, *way: tuple[float, float]) -> None:
        """Press the mouse on the first place, and move on."""
        self.to(*way[0])
        self.tab.mouse.down()
        for place in way[1:]:
            self.to(*place)

    def sides(self) -> list[str]:
        return [self.tab.locator(f"#f-roi-{side}").input_value() for side in SIDES]

    @property
    def band(self) -> Any:
        return self.tab.locator("#view .band")


@contextmanager
def drawing(folder: Path, text: str = FILE, **context: Any) -> Iterator[Drawing]:
    stage = SettingsStage(folder, token=played.TOKEN, text=text)
    try:
        stage.until(stage.up)
        with opened_tab(f"{stage.page.url}?token={played.TOKEN}", **context) as tab:
            yield Drawing(stage, tab)
    finally:
        stage.close()


def test_a_drag_that_ends_without_a_box_changes_nothing_and_its_band_goes(tmp_path: Path) -> None:
    with drawing(tmp_path) as at:
        before = at.sides()
        at.toggle.click()
        at.press((0.2, 0.3), (0.6, 0.7), (0.21, 0.31))
        at.tab.mouse.up()
        assert not at.band.is_visible(), "back to its start"
        at.press((0.2, 0.3), (0.6, 0.7))
        assert at.band.is_visible()
        at.tab.keyboard.press("Escape")
        assert not at.band.is_visible()
        at.to(0.7, 0.7)
        at.tab.mouse.up()
        assert at.sides() == before
        assert at.toggle.get_attribute("aria-pressed") == "true", "the first Escape ends the drag alone"
        at.tab.keyboard.press("Escape")
        assert at.toggle.get_attribute("aria-pressed") == "false"

        at.toggle.click()
        at.press((0.2, 0.3), (0.6, 0.7))
        at.tab.evaluate("document.querySelector('#settings > button').click()")
        at.to(0.7, 0.8)
        at.tab.mouse.up()
        assert "changed here" not in at.tab.locator("#settings .review").text_content()
        assert at.band.count() == 0, "the settings were hidden meanwhile"


def test_the_band_shows_what_was_drawn_also_once_drawing_is_turned_on_again(tmp_path: Path) -> None:
    with drawing(tmp_path) as at:
        at.toggle.click()
        at.press((0.2, 0.3), (0.6, 0.7))
        at.tab.mouse.up()
        at.stage.until(at.band.is_visible)
        drawn = at.band.get_attribute("style")
        at.toggle.click()
        assert at.band.count() == 0
        at.toggle.click()
        assert at.band.is_visible()
        assert at.band.get_attribute("style") == drawn
        at.tab.get_by_role("button", name="Show what would").dispatch_event("click")
        at.press((0.3, 0.2), (0.9, 0.9))
        at.tab.mouse.up()
        at.tab.get_by_text("Wait: the last change").wait_for()
        assert at.band.get_attribute("style") == drawn, "what was not taken is not shown"


def test_of_two_fingers_the_first_draws(tmp_path: Path) -> None:
    with drawing(tmp_path, viewport=PHONE, has_touch=True, is_mobile=True) as at:
        at.toggle.click()
        box, session = at.tab.locator("#picture").bounding_box(), at.tab.context.new_cdp_session(at.tab)

        def touch(kind: str, *fingers: tuple[float, float]) -> None:
            points = [
                {"x": box["x"] + x * box["width"], "y": box["y"] + y * box["height"], "id": n}
                for n, (x, y) in enumerate(fingers)
            ]
            session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

        touch("touchStart", (0.1, 0.2))
        touch("touchStart", (0.1, 0.2), (0.9, 0.9))
        touch("touchMove", (0.5, 0.8), (0.7, 0.3))
        touch("touchEnd")
        at.stage.until(lambda: "4 settings are" in at.tab.locator("#settings .review").inner_text())
        left, _, right, _ = map(float, at.sides())
        assert (left, right) == pytest.approx((0.1, 0.5), abs=0.02)
        shown = at.toggle.bounding_box()
        assert 0 <= shown["y"] <= PHONE["height"], "what ends it is in view"
        assert at.tab.get_by_text("It is drawn, and not written yet").is_visible()


def test_a_box_at_the_edge_has_a_size_and_without_a_picture_there_is_none(tmp_path: Path) -> None:
    with drawing(tmp_path) as at:
        at.toggle.click()
        box = at.tab.locator("#picture").bounding_box()
        at.press((0.998, 0.3), (1.2, 0.6))
        at.tab.mouse.up()
        at.stage.until(at.band.is_visible)
        left, _, right, _ = map(float, at.sides())
        assert (left, right) == (0.98, 1.0)
        before = at.sides()
        at.tab.evaluate("document.getElementById('picture').hidden = true")
        pane = at.tab.locator("#view .pane").bounding_box()
        at.tab.mouse.move(pane["x"] + 20, pane["y"] + 5)
        at.tab.mouse.down()
        at.tab.mouse.move(pane["x"] + 200, pane["y"] + 5 + box["height"] / 2)
        at.tab.mouse.up()
        assert at.sides() == before


def test_with_a_speed_and_no_mount_the_region_is_drawn(tmp_path: Path) -> None:
    text = FILE + "[mount]\nwidth = 0.5\n[stopping]\nspeed = 1.0\n"
    with drawing(tmp_path, text) as at:
        assert not at.toggle.is_disabled()
        assert "is computed" not in at.tab.locator("#settings").inner_text()


def test_that_the_region_is_computed_is_said_while_it_is(tmp_path: Path) -> None:
    mounted = "[mount]\nheight = 0.6\ntilt = 20.0\nwidth = 0.5\n[stopping]\nspeed = 1.0\n"
    with drawing(tmp_path, FILE + mounted) as at:
        assert at.tab.get_by_text("The region is computed").is_visible()
        at.stage.file.write_text(FILE)
        at.stage.start_again()
        os.kill(at.stage.pid(), signal.SIGKILL)  # the page's process, which is told when it starts
        at.stage.until(lambda: not at.toggle.is_disabled())
        assert at.tab.get_by_text("The region is computed").count() == 0
