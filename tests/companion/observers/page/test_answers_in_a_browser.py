"""A call is answered in a real browser by whoever has the token."""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from anytraverse.operations import Tap
from companion.wire.answers import Acknowledgement, Answer, CancelIncident, PackIncident
from companion.wire.ids import Motion, Result
from companion.wire.incidents import Incidents, Packed
from tests.companion.observers.page import played
from tests.companion.observers.page.browser import JPEG, PHONE, needs_browser, opened_tab
from tests.companion.observers.page.played import Stage

pytestmark = needs_browser


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
    monkeypatch.setattr(played, "JPEG", JPEG)
    calls = tmp_path / "calls"
    calls.mkdir()
    for ending in ("", "-raw", "-large"):
        (calls / f"7{ending}.jpg").write_bytes(JPEG)
    (calls / "7.json").write_text(json.dumps({"id": 7, "reasons": ["unknown_object"], "answers": []}))
    stage, given = Stage(tmp_path, token=played.TOKEN), list[bytes]()
    stage.page.answer = lambda payload, _at: given.append(payload)
    opened: dict[str, Any] = {"id": 7, "kind": "call", "stage": "open", "frame_id": 9, "age": 3}
    opened["worst_tile_box"] = [0.4, 0.5, 0.6, 0.8]
    stage.news["state"] |= {"open": opened, "reasons": ["unknown_object"], "vocabulary": ["mud"]}
    stage.until(stage.up)
    url = f"{stage.page.url}?token={played.TOKEN}"
    with closing(stage), opened_tab(url, viewport=PHONE) as tab:
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
