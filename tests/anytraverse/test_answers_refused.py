"""An answer is applied as a whole or not at all."""

from __future__ import annotations

from dataclasses import astuple
from typing import TYPE_CHECKING

import numpy as np
import pytest
from numpy.typing import NDArray

from anytraverse.errors import AnyTraverseError, ExampleError, PreferencesError, UnknownWordError
from anytraverse.operations import Tap
from anytraverse.perception import Example

if TYPE_CHECKING:
    from anytraverse.regions import Box
    from tests.anytraverse.conftest import Rover


@pytest.mark.parametrize(
    ("weights", "error", "reason"),
    [
        ({"drum": -1, "gnome": -1}, UnknownWordError, "tap the thing"),
        ({"drum": -1.2}, PreferencesError, "-1 .* to 1"),
        ({"drum": float("nan")}, PreferencesError, "-1 .* to 1"),
        ({"drum": -1, "Drum": 1}, PreferencesError, "stands twice"),
        ({"": 1}, PreferencesError, "empty"),
        ({"drum": -1, "barrel": 1}, PreferencesError, "contradicts"),
        ({f"kind {n}": 1 for n in range(17)}, PreferencesError, "17 words"),
        ({"drum": -1, "a:b": 1}, PreferencesError, "separate words"),
    ],
)
def test_a_refused_answer_changes_nothing(
    rover: Rover, weights: dict[str, float], error: type[AnyTraverseError], reason: str
) -> None:
    call = rover.call(90, thing="drum")
    memory = rover.memory
    with pytest.raises(error, match=reason):
        rover.answer(weights, call, 7, go=True, forget=("grass",), new_episode=True)
    assert rover.memory is memory


@pytest.mark.parametrize("forget", [("mud",), ("rock", "Mud")])
def test_to_forget_a_word_that_is_not_in_use_is_refused_with_those_that_are(
    rover: Rover, forget: tuple[str, ...]
) -> None:
    call, memory = rover.call(90, thing="drum"), rover.memory
    with pytest.raises(PreferencesError, match=r'^"mud" is not in use\. In use: grass, rock$'):
        rover.answer({"drum": -1}, call, 7, go=True, forget=forget)
    assert rover.memory is memory
    rover.answer(forget=("grass", "rock"))
    with pytest.raises(PreferencesError, match=r'^"grass" is not in use, nor is any word$'):
        rover.answer(forget=("grass",))


@pytest.mark.parametrize("missing", [0, 9])
def test_to_forget_a_call_that_taught_nothing_is_refused_with_those_that_did(
    rover: Rover, missing: int
) -> None:
    with pytest.raises(PreferencesError, match=f"^nothing was learnt from call {missing}, nor from any$"):
        rover.answer(forget_calls=(missing,))
    rover.answer({"trail": 1}, rover.call(90), 7)
    rover.answer({"drum": 1}, rover.call(180), 8)
    memory = rover.memory
    with pytest.raises(PreferencesError, match=f"^nothing was learnt from call {missing}, only from 8, 7$"):
        rover.answer({"rock": 1}, forget_calls=(7, missing))
    assert rover.memory is memory
    rover.answer(forget_calls=(7, missing), missing_ok=True)
    assert {7, 8} & {entry.call_id for entry in rover.memory.history} == {8}


def test_opposite_words_of_one_meaning_are_refused_with_the_reason(rover: Rover) -> None:
    rover.answer({"trail": 1})
    with pytest.raises(PreferencesError) as refusal:
        rover.answer({"path": -1})
    assert str(refusal.value) == (
        '"path: -1" contradicts "trail: 1", which means the same: change or forget "trail"'
    )
    rover.answer({"path": 0.5})
    with pytest.raises(PreferencesError, match=r'"trail: -1" contradicts "path: 0\.5"'):
        rover.answer({"trail": -1})
    rover.answer({"path": -1}, forget=("trail",))
    assert rover.memory.preferences["path"] == -1


def test_a_weight_of_zero_contradicts_nothing(rover: Rover) -> None:
    rover.answer({"trail": 0})
    rover.answer({"path": -1})
    with pytest.raises(PreferencesError, match="contradicts"):
        rover.answer({"trail": 1})


def test_a_tap_on_another_frame_is_refused(rover: Rover, ahead: Box) -> None:
    call = rover.call(thing="gnome")
    rover.see(thing="gnome")
    memory = rover.memory
    tap = Tap(call.frame.id + 1, astuple(ahead), "gnome", -1)
    with pytest.raises(PreferencesError, match="tap the call's picture again"):
        rover.answer({}, call, 7, taps=(tap,))
    assert rover.memory is memory


def test_a_tap_without_a_call_is_refused(rover: Rover, ahead: Box) -> None:
    seen = rover.see(thing="gnome")
    with pytest.raises(PreferencesError, match="not the call's"):
        rover.answer(taps=(Tap(seen.frame.id, astuple(ahead), "gnome", -1),))


def test_an_example_made_by_another_model_is_refused(rover: Rover, ahead: Box) -> None:
    call = rover.call(thing="gnome")
    foreign = Example("other-2", np.zeros(1, dtype=np.float32))
    rover.eyes.spoil_example = lambda _: foreign
    memory = rover.memory
    with pytest.raises(ExampleError, match="other-2"):
        rover.answer({}, call, 7, taps=(Tap(call.frame.id, astuple(ahead), "gnome", -1),))
    assert rover.memory is memory


def test_a_perceiver_that_fails_on_the_new_words_leaves_the_old_ones(rover: Rover) -> None:
    call = rover.call(90)
    memory = rover.memory

    def fail(_: object) -> NDArray[np.float32]:
        raise MemoryError("no room for another word")

    rover.eyes.spoil_attention = fail
    with pytest.raises(MemoryError):
        rover.answer({"trail": 1}, call, 7)
    assert rover.memory is memory
