"""The region of interest of the file, drawn on the rover's page in a real browser."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.companion.observers.page import played
from tests.companion.observers.page.browser import PHONE, needs_browser, opened_tab
from tests.companion.observers.page.played_settings import FILE, SettingsStage

WIDTH, HEIGHT, BAR, FOOT = 480, 424, 34, 30
pytestmark = [pytest.mark.slow, needs_browser]


@pytest.fixture(autouse=True)
def _picture(monkeypatch: pytest.MonkeyPatch) -> None:
    pixels = np.full((HEIGHT, WIDTH, 3), 120, np.uint8)
    monkeypatch.setattr(played, "JPEG", cv2.imencode(".jpg", pixels)[1].tobytes())


def test_a_region_is_drawn_over_the_live_picture_and_written_by_a_second_click(tmp_path: Path) -> None:
    stage = SettingsStage(tmp_path, token=played.TOKEN)
    stage.until(stage.up)
    url = f"{stage.page.url}?token={played.TOKEN}"
    with closing(stage), opened_tab(url, viewport=PHONE) as tab:
        draw = tab.get_by_role("button", name="Draw the region")
        stage.until(tab.locator("#settings").is_visible)
        assert not draw.is_visible()
        tab.get_by_role("button", name="Show settings").click()
        stage.until(draw.is_visible)
        stage.until(tab.locator("#picture").is_visible)
        draw.click()
        box = tab.locator("#picture").bounding_box()

        def to(x: float, y: float) -> None:
            """Move to a place in fractions of the frame, which has bars above and below it."""
            inside = (BAR + y * (HEIGHT - BAR - FOOT)) / HEIGHT
            tab.mouse.move(box["x"] + x * box["width"], box["y"] + inside * box["height"])

        to(0.25, 0.5)
        tab.mouse.down()
        to(0.6, 0.8)
        to(0.75, 1.0)
        tab.mouse.up()
        review, write = tab.locator("#settings .review"), tab.get_by_role("button", name="Write and restart")
        stage.until(lambda: "4 settings are changed here" in review.inner_text())
        drawn = tab.locator("#view .band").bounding_box()
        assert drawn["x"] == pytest.approx(box["x"] + 0.25 * box["width"], abs=2)
        assert drawn["width"] == pytest.approx(0.5 * box["width"], abs=2)
        tab.get_by_role("button", name="Show what would").click()
        stage.until(write.is_visible)
        write.click()
        stage.until(lambda: "[roi]" in stage.file.read_text())
        sides = dict(
            line.split(" = ")
            for line in stage.file.read_text().partition("[roi]\n")[2].split("\n")
            if "=" in line
        )
        wanted = {"left": 0.25, "top": 0.5, "right": 0.75, "bottom": 1.0}
        assert {name: float(text) for name, text in sides.items()} == pytest.approx(wanted, abs=0.01)


def test_a_region_that_is_computed_cannot_be_drawn(tmp_path: Path) -> None:
    mounted = "[mount]\nheight = 0.6\ntilt = 20.0\nwidth = 0.5\n[stopping]\nspeed = 1.0\n"
    stage = SettingsStage(tmp_path, token=played.TOKEN, text=FILE + mounted)
    stage.until(stage.up)
    with closing(stage), opened_tab(f"{stage.page.url}?token={played.TOKEN}") as tab:
        stage.until(tab.locator("#settings").is_visible)
        tab.get_by_role("button", name="Show settings").click()
        draw = tab.get_by_role("button", name="Draw the region")
        stage.until(draw.is_visible)
        assert draw.is_disabled()
        assert "computed from mount, width and speed" in tab.locator("#settings").inner_text()
