"""The page in a real browser, where Playwright and Debian's Chromium are installed."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from anytraverse.judged_picture import draw_frame
from anytraverse.operations import Tap
from companion.config import Config
from companion.config.schema import JournalSection, MountSection
from companion.config.stopping import lines_of
from companion.observers.page.page import missing
from companion.observers.recording.contents import as_json, image
from companion.observers.recording.deleting import RecordingDeleter
from companion.observers.recording.mcap_file import McapFile
from companion.observers.recording.messages import RecordedMessage
from companion.observers.recording.topics import Topic
from companion.sim.field.render import PinholeCamera
from companion.sim.field.things import World
from companion.wire.answers import Acknowledgement, Answer, CancelIncident, PackIncident, RecordingWish, Wish
from companion.wire.ids import Motion, Result
from companion.wire.incidents import Incidents, Packed
from tests.companion.observers.page import played
from tests.companion.observers.page.played import Stage
from tests.companion.observers.page.played_settings import FILE, SettingsStage
from tests.companion.observers.recording.made import BEGAN, NS, opened
from tests.waiting import wait_for

playwright = pytest.importorskip("playwright.sync_api")
CHROMIUM = Path("/usr/bin/chromium")
pytestmark = pytest.mark.skipif(
    bool(missing()) or not CHROMIUM.exists(), reason="the extra web or Chromium is not installed"
)


@pytest.fixture
def stage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Stage]:
    jpeg = cv2.imencode(".jpg", np.full((240, 320, 3), 120, np.uint8))[1].tobytes()
    monkeypatch.setattr(played, "JPEG", jpeg)
    stage = Stage(tmp_path)
    yield stage.ready()
    stage.close()


@pytest.fixture
def tab(stage: Stage) -> Iterator[Any]:
    """The open page. Console errors fail the test."""
    with playwright.sync_playwright() as browsers:
        browser = browsers.chromium.launch(executable_path=str(CHROMIUM), args=["--no-sandbox"])
        tab, errors = browser.new_page(), list[str]()
        tab.on("pageerror", lambda error: errors.append(str(error)))
        tab.goto(stage.page.url)
        yield tab
        browser.close()
        assert errors == []


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


KNOWN = {
    "scene": 31,
    "call": 12,
    "similarity": 0.96,
    "needed": 0.93,
    "since": 1_790_000_000.0,
    "changed": {"gravel": [None, 1]},
    "picture": "/calls/12.jpg",
}


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
    with closing(stage.ready()), playwright.sync_playwright() as browsers:
        browser = browsers.chromium.launch(executable_path=str(CHROMIUM), args=["--no-sandbox"])
        tab = browser.new_page()
        tab.goto(stage.page.url)
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
        browser.close()


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
    with playwright.sync_playwright() as browsers:
        browser = browsers.chromium.launch(executable_path=str(CHROMIUM), args=["--no-sandbox"])
        tab = browser.new_page()
        tab.add_init_script(NOTICES)
        tab.goto(stage.page.url)
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
        browser.close()


def held(stage: Stage, tab: Any, given: list[bytes], key: str) -> set[Motion]:
    """Hold a key until what it sends was sent three times. Returns what it is; it must be one answer."""
    tab.keyboard.down(key)
    stage.until(lambda: bool(given))
    tab.keyboard.down(key)
    stage.until(lambda: len(given) == 3)
    tab.keyboard.up(key)
    assert len({Answer.unpack(one)[0].transaction for one in given}) == 1
    return {Answer.unpack(one)[0].motion for one in given}


def have_it_packed(stage: Stage, card: Any, given: list[bytes]) -> None:
    """Ask for an incident file of call 7, cancel it, and have it packed all the same: it can be saved."""
    stay = Answer.unpack(given[-1])[0]
    stage.page.acknowledge(Acknowledgement.without_figures(stay.transaction, 7, Result.APPLIED, "noted"))
    card.get_by_role("button", name="Pack an incident file of C7").click()
    stage.until(lambda: Answer.unpack(given[-1])[0].operations == (PackIncident(7),))
    stage.news["incidents"] = Incidents(packing=7).document()
    cancelling = card.get_by_role("button", name="Cancel packing of C7")
    stage.until(cancelling.is_visible)
    cancelling.click()
    stage.until(lambda: Answer.unpack(given[-1])[0].operations == (CancelIncident(7),))
    cancel = Answer.unpack(given[-1])[0]
    stage.page.acknowledge(Acknowledgement.without_figures(cancel.transaction, 0, Result.APPLIED, "no more"))
    stage.news["incidents"] = Incidents(failed=(7, "it was cancelled")).document()
    stage.until(lambda: "It could not be packed: it was cancelled." in card.inner_text())
    assert not cancelling.is_visible()
    packed = Packed(3, 7, 5_100_000, 84_000, "without a recording: switched off")
    stage.news["incidents"] = Incidents(packed=(packed,)).document()
    stage.until(card.get_by_text("Save the whole file (5.1 MB)").is_visible)
    saved = [one.get_attribute("href") for one in card.locator(".incident a").all()]
    assert saved == ["/incidents/0003-C7-short.zip", "/incidents/0003-C7.zip"]
    assert "It is without a recording: switched off." in card.inner_text()


def go_is_in_view_wherever_it_is_scrolled_to(stage: Stage, tab: Any) -> None:
    bar = tab.locator(".bar")
    for scrolled in ("0", "document.body.scrollHeight"):
        stage.until(bar.is_visible)  # not while the news are old, as after a slow moment
        tab.evaluate(f"scrollTo(0, {scrolled})")
        go = bar.get_by_role("button", name="Go", exact=True).bounding_box()
        assert go["height"] >= 44
        assert 0 <= go["y"] <= 844 - go["height"]
    assert "C7: Unknown thing in the middle" in bar.inner_text()
    tab.evaluate("scrollTo(0, 0)")


def test_a_call_is_answered_with_a_tap_and_a_name_by_whoever_has_the_token(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    jpeg = cv2.imencode(".jpg", np.full((240, 320, 3), 120, np.uint8))[1].tobytes()
    monkeypatch.setattr(played, "JPEG", jpeg)
    calls = tmp_path / "calls"
    calls.mkdir()
    for ending in ("", "-raw", "-large"):
        (calls / f"7{ending}.jpg").write_bytes(jpeg)
    (calls / "7.json").write_text(json.dumps({"id": 7, "reasons": ["unknown_object"], "answers": []}))
    stage, given, errors = Stage(tmp_path, token=played.TOKEN), list[bytes](), list[str]()
    stage.page.answer = lambda payload, _at: given.append(payload)
    opened: dict[str, Any] = {"id": 7, "kind": "call", "stage": "open", "frame_id": 9, "age": 3}
    opened["worst_tile_box"] = [0.4, 0.5, 0.6, 0.8]
    stage.news["state"] |= {"open": opened, "reasons": ["unknown_object"], "vocabulary": ["mud"]}
    stage.until(stage.up)
    with playwright.sync_playwright() as browsers:
        browser = browsers.chromium.launch(executable_path=str(CHROMIUM), args=["--no-sandbox"])
        tab = browser.new_page(viewport={"width": 390, "height": 844})
        tab.on("pageerror", lambda error: errors.append(str(error)))
        tab.goto(f"{stage.page.url}?token={played.TOKEN}")
        card = tab.locator("#open .call")
        stage.until(card.locator(".shot.small img:visible").first.is_visible)
        go_is_in_view_wherever_it_is_scrolled_to(stage, tab)
        frame = card.locator(".shot.small .aim").bounding_box()
        tab.mouse.click(frame["x"] + 0.5 * frame["width"], frame["y"] + 0.6 * frame["height"])
        card.get_by_label("Its name").click()
        tab.keyboard.type("Old drum")
        tab.keyboard.press("Enter")
        stage.until(lambda: bool(given))
        message = Answer.unpack(given[0])[0]
        (tap,) = message.operations
        assert isinstance(tap, Tap)
        assert (message.target, message.motion) == (7, Motion.GO)
        assert (tap.frame_id, tap.word, tap.weight) == (9, "old drum", -1.0)
        assert tap.box[0] < 0.5 < tap.box[2]
        stage.until(lambda: "From here: old drum: -1, go" in card.inner_text())
        stage.page.acknowledge(
            Acknowledgement.without_figures(message.transaction, 7, Result.NOT_COVERED, "C7 still unknown")
        )
        stage.until(lambda: "does not cover what was seen: C7 still unknown" in card.inner_text())
        stage.until(lambda: "C7 still unknown" in tab.locator("#say").text_content())
        given.clear()
        tab.locator("#state-title").click()
        assert held(stage, tab, given, "s") == {Motion.STAY}
        have_it_packed(stage, card, given)
        stage.news["state"]["open"] = None
        stage.until(lambda: "closed" in card.inner_text())
        assert tab.evaluate("document.documentElement.scrollWidth") <= 390
        tab.route("**/answer", lambda route: route.abort())
        tab.get_by_label("New word").fill("mud")
        tab.keyboard.press("Enter")
        stage.until(lambda: "not known whether that was sent" in tab.locator("#words").inner_text())
        browser.close()
    stage.close()
    assert errors == []


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
    with closing(stage), playwright.sync_playwright() as browsers:
        browser = browsers.chromium.launch(executable_path=str(CHROMIUM), args=["--no-sandbox"])
        tab = browser.new_page(viewport={"width": 390, "height": 844})
        tab.goto(f"{stage.page.url}?token={played.TOKEN}")
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
        browser.close()
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
    with closing(stage), playwright.sync_playwright() as browsers:
        browser = browsers.chromium.launch(executable_path=str(CHROMIUM), args=["--no-sandbox"])
        context = browser.new_context(bypass_csp=True, color_scheme=scheme)  # axe is a script of its own
        tab = context.new_page()
        tab.goto(f"{stage.page.url}?token={played.TOKEN}")
        stage.until(tab.locator("#open .call").is_visible)
        tab.get_by_role("button", name="Show recordings").click()
        stage.until(lambda: tab.locator(".recording").count() == 1)
        tab.locator(".recording").click()
        stage.until(lambda: "of 9.0 s" in tab.locator(".replay").inner_text())
        tab.get_by_role("button", name="Delete recording 000001").click()
        found = axe.Axe().run(tab)
        assert found.violations_count == 0, found.generate_report()
        assert len(found.response["passes"]) > 30, "it has looked"
        browser.close()


def listed(home: Any) -> bool:
    """Whether the section has its settings."""
    return int(home.locator(".setting").count()) > 50


def test_a_setting_is_changed_by_a_second_click_after_what_would_change_was_shown(tmp_path: Path) -> None:
    stage = SettingsStage(tmp_path, token=played.TOKEN)
    stage.until(stage.up)
    with closing(stage), playwright.sync_playwright() as browsers:
        browser = browsers.chromium.launch(executable_path=str(CHROMIUM), args=["--no-sandbox"])
        tab, errors = browser.new_page(viewport={"width": 390, "height": 844}), list[str]()
        tab.on("pageerror", lambda error: errors.append(str(error)))
        tab.goto(f"{stage.page.url}?token={played.TOKEN}")
        home, review = tab.locator("#settings"), tab.locator("#settings .review")
        stage.until(home.is_visible)
        tab.get_by_role("button", name="Show settings").click()
        stage.until(partial(listed, home))
        assert tab.evaluate("document.documentElement.scrollWidth") == 390
        assert not any(secret in home.inner_html() for secret in ("s3cr3tword", played.TOKEN))
        tab.get_by_label("Search").fill("web token")
        (shown,) = home.locator(".setting:visible").all_inner_texts()
        assert shown.startswith("token")
        assert "set, and not shown" in shown
        assert f"companion config set {stage.file} web.token=VALUE" in shown
        assert home.locator(".setting:visible :is(input, select)").count() == 0

        tab.get_by_label("Search").fill("bad frames")
        field, look = tab.get_by_label("votes", exact=True), tab.get_by_role("button", name="Show what would")

        def asks_for(votes: str) -> None:
            field.fill(votes)
            field.press("Tab")

        write = tab.get_by_role("button", name="Write and restart")
        assert not review.is_visible()
        asks_for("9")
        look.click()
        stage.until(lambda: "companion.toml:9: call.votes = 9" in review.inner_text())
        assert not write.is_visible()
        asks_for("3")
        look.click()
        stage.until(write.is_visible)
        assert "-votes = 2\n+votes = 3" in review.inner_text()
        assert stage.file.read_text() == FILE
        stage.armed = True
        write.click()
        stage.until(lambda: "the vehicle is armed: disarm it first" in review.inner_text())
        stage.armed = False
        look.click()
        stage.until(write.is_visible)
        asks_for("1")
        assert not write.is_visible(), "what was shown is not what would be written"
        look.click()
        stage.until(write.is_visible)
        write.click()
        stage.until(lambda: "the companion starts again" in review.inner_text())
        assert "votes = 1" in stage.file.read_text()
        assert errors == []
        browser.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_settings_are_accessible_by_axe_also_where_there_is_no_helper(
    tmp_path: Path, scheme: str
) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    with playwright.sync_playwright() as browsers:
        for helper in (True, False):
            folder = tmp_path / str(helper)
            folder.mkdir()
            stage = SettingsStage(folder, helper=helper, token=played.TOKEN)
            stage.until(stage.up)
            with closing(stage):
                browser = browsers.chromium.launch(executable_path=str(CHROMIUM), args=["--no-sandbox"])
                tab = browser.new_context(bypass_csp=True, color_scheme=scheme).new_page()
                tab.goto(f"{stage.page.url}?token={played.TOKEN}")
                home = tab.locator("#settings")
                stage.until(home.is_visible)
                tab.get_by_role("button", name="Show settings").click()
                stage.until(partial(listed, home))
                if helper:
                    tab.get_by_label("votes", exact=True).fill("3")
                    tab.get_by_label("votes", exact=True).press("Tab")
                    tab.get_by_role("button", name="Show what would").click()
                    stage.until(tab.get_by_role("button", name="Write and restart").is_visible)
                else:
                    assert "not started by its service" in home.inner_text()
                    assert home.locator(".setting :is(input, select)").count() == 0
                found = axe.Axe().run(tab)
                assert found.violations_count == 0, found.generate_report()
                assert len(found.response["passes"]) > 20, "it has looked"
                browser.close()
