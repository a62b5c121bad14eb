"""Things that are shown rather than named."""

from __future__ import annotations

from dataclasses import astuple
from typing import TYPE_CHECKING

import pytest

from anytraverse.answers import MAX_EXAMPLES
from anytraverse.assessment import Observation, Reason
from anytraverse.errors import ExampleError, UnknownWordError
from anytraverse.operations import Tap
from anytraverse.preferences import Preferences
from anytraverse.regions import Box

if TYPE_CHECKING:
    from tests.anytraverse.conftest import Rover

AHEAD = Box(0.4, 0.65, 0.6, 0.9)


def tap(call: Observation, word: str = "gnome", weight: float = -1) -> tuple[Tap, ...]:
    """A tap on the thing ahead."""
    return (Tap(call.frame.id, astuple(AHEAD), word, weight),)


@pytest.fixture
def taught(rover: Rover) -> Rover:
    """A rover that was shown a gnome."""
    call = rover.call(thing="gnome")
    rover.answer({}, call, 7, taps=tap(call))
    return rover


def test_a_tapped_thing_is_known_under_a_word_that_the_perceiver_cannot_ground(taught: Rover) -> None:
    assert taught.memory.preferences["gnome"] == -1
    assert taught.see(thing="gnome").reasons == {Reason.BLOCKED}


def test_the_tapped_word_is_remembered_with_its_examples(taught: Rover) -> None:
    entry = taught.memory.history[-1]
    assert entry.examples["gnome"] is taught.memory.examples["gnome"]


def test_the_weight_of_a_tapped_word_can_be_set_alone(taught: Rover) -> None:
    taught.answer({"gnome": 1})
    assert taught.see(thing="gnome").ok


def test_what_was_tapped_or_named_as_not_drivable_counts_as_if_it_had_no_name(taught: Rover) -> None:
    taught.answer({"drum": -1})
    for thing, strange in (("gnome", 1.0), ("drum", 1.0), ("", 0.0)):
        roi = taught.see(thing=thing).roi
        assert roi is not None
        assert roi.named_tile is not None
        assert roi.named_tile.tile.uncertainty == pytest.approx(strange)
        assert roi.named_tile.explained > 0.9 or not thing
    taught.answer({"gnome": 1, "drum": 1}, forget=("rock",))
    roi = taught.see(thing="gnome").roi
    assert roi is not None
    assert roi.named_tile is None


def test_another_tap_adds_an_example_and_the_oldest_go(taught: Rover) -> None:
    first = taught.memory.examples["gnome"][0]
    for _ in range(MAX_EXAMPLES):
        call = taught.call(thing="gnome")
        taught.answer({}, call, 7, taps=tap(call))
    assert len(taught.memory.examples["gnome"]) == MAX_EXAMPLES
    assert first not in taught.memory.examples["gnome"]


def test_a_tap_that_makes_the_examples_too_large_to_be_remembered_is_refused(
    taught: Rover, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "anytraverse.answers.LARGEST_EXAMPLES", taught.memory.examples["gnome"][0].vector.nbytes
    )
    before, call = taught.memory, taught.call(thing="gnome")
    with pytest.raises(ExampleError, match="forget a tapped word first"):
        taught.answer({}, call, 7, taps=tap(call))
    assert taught.memory == before


def test_a_tap_teaches_a_known_word_what_else_it_means(rover: Rover) -> None:
    call = rover.call(thing="gnome")
    rover.answer({}, call, 7, taps=tap(call, "Rock"))
    assert rover.see(thing="gnome").reasons == {Reason.BLOCKED}
    assert rover.see(thing="rock").reasons == {Reason.BLOCKED}


def test_a_forgotten_word_loses_its_examples_and_must_be_shown_again(taught: Rover) -> None:
    taught.answer(forget=("gnome",))
    assert not taught.memory.examples
    with pytest.raises(UnknownWordError):
        taught.answer({"gnome": -1})


def test_forgetting_and_showing_in_one_answer_begins_anew(taught: Rover) -> None:
    old = taught.memory.examples["gnome"]
    call = taught.call(thing="drum")
    taught.answer({}, call, 8, forget=("gnome",), taps=tap(call))
    assert len(taught.memory.examples["gnome"]) == 1
    assert taught.memory.examples["gnome"] != old
    assert Reason.UNKNOWN_OBJECT in taught.see(thing="gnome").reasons


def test_forgetting_and_naming_in_one_answer_does_not_keep_the_examples(taught: Rover) -> None:
    with pytest.raises(UnknownWordError):
        taught.answer({"gnome": 1}, forget=("gnome",))
    assert "gnome" in taught.memory.examples


def test_a_word_forgotten_and_set_again_has_no_examples_even_in_its_old_scene(rover: Rover) -> None:
    call = rover.call(90, thing="gnome")
    rover.answer({}, call, 7, taps=tap(call, "rock"))
    rover.answer(forget=("rock",))
    rover.answer({"rock": -1})
    rover.see(0)
    rover.see(0)
    rover.see(90, thing="gnome")
    seen = rover.see(90, thing="gnome")
    assert seen.adopted is not None
    assert not rover.memory.examples
    assert seen.reasons == {Reason.UNKNOWN_OBJECT}


def test_a_word_that_goes_for_want_of_room_takes_its_examples_along(taught: Rover) -> None:
    outcome = taught.answer({f"kind {n}": 1.0 for n in range(16)})
    assert "gnome" in outcome.dropped
    assert not taught.memory.examples


def test_the_later_of_a_weight_and_a_tap_is_the_tap(rover: Rover) -> None:
    call = rover.call(thing="gnome")
    rover.answer({"gnome": 1, "trail": 1}, call, 7, taps=tap(call, weight=-0.5))
    assert rover.memory.preferences == Preferences.parse("grass: 1; rock: -1; gnome: -0.5; trail: 1")
