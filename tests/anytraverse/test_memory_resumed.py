"""What a rover starts with after a restart, and what a person is told about it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from anytraverse.assessment import Reason
from anytraverse.errors import PreferencesError
from anytraverse.memory import Memory, resumed_memory
from anytraverse.operations import Tap
from anytraverse.perception import Example
from anytraverse.preferences import Preferences, Setting

if TYPE_CHECKING:
    from tests.anytraverse.conftest import Rover

CONFIGURED = "grass: 1; rock: -1"


def resumed(
    rover: Rover, configured: str = CONFIGURED, model_id: str = "painted-1"
) -> tuple[Memory, list[str]]:
    """The rover's memory after a restart."""
    return resumed_memory(rover.memory, model_id, Preferences.parse(configured), rover.eyes.meaning)


@pytest.fixture
def taught(rover: Rover) -> Rover:
    """A rover that learnt a word, was shown a gnome, and had a configured weight changed."""
    call = rover.call(90, thing="gnome")
    tap = Tap(call.frame.id, (0.4, 0.65, 0.6, 0.9), "gnome", -1)
    rover.answer({"trail": 1}, call, 7, taps=(tap,))
    rover.answer({"grass": 0.5})
    return rover


def test_nothing_is_said_and_all_is_kept_when_nothing_was_edited(taught: Rover) -> None:
    memory, notices = resumed(taught)
    assert notices == []
    assert memory.preferences.settings == taught.memory.preferences.settings
    assert memory.examples == taught.memory.examples
    assert memory.reference is taught.memory.reference
    assert [entry.order for entry in memory.history] == [entry.order for entry in taught.memory.history]
    assert memory.clock > taught.memory.clock


def test_an_edited_word_wins_over_the_operators_and_that_is_said(taught: Rover) -> None:
    memory, [notice] = resumed(taught, "grass: 0.8; rock: -1; drum: -1")
    assert memory.preferences == Preferences.parse("grass: 0.8; rock: -1; trail: 1; gnome: -1; drum: -1")
    assert "drum, grass" in notice
    assert memory.configured == Preferences.parse("grass: 0.8; rock: -1; drum: -1")
    assert resumed_memory(memory, "painted-1", memory.configured, taught.eyes.meaning)[1] == []


def test_no_remembered_scene_undoes_an_edited_word(taught: Rover, make_rover: type[Rover]) -> None:
    memory, _ = resumed(taught, "grass: 0.8; rock: -0.5")
    again = make_rover("", memory=memory)
    again.see(0)
    assert again.see(0).adopted is not None
    assert again.memory.preferences == Preferences.parse("grass: 0.8; rock: -0.5; trail: 1; gnome: -1")


def test_without_an_edit_a_remembered_scene_gives_its_words_back_after_a_restart(
    rover: Rover, make_rover: type[Rover]
) -> None:
    rover.answer({"grass": -1}, rover.call(90), 7)
    again = make_rover("", memory=resumed(rover)[0])
    again.see(0)
    assert again.see(0).words["grass"] == 1


def test_an_edited_number_of_scenes_counts_from_the_next_start(taught: Rover) -> None:
    words, meaning = taught.memory.configured, taught.eyes.meaning
    memory, _ = resumed_memory(taught.memory, "painted-1", words, meaning, history_limit=1)
    assert memory.history.limit == 1
    assert [entry.call_id for entry in memory.history] == [7]
    memory, _ = resumed_memory(memory, "painted-2", words, meaning, history_limit=5)
    assert memory.history.limit == 5


def test_a_removed_word_is_out_of_use_and_no_remembered_scene_brings_it_back(
    taught: Rover, make_rover: type[Rover]
) -> None:
    memory, [notice] = resumed(taught, "grass: 1")
    assert "rock" in notice
    assert "rock" not in memory.preferences
    again = make_rover("", memory=memory)
    again.see(0, thing="rock")
    seen = again.see(0, thing="rock")
    assert seen.adopted is not None
    assert seen.reasons == {Reason.UNKNOWN_OBJECT}


def test_a_word_that_the_operator_forgot_stays_forgotten(taught: Rover, make_rover: type[Rover]) -> None:
    taught.answer(forget=("rock",))
    memory, notices = resumed(taught)
    assert notices == []
    assert "rock" not in memory.preferences
    again = make_rover("", memory=memory)
    again.see(0)
    assert "rock" not in again.see(0).words


def test_of_another_model_only_the_words_are_kept_and_that_is_said(taught: Rover) -> None:
    memory, notices = resumed(taught, model_id="painted-2")
    assert memory.model_id == "painted-2"
    assert memory.preferences == Preferences.parse("grass: 0.5; rock: -1; trail: 1")
    assert memory.reference is None
    assert len(memory.history) == 0
    assert memory.history.limit == taught.memory.history.limit
    assert not memory.examples
    assert "painted-1 does not fit painted-2: 2 scenes and 1 tapped words" in notices[0]
    assert notices[1] == "words that painted-2 cannot ground are out of use: gnome"


def test_examples_of_another_model_are_left_out_wherever_they_stand(taught: Rover) -> None:
    foreign = {"gnome": (Example("other-2", np.zeros(1, dtype=np.float32)),)}
    saved = replace(
        taught.memory,
        examples=foreign,
        history=taught.memory.history.added(
            replace(taught.memory.history[-1], order=50, matched=50, examples=foreign)
        ),
    )
    memory, notices = resumed_memory(saved, "painted-1", saved.configured, taught.eyes.meaning)
    assert not memory.examples
    assert not memory.history[-1].examples
    assert memory.history[-2].examples
    assert notices == ["words that painted-1 cannot ground are out of use: gnome"]


def test_a_word_that_cannot_be_grounded_goes_and_that_is_said(rover: Rover) -> None:
    memory, notices = resumed(rover, CONFIGURED + "; elf: 1")
    assert "elf" not in memory.preferences
    assert notices[-1] == "words that painted-1 cannot ground are out of use: elf"


def test_an_edited_word_puts_its_opposite_synonym_out_of_use(taught: Rover, make_rover: type[Rover]) -> None:
    memory, notices = resumed(taught, CONFIGURED + "; path: -1")
    assert "trail" not in memory.preferences
    assert memory.preferences["path"] == -1
    assert notices[-1] == "words that later ones contradict are out of use: trail"
    make_rover("", memory=memory)


def test_configured_words_that_contradict_each_other_are_refused_at_the_start(
    rover: Rover, make_rover: type[Rover]
) -> None:
    memory, _ = resumed(rover, CONFIGURED + "; path: -1; trail: 1")
    with pytest.raises(PreferencesError, match="contradicts"):
        make_rover("", memory=memory)


def test_words_that_contradict_each_other_under_a_new_model_go_by_age(
    rover: Rover, make_rover: type[Rover]
) -> None:
    words = Preferences(
        {"path": Setting(1, 3), "trail": Setting(-1, 4), "drum": Setting(1, 5), "barrel": Setting(-1, 5)}
    )
    saved = Memory("old-1", words, Preferences(), clock=9)
    memory, _ = resumed_memory(saved, "painted-1", Preferences(), rover.eyes.meaning)
    assert memory.preferences == Preferences.parse("trail: -1")
    make_rover("", memory=memory)


def test_edited_words_beyond_sixteen_put_the_least_recently_set_out_of_use_and_that_is_said(
    rover: Rover,
) -> None:
    rover.answer({f"kind {n}": 1.0 for n in range(14)})
    memory, notices = resumed(rover, CONFIGURED + "; trail: 1")
    assert "trail" in memory.preferences
    assert len(memory.preferences) == 16
    assert notices[-1] == "more than 16 words, the least recently set are out of use: grass"
