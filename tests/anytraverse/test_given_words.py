"""Which words a memory knows, and whose sign a change turns."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hypothesis import given
from hypothesis import strategies as st

from anytraverse.memory import MOST_GIVEN, first_memory
from anytraverse.preferences import MAX_WORDS, Preferences

if TYPE_CHECKING:
    from tests.anytraverse.conftest import Rover

WORDS = st.dictionaries(
    st.sampled_from(["grass", "water", "mud", "bush"]), st.sampled_from([-1.0, 0.0, 0.5, 1.0])
)


def test_a_word_of_a_remembered_place_is_known_when_it_is_out_of_use(rover: Rover) -> None:
    call = rover.call(90, thing="gnome")
    rover.answer({"trail": -0.5}, call, 7)
    rover.answer({}, forget=("trail",))
    assert "trail" not in rover.memory.preferences
    assert rover.memory.given["trail"] == -0.5
    before = rover.memory
    rover.answer({"trail": 1})
    assert before.turned(rover.memory) == {"trail": (-0.5, 1.0)}
    assert "trail" not in rover.memory.given, "a word in force is not listed"
    rover.answer({}, forget=("trail",))
    assert rover.memory.given["trail"] == 1.0, "the weight that it had last, not that of a place"


def test_a_configured_word_that_was_forgotten_is_known(rover: Rover) -> None:
    rover.answer({}, forget=("rock",))
    assert rover.memory.given["rock"] == -1.0


def test_a_word_that_was_set_without_a_call_is_known_when_it_is_forgotten(rover: Rover) -> None:
    rover.answer({"drum": -0.5})
    rover.answer({}, forget=("drum",))
    assert rover.memory.given["drum"] == -0.5
    before = rover.memory
    rover.answer({"drum": 1})
    assert before.turned(rover.memory) == {"drum": (-0.5, 1.0)}


def test_the_words_that_are_longest_out_of_use_are_forgotten_first() -> None:
    memory = first_memory("m", Preferences.of({"grass": 1.0}))
    for number in range(MOST_GIVEN + 2):
        memory = memory.using(Preferences.of({"grass": 1.0, f"kind {number}": -1.0}, number + 1), {})
    assert list(memory.given)[:2] == [f"kind {MOST_GIVEN}", f"kind {MOST_GIVEN - 1}"]
    memory = memory.using(Preferences.of({"kind 1": 1.0}, 999), {})
    assert len(memory.given) == MOST_GIVEN
    assert "kind 1" not in memory.given
    assert "kind 0" not in memory.given
    assert memory.given["grass"] == 1.0, "however long ago it was set"


@given(WORDS, WORDS, WORDS)
def test_no_change_turns_a_sign_without_being_named(
    configured: dict[str, float], used: dict[str, float], after: dict[str, float]
) -> None:
    before = first_memory("m", Preferences.of(configured)).using(Preferences.of(used, 1), {})
    then = before.using(before.preferences.merged(Preferences.of(after, 2)), {})
    known = {**configured, **used}
    for word, weight in then.preferences.items():
        turns = word in known and (weight > 0) != (known[word] > 0)
        assert (word in before.turned(then)) == turns
    assert len(then.preferences) <= MAX_WORDS
