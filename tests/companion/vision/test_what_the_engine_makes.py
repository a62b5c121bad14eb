"""What the engine makes of any perceiver and any words is believed, a fault included."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.assessment import Reason
from anytraverse.engine import AnyTraverse
from anytraverse.frame import Frame
from anytraverse.judging import Settings
from anytraverse.memory import first_memory
from anytraverse.pooling import POOLINGS, UNCERTAINTIES
from anytraverse.preferences import Preferences
from companion.vision.worker import Worker
from tests.anytraverse.conftest import Painted
from tests.companion.daemon.rig import picture
from tests.companion.vision.played import WORDS, heard


def broken_eyes(spoil: str, value: float) -> Painted:
    """Painted eyes that answer `value`."""
    perceiver = Painted()
    made: Callable[[Any], Any] = lambda right: np.full_like(right, value)  # noqa: E731
    setattr(perceiver, spoil, made)
    return perceiver


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 0.0, -1e-3, 1.0005, 3.0])
@pytest.mark.parametrize("spoil", ["spoil_attention", "spoil_embedding"])
def test_whatever_a_broken_perceiver_answers_the_fault_is_believed(spoil: str, value: float) -> None:
    perceiver = broken_eyes(spoil, value)
    start = replace(first_memory(perceiver.model_id, WORDS), reference=np.ones(2, np.float32))
    worker = Worker(AnyTraverse(perceiver, Settings(), start), 1)
    heard(worker.judge(Frame(1, time.monotonic(), picture())))


def test_a_scene_that_cannot_be_compared_is_a_fault_that_is_believed() -> None:
    perceiver = Painted()
    start = replace(first_memory(perceiver.model_id, WORDS), reference=np.ones(7, np.float32))
    looked = Worker(AnyTraverse(perceiver, Settings(), start), 1).judge(Frame(1, time.monotonic(), picture()))
    assert looked.assessment.reasons == {Reason.FAULT}
    heard(looked)


@pytest.mark.slow
@settings(max_examples=80)
@given(st.integers(0, 2**32 - 1), st.sampled_from(list(POOLINGS)), st.sampled_from(list(UNCERTAINTIES)))
def test_every_map_that_the_engine_makes_is_believed(seed: int, pooling: str, uncertainty: str) -> None:
    grain = np.random.default_rng(seed)
    perceiver = Painted()
    perceiver.spoil_attention = lambda maps: grain.choice(
        [0.0, 1.0, 1 / 3, grain.random()], maps.shape
    ).astype(np.float32)
    names = grain.permutation(["grass", "trail", "drum", "rock", "kind 1", "kind 2"])[: grain.integers(1, 7)]
    words = Preferences.of({str(name): float(grain.choice([-1.0, 1.0, 0.0, 0.7])) for name in names})
    given_settings = Settings(pooling=pooling, uncertainty=uncertainty)
    worker = Worker(AnyTraverse(perceiver, given_settings, first_memory(perceiver.model_id, words)), 1)
    looked = worker.judge(Frame(1, time.monotonic(), picture("drum")))
    assert looked.assessment.maps is not None
    heard(looked)
