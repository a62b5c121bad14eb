"""A stay counts at once, also one that comes with words that vision has still to apply, or cannot take."""

from __future__ import annotations

import pytest

from anytraverse.operations import SetWord
from companion.wire.ids import Motion, Result
from tests.companion.daemon.rig import HOLD, Rig


@pytest.fixture
def going(held: Rig) -> Rig:
    """A go is kept, and waits for a few more clear frames."""
    held.word(1, "drum", 0.5, Motion.GO)
    held.see(0.3, "drum")
    assert [ack.result for ack in held.acks] == [Result.APPLIED]
    assert held.calls.go_at is not None
    assert held.stage.mode == HOLD
    return held


def test_stay_with_words_takes_a_go_back_before_vision_has_applied_them(going: Rig) -> None:
    going.answer(1, Motion.STAY, SetWord("trail", 1.0), transaction=8)
    going.turn()
    assert going.calls.go_at is None
    going.see(3.0, "drum")
    assert going.acks[-1].result is Result.APPLIED
    assert going.engine.memory.preferences["trail"] == 1.0
    assert going.stage.mode == HOLD


def test_stay_with_words_counts_though_vision_takes_no_more_of_them(going: Rig) -> None:
    while going.vision.answer(None, ()):
        pass
    going.answer(1, Motion.STAY, SetWord("trail", 1.0), transaction=8)
    going.see(3.0, "drum")
    assert going.acks[-1].result is Result.BUSY
    assert going.stage.mode == HOLD


def test_stay_with_a_word_that_is_refused_counts_all_the_same(going: Rig) -> None:
    going.answer(1, Motion.STAY, SetWord("unicorn", 1.0), transaction=8)
    going.see(3.0, "drum")
    assert going.acks[-1].result is Result.REFUSED
    assert going.stage.mode == HOLD


def test_a_go_with_a_word_that_a_stay_overtook_is_told_to_be_taken_back(held: Rig) -> None:
    held.hung = True
    held.answer(1, Motion.GO, SetWord("drum", 0.5))
    held.wait(0.3)
    held.answer(1, Motion.STAY, transaction=8)
    held.wait(0.3)
    held.hung = False
    held.see(1.0, "drum")
    assert {ack.transaction: ack.text for ack in held.acks} == {
        7: "C1 go taken back by a later answer",
        8: "C1 noted: still open",
    }
    assert held.stage.mode == HOLD


def test_a_go_that_waits_for_the_disk_is_taken_back_by_a_look_again(held: Rig) -> None:
    held.disk_hangs = True
    held.answer(1, Motion.GO)
    held.see(0.3)
    held.answer(1, Motion.LOOK_AGAIN, transaction=8)
    held.see(0.3)
    held.disk_hangs = False
    held.see(1.0)
    assert (held.acks[0].transaction, held.acks[0].text) == (7, "C1 go taken back by a later answer")
    assert held.stage.mode == HOLD
