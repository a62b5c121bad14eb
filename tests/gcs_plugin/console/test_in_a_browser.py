"""A call is seen and answered in a real browser, where Playwright and Debian's Chromium are installed."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from anytraverse.operations import Tap
from companion.wire import ids
from companion.wire.answers import CancelIncident, PackIncident
from tests.gcs_plugin.console.browser import AXE, CALL, needs_browser
from tests.gcs_plugin.console.served import Served

pytestmark = needs_browser


def test_a_call_is_seen_tapped_named_and_acknowledged_in_four_actions(
    served: Served, open_page: Callable[..., Any], rover: Any
) -> None:
    tab = open_page()
    card = tab.locator(CALL)
    served.until(card.is_visible)
    served.until(card.get_by_role("button", name="mud", exact=True).is_visible)  # its words are read
    assert "Unknown thing in the middle: " in card.inner_text()
    assert tab.locator("#title").inner_text() == "CALLING"
    assert "Unknown thing in the middle" in tab.locator("#say").text_content()
    frame = card.locator(".shot.small .aim").bounding_box()
    tab.mouse.click(frame["x"] + 0.3 * frame["width"], frame["y"] + 0.6 * frame["height"])
    assert card.locator(".shot.small rect.own").count() == 1
    card.get_by_label("Its name").fill("Drum")
    assert card.locator("button.go").inner_text() == "Drum −1, and go"
    card.get_by_label("Its name").press("Enter")
    served.until(lambda: rover.applied != [])
    ((target, motion, (tap,)),) = rover.applied
    assert (target, motion) == (7, ids.Motion.GO)
    assert isinstance(tap, Tap)
    assert (tap.frame_id, tap.word, tap.weight) == (4711, "drum", -1.0)
    left, top, right, bottom = tap.box
    assert ((left + right) / 2, (top + bottom) / 2) == pytest.approx((0.3, 0.6), abs=0.01)
    said = tab.locator(".becoming").first
    served.until(lambda: "From here: drum: -1, go" in said.inner_text() and "done" in said.inner_text())
    served.until(lambda: "The rover drives on" in said.inner_text())
    served.until(lambda: tab.locator("#title").inner_text() == "OK")


def test_before_its_words_are_read_a_name_is_asked_about_in_red(
    served: Served, open_page: Callable[..., Any], rover: Any
) -> None:
    rover.files = {}
    tab = open_page()
    card = tab.locator(CALL)
    served.until(card.is_visible)
    card.get_by_label("Its name").fill("Grass")
    card.get_by_label("Its name").press("Enter")
    question = card.locator(".turning")
    assert (
        "What weight grass has is not read yet. All that fits it becomes not drivable."
        in question.inner_text()
    )
    question.get_by_role("button", name="Keep grass as it is").press("Enter")
    assert not question.is_visible()
    card.get_by_label("Its name").press("Enter")
    question.locator("button.turn").click()
    served.until(lambda: rover.applied != [])
    assert len(rover.applied) == 1


def test_an_incident_file_is_asked_for_and_cancelled(
    served: Served, open_page: Callable[..., Any], rover: Any
) -> None:
    rover.stage_after = ids.Stage.OPEN
    rover.files["/incidents.json"] = b'{"packing": "C7", "failed": null, "packed": []}'
    tab = open_page()
    card = tab.locator(CALL)
    served.until(card.is_visible)
    card.get_by_role("button", name="Pack an incident file of C7").click()
    cancelling = card.get_by_role("button", name="Cancel packing of C7")
    served.until(cancelling.is_visible)
    cancelling.press("Enter")
    served.until(lambda: len(rover.applied) == 2)
    none = ids.Motion.NONE
    assert rover.applied == [(0, none, (PackIncident(7),)), (0, none, (CancelIncident(7),))]
    told = b'{"packing": null, "failed": {"what": "C7", "why": "it was cancelled"}, "packed": []}'
    rover.files["/incidents.json"] = told
    served.until(lambda: "It could not be packed: it was cancelled." in card.inner_text())
    assert not cancelling.is_visible()


@pytest.mark.usefixtures("rover")
def test_a_call_is_saved_by_a_click_and_the_page_inside_opens_from_a_file(
    served: Served, open_page: Callable[..., Any], tmp_path: Path
) -> None:
    tab = open_page()
    card = tab.locator(CALL)
    served.until(card.is_visible)
    with tab.expect_download() as saving:
        card.get_by_role("link", name="Save call C7").click()
    assert saving.value.suggested_filename == "rover-1-call-7.zip"
    with zipfile.ZipFile(saving.value.path()) as archive:
        archive.extractall(tmp_path)
    saved = tab.context.browser.new_page()
    errors: list[str] = []
    saved.on("console", lambda said: errors.append(said.text))
    saved.goto((tmp_path / "report.html").as_uri())
    assert "Unknown thing in the middle: " in saved.inner_text("section")
    assert errors == []
    assert tab.get_by_role("link", name="Save all calls").count() == 0, "there is no earlier call"


CARD = """async () => {
  const { ConsoleCard } = await import("/console_card.js");
  const { Words } = await import("/words.js");
  const words = new Words(1, () => "", () => {});
  let posted = null;
  const post = (_kind, content) => (posted = content, "");
  const card = new ConsoleCard(1, post, () => {}, words.staged, () => {});
  document.querySelector("main").append(card.part);
  const [small, raw, large, picture] = ["small", "raw", "large", "near"].map((one) => `/favicon.svg?${one}`);
  const said = [["drum", -0.5], ["mud", -1]];
  const call = {
    id: 7, name: "C7", open: true, stage: "open", kind: "call", reasons: ["unknown_object"], frame: 9,
    roi: [0.3, 0.5, 0.7, 0.95], box: [0.4, 0.5, 0.6, 0.8], large: {}, pictures: { small, raw, large },
    nearest: { call: 3, text: "<b>Most</b> like call C3", words: said, alike: true, picture },
    answers: [], said: [],
  };
  const each = (part, what, name) => [...part.querySelectorAll(what)].map((one) => one.getAttribute(name));
  const rover = { names: [], words: [], given: {} };
  const known = { word: "drum", weight: -0.5, motion: "go", text: "Still the drum" };
  card.show({ ...call, known }, rover, 1);
  const shown = {
    sources: each(card.part, ".shots img:not([hidden])", "src"),
    marks: each(card.raw.part, "rect", "class"),
    near: card.near.textContent,
    bold: card.near.querySelectorAll("b").length,
  };
  card.judged.share.value = 40;
  card.judged.share.dispatchEvent(new Event("input"));
  shown.opacity = card.judged.image.style.opacity;
  shown.again = card.again.textContent;
  card.again.click();
  shown.changes = posted.changes;
  delete call.pictures.raw;
  card.show({ ...call, known: null }, rover, 2);
  shown.hidden = card.again.hidden;
  return { ...shown, without: each(card.raw.part, "rect", "class") };
}"""


def test_a_place_is_marked_in_the_plain_frame_and_what_was_said_in_a_similar_one_is_taken_over(
    open_page: Callable[..., Any],
) -> None:
    told = open_page().evaluate(CARD)
    assert told["sources"] == [f"/favicon.svg?{one}" for one in ("raw", "raw", "large")]
    assert told["marks"] == ["halo", "roi", "halo", "tile"]
    assert told["without"] == ["halo", "tile"], "the thumbnail has the region of interest in it"
    assert (told["near"], told["bold"]) == ("<b>Most</b> like call C3", 0)
    assert told["again"] == "Still the drum"
    assert told["opacity"] == "0.4"
    tap = {"tap": "drum", "weight": -0.5, "box": [0.4, 0.5, 0.6, 0.8], "frame": 9}
    assert told["changes"] == [tap], "what was said of all the ground there is not said here"
    assert told["hidden"] is True


def test_by_keyboard_alone_a_frame_is_moved_named_and_sent(
    served: Served, open_page: Callable[..., Any], rover: Any
) -> None:
    tab = open_page()
    card = tab.locator(CALL)
    served.until(card.is_visible)
    served.until(card.get_by_role("button", name="mud", exact=True).is_visible)  # its words are read
    tab.keyboard.press("t")
    for key in ("ArrowLeft", "ArrowLeft", "Shift+ArrowDown", "n"):
        tab.keyboard.press(key)
    tab.keyboard.type("grass log")
    tab.keyboard.press("Enter")
    served.until(lambda: rover.applied != [])
    ((_, motion, (tap,)),) = rover.applied
    assert motion is ids.Motion.GO
    assert tap.word == "grass log"
    assert tap.box == pytest.approx((0.39, 0.55, 0.58, 0.82), abs=1e-3)


@pytest.mark.parametrize(
    ("key", "motion"), [("g", ids.Motion.GO), ("s", ids.Motion.STAY), ("l", ids.Motion.LOOK_AGAIN)]
)
def test_one_key_answers_with_a_motion(
    served: Served, open_page: Callable[..., Any], rover: Any, key: str, motion: ids.Motion
) -> None:
    tab = open_page()
    served.until(tab.locator(CALL).is_visible)
    tab.keyboard.press(key)
    served.until(lambda: rover.applied == [(7, motion, ())])


@pytest.mark.usefixtures("rover")
@pytest.mark.parametrize("width", [320, 1280, 2560])
def test_it_fits_and_can_be_reached_at_any_width(
    served: Served, open_page: Callable[..., Any], width: int
) -> None:
    for scheme in ("light", "dark"):
        tab = open_page(width, scheme)
        served.until(tab.locator(CALL).is_visible)
        assert tab.evaluate("document.documentElement.scrollWidth <= innerWidth")
        for button in tab.locator(f"{CALL} .motions button:visible").all():
            box = button.bounding_box()
            assert box["height"] >= 40
            assert box["x"] >= 0
            assert box["x"] + box["width"] <= width
        if AXE.exists():
            tab.evaluate(AXE.read_text())
            found = tab.evaluate("axe.run().then(told => told.violations)")
            assert [(one["id"], [node["html"] for node in one["nodes"]]) for one in found] == []
