"""Which answer is a repetition, by whichever message it comes, and what it gets then."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anytraverse.operations import SetWord, Tap
from companion.link.answer_store import IN_ALL, MAX_TEXTS, OF_A_SENDER, UNDECIDED_FOR, AnswerStore
from companion.wire.answers import PAYLOADS, Acknowledgement, Answer, Via
from companion.wire.ids import CHANGING_RESULTS, PAGE_SENDER, Motion, Result

GROUND, OTHER = (255, 190), (254, 1)
BOX = (0.4, 0.5, 0.6, 0.7)
ANSWERS = {
    Via.TUNNEL: Answer(7, Motion.GO, (SetWord("drum", -1.0),), transaction=9, sender=GROUND, via=Via.TUNNEL),
    Via.PAGE: Answer(7, Motion.GO, (SetWord("drum", -1.0),), transaction=9, sender=PAGE_SENDER, via=Via.PAGE),
    Via.COMMAND: Answer(7, Motion.GO, sender=GROUND, via=Via.COMMAND, confirmation=1),
    **{
        via: Answer(7, Motion.NONE, (Tap(3, BOX, "obstacle", -1.0),), sender=GROUND, via=via, confirmation=1)
        for via in (Via.TRACK_POINT, Via.TRACK_RECTANGLE)
    },
    Via.AT_ANSWER: Answer(7, Motion.GO, sender=GROUND, via=Via.AT_ANSWER),
    Via.TEXT: Answer(
        0, Motion.NONE, (SetWord("mud", -1.0),), sender=GROUND, via=Via.TEXT, name="AT_WORDS", raw=b"mud: -1"
    ),
}
vias = pytest.mark.parametrize("via", Via)


def reply(answer: Answer, result: Result = Result.APPLIED, target: int = 7) -> Acknowledgement:
    return Acknowledgement.without_figures(answer.transaction, target, result, result.name)


def decided(result: Result = Result.APPLIED, via: Via = Via.TUNNEL) -> tuple[AnswerStore, Answer]:
    store, answer = AnswerStore(), ANSWERS[via]
    assert store.begin(answer, 0.0)
    store.finish(answer, reply(answer, result), 1.0)
    return store, answer


@vias
def test_an_undecided_answer_is_not_new_until_nobody_decides_it_any_more(via: Via) -> None:
    store, answer = AnswerStore(), ANSWERS[via]
    assert store.find(answer, 0.0) is None
    assert store.begin(answer, 0.0)
    assert store.find(answer, UNDECIDED_FOR - 0.1) == (0.0, None)
    assert store.find(replace(answer, sender=OTHER), 0.1) is None
    assert store.find(answer, UNDECIDED_FOR) is None
    store.set_undecided_for(90.0)
    assert store.find(answer, 89.0) == (0.0, None)


@vias
def test_a_busy_answer_is_forgotten(via: Via) -> None:
    store, answer = decided(Result.BUSY, via)
    assert (store.find(answer, 1.0), len(store)) == (None, 0)


@pytest.mark.parametrize(
    ("via", "lasts"),
    [(Via.TUNNEL, 1e6), (Via.PAGE, 1e6), (Via.COMMAND, 5.0), (Via.AT_ANSWER, 5.0), (Via.TEXT, None)],
)
def test_a_decided_answer_is_known_for_as_long_as_its_message_needs(via: Via, lasts: float | None) -> None:
    store, answer = decided(via=via)
    if lasts is not None:
        assert store.find(answer, 1.0 + lasts) == (1.0, reply(answer))
    assert store.find(answer, 1.0 + (lasts or 0.0) + 0.1) is None or via in PAYLOADS


def test_a_command_without_a_confirmation_count_is_new_once_the_last_is_decided() -> None:
    store, answer = decided(via=Via.COMMAND)
    assert store.find(replace(answer, confirmation=0), 1.0) is None
    assert store.find(replace(answer, confirmation=7), 1.0) is not None
    assert store.find(replace(answer, target=8), 1.0) is None


def test_stay_by_at_answer_is_new_each_time() -> None:
    store, stay = AnswerStore(), replace(ANSWERS[Via.AT_ANSWER], motion=Motion.STAY)
    store.begin(stay, 0.0)
    assert store.find(stay, 0.0) is None
    store.finish(stay, reply(stay), 0.0)
    assert store.find(stay, 0.0) is None


@pytest.mark.parametrize("result", Result)
@pytest.mark.parametrize("target", [0, 7])
def test_an_at_answer_is_known_by_both_ids_when_it_was_accepted_or_stale_without_an_id(
    result: Result, target: int
) -> None:
    store, answer = AnswerStore(), replace(ANSWERS[Via.AT_ANSWER], target=target)
    store.begin(answer, 0.0)
    store.finish(answer, reply(answer, result), 0.0)
    known = result in CHANGING_RESULTS or (result is Result.STALE and target == 0)
    assert [store.find(replace(answer, target=one), 0.0) is not None for one in (target, 7)] == [known] * 2


def test_no_more_than_16_texts_wait_at_once() -> None:
    store, text = AnswerStore(), ANSWERS[Via.TEXT]
    for number in range(MAX_TEXTS):
        assert store.begin(replace(text, raw=b"%d" % number), 0.0)
    assert not store.begin(text, 1.0)
    assert store.find(text, 1.0) is None
    assert store.begin(ANSWERS[Via.TUNNEL], 1.0)
    first = replace(text, raw=b"0")
    store.finish(first, reply(first), 2.0)
    assert store.begin(text, 2.0)
    assert store.begin(first, UNDECIDED_FOR), "those that nobody decided do not count"


@pytest.mark.parametrize("via", [Via.TUNNEL, Via.COMMAND, Via.AT_ANSWER])
@pytest.mark.parametrize("flood", Via)
@pytest.mark.parametrize("sender", [GROUND, OTHER])
def test_nothing_is_pushed_out_by_another_sender_or_by_what_the_same_one_sends_by_another_message(
    via: Via, flood: Via, sender: tuple[int, int]
) -> None:
    store, answer = decided(via=via)
    other = replace(ANSWERS[flood], sender=sender)
    for number in range(100, 100 + 2 * OF_A_SENDER):
        store.begin(replace(other, transaction=number, target=number, raw=b"%d" % number), 2.0)
    known = store.find(answer, 3.0)
    assert (known == (1.0, reply(answer))) == (sender == OTHER or flood is not via)
    assert len(store) <= 1 + OF_A_SENDER


def test_the_store_is_bounded_whatever_names_are_used() -> None:
    store, answer = AnswerStore(), ANSWERS[Via.TUNNEL]
    for number in range(IN_ALL + 100):
        store.begin(replace(answer, sender=(number // 256, number % 256)), 0.0)
    assert len(store) == IN_ALL


@vias
@pytest.mark.parametrize("result", Result)
def test_only_what_changed_something_by_a_transaction_is_known_after_a_restart(
    via: Via, result: Result
) -> None:
    store, answer = decided(result, via)
    store.save(answer, reply(answer, result))
    after = AnswerStore(store.saved())
    saved = via in PAYLOADS and result in CHANGING_RESULTS
    assert after.before_restart(answer) == (reply(answer, result) if saved else None)
    assert after.saved() == ([[*answer.sender, 9, 7, result, result.name]] if saved else [])
    assert after.find(answer, 0.0) is None, "it is completed with the figures of now"
    assert after.before_restart(replace(answer, sender=OTHER)) is None


def test_the_newest_16_are_saved_and_all_that_were_read_are_known() -> None:
    store, answer = decided()
    store.save(answer, reply(answer))
    store = AnswerStore(store.saved())
    newer = [replace(answer, transaction=100 + number) for number in range(20)]
    for one in newer:
        store.save(one, reply(one))
    assert [row[2] for row in store.saved()] == [one.transaction for one in newer[-16:]]
    assert store.before_restart(answer) == reply(answer)
    assert store.before_restart(newer[-1]) is None, "this run's replies are repeated from memory"


rows = st.tuples(
    st.integers(1, 255),
    st.integers(1, 255),
    st.integers(1, 2**32 - 1),
    st.integers(0, 65535),
    st.sampled_from(Result).map(int),
    st.text(max_size=20),
)


@given(st.lists(rows, max_size=16))
def test_the_rows_of_a_journal_come_back_as_they_were(saved: list[tuple[Any, ...]]) -> None:
    assert AnswerStore([list(row) for row in saved]).saved() == [list(row) for row in saved]


@pytest.mark.parametrize(
    ("column", "value"),
    [
        *((0, raw) for raw in (-1, 256, "7", True, 7.5, None)),
        (1, 256),
        *((2, raw) for raw in (0, 2**32)),
        *((3, raw) for raw in (-1, 65536)),
        *((4, raw) for raw in (7, True)),
        *((5, raw) for raw in ("\ud800", 7, None)),
    ],
)
def test_a_row_that_no_reply_could_have_made_is_dropped(column: int, value: Any) -> None:
    row = [255, 190, 9, 7, 0, "applied"]
    assert AnswerStore([[*row[:column], value, *row[column + 1 :]], row]).saved() == [row]


@pytest.mark.slow
@given(st.recursive(st.none() | st.booleans() | st.integers() | st.floats() | st.text(), st.lists))
def test_whatever_else_stands_in_the_journal_counts_for_nothing(saved: Any) -> None:
    assert isinstance(AnswerStore(saved).saved(), list)
