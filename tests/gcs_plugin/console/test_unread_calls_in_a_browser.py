"""Nothing is sent to a call in a real browser that nobody can have read yet."""

from __future__ import annotations

import time
import zipfile
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from companion.wire import ids
from companion.wire.call_report import CallReport
from tests.gcs_plugin.console.browser import CALL, needs_browser
from tests.gcs_plugin.console.served import Served

pytestmark = needs_browser


def test_a_call_that_takes_anothers_place_is_not_answered_before_it_can_be_read(
    served: Served, open_page: Callable[..., Any], rover: Any, thing_call: CallReport
) -> None:
    tab = open_page()
    served.until(tab.locator(CALL).is_visible)
    rover.call = replace(thing_call, stage=ids.Stage.CLOSED, outcome=ids.Outcome.PASSED)
    served.until(lambda: tab.locator(CALL).count() == 0)
    rover.call = replace(thing_call, id=8, frame_id=4800)
    served.until(tab.locator(CALL).is_visible)
    tab.keyboard.press("g")
    assert "C8 is new, so nothing was sent" in tab.locator(CALL).inner_text()
    assert rover.applied == []
    for chosen, calls in (("Save all calls as one report", ["7", "8"]), ("Save the call chosen", ["7"])):
        with tab.expect_download() as saving:
            tab.get_by_role("link", name=chosen).click()
        with zipfile.ZipFile(saving.value.path()) as archive:
            folders = {name.split("/")[0] for name in archive.namelist()} - {"report.html"}
        assert folders == {f"call-{number}" for number in calls}
        tab.locator(".past").get_by_label("in the report").check()


def test_where_another_rovers_call_comes_first_a_key_does_not_reach_it_before_it_can_be_read(
    served: Served,
    open_page: Callable[..., Any],
    rover: Any,
    tiny_rover: Callable[..., Any],
    thing_call: CallReport,
) -> None:
    other = tiny_rover(2, replace(thing_call, id=9))
    served.rovers.append(other)
    tab = open_page(390, "light", 844)
    why, told = tab.locator(".bar .why"), tab.locator(".bar .told")
    served.until(lambda: tab.locator(CALL).count() == 2)
    over = time.monotonic() + 2.5
    served.until(lambda: time.monotonic() > over)  # the one that came second may be the first
    first, second = (rover, other) if "Rover 1" in why.inner_text() else (other, rover)
    first.call = replace(first.call, stage=ids.Stage.CLOSED, outcome=ids.Outcome.PASSED)
    served.until(lambda: tab.locator(CALL).count() == 1)
    tab.keyboard.press("g")
    tab.locator(".bar .go").click()
    assert f"C{second.call.id} has come first, so nothing was sent" in told.inner_text()
    served.until(lambda: told.text_content() == "")
    assert tab.locator(CALL).locator(".problem").first.text_content() == ""
    assert (first.applied, second.applied) == ([], [])
    tab.locator(".bar .go").click()
    served.until(lambda: [motion for _, motion, _ in second.applied] == [ids.Motion.GO])
    assert first.applied == []


def test_who_presses_go_twice_sends_one_answer_and_stay_waits_for_none(
    served: Served, open_page: Callable[..., Any], rover: Any
) -> None:
    rover.stage_after, rover.result = ids.Stage.OPEN, ids.Result.NOT_COVERED
    tab = open_page(390, "light", 844)
    card, bar = tab.locator(CALL), tab.locator(".bar")
    served.until(card.is_visible)
    served.until(card.get_by_role("button", name="mud", exact=True).is_visible)  # its words are read
    name = card.get_by_label("Its name")
    name.fill("drum")
    bar.locator(".go").click()
    served.until(lambda: name.input_value() == "")
    bar.locator(".go").click()
    assert "was sent: wait for its answer" in bar.locator(".told").inner_text()
    served.until(lambda: "does not cover what was seen" in bar.locator(".told").inner_text())
    assert len(rover.applied) == 1
    bar.locator(".go").click()
    served.until(lambda: len(rover.applied) == 2)
    bar.get_by_role("button", name="Stay").click()
    served.until(lambda: len(rover.applied) == 3)
    assert [motion for _, motion, _ in rover.applied] == [ids.Motion.GO, ids.Motion.GO, ids.Motion.STAY]


def test_a_call_that_gains_a_reason_takes_no_go_before_that_can_be_read(
    served: Served, open_page: Callable[..., Any], rover: Any, thing_call: CallReport
) -> None:
    rover.call = replace(thing_call, reasons=ids.Reasons.UNKNOWN_SCENE)
    tab = open_page()
    card = tab.locator(CALL)
    served.until(lambda: card.is_visible() and "What is the ground here?" in card.inner_text())
    rover.call = replace(thing_call, reasons=ids.Reasons.UNKNOWN_SCENE | ids.Reasons.UNKNOWN_OBJECT)
    served.until(lambda: "What is in the yellow frame?" in card.inner_text())
    tab.keyboard.press("g")
    assert "C7 has changed, so nothing was sent" in card.inner_text()
    served.until(lambda: card.locator(".problem").first.text_content() == "")
    assert rover.applied == []
