"""What an operator's answer changes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from anytraverse.assessment import Reason
from anytraverse.history import Place
from anytraverse.operations import SetWord
from anytraverse.preferences import Preferences

if TYPE_CHECKING:
    from tests.anytraverse.conftest import Rover


def test_an_answer_is_partial(rover: Rover) -> None:
    rover.answer({"drum": -1}, rover.call(thing="drum"), 7)
    assert rover.memory.preferences == Preferences.parse("grass: 1; rock: -1; drum: -1")


def test_the_calls_frame_and_the_newest_are_judged_again_without_another_encoding(rover: Rover) -> None:
    call = rover.call(thing="drum")
    newest = rover.call()
    encoded, embedded = rover.eyes.encoded, rover.eyes.embedded
    outcome = rover.answer({"drum": -1}, call, 7)
    assert (rover.eyes.encoded, rover.eyes.embedded) == (encoded, embedded)
    assert outcome.call is not None
    assert outcome.call.observation is call
    assert outcome.newest is not None
    assert outcome.newest.observation is newest
    assert outcome.newest.ok
    assert outcome.remembered


def test_a_drum_named_not_drivable_is_blocked_and_not_ok(rover: Rover) -> None:
    outcome = rover.answer({"drum": -1}, rover.call(thing="drum"), 7)
    assert outcome.call is not None
    assert outcome.call.reasons == {Reason.BLOCKED}


def test_a_word_that_does_not_cover_the_thing_leaves_it_unknown_with_the_figure(rover: Rover) -> None:
    outcome = rover.answer({"trail": 1}, rover.call(thing="drum"), 7)
    assert outcome.call is not None
    finding = outcome.call.finding(Reason.UNKNOWN_OBJECT)
    assert finding is not None
    assert finding.value == pytest.approx(120 / 280)
    assert finding.threshold == 0.3


def test_an_old_call_frame_is_not_a_fault_of_its_words(rover: Rover) -> None:
    call = rover.call(thing="drum")
    rover.now += 500
    outcome = rover.answer({"drum": 1}, call, 7)
    assert outcome.call is not None
    assert outcome.call.ok
    assert outcome.newest is not None
    assert outcome.newest.reasons == {Reason.FAULT}


def test_the_scene_is_remembered_with_all_words_after_the_answer(rover: Rover) -> None:
    call = rover.call(90)
    rover.answer({"trail": 1}, call, 7)
    entry = rover.memory.history[-1]
    assert entry.call_id == 7
    assert entry.embedding is call.embedding
    assert entry.preferences == Preferences.parse("grass: 1; rock: -1; trail: 1")
    assert entry.order > entry.preferences.order("trail") > entry.preferences.order("grass") == 0


def test_where_and_when_is_remembered(rover: Rover) -> None:
    place = Place(heading=12.0)
    rover.engine.answer((SetWord("trail", 1),), rover.now, call=rover.call(90), call_id=7, place=place)
    assert rover.memory.history[-1].place == place


def test_a_second_answer_to_a_call_replaces_what_the_first_taught(rover: Rover) -> None:
    call = rover.call(90)
    rover.answer({"trail": 1}, call, 7)
    rover.answer({"drum": -1}, call, 7)
    assert [entry.call_id for entry in rover.memory.history] == [0, 7]
    assert "drum" in rover.memory.history[-1].preferences


def test_the_reference_moves_to_the_calls_scene_where_the_rover_still_is(rover: Rover) -> None:
    call = rover.call(90)
    rover.see(95)
    rover.answer({"trail": 1}, call, 7)
    assert rover.memory.reference is call.embedding
    assert rover.see(90).ok


def test_the_reference_stays_when_the_rover_has_left_the_calls_scene(rover: Rover) -> None:
    reference = rover.memory.reference
    call = rover.call(90)
    rover.see(0)
    outcome = rover.answer({"trail": 1}, call, 7)
    assert outcome.remembered
    assert rover.memory.reference is reference
    assert outcome.newest is not None
    assert outcome.newest.ok


def test_the_reference_stays_when_nothing_is_seen_live(rover: Rover, make_rover: type[Rover]) -> None:
    again = make_rover("", memory=rover.memory)
    call = again.engine.observe(again.frame(90))
    outcome = again.answer({"trail": 1}, call, 7)
    assert outcome.newest is None
    assert again.memory.reference is rover.memory.reference


def test_stay_and_look_again_teach_nothing(rover: Rover) -> None:
    call = rover.call(90, thing="drum")
    memory = rover.memory
    outcome = rover.answer({}, call, 7)
    assert rover.memory is memory
    assert not outcome.remembered
    assert outcome.call is not None
    assert outcome.call.reasons == {Reason.UNKNOWN_SCENE, Reason.UNKNOWN_OBJECT}


def test_go_without_changes_remembers_the_scene_and_moves_the_reference(rover: Rover) -> None:
    call = rover.call(90)
    words = rover.memory.preferences
    assert rover.answer({}, call, 7, go=True).remembered
    assert rover.memory.reference is call.embedding
    assert rover.memory.preferences is words
    assert rover.memory.history[-1].call_id == 7


def test_a_scene_without_an_embedding_is_not_remembered(rover: Rover) -> None:
    rover.eyes.spoil_embedding = lambda vector: vector * float("nan")
    outcome = rover.answer({"trail": 1}, rover.call(90), 7)
    assert not outcome.remembered
    assert len(rover.memory.history) == 1
    assert "trail" in rover.memory.preferences


def test_words_without_a_call_change_the_words_at_once_and_teach_no_scene(rover: Rover) -> None:
    history = rover.memory.history
    clock = rover.memory.clock
    outcome = rover.answer({"grass": 0.5, "trail": 1})
    assert outcome.call is None
    assert not outcome.remembered
    assert outcome.newest is not None
    assert outcome.newest.words == Preferences.parse("grass: 0.5; rock: -1; trail: 1")
    assert rover.memory.preferences.order("grass") == clock + 1
    assert rover.memory.preferences.order("rock") == 0
    assert rover.memory.history is history


def test_a_change_of_weights_that_turns_no_sign_asks_for_nothing(rover: Rover) -> None:
    call = rover.call(thing="drum")
    rover.answer({"drum": -1}, call, 7)
    attended = rover.eyes.attended
    rover.answer({"grass": 0.4, "drum": -0.8}, call, 7)
    assert rover.eyes.attended == attended
    outcome = rover.answer({"drum": 0.8}, call, 7)
    assert rover.eyes.attended == attended, "its words are independent of each other"
    assert outcome.call is not None
    assert outcome.call.words == Preferences.parse("grass: 0.4; rock: -1; drum: 0.8")
    assert outcome.call.ok


def test_where_words_share_what_they_explain_a_turned_sign_asks_for_all_again_and_for_the_drivable_ones(
    rover: Rover, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rover.eyes, "independent", False)
    call = rover.call(thing="drum")
    rover.answer({"drum": -1}, call, 7)
    attended = rover.eyes.attended
    rover.answer({"drum": 0.8}, call, 7)
    assert rover.eyes.attended == attended + 2, "of the one frame there is"


def test_a_new_word_runs_the_network_once_for_each_frame(rover: Rover) -> None:
    call = rover.call(thing="drum")
    rover.see()
    attended = rover.eyes.attended
    rover.answer({"drum": -1}, call, 7)
    assert rover.eyes.attended == attended + 2


def test_beyond_sixteen_words_the_least_recently_set_goes_and_that_is_said(rover: Rover) -> None:
    rover.answer({f"kind {n}": 1.0 for n in range(14)})
    rover.answer({"grass": 1})
    outcome = rover.answer({"trail": 1})
    assert outcome.dropped == ("rock",)
    assert len(rover.memory.preferences) == 16
    assert rover.answer({f"kind {n}": 1.0 for n in range(4, 20)}).dropped[-2:] == ("kind 3", "trail")


@pytest.mark.parametrize(("forget", "missing_ok"), [(("Rock",), False), (("Rock", "mud"), True)])
def test_a_forgotten_word_is_out_of_use(rover: Rover, forget: tuple[str, ...], missing_ok: bool) -> None:
    outcome = rover.answer(forget=forget, missing_ok=missing_ok)
    assert outcome.dropped == ()
    assert rover.memory.preferences == Preferences.parse("grass: 1")


def test_what_a_call_taught_can_be_forgotten(rover: Rover) -> None:
    rover.answer({"trail": 1}, rover.call(90), 7)
    rover.answer({"drum": 1}, rover.call(180), 8)
    rover.answer(forget_calls=(7,))
    assert [entry.call_id for entry in rover.memory.history] == [0, 8]
    assert "trail" in rover.memory.preferences


def test_a_new_episode_forgets_all_scenes_and_keeps_the_words(rover: Rover) -> None:
    rover.answer({"trail": 1}, rover.call(90), 7)
    rover.answer(new_episode=True)
    assert len(rover.memory.history) == 0
    assert rover.memory.preferences == Preferences.parse("grass: 1; rock: -1; trail: 1")


def test_only_words_in_use_or_in_a_remembered_scene_are_listed_as_settled(rover: Rover) -> None:
    for n in range(20):
        rover.answer({f"kind {n}": 1.0})
        rover.answer(forget=(f"kind {n}",))
    rover.answer(forget=("rock",))
    assert rover.memory.settled.keys() == {"rock"}
    rover.answer({"trail": 1})
    assert rover.memory.settled.keys() == {"rock", "trail"}
    rover.answer(new_episode=True)
    assert rover.memory.settled.keys() == {"trail"}


def test_words_answered_to_a_call_belong_to_its_scene_and_settle_nothing(rover: Rover) -> None:
    rover.answer({"grass": 0.5, "trail": 1}, rover.call(90), 7)
    assert not rover.memory.settled
    rover.answer({"grass": 0.2})
    settled = rover.memory.settled
    rover.answer({"grass": 0.7}, rover.call(180), 8)
    assert rover.memory.settled == settled
