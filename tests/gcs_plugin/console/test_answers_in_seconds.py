"""What makes an answer quick, in a real browser: the bar of a phone, keys, a known thing, and notices."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from anytraverse.operations import Tap
from companion.wire import ids
from companion.wire.call_report import CallReport
from tests.gcs_plugin.console.browser import AXE, CALL, needs_browser
from tests.gcs_plugin.console.served import Served

pytestmark = [needs_browser, pytest.mark.slow]
PHONE = 390, 844
TEXT = "C7 unknown 71% in yellow frame, over 25% calls"
WHY = "Unknown thing in the middle: 71 % of the yellow frame is unknown, over 25 % calls."
SMALL = """[...document.querySelectorAll(".bar button, .call button, .call input, .call select")]
  .filter((one) => one.offsetParent && one.type !== "checkbox" && one.getBoundingClientRect().height < 44)
  .map((one) => one.outerHTML)"""
NOTICES = """
window.told = [];
window.Notification = class {
  static permission = "default";
  static async requestPermission() { return (Notification.permission = "granted"); }
  constructor(title, { body, tag }) { window.told.push([title, body, tag]); }
};
navigator.vibrate = (pattern) => window.told.push(["vibrated", pattern.length]);
Object.defineProperty(document, "hidden", { get: () => Boolean(window.away) });
"""


def opened(served: Served, tab: Any, rover: Any) -> Any:
    card = tab.locator(CALL)
    served.until(card.is_visible)
    served.say(rover.text(TEXT))
    served.until(lambda: WHY in card.inner_text())
    return card


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_on_a_phone_go_stay_and_the_reason_are_in_view_wherever_it_is_scrolled_to(
    served: Served, open_page: Callable[..., Any], rover: Any, scheme: str
) -> None:
    tab = open_page(PHONE[0], scheme, PHONE[1])
    opened(served, tab, rover)
    bar = tab.locator(".bar")
    for scrolled in ("0", "document.body.scrollHeight / 2", "document.body.scrollHeight"):
        tab.evaluate(f"scrollTo(0, {scrolled})")
        assert WHY in bar.locator(".why").inner_text()
        for button in bar.locator("button").all():
            box = button.bounding_box()
            assert box["height"] >= 44
            assert box["x"] >= 0
            assert box["x"] + box["width"] <= PHONE[0]
            assert box["y"] >= 0
            assert box["y"] + box["height"] <= PHONE[1]
    last = tab.locator("#about").bounding_box()
    assert last["y"] + last["height"] <= bar.bounding_box()["y"], "the end of the page is not covered"
    assert tab.evaluate("document.documentElement.scrollWidth") <= PHONE[0]
    assert tab.evaluate(SMALL) == []
    if AXE.exists():
        tab.evaluate(AXE.read_text())
        found = tab.evaluate("axe.run().then(told => told.violations)")
        assert [(one["id"], [node["html"] for node in one["nodes"]]) for one in found] == []
    bar.get_by_role("button", name="Stay").click()
    served.until(lambda: rover.applied == [(7, ids.Motion.STAY, ())])
    served.until(lambda: not bar.is_visible())


def test_the_bar_sends_what_is_typed_and_says_what_became_of_it(
    served: Served, open_page: Callable[..., Any], rover: Any
) -> None:
    rover.stage_after, rover.result = ids.Stage.OPEN, ids.Result.NOT_COVERED
    tab = open_page(PHONE[0], "light", PHONE[1])
    card, bar = opened(served, tab, rover), tab.locator(".bar")
    served.until(card.get_by_role("button", name="mud", exact=True).is_visible)  # its words are read
    card.get_by_label("Its name").fill("drum")
    assert bar.locator(".go").inner_text() == "Drum −1, and go"
    bar.locator(".go").click()
    served.until(lambda: len(rover.applied) == 1)
    served.until(lambda: "does not cover what was seen" in bar.locator(".told").inner_text())
    assert bar.locator(".go").inner_text() == "Go"


@pytest.mark.usefixtures("rover")
def test_a_wide_page_has_no_bar_and_neither_has_one_without_a_call(
    served: Served, open_page: Callable[..., Any], rover: Any
) -> None:
    tab = open_page(1280, "light", 800)
    card = opened(served, tab, rover)
    go = card.locator(".motions .go").bounding_box()
    assert go["y"] + go["height"] <= 800, "its own Go is in view"
    assert not tab.locator(".bar").is_visible()
    rover.call = None
    phone = open_page(PHONE[0], "light", PHONE[1])
    served.until(phone.locator("#title").is_visible)
    tab.close()


def test_the_key_that_is_typed_after_a_name_was_sent_answers_and_is_no_letter(
    served: Served, open_page: Callable[..., Any], rover: Any
) -> None:
    rover.stage_after, rover.result = ids.Stage.OPEN, ids.Result.NOT_COVERED
    tab = open_page()
    card = opened(served, tab, rover)
    served.until(card.get_by_role("button", name="mud", exact=True).is_visible)  # its words are read
    tab.keyboard.press("n")
    tab.keyboard.type("drum")
    tab.keyboard.press("Enter")
    served.until(lambda: len(rover.applied) == 1)
    served.until(lambda: card.get_by_label("Its name").input_value() == "")
    tab.keyboard.press("s")  # a go would wait
    served.until(lambda: len(rover.applied) == 2)
    assert rover.applied[1] == (7, ids.Motion.STAY, ())
    assert card.get_by_label("Its name").input_value() == ""


def test_a_new_call_takes_the_focus_out_of_an_empty_field_but_not_out_of_a_word_that_is_typed(
    served: Served, open_page: Callable[..., Any], rover: Any, thing_call: CallReport
) -> None:
    rover.call = None
    tab = open_page()
    field = tab.get_by_label("New word")
    served.until(field.is_visible)
    field.click()
    rover.call = thing_call
    served.until(tab.locator(CALL).is_visible)
    tab.keyboard.press("s")
    served.until(lambda: rover.applied == [(7, ids.Motion.STAY, ())])
    assert field.input_value() == ""
    field.click()
    tab.keyboard.type("mu")
    rover.call = replace(thing_call, id=8, frame_id=4800)
    served.until(tab.locator(CALL).is_visible)
    tab.keyboard.type("d")
    assert field.input_value() == "mud"
    tab.keyboard.press("Escape")
    assert tab.evaluate("document.activeElement.tagName") == "BODY"


def test_in_a_list_or_on_a_slider_a_key_does_not_answer(
    served: Served, open_page: Callable[..., Any], rover: Any
) -> None:
    tab = open_page()
    card = opened(served, tab, rover)
    for label in ("It names", "Weight"):
        card.get_by_label(label).focus()
        tab.keyboard.press("g")
    card.get_by_role("button", name="Stay").focus()
    tab.keyboard.press("l")
    served.until(lambda: rover.applied == [(7, ids.Motion.LOOK_AGAIN, ())])


def test_what_was_named_before_is_named_again_by_one_click(
    served: Served, open_page: Callable[..., Any], rover: Any, thing_call: CallReport
) -> None:
    tab = open_page()
    card = opened(served, tab, rover)
    served.until(card.get_by_role("button", name="mud", exact=True).is_visible)  # its words are read
    assert not card.locator(".again").is_visible()
    card.get_by_label("Its name").fill("drum")
    tab.keyboard.press("Enter")
    served.until(lambda: len(rover.applied) == 1)
    served.until(lambda: tab.locator(CALL).count() == 0)
    rover.files["/state.json"] = b'{"state": "calling", "words": {"drum": -1}, "given": {}}'
    nearest = {"call": 7, "similarity": 0.97, "words": {"drum": -1}}
    rover.files["/calls/8.json"] = json.dumps({"id": 8, "nearest": nearest}).encode()
    rover.call = replace(thing_call, id=8, frame_id=4800)
    served.until(tab.locator(CALL).is_visible)
    again = card.get_by_role("button", name="Still the drum you named at C7: −1, and go")
    served.until(again.is_visible)
    tab.wait_for_timeout(2100)  # a call that is new takes no answer
    again.click()
    served.until(lambda: len(rover.applied) == 2)
    target, motion, (tap,) = rover.applied[1]
    assert (target, motion) == (8, ids.Motion.GO)
    assert isinstance(tap, Tap)
    assert (tap.word, tap.weight, tap.frame_id) == ("drum", -1.0, 4800)


def test_a_call_that_opens_in_the_background_is_noticed_once_if_a_person_allowed_it(
    served: Served, open_page: Callable[..., Any], rover: Any, thing_call: CallReport
) -> None:
    rover.call = None
    tab = open_page(before=NOTICES)
    served.until(tab.locator("#alarm").is_visible)
    assert tab.locator("#alarm").inner_text() == "Sound and notice: off"
    tab.locator("#alarm").click()
    served.until(lambda: tab.locator("#alarm").inner_text() == "Sound and notice: on")
    tab.evaluate("window.away = true")
    rover.call = thing_call
    served.until(lambda: bool(tab.evaluate("told.length")))
    assert tab.title() == "(1) CALLING · AnyTraverse"
    first = json.loads(json.dumps(tab.evaluate("told")))
    assert first[0] == ["vibrated", 5]
    assert first[1][0] == "A rover calls"
    assert "C7. Unknown thing in the middle" in first[1][1]
    assert first[1][2] == "1/7-1"
    served.say(rover.text(TEXT))
    served.until(lambda: WHY in tab.locator(CALL).inner_text())
    assert tab.evaluate("told.length") == 2, "each call once"
