"""A match can be refused: it is undone, and the scene does not match such a frame again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anytraverse.adoption import adopted_memory, refused_memory
from anytraverse.assessment import Reason
from anytraverse.errors import PreferencesError, UnknownWordError
from anytraverse.history import MAX_REFUSED, Entry, History, Place
from anytraverse.judging import Thresholds
from anytraverse.memory import resumed_memory
from anytraverse.operations import OtherPlace, SetWord
from anytraverse.preferences import Preferences
from tests.anytraverse.conftest import MEANINGS, Rover
from tests.anytraverse.test_remembered_scenes import GNOME, GRASS, TRAIL_TOO, at, entry, memory, stamped

REFUSED = (OtherPlace(),)


def matched(*others: Entry, words: Preferences = GRASS, of: Entry | None = None) -> Rover:
    """A rover that came to 90 degrees, where the scene at 100 degrees matched."""
    found = of or entry(100, TRAIL_TOO, order=5)
    rover = Rover("", memory=memory(words, found, *others))
    rover.see(90, "trail")
    assert rover.see(90, "trail").adopted is not None
    return rover


def test_words_and_reference_are_as_before_and_the_place_is_unknown_again() -> None:
    rover = matched(of=entry(100, stamped(grass=(-1, 3), trail=(1, 3), rock=(-1, 3)), order=5))
    outcome = rover.answer(other_place=0)
    assert rover.memory.preferences == GRASS
    assert outcome.undone == ("trail", "rock")
    assert not outcome.remembered
    assert outcome.newest is not None
    assert Reason.UNKNOWN_SCENE in outcome.newest.reasons
    assert len(rover.memory.history) == 1


def test_the_scene_does_not_match_such_a_frame_again_but_still_its_own_place() -> None:
    rover = matched()
    rover.answer(other_place=5)
    for _ in range(4):
        seen = rover.see(90, "trail")
        assert seen.match is None
        assert not seen.undecided
        assert Reason.UNKNOWN_SCENE in seen.reasons
    rover.see(100, "trail")
    assert rover.see(100, "trail").adopted is not None


def test_no_other_scene_that_the_frame_matches_takes_its_place() -> None:
    rover = matched(entry(75, TRAIL_TOO, order=6))
    rover.answer(other_place=0)
    assert [len(one.refused) for one in rover.memory.history] == [1, 1]
    assert rover.see(90, "trail").match is None


def test_the_newest_frame_is_refused_too_where_it_still_counts_as_that_place() -> None:
    rover = matched()
    rover.see(108, "trail")  # nearer to the scene than to the frame that matched
    rover.answer(other_place=0)
    (scene,) = rover.memory.history
    assert len(scene.refused) == 2
    assert rover.see(108, "trail").match is None


def test_what_was_set_or_forgotten_since_the_match_stays_so() -> None:
    rover = matched(words=stamped(grass=(1, 0), rock=(-1, 0), drum=(-1, 0)))
    rover.answer({"rock": -0.4, "trail": 0.5})
    rover.answer(forget=("drum",))
    rover.answer(other_place=0)
    assert rover.memory.preferences == Preferences.of({"grass": 1, "rock": -0.4, "trail": 0.5})


def test_a_word_from_before_does_not_come_back_against_one_that_was_set_since() -> None:
    rover = matched(of=entry(100, stamped(path=(1, 3)), order=5), words=stamped(grass=(1, 0), trail=(-1, 0)))
    assert dict(rover.memory.preferences) == {"grass": 1, "path": 1}
    rover.answer({"path": 0.5})
    rover.answer(other_place=0)
    assert dict(rover.memory.preferences) == {"grass": 1, "path": 0.5}


def test_a_scene_that_was_answered_since_loses_the_words_of_the_match_and_stays_the_reference() -> None:
    rover = matched(of=entry(100, stamped(grass=(-1, 3), trail=(1, 3)), order=5))
    call = rover.call(90, "trail")
    rover.answer({"rock": -1}, call, 7, go=True)
    rover.answer(other_place=0)
    learnt = rover.memory.history[-1]
    assert learnt.call_id == 7
    assert dict(learnt.preferences) == {"grass": 1, "rock": -1}
    assert not learnt.refused
    assert Reason.UNKNOWN_SCENE not in rover.see(90).reasons


def test_a_scene_that_was_imported_since_keeps_its_words() -> None:
    rover = matched(words=stamped(grass=(1, 0), drum=(-1, 0)))
    imported = entry(0, stamped(trail=(1, 90)), order=90)
    assert imported.call_id == 90
    imported = replace(imported, call_id=0)
    history = rover.memory.history.added(imported)
    rover.engine.memory = replace(rover.memory, history=history, clock=90)
    rover.answer(other_place=0)
    assert rover.memory.history[-1] is imported


def test_with_words_for_the_place_the_frame_of_the_call_is_remembered_without_those_of_the_match() -> None:
    rover = matched()
    call = rover.call(90, "grass", thing="drum")
    outcome = rover.engine.answer((*REFUSED, SetWord("drum", -1)), rover.now, call=call, call_id=9, go=True)
    assert outcome.remembered
    assert dict(rover.memory.history[-1].preferences) == {"grass": 1, "drum": -1}


def test_alone_it_says_nothing_of_the_place_of_the_open_call() -> None:
    rover = matched()
    call = rover.call(90, "grass", thing="drum")
    outcome = rover.engine.answer(REFUSED, rover.now, call=call, call_id=9)
    assert not outcome.remembered
    assert outcome.call is not None
    assert Reason.UNKNOWN_SCENE in outcome.call.reasons
    assert len(rover.memory.history) == 1


def test_taps_of_the_match_go_and_those_of_before_come_back() -> None:
    rover = matched(of=entry(100, stamped(grass=(1, 0), gnome=(-1, 3)), order=5, gnome=(GNOME,)))
    assert "gnome" in rover.memory.examples
    rover.answer(other_place=0)
    assert rover.memory.examples == {}


def test_without_a_match_or_for_that_of_another_call_nothing_changes() -> None:
    rover = Rover("grass: 1")
    rover.see()
    with pytest.raises(PreferencesError, match="nothing to refuse"):
        rover.answer(other_place=0)
    rover = matched()
    before = rover.memory
    with pytest.raises(PreferencesError, match="the place of C5 matched, not that of C6"):
        rover.answer(other_place=6)
    assert rover.memory is before
    with pytest.raises(UnknownWordError):  # what comes with it is refused, so all of it is
        rover.answer({"unicorn": 1}, other_place=5)
    assert rover.memory is before
    rover.answer(other_place=5)
    with pytest.raises(PreferencesError, match="nothing to refuse"):
        rover.answer(other_place=5)


def test_a_new_episode_leaves_nothing_to_refuse() -> None:
    rover = matched()
    rover.answer(new_episode=True)
    assert rover.memory.adoption is None


def test_a_scene_that_is_refused_too_often_is_forgotten() -> None:
    rover = matched(of=entry(100, TRAIL_TOO, order=5))
    rover.answer(other_place=0)
    full = replace(rover.memory.history[0], refused=(at(-90),) * MAX_REFUSED)
    rover.engine.memory = replace(rover.memory, history=History([full]))
    rover.see(100, "trail")
    assert rover.see(100, "trail").adopted is not None
    outcome = rover.answer(other_place=0)
    assert outcome.forgotten == (5,)
    assert len(rover.memory.history) == 0


def test_it_can_be_refused_after_a_restart_and_what_it_taught_stays() -> None:
    rover = matched()
    kept, _ = resumed_memory(rover.memory, "painted-1", GRASS, lambda word: MEANINGS[word])
    again = Rover("", memory=kept)
    again.see(90, "trail")
    again.answer(other_place=5)
    assert again.memory.preferences == GRASS
    kept, _ = resumed_memory(again.memory, "painted-1", GRASS, lambda word: MEANINGS[word])
    assert Rover("", memory=kept).see(90, "trail").match is None


def test_a_refused_frame_that_cannot_be_compared_excludes_the_scene() -> None:
    spoilt = replace(entry(90, GRASS), refused=(np.zeros(2, np.float32),))
    assert History([spoilt]).best(at(90)) is None


ANGLES = st.integers(0, 359)


@given(st.lists(ANGLES, min_size=1, max_size=6), ANGLES, st.lists(ANGLES, max_size=4), st.booleans())
def test_no_scene_that_was_there_matches_a_refused_frame_and_words_are_as_before(
    places: list[int], seen: int, later: list[int], has_moved: bool
) -> None:
    """Whatever was remembered, and whatever frames come after: the engine's rule, on its parts."""
    limits = Thresholds(scene=0.85)
    before = memory(GRASS, *(entry(angle, TRAIL_TOO, order=n) for n, angle in enumerate(places)))
    matches = before.history.matches(at(seen), limits.least_match(len(places)))
    if not matches:
        return
    after, _ = adopted_memory(before, matches[0], str, at(seen))
    newest = at(later[0]) if later else None
    if has_moved:
        after = after.remembering(at(seen), 99, Place(), move=True)
    undone, _, _ = refused_memory(after, 0, newest, limits, str)
    assert dict(undone.preferences) == dict(before.preferences)
    assert undone.adoption is None
    found = undone.history.matches(at(seen), limits.scene)
    assert {match.entry.call_id for match in found} <= {99}
    for angle in later:
        for match in undone.history.matches(at(angle), -1.0):
            assert all(match.similarity > float(one @ at(angle)) for one in match.entry.refused)


@given(st.integers(1, 30))
def test_what_a_scene_keeps_of_refusals_is_bounded(times: int) -> None:
    history = History([entry(90, GRASS)])
    for _ in range(times):
        history = history.refusing({5}, at(0))
    assert all(len(one.refused) <= MAX_REFUSED for one in history)
    assert (len(history) == 0) == (times > MAX_REFUSED)
