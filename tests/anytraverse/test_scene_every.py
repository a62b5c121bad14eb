"""The scene's embedding made on every N-th frame: it saves work where nothing is in doubt, and only there."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from anytraverse.assessment import Assessment, Reason
from anytraverse.errors import PerceiverError, SettingsError
from anytraverse.history import Embedding
from anytraverse.judging import Settings, Thresholds
from anytraverse.operations import SetWord
from anytraverse.perception import DefaultThresholds

if TYPE_CHECKING:
    from tests.anytraverse.conftest import Rover

N = 4


@pytest.fixture
def rover(make_rover: type[Rover]) -> Rover:
    """On grass in the scene at 0 degrees, beyond doubt; the third frame was embedded, and was the last."""
    rover = make_rover("grass: 1; rock: -1", Settings(scene_every=N))
    for _ in range(3):
        assert rover.see().ok
    assert rover.eyes.embedded == 3
    return rover


def embedded(rover: Rover, scenes: list[int]) -> list[bool]:
    """For each frame whether its scene was embedded."""
    before = rover.eyes.embedded
    counts = []
    for scene in scenes:
        rover.see(scene)
        counts.append(rover.eyes.embedded)
    return [bool(after - before) for before, after in zip([before, *counts], counts, strict=False)]


def angle(embedding: Embedding | None) -> float:
    """The scene that an embedding shows, in degrees."""
    assert embedding is not None
    return math.degrees(math.atan2(embedding[1], embedding[0]))


def test_in_a_known_scene_every_fourth_frame_is_embedded(rover: Rover) -> None:
    assert embedded(rover, [0] * 9) == [False, False, False, True] * 2 + [False]


def test_by_default_every_frame_is(make_rover: type[Rover]) -> None:
    assert embedded(make_rover("grass: 1"), [0] * 6) == [True] * 6


def test_a_judged_frame_tells_how_much_older_its_scene_is(rover: Rover) -> None:
    ages = [rover.see().scene_age for _ in range(4)]
    assert ages == pytest.approx([0.2, 0.4, 0.6, 0.0])


@pytest.mark.parametrize("every", [0, 101])
def test_another_number_is_refused(every: int) -> None:
    with pytest.raises(SettingsError, match="scene_every"):
        Settings(scene_every=every)


def test_an_embedding_older_than_the_freshness_limit_is_not_used(make_rover: type[Rover]) -> None:
    rover = make_rover("grass: 1", Settings(scene_every=100, freshness=0.5))
    seen = [rover.see() for _ in range(12)]
    assert [one.scene_age > 0 for one in seen] == [False] * 3 + [True, True, False] * 3
    assert all(one.age + one.scene_age <= 0.5 + 1e-9 for one in seen)


def test_a_new_place_is_seen_when_the_embedding_is_due_and_each_vote_for_it_is_an_embedding(
    rover: Rover,
) -> None:
    seen = [rover.see(90) for _ in range(6)]
    unknown = [Reason.UNKNOWN_SCENE in one.reasons for one in seen]
    assert unknown == [False, False, False, True, True, True]
    assert all(one.scene_age == 0.0 for one, bad in zip(seen, unknown, strict=True) if bad)


def test_a_doubt_is_ended_by_as_many_embeddings_as_the_window_has_frames(rover: Rover) -> None:
    for _ in range(6):
        rover.see(90)
    assert embedded(rover, [0] * 5) == [True, True, True, False, False]


@pytest.mark.parametrize("degrees", [31, 32])
def test_a_scene_on_the_threshold_is_looked_at_on_every_frame(rover: Rover, degrees: int) -> None:
    embedded(rover, [degrees] * N)
    assert embedded(rover, [degrees] * 6) == [True] * 6


def test_a_remembered_scene_is_adopted_by_two_embeddings_not_by_one_counted_twice(rover: Rover) -> None:
    for _ in range(N):
        call = rover.see(90, "trail").observation
    rover.answer({"trail": 1}, call, 1)
    embedded(rover, [0] * 2 * N)
    shown = [rover.see(90, "trail") for _ in range(N + 2)]
    adopted = next(index for index, one in enumerate(shown) if one.adopted is not None)
    matched = [one for one in shown[: adopted + 1] if one.match is not None]
    assert len(matched) == 2
    assert all(one.scene_age == 0.0 for one in matched)


def test_after_a_fault_the_scene_is_looked_at_anew(rover: Rover) -> None:
    assert Reason.FAULT in rover.see(captured_at=0.0).reasons
    assert embedded(rover, [0] * 4) == [True, True, True, False]


def test_after_a_frame_that_the_perceiver_failed_on_too(
    rover: Rover, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(rover.eyes, "encode", lambda _: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            rover.see()
    assert embedded(rover, [0]) == [True]


def test_a_stricter_threshold_is_asked_of_a_new_embedding(rover: Rover) -> None:
    embedded(rover, [10] * N)
    rover.engine.settings = replace(
        rover.engine.settings, thresholds=Thresholds.of(DefaultThresholds(0.3, 0.99))
    )
    assert embedded(rover, [10]) == [True]


def test_the_first_reference_and_that_of_a_new_episode_are_their_frames_own(rover: Rover) -> None:
    rover.see(40)
    rover.answer(new_episode=True)
    rover.see(40)
    assert angle(rover.memory.reference) == pytest.approx(40)


def test_an_answer_that_teaches_nothing_embeds_nothing(rover: Rover) -> None:
    call = rover.see().observation
    assert call is not None
    assert call.scene_at is not None
    before = rover.eyes.embedded
    rover.answer(call=call, call_id=1)
    assert rover.eyes.embedded == before


def test_an_answer_teaches_the_scene_of_the_calls_frame_and_not_an_earlier_one(rover: Rover) -> None:
    call = rover.see(25, thing="drum").observation
    assert call is not None
    assert call.scene_age == pytest.approx(0.2)
    outcome = rover.answer({"drum": -1}, call, 1)
    assert angle(rover.memory.history[-1].embedding) == pytest.approx(25)
    assert outcome.call is not None
    assert outcome.call.scene_age == 0.0


def test_the_reference_stays_where_the_newest_frame_shows_another_place_by_its_own_embedding(
    rover: Rover,
) -> None:
    call = rover.see(0, thing="drum").observation
    newest = rover.see(90)
    assert Reason.UNKNOWN_SCENE not in newest.reasons, "judged by the scene of an earlier frame"
    outcome = rover.answer({"drum": -1}, call, 1)
    assert angle(rover.memory.reference) == pytest.approx(0)
    assert len(rover.memory.history) == 2
    assert outcome.newest is not None
    assert Reason.UNKNOWN_SCENE in outcome.newest.reasons


def test_an_answer_whose_scene_cannot_be_embedded_changes_nothing(
    rover: Rover, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(_: object) -> Embedding:
        raise PerceiverError("the network failed")

    call = rover.see(0, thing="drum").observation
    before = rover.memory
    monkeypatch.setattr(rover.eyes, "embed", broken)
    with pytest.raises(PerceiverError):
        rover.answer({"drum": -1}, call, 1)
    assert rover.memory is before


def test_words_alone_cost_no_embedding(rover: Rover) -> None:
    rover.see()
    before = rover.eyes.embedded
    rover.engine.answer((SetWord("grass", 0.5),), rover.now)
    assert rover.eyes.embedded == before


def test_a_stored_frame_is_embedded_whatever_came_before(rover: Rover) -> None:
    assert rover.engine.observe(rover.frame(70)).scene_at is None
    assert embedded(rover, [0] * 3) == [False] * 3, "and leaves the stream as it is"


def test_an_embedding_that_is_not_finite_is_never_used_again(rover: Rover) -> None:
    embedded(rover, [0] * 3)
    rover.eyes.spoil_embedding = lambda vector: np.full_like(vector, np.nan)
    seen: list[Assessment] = [rover.see() for _ in range(3)]
    assert all(Reason.FAULT in one.reasons for one in seen)
