"""Which words a memory knows, and whose sign a change turns."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hypothesis import given
from hypothesis import strategies as st

from anytraverse.memory import Memory
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
    assert rover.memory.given["trail"] == 1.0, "what is in force comes before what a place remembers"


def test_a_configured_word_that_was_forgotten_is_known(rover: Rover) -> None:
    rover.answer({}, forget=("rock",))
    assert rover.memory.given["rock"] == -1.0


@given(WORDS, WORDS, WORDS)
def test_no_change_turns_a_sign_without_being_named(
    configured: dict[str, float], used: dict[str, float], after: dict[str, float]
) -> None:
    before = Memory("m", Preferences.of(used, 1), Preferences.of(configured))
    then = before.using(before.preferences.merged(Preferences.of(after, 2)), {})
    known = {**configured, **used}
    for word, weight in then.preferences.items():
        turns = word in known and (weight > 0) != (known[word] > 0)
        assert (word in before.turned(then)) == turns
    assert len(then.preferences) <= MAX_WORDS
