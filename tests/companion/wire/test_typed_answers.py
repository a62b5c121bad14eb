"""What is formatted as an operator types it is read back as the same answer, or refused."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anytraverse.operations import ForgetWord, SetWord, Tap
from companion.wire.answers import Answer
from companion.wire.call_report import RECORD_MEMBERS, CallReport
from companion.wire.ids import Motion
from companion.wire.typed_answers import CommandError, placed, read_typed, typed
from tests.companion.link.payloads import CALL

WORD = st.from_regex(r"[a-z]{1,8}( (go|look|[a-z]{1,4}))?", fullmatch=True)
WEIGHT = st.integers(-100, 100).map(lambda hundredths: hundredths / 100)
SIDE = st.integers(0, 4_000)
BOX = st.tuples(SIDE, SIDE, SIDE, SIDE).map(
    lambda one: (one[0] / 1e4, one[1] / 1e4, (one[2] + 5_000) / 1e4, (one[3] + 5_000) / 1e4)
)


@given(st.lists(WORD, max_size=4, unique=True), WEIGHT, BOX, st.sampled_from(Motion))
def test_an_answer_is_read_back_as_it_was(
    words: list[str], weight: float, box: tuple[float, float, float, float], motion: Motion
) -> None:
    kinds = (
        lambda word: SetWord(word, weight),
        lambda word: Tap(4711, box, word, weight),
        ForgetWord,
    )
    operations = tuple(kinds[number % 3](word) for number, word in enumerate(words))
    try:
        line = typed(Answer(0, motion, operations))
    except CommandError:
        return
    read = read_typed(line)
    assert read.motion is motion
    assert [type(one) for one in read.operations] == [type(one) for one in operations]
    assert [one.word for one in read.operations if hasattr(one, "word")] == words


def test_a_tap_keeps_its_box() -> None:
    tap = Tap(CALL.frame_id, (0.4012, 0.5, 0.6, 0.8), "drum", -1.0)
    line = typed(Answer(0, Motion.GO, (tap,)))
    assert line == "tap drum: -1 0.4012 0.5000 0.6000 0.8000, go"
    assert placed(read_typed(line), CALL).operations == (tap,)


@pytest.mark.parametrize("word", ["look", "call 7", "go"])
def test_a_word_that_would_be_a_command_is_refused(word: str) -> None:
    with pytest.raises(CommandError, match="read otherwise"):
        typed(Answer(0, Motion.NONE, (ForgetWord(word),)))


def test_a_box_that_is_nothing_as_it_is_sent_is_refused() -> None:
    with pytest.raises(CommandError, match="a box is"):
        read_typed("tap drum -1 0.40001 0.5 0.40004 0.6, stay")


def test_a_call_whose_worst_tile_is_nothing_as_it_is_sent_points_at_no_place() -> None:
    call = CallReport.read({"id": 7, "worst_tile_box": [0.40001, 0.5, 0.40004, 0.6]}, RECORD_MEMBERS)
    with pytest.raises(CommandError, match="call 7 points at no place"):
        placed(read_typed("tap drum -1, stay"), call)
