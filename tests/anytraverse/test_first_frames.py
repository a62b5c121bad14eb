"""Which frame becomes the reference."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from numpy.typing import NDArray

from anytraverse.assessment import Reason
from anytraverse.history import Place
from anytraverse.memory import Memory, first_memory
from anytraverse.preferences import Preferences

if TYPE_CHECKING:
    from tests.anytraverse.conftest import Rover


def test_the_first_frame_becomes_the_reference_and_is_remembered_with_the_configured_words(
    make_rover: type[Rover],
) -> None:
    rover = make_rover("grass: 1; rock: -1")
    place = Place(48.1, 11.5, 90.0, 1.7e9)
    seen = rover.engine.step(rover.frame(30), rover.now, place)
    assert seen.ok
    assert seen.similarity == pytest.approx(1)
    [entry] = rover.memory.history
    assert entry.embedding is rover.memory.reference
    assert entry.preferences == Preferences.parse("grass: 1; rock: -1")
    assert (entry.call_id, entry.place) == (0, place)


def test_the_second_frame_does_not(rover: Rover) -> None:
    memory = rover.memory
    assert rover.see(90).reasons == {Reason.UNKNOWN_SCENE}
    assert rover.memory is memory


def test_a_black_frame_is_a_fault_and_never_the_reference(make_rover: type[Rover]) -> None:
    rover = make_rover("grass: 1")
    black = np.zeros((40, 60, 3), dtype=np.uint8)
    assert rover.see(image=black).reasons >= {Reason.FAULT}
    assert rover.memory.reference is None
    assert rover.see(50).ok
    assert rover.see(50).similarity == pytest.approx(1)


@pytest.mark.parametrize("broken", [math.nan, math.inf, 0.0])
def test_a_frame_without_an_embedding_is_a_fault_and_never_the_reference(
    make_rover: type[Rover], broken: float
) -> None:
    rover = make_rover("grass: 1")
    rover.eyes.spoil_embedding = lambda vector: np.full_like(vector, broken)
    assert rover.see().reasons == {Reason.FAULT}
    assert len(rover.memory.history) == 0
    rover.eyes.spoil_embedding = lambda vector: vector
    assert rover.see().ok


def test_a_frame_without_finite_attention_is_never_the_reference(make_rover: type[Rover]) -> None:
    rover = make_rover("grass: 1")
    rover.eyes.spoil_attention = lambda maps: maps * np.float32(np.nan)
    assert Reason.FAULT in rover.see().reasons
    assert rover.memory.reference is None


def test_after_a_restart_the_first_frame_is_judged_like_any_other(
    rover: Rover, make_rover: type[Rover]
) -> None:
    again = make_rover("", memory=rover.memory)
    assert again.see(90).reasons == {Reason.UNKNOWN_SCENE}
    assert again.memory is rover.memory


def test_after_a_new_episode_the_next_frame_becomes_the_reference(rover: Rover) -> None:
    rover.answer(new_episode=True)
    assert rover.memory.reference is None
    assert len(rover.memory.history) == 0
    assert rover.see(90).ok
    assert len(rover.memory.history) == 1


def test_one_picture_judged_alone_has_no_similarity(make_rover: type[Rover]) -> None:
    rover = make_rover("grass: 1")
    seen = rover.engine.judge(rover.engine.observe(rover.frame()), rover.now)
    assert seen.ok
    assert seen.similarity is None
    assert rover.memory.reference is None


def test_the_reference_does_not_change_when_the_perceiver_uses_its_buffer_again(
    make_rover: type[Rover],
) -> None:
    rover = make_rover("grass: 1")
    buffer = np.zeros(2, dtype=np.float32)

    def reused(vector: NDArray[np.float32]) -> NDArray[np.float32]:
        buffer[:] = vector
        return buffer

    rover.eyes.spoil_embedding = reused
    rover.see(0)
    assert rover.see(90).reasons == {Reason.UNKNOWN_SCENE}


def test_a_first_memory_holds_the_configured_words_and_nothing_else() -> None:
    words = Preferences.parse("grass: 1")
    memory = first_memory("m", words, history_limit=3)
    assert isinstance(memory, Memory)
    assert memory.preferences == memory.configured == words
    assert memory.reference is None
    assert memory.history.limit == 3
