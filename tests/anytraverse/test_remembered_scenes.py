"""A changed scene that was answered before gives its words back."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anytraverse.assessment import Assessment, Reason
from anytraverse.history import Embedding, Entry, History
from anytraverse.judging import Settings, Thresholds
from anytraverse.memory import Memory
from anytraverse.perception import Example
from anytraverse.preferences import Preferences, Setting

if TYPE_CHECKING:
    from tests.anytraverse.conftest import Rover

GNOME = Example("painted-1", np.array([99], dtype=np.float32))


def at(angle: float) -> Embedding:
    """A scene in the plane, in degrees."""
    radians = math.radians(angle)
    return np.array([math.cos(radians), math.sin(radians)], dtype=np.float32)


def stamped(**words: tuple[float, int]) -> Preferences:
    """Words with weight and stamp."""
    return Preferences({word: Setting(*setting) for word, setting in words.items()})


def entry(angle: float, words: Preferences, order: int = 5, **examples: tuple[Example, ...]) -> Entry:
    """An answered scene."""
    return Entry(at(angle), words, order, order, call_id=order, examples=examples)


def memory(words: Preferences, *entries: Entry, **settled: int) -> Memory:
    """What was learnt so far; the reference is the scene at 0 degrees."""
    return Memory(
        "painted-1", words, words, settled=settled, reference=at(0), history=History(entries), clock=20
    )


GRASS = stamped(grass=(1, 0))
TRAIL_TOO = stamped(grass=(1, 0), trail=(1, 3))


def test_a_scene_never_seen_is_a_call_for_words(rover: Rover) -> None:
    seen = rover.see(90)
    assert seen.reasons == {Reason.UNKNOWN_SCENE}
    assert seen.match is None
    assert not seen.undecided


def test_a_match_is_adopted_after_two_frames_and_judged_with_its_words_before_anything_is_told(
    make_rover: type[Rover],
) -> None:
    rover = make_rover("", memory=memory(GRASS, entry(90, TRAIL_TOO)))
    first = rover.see(90, "trail")
    assert first.reasons == {Reason.UNKNOWN_SCENE, Reason.UNKNOWN_OBJECT}
    assert first.match is not None
    assert first.undecided
    assert first.adopted is None
    assert "trail" not in first.words
    second = rover.see(90, "trail")
    assert second.adopted is not None
    assert not second.undecided
    assert second.words == TRAIL_TOO
    assert second.ok
    assert second.roi is not None
    assert second.roi.uncertainty == 0
    assert rover.eyes.encoded == 2


def test_words_of_a_match_that_forbid_the_ground_are_told_at_once(make_rover: type[Rover]) -> None:
    rover = make_rover("", memory=memory(GRASS, entry(90, stamped(grass=(-1, 0)))))
    rover.see(90)
    assert rover.see(90).reasons == {Reason.BLOCKED}


def test_words_of_a_match_that_do_not_cover_the_thing_leave_the_call(make_rover: type[Rover]) -> None:
    rover = make_rover("", memory=memory(GRASS, entry(90, TRAIL_TOO)))
    rover.see(90, "trail", "drum")
    second = rover.see(90, "trail", "drum")
    assert second.adopted is not None
    assert second.reasons == {Reason.UNKNOWN_OBJECT}


@pytest.mark.parametrize(
    ("scenes", "adopted"),
    [([90, 90], True), ([90, 0, 90], True), ([90, 0, 0, 90], False), ([90, 180, 180, 90], False)],
)
def test_two_of_the_last_three_frames_must_match(
    make_rover: type[Rover], scenes: list[int], adopted: bool
) -> None:
    rover = make_rover("", memory=memory(GRASS, entry(90, TRAIL_TOO)))
    last = [rover.see(scene) for scene in scenes][-1]
    assert (last.adopted is not None) is adopted


def test_the_votes_are_a_setting(make_rover: type[Rover]) -> None:
    rover = make_rover("", Settings(votes=1, window=1), memory(GRASS, entry(90, TRAIL_TOO)))
    assert rover.see(90).adopted is not None


def test_broken_frames_are_counted_as_frames_without_a_match(make_rover: type[Rover]) -> None:
    rover = make_rover("", memory=memory(GRASS, entry(90, TRAIL_TOO)))
    rover.see(90)
    rover.see(90, captured_at=0.0)
    rover.see(90, image=None)
    assert rover.see(90).adopted is None
    assert rover.see(90).adopted is not None


def test_the_most_similar_scene_is_adopted_and_becomes_the_reference(make_rover: type[Rover]) -> None:
    near, far = entry(90, TRAIL_TOO, 5), entry(70, GRASS, 6)
    rover = make_rover("", memory=memory(GRASS, far, near))
    rover.see(85)
    seen = rover.see(85)
    assert seen.adopted is near
    assert seen.similarity == pytest.approx(math.cos(math.radians(5)))
    assert rover.memory.reference is near.embedding
    matched = {one.order: one.matched for one in rover.memory.history}
    assert matched == {5: 21, 6: 6}


def test_a_scene_not_similar_enough_is_no_match(make_rover: type[Rover]) -> None:
    rover = make_rover("", memory=memory(GRASS, entry(90, TRAIL_TOO)))
    assert rover.see(130).match is None


def test_an_unknown_object_is_a_call_even_where_a_remembered_scene_has_the_word(
    make_rover: type[Rover],
) -> None:
    rover = make_rover("", memory=memory(GRASS, entry(0, stamped(drum=(-1, 3)))))
    for _ in range(4):
        seen = rover.see(0, thing="drum")
        assert seen.reasons == {Reason.UNKNOWN_OBJECT}
        assert seen.match is None
    assert "drum" not in rover.memory.preferences


def test_words_that_the_match_does_not_name_stay(make_rover: type[Rover]) -> None:
    rover = make_rover("", memory=memory(stamped(grass=(1, 0), rock=(-1, 0)), entry(90, TRAIL_TOO)))
    rover.see(90)
    rover.see(90)
    assert rover.memory.preferences == Preferences.parse("grass: 1; rock: -1; trail: 1")


def back_at(rover: Rover, scene: int) -> Assessment:
    """The scene is seen until it is recognized."""
    rover.see(scene)
    seen = rover.see(scene)
    assert seen.adopted is not None
    return seen


def test_back_at_a_scene_its_words_are_in_force_again_though_another_scenes_answer_set_them_otherwise(
    rover: Rover,
) -> None:
    rover.answer({"grass": 1}, rover.call(90), 1)
    rover.answer({"grass": -1}, rover.call(180), 2)
    assert rover.memory.preferences["grass"] == -1
    assert back_at(rover, 90).words["grass"] == 1
    assert back_at(rover, 180).words["grass"] == -1


def test_a_word_set_without_a_call_after_a_scene_was_answered_stands_there(rover: Rover) -> None:
    rover.answer({"grass": 1}, rover.call(90), 1)
    rover.answer({"grass": 0.2})
    rover.answer({"trail": 1}, rover.call(180), 2)
    assert back_at(rover, 90).words["grass"] == 0.2


def test_a_word_set_without_a_call_before_a_scene_was_answered_gives_way_there(rover: Rover) -> None:
    rover.answer({"grass": 0.2})
    rover.answer({"grass": 1}, rover.call(90), 1)
    rover.answer({"grass": -1}, rover.call(180), 2)
    assert back_at(rover, 90).words["grass"] == 1


def test_a_word_set_without_a_call_stands_against_older_scenes_though_answered_since(rover: Rover) -> None:
    rover.answer({"grass": 1}, rover.call(90), 1)
    rover.answer({"grass": 0.2})
    rover.answer({"grass": -1}, rover.call(180), 2)
    assert back_at(rover, 90).words["grass"] == -1


def test_a_word_forgotten_since_does_not_come_back_from_a_scene_though_answered_elsewhere(
    rover: Rover,
) -> None:
    rover.answer({"trail": 1}, rover.call(90), 1)
    rover.answer(forget=("trail",))
    rover.answer({"trail": -1}, rover.call(180), 2)
    assert back_at(rover, 90).words["trail"] == -1


def test_a_match_does_not_bring_a_forgotten_word_back(make_rover: type[Rover]) -> None:
    rover = make_rover("grass: 1")
    rover.see()
    call = rover.call(90, "trail")
    rover.answer({"trail": 1}, call, 1)
    rover.answer(forget=("trail",))
    rover.see(0)
    rover.see(0)
    rover.see(90, "trail")
    back = rover.see(90, "trail")
    assert back.adopted is not None
    assert back.reasons == {Reason.UNKNOWN_OBJECT}
    assert "trail" not in back.words


def test_a_forgotten_word_is_brought_back_by_a_scene_that_was_answered_after_it_was_set_again(
    make_rover: type[Rover],
) -> None:
    words = stamped(grass=(1, 0), trail=(1, 8))
    rover = make_rover("", memory=memory(GRASS, entry(90, TRAIL_TOO, 5), entry(180, words, 9), trail=7))
    rover.see(90)
    assert rover.see(90).words == GRASS
    rover.see(180)
    assert rover.see(180).words == words


def test_a_synonym_set_without_a_call_later_keeps_the_matchs_word_out(make_rover: type[Rover]) -> None:
    words = stamped(grass=(1, 0), path=(-1, 9))
    rover = make_rover("", memory=memory(words, entry(90, TRAIL_TOO), path=9))
    rover.see(90)
    seen = rover.see(90)
    assert seen.adopted is not None
    assert seen.words == Preferences.parse("grass: 1; path: -1")
    assert seen.dropped == ()


@pytest.mark.parametrize(("stamp", "settled"), [(2, {"path": 2}), (2, {}), (9, {})])
def test_a_synonym_set_before_or_answered_elsewhere_gives_way_and_that_is_said(
    make_rover: type[Rover], stamp: int, settled: dict[str, int]
) -> None:
    words = stamped(grass=(1, 0), path=(-1, stamp))
    rover = make_rover("", memory=memory(words, entry(90, TRAIL_TOO), **settled))
    rover.see(90)
    seen = rover.see(90)
    assert seen.words == TRAIL_TOO
    assert seen.dropped == ("path",)


def test_beyond_sixteen_words_the_least_recently_set_goes_and_that_is_said(make_rover: type[Rover]) -> None:
    words = Preferences({f"kind {n}": Setting(1, n) for n in range(16)})
    rover = make_rover("", memory=memory(words, entry(90, stamped(grass=(1, 7)), order=17)))
    rover.see(90, "kind 5")
    seen = rover.see(90, "kind 5")
    assert seen.dropped == ("kind 0",)
    assert "grass" in seen.words
    assert len(seen.words) == 16


@pytest.mark.parametrize(("settled", "comes_back"), [({"kind 0": 6}, False), ({}, True)])
def test_a_word_set_without_a_call_and_dropped_since_does_not_come_back_from_an_older_scene(
    make_rover: type[Rover], settled: dict[str, int], comes_back: bool
) -> None:
    words = Preferences({f"kind {n}": Setting(1, 6 + n) for n in range(16)})
    old = entry(90, Preferences({"kind 0": Setting(-1, 2)}), 5)
    new = entry(180, stamped(grass=(1, 18)), 19)
    rover = make_rover("", memory=memory(words, old, new, **settled))
    assert back_at(rover, 180).dropped == ("kind 0",)
    rover.answer(forget=("kind 15",))
    assert ("kind 0" in back_at(rover, 90).words) is comes_back


def test_tapped_words_come_back_with_their_examples(make_rover: type[Rover]) -> None:
    words = stamped(grass=(1, 0), gnome=(-1, 3))
    rover = make_rover("", memory=memory(GRASS, entry(90, words, gnome=(GNOME,))))
    rover.see(90, thing="gnome")
    seen = rover.see(90, thing="gnome")
    assert seen.reasons == {Reason.BLOCKED}
    assert rover.memory.examples["gnome"] == (GNOME,)


def test_a_remembered_word_that_cannot_be_grounded_is_left_out(make_rover: type[Rover]) -> None:
    words = stamped(grass=(1, 0), gnome=(-1, 3))
    rover = make_rover("", memory=memory(GRASS, entry(90, words)))
    rover.see(90)
    assert rover.see(90).words == GRASS


def test_a_frame_with_a_fault_does_not_vote(make_rover: type[Rover]) -> None:
    rover = make_rover("", memory=memory(GRASS, entry(90, TRAIL_TOO)))
    for _ in range(4):
        seen = rover.see(90, captured_at=rover.now - 60)
        assert seen.reasons == {Reason.FAULT, Reason.UNKNOWN_SCENE}
        assert seen.adopted is None


MEASURED = Thresholds(scene=0.85, match=((1, 0.80), (4, 0.90), (16, 0.96)))


def test_without_measured_numbers_the_scenes_own_threshold_counts_for_any_number() -> None:
    assert {Thresholds(scene=0.85).least_match(n) for n in (0, 1, 40, 10_000)} == {0.85}


def test_between_two_measured_numbers_it_rises_with_the_logarithm_and_beyond_the_last_up_to_1() -> None:
    assert MEASURED.least_match(0) == MEASURED.least_match(1) == 0.85  # never below the scene's own
    assert MEASURED.least_match(4) == pytest.approx(0.90)
    assert MEASURED.least_match(8) == pytest.approx(0.93)
    assert MEASURED.least_match(23) == pytest.approx(0.96 + 0.04 * math.log(23 / 16, 2))
    assert MEASURED.least_match(256) == 1.0
    flat = replace(MEASURED, match=(*MEASURED.match, (64, 0.96)))  # more false matches were allowed
    assert flat.least_match(128) > 0.98


def test_a_configured_scene_threshold_is_the_least_and_lowers_no_measured_number() -> None:
    assert replace(MEASURED, scene=0.93).least_match(4) == 0.93
    assert replace(MEASURED, scene=0.2).least_match(4) == pytest.approx(0.90)


@given(st.integers(0, 20_000), st.integers(0, 20_000))
def test_more_scenes_never_make_a_match_easier(one: int, other: int) -> None:
    fewer, more = sorted((one, other))
    assert 0.85 <= MEASURED.least_match(fewer) <= MEASURED.least_match(more) <= 1.0


@pytest.mark.parametrize("others", [0, 15])
def test_a_frame_that_matches_one_scene_of_few_does_not_match_one_of_many(
    make_rover: type[Rover], others: int
) -> None:
    """20 degrees apart is a cosine of .94: enough for one of 2 scenes, too little for one of 16."""
    far = (entry(-90 - n, GRASS, order=6 + n) for n in range(others))
    rover = make_rover(
        "", memory=memory(GRASS, entry(90, TRAIL_TOO), *far), settings=Settings(thresholds=MEASURED)
    )
    rover.see(70, "trail")
    assert (rover.see(70, "trail").adopted is not None) == (others == 0)


def of_many(make_rover: type[Rover], margin: float = 0.01) -> Rover:
    """One of 16 scenes is at 90 degrees: a match needs a cosine of .96."""
    far = (entry(-90 - n, GRASS, order=6 + n) for n in range(15))
    limits = replace(MEASURED, similarity_margin=margin)
    return make_rover("", Settings(thresholds=limits), memory(GRASS, entry(90, TRAIL_TOO), *far))


@pytest.mark.parametrize(
    ("degrees", "match", "undecided"),
    [(16, True, True), (17, False, True), (18, False, True), (19, False, False)],
)
def test_a_scene_that_misses_a_match_by_at_most_the_margin_is_undecided(
    make_rover: type[Rover], degrees: int, match: bool, undecided: bool
) -> None:
    """17, 18 and 19 degrees are .956, .951 and .946."""
    seen = of_many(make_rover).see(90 + degrees)
    assert (seen.match is not None, seen.undecided) == (match, undecided)
    assert seen.reasons == {Reason.UNKNOWN_SCENE}


def test_a_scene_that_only_misses_a_match_is_never_adopted(make_rover: type[Rover]) -> None:
    rover = of_many(make_rover)
    assert not any(rover.see(107).adopted for _ in range(20))


def test_a_scene_that_the_threshold_of_the_scene_tells_apart_is_not_undecided_however_wide_the_margin(
    make_rover: type[Rover],
) -> None:
    rover = of_many(make_rover, margin=0.5)
    assert rover.see(90 + 31).undecided  # .857; the threshold is .85
    assert not rover.see(90 + 32).undecided


def test_a_scene_that_is_as_it_was_is_not_undecided(make_rover: type[Rover]) -> None:
    rover = make_rover("", memory=memory(GRASS, entry(20, TRAIL_TOO)))
    assert not rover.see(10).undecided


def test_a_fault_is_not_undecided(make_rover: type[Rover]) -> None:
    rover = make_rover("", memory=memory(GRASS, entry(90, TRAIL_TOO)))
    assert not rover.see(90, captured_at=0.0).undecided


def test_a_new_place_tells_which_known_one_it_lacks_least_and_what_it_needs(make_rover: type[Rover]) -> None:
    many = [entry(angle, GRASS, order) for order, angle in ((5, 90), (6, 120), (7, 150), (8, 180))]
    rover = make_rover("", settings=Settings(thresholds=MEASURED), memory=memory(GRASS, *many))
    near = rover.see(62).likeness
    assert near is not None
    assert near.call_id == 5
    assert near.needed == pytest.approx(0.90)
    assert near.similarity == pytest.approx(math.cos(math.radians(28)), abs=1e-3)


def test_a_new_place_that_is_most_nearly_the_one_of_now_needs_what_the_scene_does(
    make_rover: type[Rover],
) -> None:
    now = replace(entry(0, GRASS, 4), embedding=at(0))
    rover = make_rover("", settings=Settings(thresholds=MEASURED), memory=memory(GRASS, now))
    near = rover.see(34).likeness
    assert near is not None
    assert (near.call_id, near.needed) == (4, 0.85)
    assert near.similarity == pytest.approx(math.cos(math.radians(34)), abs=1e-3)
    assert rover.see(0).likeness is None


def test_a_reference_that_no_remembered_scene_is_has_no_call(make_rover: type[Rover]) -> None:
    near = make_rover("", memory=memory(GRASS)).see(90).likeness
    assert near is not None
    assert (near.call_id, near.needed) == (0, 0.85)
