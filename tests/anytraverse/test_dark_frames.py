"""Dark frames are brightened before the network sees them; others and what a lamp lights are not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anytraverse.perception.builtin.network import EXPOSED, MOST_GAIN, exposure_gain, network_input


def ground(level: float) -> np.ndarray:
    """A frame of this mean brightness with some texture."""
    texture = np.random.default_rng(1).normal(1.0, 0.2, (340, 640, 3))
    return np.clip(level * texture, 0, 255).astype(np.uint8)


def test_a_dark_frame_is_as_bright_to_the_network_as_a_well_exposed_one() -> None:
    assert network_input(ground(11.0)).mean() == pytest.approx(EXPOSED, rel=0.1)
    assert network_input(ground(120.0)).mean() == pytest.approx(120.0, rel=0.05)


def test_a_brightened_frame_has_finer_steps_than_its_own_levels() -> None:
    assert len(np.unique(network_input(ground(11.0)))) > 200


def test_what_a_lamp_lights_at_night_is_not_made_white() -> None:
    night = ground(4.0)
    night[200:] = ground(200.0)[200:]
    assert exposure_gain(night) < 1.3


@given(level=st.integers(0, 255), bright=st.integers(0, 255))
def test_the_factor_never_darkens_and_is_bounded(level: int, bright: int) -> None:
    image = np.full((20, 20, 3), level, np.uint8)
    image[:, 10:] = bright
    assert 1.0 <= exposure_gain(image) <= MOST_GAIN
