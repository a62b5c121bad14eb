"""An answer that brings no new word to a new place says that such a change needs no call."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anytraverse.answers import Tap
from anytraverse.assessment import Reason
from anytraverse.history import History
from anytraverse.judging import WIDENED_AS, Settings, Thresholds
from anytraverse.regions import Box
from tests.anytraverse.conftest import Rover
from tests.anytraverse.test_remembered_scenes import GRASS, TRAIL_TOO, entry, memory

MATCH = ((1, 0.9), (16, 0.95), (64, 0.99))
LIMITS = Thresholds(scene=0.85, match=MATCH)
"""The cosine of 30 degrees is .87, of 20 degrees .94, of 10 degrees .98."""
COSINE = {angle: math.cos(math.radians(angle)) for angle in (5, 12, 20, 40)}


def rover(*known: int) -> Rover:
    """A rover that remembers scenes at these angles, and drives at 0 degrees. 60 more are far from all."""
    far = [entry(200 + number, GRASS, order=100 + number) for number in range(60)]
    scenes = memory(
        GRASS, entry(0, GRASS, order=1), *(entry(each, GRASS, order=each) for each in known), *far
    )
    made = Rover("", settings=Settings(thresholds=LIMITS), memory=scenes)
    made.see(0)
    return made


def widened(of: Rover) -> dict[int, float]:
    """Stamp -> what each scene is widened to."""
    return {one.order: one.widened for one in of.memory.history if one.widened is not None}


def test_a_go_without_a_new_word_widens_the_place_and_the_one_most_like_it() -> None:
    driving = rover(70)
    call = driving.call(90)
    driving.answer(call=call, call_id=7, go=True)
    new = driving.memory.clock
    assert widened(driving) == {new: pytest.approx(COSINE[20]), 70: pytest.approx(COSINE[20])}


@pytest.mark.parametrize("weights", [{"grass": 1.0}, {}])
def test_words_that_are_in_force_bring_nothing_new(weights: dict[str, float]) -> None:
    driving = rover(70)
    driving.answer(weights, call=driving.call(90), call_id=7, go=True)
    assert len(widened(driving)) == 2


def test_a_new_word_another_weight_or_a_tap_widens_nothing() -> None:
    for weights in ({"trail": 1.0}, {"grass": 0.5}):
        driving = rover(70)
        driving.answer(weights, call=driving.call(90), call_id=7, go=True)
        assert not widened(driving)
    driving = rover(70)
    call = driving.call(90)
    tap = Tap(call.frame.id, Box(0.4, 0.7, 0.6, 0.9), "grass", 1.0)
    driving.answer(call=call, call_id=7, go=True, taps=(tap,))
    assert not widened(driving)


def test_an_answer_about_a_thing_in_a_known_place_widens_nothing() -> None:
    driving = rover(70)
    driving.answer(call=driving.call(0, thing="drum"), call_id=7, go=True)
    assert not widened(driving)


def test_frames_as_far_from_a_widened_place_match_it_and_no_others() -> None:
    driving = rover(70)
    driving.answer(call=driving.call(90), call_id=7, go=True)
    driving.see(0)
    driving.see(0)
    for _ in range(2):
        seen = driving.see(102)
    assert seen.adopted is not None, "12 degrees: less than 61 scenes need, and more than 40 do"
    for _ in range(3):
        seen = driving.see(70 - 20)
        assert seen.reasons == {Reason.UNKNOWN_SCENE}, "20 degrees: never less than 40 scenes need"


def test_the_widest_answer_counts_and_the_bound_is_not_passed() -> None:
    history = History([entry(0, GRASS, order=1), entry(12, GRASS, order=2), entry(40, GRASS, order=3)])
    once = history.widened(2)
    assert [one.widened for one in once] == [pytest.approx(COSINE[12]), pytest.approx(COSINE[12]), None]
    again = History([replace(one, matched=9) for one in once]).added(entry(17, GRASS, order=4)).widened(4)
    assert [one.widened for one in again][1] == pytest.approx(COSINE[12]), "it is not made narrower"
    assert History([entry(0, GRASS, order=1)]).widened(1)[0].widened is None, "nothing is like it"


@given(st.integers(0, 300), st.none() | st.floats(-1, 1))
def test_a_widened_scene_needs_no_more_and_never_less_than_among_few(scenes: int, wide: float | None) -> None:
    needed = LIMITS.needed(scenes, wide)
    assert LIMITS.least_match(min(scenes, WIDENED_AS)) <= needed <= LIMITS.least_match(scenes)
    assert wide is not None or needed == LIMITS.least_match(scenes)


def test_other_place_takes_it_back() -> None:
    driving = rover(70)
    driving.answer(call=driving.call(90), call_id=7, go=True)
    driving.see(0)
    driving.see(0)
    driving.see(102)
    assert driving.see(102).adopted is not None
    matched = driving.memory.adoption
    assert matched is not None
    driving.answer(other_place=0)
    assert matched.order not in widened(driving)


def test_words_of_a_widened_scene_come_back_with_it() -> None:
    scenes = History([entry(90, TRAIL_TOO, order=5), entry(0, GRASS, order=1)]).widened(5)
    driving = Rover("", settings=Settings(thresholds=LIMITS), memory=replace(memory(GRASS), history=scenes))
    driving.see(0)
    driving.see(85)
    assert driving.see(85).adopted is not None
    assert "trail" in driving.memory.preferences
