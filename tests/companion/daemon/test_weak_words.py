"""A word that the perceiver finds badly is told to be weak, once, when it comes into use."""

from __future__ import annotations

import pytest

from anytraverse.operations import Tap
from companion.wire import notices
from companion.wire.ids import Motion
from tests.anytraverse.conftest import AHEAD, Painted
from tests.companion.daemon.rig import MakeRig

BOX = (AHEAD.left, AHEAD.top, AHEAD.right, AHEAD.bottom)


@pytest.fixture(autouse=True)
def doubtful(monkeypatch: pytest.MonkeyPatch) -> None:
    """A perceiver that finds rocks and drums badly."""
    trust = {"rock": "weak", "drum": "weak"}
    monkeypatch.setattr(Painted, "trust", lambda _, word: trust.get(word, "good"), raising=False)


def test_weak_words_are_told_once_at_the_start_and_when_they_come_into_use(make_rig: MakeRig) -> None:
    rig = make_rig()
    rig.see(1.0)
    assert rig.texts.count(notices.weak_word("rock")) == 1
    assert notices.weak_word("drum") not in rig.texts
    rig.word(0, "drum", -1.0)
    rig.see(2.0)
    assert rig.texts.count(notices.weak_word("drum")) == 1
    assert rig.texts.count(notices.weak_word("rock")) == 1
    assert notices.weak_word("grass") not in rig.texts


def test_a_weak_word_that_comes_with_a_tap_is_not_told(make_rig: MakeRig) -> None:
    rig = make_rig()
    rig.see(2.0, "gnome")
    call = rig.calls.call
    assert call is not None
    rig.answer(call.id, Motion.NONE, Tap(call.frame_id, BOX, "drum", -1.0))
    rig.see(1.0, "gnome")
    assert "drum" in rig.engine.memory.preferences
    assert notices.weak_word("drum") not in rig.texts
