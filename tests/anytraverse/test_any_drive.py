"""What holds on any drive, whatever is seen, answered and forgotten."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.errors import AnyTraverseError
from anytraverse.memory import first_memory, resumed_memory
from anytraverse.preferences import MAX_WORDS, Preferences
from anytraverse.synonyms import refuse_contradictions

if TYPE_CHECKING:
    from tests.anytraverse.conftest import Rover

SCENES = st.sampled_from([0, 10, 60, 70, 120, 180])
WORDS = st.sampled_from(["grass", "lawn", "trail", "path", "drum", *(f"kind {n}" for n in range(18))])
WEIGHTS = st.dictionaries(WORDS, st.sampled_from([-1.0, 0.0, 0.5, 1.0]), max_size=5)
STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("see"), SCENES, st.sampled_from(["", "drum", "kind 3"])),
        st.tuples(st.just("answer"), WEIGHTS, st.lists(WORDS, max_size=1)),
        st.tuples(st.just("set"), WEIGHTS, st.lists(WORDS, max_size=1)),
        st.tuples(st.just("restart"), st.none(), st.none()),
    ),
    max_size=40,
)


@pytest.mark.slow
@given(STEPS)
@settings(max_examples=80)
def test_nothing_from_before_a_word_was_set_without_a_call_or_forgotten_comes_back_or_contradicts_itself(
    make_rover: type[Rover], steps: list[tuple[str, object, object]]
) -> None:
    configured = Preferences.parse("grass: 1")
    rover = make_rover("", memory=first_memory("painted-1", configured, history_limit=3))
    given = {word: {weight} for word, weight in configured.items()}
    call, call_id = rover.call(), 0
    for step in steps:
        match step:
            case ("see", int(scene), str(thing)):
                seen = rover.see(scene, thing=thing)
                assert seen.observation is not None
                assert seen.ok == (not seen.reasons)
                assert seen.words == rover.memory.preferences
                call = seen.observation
            case ("restart", _, _):
                meaning = rover.eyes.meaning
                memory, notices = resumed_memory(rover.memory, "painted-1", configured, meaning)
                assert notices == []
                rover = make_rover("", memory=memory)
            case (kind, dict(weights), list(forget)):
                call_id += 1
                answered = call if kind == "answer" else None
                before = rover.memory
                try:
                    rover.answer(
                        weights, answered, call_id, forget=tuple(forget), missing_ok=answered is None
                    )
                except AnyTraverseError:
                    assert rover.memory is before
                else:
                    for word in forget:
                        given[word] = set()
                    for word, weight in weights.items():
                        given[word] = {weight} | (given.get(word, set()) if answered is not None else set())
        memory = rover.memory
        assert all(weight in given[word] for word, weight in memory.preferences.items())
        assert len(memory.preferences) <= MAX_WORDS
        refuse_contradictions(memory.preferences, rover.eyes.meaning)
        assert memory.reference is not None
        orders = [entry.order for entry in memory.history]
        assert len(set(orders)) == len(orders) <= 3
        stamps = [setting.order for setting in memory.preferences.settings.values()]
        assert max([*orders, *stamps], default=0) <= memory.clock
