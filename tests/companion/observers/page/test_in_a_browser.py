"""What is so is shown in a real browser, and nothing old as if it were live."""

from __future__ import annotations

import json
import re
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import pytest

from anytraverse.judged_picture import draw_frame
from companion.config import Config
from companion.config.schema import MountSection
from companion.config.stopping import lines_of
from companion.sim.field.render import PinholeCamera
from companion.sim.field.things import World
from tests.companion.observers.page import played
from tests.companion.observers.page.browser import KNOWN, needs_browser, opened_tab, stage, tab
from tests.companion.observers.page.played import Stage
from tests.waiting import wait_for

__all__ = ["stage", "tab"]
pytestmark = needs_browser


def test_the_page_says_what_is_so_and_never_shows_old_news_as_live(stage: Stage, tab: Any) -> None:
    title, why = tab.locator("#state-title"), tab.locator("#state-why")
    picture, note = tab.locator("#picture"), tab.locator("#picture-note")
    stage.until(lambda: title.inner_text() == "OK")
    stage.until(picture.is_visible)
    stage.until(lambda: note.text_content() == "")
    assert tab.locator("#words").inner_text().split() == ["grass", "+1"]
    assert tab.locator("#words input:enabled").count() == 0
    assert "make room" in tab.locator("#check").inner_text()
    stage.news["status"]["state"] = "calling"
    stage.news["told"] = "C7 unknown thing ahead 38%: go/stay/word"
    stage.until(lambda: title.inner_text() == "CALLING")
    assert "C7 unknown thing ahead" in why.inner_text()

    calls = stage.folder / "calls"
    calls.mkdir(exist_ok=True)
    for ending in ("", "-raw", "-large"):
        (calls / f"7{ending}.jpg").write_bytes(played.JPEG)
    answer = {"at": 1.8e9, "motion": "go", "operations": ["<img src=x>: 1"], "text": "<b>no</b>"}
    (calls / "7.json").write_text(json.dumps({"id": 7, "reasons": ["unknown_object"], "answers": [answer]}))
    opened = {"id": 7, "kind": "call", "stage": "open", "frame_id": 9, "age": 3, "holding": True}
    stage.news["state"] |= {"open": opened, "reasons": ["unknown_object"]}
    stage.news["status"]["current_id"] = 7
    card = tab.locator("#open .call")
    stage.until(card.is_visible)
    assert "Unknown thing" in card.inner_text()
    assert re.match(r"Call C7, open for \d+ s\n", card.inner_text())
    assert "<img src=x>: 1, go: <b>no</b>" in card.inner_text()
    assert card.locator("b").count() == 0
    sources = card.locator(".shots img:visible").evaluate_all(
        "all => all.map(one => one.src.split('/').pop())"
    )
    assert [one.partition("?")[0] for one in sources] == ["7-raw.jpg", "7-raw.jpg", "7-large.jpg"]
    controls = tab.locator("button:visible:not(#alarm), .bar, form, input:visible:enabled:not([type=range])")
    assert controls.all_text_contents() == ["Show recordings"], "it only shows"

    wait_for(lambda: title.inner_text() == "NO NEWS", 6.0)  # nothing is told meanwhile
    assert "nothing below is live" in why.inner_text()
    assert "Not live: this picture is" in note.inner_text()
    assert "grayscale" in picture.evaluate("shown => getComputedStyle(shown).filter")

    stage.until(lambda: title.inner_text() == "CALLING")
    stage.until(lambda: note.text_content() == "")
    stage.close()
    wait_for(lambda: "no connection" in why.inner_text(), 8.0)
    assert title.inner_text() == "NO NEWS"


def test_the_place_that_matched_is_shown_beside_the_newest_picture_while_it_is_in_force(
    stage: Stage, tab: Any
) -> None:
    calls = stage.folder / "calls"
    calls.mkdir(exist_ok=True)
    (calls / "12-large.jpg").write_bytes(played.JPEG)
    place, picture = tab.locator(".place"), tab.locator(".place img")
    stage.until(tab.locator("#picture").is_visible)
    assert not place.is_visible()
    stage.news["state"]["known_place"] = KNOWN
    stage.until(picture.is_visible)
    assert "that of call 12" in place.inner_text()
    assert "0.96" in place.inner_text()
    assert tab.locator(".place .note").text_content() == ""
    newest, remembered = tab.locator("#picture").bounding_box(), picture.bounding_box()
    assert abs(newest["y"] - remembered["y"]) < 2.0
    assert remembered["x"] >= newest["x"] + newest["width"]
    stage.news["state"]["known_place"] = {**KNOWN, "call": 13, "picture": "/calls/13.jpg"}
    stage.until(lambda: "No picture" in tab.locator(".place .note").text_content())
    assert not picture.is_visible()
    stage.news["state"]["known_place"] = None
    stage.until(lambda: not place.is_visible())


def test_the_metres_are_laid_over_the_frame_without_its_bars_when_they_are_switched_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = World(0)
    frame, _ = PinholeCamera(world).render(world.trail.pose(20.0), 0.0)
    panel = draw_frame(frame, "the simulated field")
    monkeypatch.setattr(played, "JPEG", cv2.imencode(".jpg", panel[..., ::-1])[1].tobytes())
    mounted = replace(
        Config(),
        camera=replace(Config().camera, view=75.0),
        mount=MountSection(height=1.0, tilt=7.0, aspect=4 / 3, front=0.6, width=2.9),
        stopping=replace(Config().stopping, speed=0.8),
    )
    stage = Stage(tmp_path, config=mounted)
    with closing(stage.ready()), opened_tab(stage.page.url) as tab:
        switch, lines = tab.get_by_label("Metres"), tab.locator(".metres line:not(.halo)")
        stage.until(tab.locator("#picture").is_visible)
        stage.until(switch.is_visible)
        assert lines.count() == 0
        switch.check()
        assert lines.count() == 10
        labels = tab.locator(".metres text").all_text_contents()
        assert labels[:7] == ["horizon", "1 m", "2 m", "3 m", "4 m", "5 m", "6 m"]
        assert labels[8:] == ["2.9 m wide", "stops in 3.4 m"]
        shown, scale = tab.locator("#picture").bounding_box(), 360 / 424
        for line, expected in zip(lines.all()[:7], lines_of(mounted), strict=False):
            across = line.bounding_box()
            row = (across["y"] + across["height"] / 2 - shown["y"]) / shown["height"]
            assert abs(row - (34 / 424 + scale * expected.start[1])) < 0.006
        switch.uncheck()
        assert lines.count() == 0


def test_without_a_mount_there_is_no_switch_for_metres(stage: Stage, tab: Any) -> None:
    stage.until(tab.locator("#picture").is_visible)
    assert not tab.get_by_label("Metres").is_visible()


NOTICES = """
window.told = [];
window.Notification = class {
  static permission = "default";
  static async requestPermission() { return (Notification.permission = "granted"); }
  constructor(title, { body, tag }) { window.told.push([title, body, tag]); }
};
Object.defineProperty(document, "hidden", { get: () => Boolean(window.away) });
"""

LEAVE = "window.away = true; document.dispatchEvent(new Event('visibilitychange'))"


def test_a_page_in_the_background_hears_of_a_call_where_somebody_allowed_it_and_has_no_pictures_drawn(
    stage: Stage,
) -> None:
    with opened_tab(stage.page.url, NOTICES) as tab:
        stage.until(lambda: stage.frames > 0)
        tab.locator("#alarm").click()
        stage.until(lambda: tab.locator("#alarm").inner_text() == "Sound and notice: on")
        tab.evaluate(LEAVE)
        over = time.monotonic() + 2.0  # a picture that was asked for may still be drawn
        stage.until(lambda: time.monotonic() > over)
        drawn = stage.frames
        opened = {"id": 7, "kind": "call", "stage": "open", "frame_id": 9, "age": 3, "holding": True}
        stage.news["state"] |= {"open": opened, "reasons": ["unknown_object"]}
        stage.until(lambda: bool(tab.evaluate("told.length")))
        ((title, text, _tag),) = tab.evaluate("told")
        assert title == "A rover calls"
        assert text.startswith("C7. Unknown thing.")
        assert tab.title().startswith("(1) ")
        over = time.monotonic() + 1.5
        stage.until(lambda: time.monotonic() > over)
        assert stage.frames == drawn
