"""The engine is asked what a frame matches."""

from __future__ import annotations

import numpy as np
import pytest

from anytraverse.frame import Image
from anytraverse.perception import Perceiver, make_perceiver
from anytraverse.perception.runtime import Runtime
from bench.perception.scenes import EmbeddedFrame, Replay, Rover, revisited, same_place

RNG = np.random.default_rng(5)


@pytest.fixture(scope="module")
def perceiver() -> Perceiver:
    return make_perceiver("builtin", Runtime(threads=1))


def unit(*values: float) -> np.ndarray:
    vector = np.zeros(33, dtype=np.float32)
    vector[: len(values)] = values
    return np.asarray(vector / np.linalg.norm(vector))


def picture(seed: int) -> Image:
    rng = np.random.default_rng(seed)
    return np.asarray(rng.integers(0, 255, (12, 16, 3)).repeat(20, 0).repeat(20, 1), dtype=np.uint8)


def test_a_frame_matches_the_scene_that_it_resembles_most_and_no_other(perceiver: Perceiver) -> None:
    rover = Rover(perceiver, [EmbeddedFrame(7, unit(1, 0, 0)), EmbeddedFrame(8, unit(0, 1, 0))])
    found = rover.matched(unit(0.02, 1, 0))
    assert found is not None
    assert found.number == 8
    assert rover.matched(unit(0, 0, 1)) is None


def test_asking_changes_nothing(perceiver: Perceiver) -> None:
    """The engine adopts a scene after two matches; the next frame must meet the same memory."""
    rover = Rover(perceiver, [EmbeddedFrame(7, unit(1, 0, 0)), EmbeddedFrame(8, unit(0, 1, 0))])
    for _ in range(4):
        found = rover.matched(unit(1, 0.01, 0))
        assert found is not None
        assert found.number == 7
    assert rover.matched(unit(0, 0, 1)) is None


def test_what_is_replayed_is_the_perceivers_own(perceiver: Perceiver) -> None:
    replay = Replay(perceiver)
    assert replay.model_id == perceiver.model_id
    assert replay.defaults == perceiver.defaults
    assert replay.meaning("path") == perceiver.meaning("path")


def test_a_frame_that_is_moved_and_relit_shows_one_place_and_another_frame_does_not() -> None:
    again = revisited(picture(1), RNG)
    assert (again != picture(1)).any()
    assert same_place(picture(1), again)
    assert not same_place(picture(1), picture(2))
    assert not same_place(picture(1), np.zeros((240, 320, 3), dtype=np.uint8))
