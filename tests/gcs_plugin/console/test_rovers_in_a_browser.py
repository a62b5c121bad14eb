"""Several rovers, lost links and hostile texts in a real browser."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from companion.wire import ids
from companion.wire.call_report import CallReport
from tests.gcs_plugin.console.browser import CALL, needs_browser
from tests.gcs_plugin.console.served import Served

pytestmark = needs_browser


def test_after_a_reload_and_with_a_second_page_the_call_and_its_answer_are_there(
    served: Served, open_page: Callable[..., Any], rover: Any
) -> None:
    rover.stage_after, rover.result = ids.Stage.ANSWERED, ids.Result.APPLIED
    tab = open_page()
    served.until(tab.locator(CALL).is_visible)
    tab.locator(CALL).get_by_role("button", name="Go").click()
    served.until(lambda: rover.applied != [])
    served.until(lambda: "done" in tab.locator(".becoming").inner_text())
    rover.call = replace(rover.call, latitude=47.0001, longitude=8.0)
    where = mavlink.MAVLink_global_position_int_message(0, 470000000, 80000000, 0, 0, 0, 0, 0, 9000)
    served.say(rover.autopilot.frame(where))
    served.until(lambda: tab.locator(".track .own").count() == 1)
    tab.reload()
    served.until(tab.locator(CALL).is_visible)
    served.until(lambda: tab.locator(".dots button").count() == 1)
    dot, own = tab.locator(".dots button").bounding_box(), tab.locator(".track .own").bounding_box()
    assert dot["y"] < own["y"], "the call was north of here"
    tab.locator(".dots button").click()
    assert tab.evaluate("document.activeElement.textContent").startswith("Call C7")
    assert "From here: go done" in tab.locator(".becoming").inner_text()
    assert tab.locator(".timeline li").count() > 2
    other = open_page()
    served.until(other.locator(CALL).is_visible)
    assert "From here: go done" in other.locator(".becoming").inner_text()


def test_of_two_rovers_the_one_that_calls_comes_first(
    served: Served,
    open_page: Callable[..., Any],
    rover: Any,
    tiny_rover: Callable[..., Any],
    thing_call: CallReport,
) -> None:
    other = tiny_rover(2, None)
    served.rovers.append(other)
    rover.call = None
    tab = open_page()
    served.until(lambda: tab.locator(".rover").count() == 2)
    assert tab.locator(".rover h2").all_inner_texts() == ["Rover 1", "Rover 2"]
    other.call = thing_call
    served.until(lambda: tab.locator(".rover h2").all_inner_texts() == ["Rover 2", "Rover 1"])
    assert "Rover 2" in tab.locator("#summary").inner_text()
    tab.locator(CALL).get_by_role("button", name="Go").click()
    served.until(lambda: other.applied != [])
    assert rover.applied == []


def test_forged_rovers_do_not_hide_the_rover_and_leave_the_page_when_they_are_silent(
    served: Served, open_page: Callable[..., Any], tiny_rover: Callable[..., Any], thing_call: CallReport
) -> None:
    tab = open_page()
    sections = tab.locator("article.rover")

    def are_shown() -> bool:
        for system in (0, *range(2, 256)):
            served.say(tiny_rover(system).heartbeat())
            served.turn()
        return bool(sections.count() > 16)

    served.until(are_shown)
    real = tiny_rover(1, thing_call)
    served.rovers.append(real)
    served.until(tab.locator(CALL).is_visible)
    assert sections.first.locator("h2").inner_text() == "Rover 1"
    served.until(lambda: sections.count() == 16)
    tab.locator(CALL).get_by_role("button", name="Go").click()
    served.until(lambda: real.applied != [])


def test_a_link_that_is_cut_is_said_and_an_answer_waits_until_it_is_back(
    served: Served, open_page: Callable[..., Any], rover: Any
) -> None:
    tab = open_page()
    served.until(tab.locator(CALL).is_visible)
    served.rovers.clear()
    served.until(lambda: "NOT HEARD" in tab.locator(".strip strong").text_content())
    tab.locator(CALL).get_by_role("button", name="Stay").click()
    served.until(lambda: "waits: the companion is not heard" in tab.locator(".becoming").inner_text())
    assert rover.applied == []
    served.rovers.append(rover)
    served.until(lambda: rover.applied == [(7, ids.Motion.STAY, ())])


@pytest.mark.usefixtures("rover")
def test_a_console_that_ended_is_said_and_nothing_looks_live(
    served: Served, open_page: Callable[..., Any]
) -> None:
    tab = open_page()
    served.until(tab.locator(CALL).is_visible)
    served.process.terminate()
    served.until(lambda: tab.locator("#title").inner_text() == "NO CONNECTION")
    assert "grayscale" in tab.locator("main").evaluate("part => getComputedStyle(part).filter")
    served.process.wait(10.0)  # a second signal, at its end, would be one that kills


def test_hostile_text_is_text(served: Served, open_page: Callable[..., Any], rover: Any) -> None:
    tab = open_page()
    served.until(tab.locator(CALL).is_visible)
    served.say(rover.text("<img src=x onerror=document.title=1>"))
    served.until(lambda: "<img src=x" in tab.locator(".timeline").inner_text())
    assert tab.locator(".timeline img").count() == 0
