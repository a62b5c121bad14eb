"""The books of shadow policy: rates, lengths, what survives a restart, and what is not believed."""

from __future__ import annotations

import json

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from anytraverse.assessment import Reason
from anytraverse.preferences import Preferences
from companion.calls.decisions import WouldHold, WouldResume
from companion.calls.policy import Shadow
from companion.daemon.policy.shadow_statistics import ShadowStatistics, rate
from companion.wire.parameters import build

OBJECT, BLOCKED = frozenset({Reason.UNKNOWN_OBJECT}), frozenset({Reason.BLOCKED, Reason.UNKNOWN_OBJECT})
LISTED = {parameter.name: parameter for parameter in build([], Preferences({}), {})}
WALL = 1_800_000_000.0


def counted() -> tuple[ShadowStatistics, Shadow]:
    """Two hours with three would-be holds, of 4 s, of 10 s and one that a human ended."""
    shadow = Shadow(count=3, watched=7200.0)
    statistics = ShadowStatistics(shadow, "model", WALL)
    for number, (reasons, lasted, by_hand) in enumerate(
        [(OBJECT, 4.0, False), (BLOCKED, 10.0, False), (OBJECT, 99.0, True)], start=1
    ):
        statistics.began(WouldHold(reasons, number), WALL + number)
        statistics.ended(WouldResume(reasons, number, lasted, by_hand))
    return statistics, shadow


def test_the_figures_say_how_many_how_often_and_how_long_for_each_reason() -> None:
    statistics, _ = counted()
    figures = statistics.figures()
    assert (figures["would_hold"], figures["watched_hours"], figures["per_hour"]) == (3, 2.0, 1.5)
    assert figures["since"] == "2027-01-15T08:00:00+00:00"
    assert figures["by_reason"]["unknown_object"] == {
        "would_hold": 3,
        "per_hour": 1.5,
        "mean_s": 7.0,
        "longest_s": 10.0,
        "by_hand": 1,
    }
    assert figures["by_reason"]["blocked"]["would_hold"] == 1
    assert figures["by_reason"]["fault"]["mean_s"] is None
    assert [entry["number"] for entry in figures["newest"]] == [3, 2, 1]
    assert figures["newest"][0]["at"] == "2027-01-15T08:00:03+00:00"
    json.dumps(figures)


def test_a_rate_waits_until_there_is_time_to_count_in() -> None:
    assert rate(3, 0.09) is None
    assert rate(3, 0.1) == 30.0
    assert rate(0, 5.0) == 0.0


def test_one_line_and_one_text_sum_it_up() -> None:
    statistics, _ = counted()
    assert statistics.line().startswith(
        "3 would-be holds in 2.00 h (1.5 an hour); unknown_object 3 (1.5 an hour)"
    )
    assert statistics.text() == "Shadow: 3 in 2.0 h (1.5/h), most unknown thing"


def test_the_parameters_carry_the_counts_and_tenths_of_hours() -> None:
    statistics, shadow = counted()
    shadow.watched += 359.0
    assert statistics.values() == {
        "AT_SHD_HOLDS": 3.0,
        "AT_SHD_HOURS": 2.0,
        "AT_SHD_SCENE": 0.0,
        "AT_SHD_OBJECT": 3.0,
        "AT_SHD_BLOCKED": 1.0,
        "AT_SHD_FAULT": 0.0,
    }


def test_the_newest_fifty_are_listed_and_all_are_counted() -> None:
    statistics = ShadowStatistics(Shadow())
    for number in range(1, 81):
        statistics.began(WouldHold(OBJECT, number), WALL)
    assert len(statistics.figures()["newest"]) == 50
    assert statistics.counts["unknown_object"].holds == 80


def test_a_restart_goes_on_counting_and_a_would_be_hold_goes_on_standing() -> None:
    statistics, shadow = counted()
    shadow.open, shadow.began_at = OBJECT, 500.0
    saved = json.loads(json.dumps(statistics.saved(507.0)))
    again = Shadow()
    restored, notice = ShadowStatistics.restored(saved, again, "model", 20.0, WALL + 99)
    assert notice == ""
    assert (again.count, again.watched, again.open, again.began_at) == (3, 7200.0, OBJECT, 13.0)
    assert restored.figures() == statistics.figures()


def test_another_model_begins_anew_and_says_so() -> None:
    statistics, _ = counted()
    again = Shadow()
    restored, notice = ShadowStatistics.restored(statistics.saved(0.0), again, "other", 0.0, WALL + 99)
    assert "another model's (model)" in notice
    assert (again.count, restored.since) == (0, WALL + 99)


def test_time_alone_is_written_once_a_minute_and_a_would_be_hold_at_once() -> None:
    statistics, shadow = counted()
    first = statistics.saved(0.0)
    shadow.watched += 59.0
    assert statistics.saved(59.0) is first
    shadow.watched += 1.0
    second = statistics.saved(60.0)
    assert second is not first
    statistics.began(WouldHold(OBJECT, 4), WALL)
    assert statistics.saved(61.0) is not second


def test_begun_anew_nothing_is_left() -> None:
    statistics, shadow = counted()
    statistics.reset(WALL + 5)
    assert (shadow.count, shadow.watched) == (0, 0.0)
    assert statistics.figures()["newest"] == []
    assert set(statistics.values().values()) == {0.0}


VALUES = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)


@example(key="since", value=9e11)
@example(key="watched", value=9e10)
@example(key="count", value=9e10)
@given(key=st.sampled_from(sorted(counted()[0].saved(0.0))), value=VALUES)
def test_nonsense_in_the_journal_begins_anew_or_makes_sense(key: str, value: object) -> None:
    statistics, _ = counted()
    again = Shadow()
    restored, _ = ShadowStatistics.restored({**statistics.saved(0.0), key: value}, again, "model", 0.0, WALL)
    json.dumps(restored.figures())
    restored.line()
    assert all(LISTED[name].accepts(told) for name, told in restored.values().items())


@pytest.mark.parametrize("saved", [3, "x", [], {"model": "model"}])
def test_what_is_no_book_is_told(saved: object) -> None:
    _, notice = ShadowStatistics.restored(saved, Shadow(), "model", 0.0, WALL)
    assert "begun anew" in notice
