"""What the page shows of calls: the open one as the supervisor tells it, the others as their records do."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.virtual_time import Clock
from companion.observers.page.calls import shown_calls
from companion.observers.page.files import StateFolder
from companion.observers.page.messages import PageMessageKind
from companion.observers.page.news import News
from companion.system.datagrams import Datagram
from tests.companion.wire.test_documents import JSON, RECORD, STATE

RECORDS: list[dict[str, Any]] = [
    {**RECORD, "outcome": None},
    {**RECORD, "id": 3, "drivable_share": 0.5, "outcome": "accepted", "answers": [], "nearest": None},
]


def there(path: str) -> str:
    return f"{path}?v=1"


def test_the_open_call_comes_first_and_says_why_what_was_answered_and_what_is_alike() -> None:
    first, second = shown_calls(STATE, 100.0, RECORDS, there, {})["calls"]
    assert (first["name"], first["open"], first["since"]) == ("C7", True, 88.0)
    assert first["reason"] == (
        "Unknown thing in the middle, 2.1 m ahead: 71 % of the yellow frame is unknown, over 25 % calls."
    )
    assert first["figures"] == "90% of the known ground drivable"
    assert (first["stands"], first["box"]) == ("The vehicle is held.", (0.41, 0.55, 0.6, 0.81))
    assert first["said"] == [{"at": 1.8e9, "text": "gravel: 1, go: ok"}]
    assert first["nearest"]["text"] == "Most like call C3 (0.91): the answer was drum -1."
    assert first["pictures"]["raw"] == "/calls/7-raw.jpg?v=1"
    assert (second["name"], second["open"], second["outcome"]) == ("C3", False, "accepted by a go")
    assert second["reason"] == "New place: 0.91 like C3, known from 0.94 on."
    assert second["figures"] == "50% of the known ground drivable"


def test_the_figures_alone_are_told_of_a_call_whose_record_has_no_words_for_them() -> None:
    plain = {name: value for name, value in RECORDS[1].items() if name != "why"}
    [shown] = shown_calls({}, 0.0, [{**plain, "similarity": 0.91}], there, {})["calls"]
    assert shown["figures"] == "50% of the known ground drivable, 0.91 like the place it knows"


def test_without_an_open_call_a_record_without_an_outcome_is_not_shown_as_open() -> None:
    first, _ = shown_calls({"state": "ok"}, 100.0, RECORDS, lambda _: "", {})["calls"]
    assert (first["open"], first["pictures"]) == (False, {})


def test_a_tap_is_told_by_its_word() -> None:
    tapped = {"at": None, "motion": "none", "operations": ["tap old drum: -1 0.1 0.2 0.3 0.4"]}
    shown = shown_calls({}, 0.0, [{**RECORD, "answers": [tapped]}], there, {})
    assert shown["calls"][0]["given"] == ["old drum: -1"]
    assert shown["names"] == [("old drum", -1.0)], "it can be said again with one click"


def test_a_thing_that_was_tapped_in_a_like_scene_is_offered_not_a_word_of_all_the_ground() -> None:
    def known(*operations: str) -> Any:
        said = {"at": None, "motion": "stay", "operations": [*operations], "result": "applied"}
        records = [RECORD, {**RECORD, "id": 3, "answers": [said]}]
        return shown_calls(STATE, 0.0, records, there, {})["calls"][0]["known"]

    found = known("mud: -1", "tap old drum: -1 0.1 0.2 0.3 0.4")
    assert found["text"] == "Still the old drum you named at C3: −1, and stay"
    assert known("mud: -1") is None


@pytest.mark.slow
@given(
    st.dictionaries(st.sampled_from([*STATE, "x"]), JSON), st.dictionaries(st.sampled_from([*RECORD]), JSON)
)
def test_what_is_not_understood_is_left_out(state: dict[str, Any], record: dict[str, Any]) -> None:
    shown = shown_calls({**STATE, **state}, 0.0, [{**RECORD, **record}], there, {})
    json.dumps(shown)
    assert len(shown["calls"]) <= 2


def test_a_pictures_address_changes_with_the_picture(tmp_path: Path) -> None:
    (tmp_path / "calls").mkdir()
    picture, folder = tmp_path / "calls" / "7.jpg", StateFolder(str(tmp_path))
    assert folder.address("/calls/7.jpg") == ""
    picture.write_bytes(b"1")
    os.utime(picture, (1.0, 1.0))
    assert folder.address("/calls/7.jpg") == "/calls/7.jpg?v=1000"


def test_what_is_ahead_is_plotted_while_it_is_known() -> None:
    clock = Clock()
    news = News(clock)
    for ahead in ({"traversability": 0.9, "uncertainty": 0.1}, None, {"traversability": None}):
        news.take(Datagram(PageMessageKind.NEWS, {"ahead": ahead, "at": clock.now}))
    assert list(news.points) == [(clock.now, 0.9, 0.1), (clock.now, None, None)]
