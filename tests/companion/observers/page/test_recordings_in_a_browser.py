"""Recordings are found, watched and deleted in a real browser."""

from __future__ import annotations

import json
import re
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from companion.config import Config
from companion.config.schema import JournalSection
from companion.observers.recording.contents import as_json, image
from companion.observers.recording.deleting import RecordingDeleter
from companion.observers.recording.mcap_file import McapFile
from companion.observers.recording.messages import RecordedMessage
from companion.observers.recording.topics import Topic
from companion.wire.answers import Acknowledgement, Answer, RecordingWish, Wish
from tests.companion.observers.page import played
from tests.companion.observers.page.browser import KNOWN, PHONE, needs_browser, opened_tab, stage, tab
from tests.companion.observers.page.played import Stage
from tests.companion.observers.recording.made import BEGAN, NS, opened

__all__ = ["stage", "tab"]
pytestmark = needs_browser


def recorded(path: Path, grey: int = 120) -> McapFile:
    """Record ten seconds: a frame a second, brighter from one to the next; call 7 opens after four."""
    path.parent.mkdir(exist_ok=True)
    file = McapFile(path, 1 << 22)
    kinds = ((Topic.CAMERA, "jpeg", (240, 320, 3)), (Topic.TRAVERSABILITY, "png", (60, 80)))
    for second in range(10):
        at = BEGAN + second * NS
        for topic, kind, shape in (*kinds, (Topic.UNCERTAINTY, "png", (60, 80))):
            level = 0 if topic is Topic.UNCERTAINTY else grey + 10 * second
            packed = cv2.imencode(f".{kind[:3]}", np.full(shape, level, np.uint8))[1].tobytes()
            file.add(RecordedMessage(topic, at, image(packed, kind, at), second + 1))
        told = {"state": "ok" if second < 4 else "calling", "open": 7 if second >= 4 else None}
        file.add(RecordedMessage(Topic.STATE, at, as_json(told)))
        if second == 4:
            file.add(opened(7, second))
        file.flush()
    return file


PIXEL = "shown => [...shown.getContext('2d').getImageData(9, 9, 1, 1).data]"


def test_a_recording_is_found_and_scrubbed_through_with_the_keys(stage: Stage, tab: Any) -> None:
    recorded(stage.folder / "recordings" / "000001.mcap").finish()
    (stage.folder / "recordings" / "000002.mcap").write_bytes(b"rubbish")
    tab.get_by_role("button", name="Show recordings").click()
    rows, replay = tab.locator(".recording"), tab.locator(".replay")
    stage.until(lambda: rows.count() == 2)
    stage.until(lambda: "9 s" in rows.nth(1).inner_text())
    assert "Nothing in it can be read" in rows.nth(0).inner_text()
    assert "C7" in rows.nth(1).inner_text()
    stage.until(lambda: rows.nth(1).locator("img").evaluate("shown => shown.naturalWidth") == 320)
    rows.nth(1).click()
    stage.until(lambda: "4.0 s of 9.0 s" in replay.inner_text())
    assert "CALLING" in replay.inner_text(), "it opens where the call did"
    assert "call 7" not in tab.locator("#open").inner_text()
    before = replay.locator("canvas").evaluate(PIXEL)
    assert before[1] > before[0], "what is drivable is tinted green"
    tab.keyboard.press("ArrowLeft")
    stage.until(lambda: "3.0 s of 9.0 s" in replay.inner_text())
    assert "OK: The way ahead" in replay.inner_text()
    assert replay.locator("canvas").evaluate(PIXEL) != before
    tab.keyboard.press("End")
    stage.until(lambda: "9.0 s of 9.0 s" in replay.inner_text())
    assert tab.get_by_role("button", name="Frame after").is_disabled()
    tab.get_by_label("How it was judged").uncheck()
    red, green, blue, _ = replay.locator("canvas").evaluate(PIXEL)
    assert max(red, green, blue) - min(red, green, blue) < 6, "as it was seen"
    assert replay.get_by_label("Moment of the recording").get_attribute("aria-valuetext") == (
        "9.0 s of 9.0 s, calling"
    )
    assert replay.get_by_role("button", name=re.compile("Delete|Pack")).count() == 0, "it only shows"
    rows.nth(0).click()
    stage.until(lambda: "There is no picture in it." in replay.inner_text())
    replay.get_by_role("button", name="Close").click()
    assert replay.count() == 0


def test_a_recording_is_deleted_by_a_second_click_and_never_the_one_that_is_being_written(
    tmp_path: Path,
) -> None:
    home = tmp_path / "recordings"
    recorded(home / "000001.mcap").finish()
    writing = recorded(home / "000002.mcap", 60)
    stage, given = Stage(tmp_path, token=played.TOKEN), list[Answer]()
    deleter = RecordingDeleter(replace(Config(), journal=JournalSection(folder=str(tmp_path))))
    stage.page.answer = lambda payload, _at: given.append(Answer.unpack(payload)[0])
    stage.news["status"]["recording"] = {"on": True, "files": 2, "bytes": 9000}
    stage.until(stage.up)
    url = f"{stage.page.url}?token={played.TOKEN}"
    with closing(stage), opened_tab(url, viewport=PHONE) as tab:
        tab.get_by_role("button", name="Show recordings").click()
        rows, replay = tab.locator(".recording"), tab.locator(".replay")
        stage.until(lambda: rows.count() == 2)
        stage.until(lambda: "It is being written." in rows.nth(0).inner_text())
        rows.nth(0).click()
        assert replay.get_by_role("button", name="Delete recording 000002").is_disabled()
        rows.nth(1).click()
        with tab.expect_download() as saving:
            replay.get_by_role("link", name="Save 000001.mcap").click()
        assert Path(saving.value.path()).read_bytes() == (home / "000001.mcap").read_bytes()
        ask = replay.get_by_role("button", name="Delete recording 000001")
        ask.click()
        assert replay.get_by_role("button", name="Keep it").evaluate("one => one === document.activeElement")
        tab.keyboard.press("Enter")
        assert ask.is_visible()
        assert not given
        ask.click()
        replay.get_by_role("button", name="Delete it for good").click()
        stage.until(lambda: bool(given))
        (wish,) = given[0].operations
        assert wish == RecordingWish(1, Wish.DELETE)
        acknowledge = stage.page.acknowledge
        deleter.ask(
            wish.number,
            lambda result, text: acknowledge(
                Acknowledgement.without_figures(given[0].transaction, 0, result, text)
            ),
        )

        def gone() -> bool:
            deleter.poll()
            return bool(rows.count() == 1)

        stage.until(gone)
        assert replay.count() == 0
        assert "Recording 000001 is gone." in tab.locator("#say").text_content()
        assert tab.evaluate("document.documentElement.scrollWidth") <= 390
        assert [one.name for one in home.iterdir()] == ["000002.mcap"]
    writing.finish()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_whole_page_with_a_recording_open_is_accessible_by_axe(tmp_path: Path, scheme: str) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    recorded(tmp_path / "recordings" / "000001.mcap").finish()
    (tmp_path / "calls").mkdir()
    (tmp_path / "calls" / "7.json").write_text(json.dumps({"id": 7, "reasons": ["unknown_object"]}))
    stage = Stage(tmp_path, token=played.TOKEN)
    opened = {"id": 7, "kind": "call", "stage": "open", "frame_id": 9, "age": 3}
    stage.news["state"] |= {"open": opened, "reasons": ["unknown_object"], "known_place": KNOWN}
    stage.until(stage.up)
    url = f"{stage.page.url}?token={played.TOKEN}"
    with closing(stage), opened_tab(url, bypass_csp=True, color_scheme=scheme) as tab:  # axe is a script
        stage.until(tab.locator("#open .call").is_visible)
        tab.get_by_role("button", name="Show recordings").click()
        stage.until(lambda: tab.locator(".recording").count() == 1)
        tab.locator(".recording").click()
        stage.until(lambda: "of 9.0 s" in tab.locator(".replay").inner_text())
        tab.get_by_role("button", name="Delete recording 000001").click()
        found = axe.Axe().run(tab)
        assert found.violations_count == 0, found.generate_report()
        assert len(found.response["passes"]) > 30, "it has looked"
