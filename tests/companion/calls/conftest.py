"""Scenes to start from."""

from __future__ import annotations

import pytest
from hypothesis import settings

from companion.wire.ids import Policy
from tests.companion.calls.scenes import DRUM, HOLD, LOG, Scene

settings.register_profile("steady", derandomize=True, deadline=None)
settings.load_profile("steady")


@pytest.fixture
def report() -> Scene:
    """Driving in AUTO over a clear trail, only reporting."""
    scene = Scene()
    scene.run(1.0)
    return scene


@pytest.fixture
def hold() -> Scene:
    """Driving in AUTO over a clear trail, allowed to hold."""
    scene = Scene(Policy.HOLD)
    scene.run(1.0)
    return scene


@pytest.fixture
def held(hold: Scene) -> Scene:
    """Standing before a drum that no word explains: call 1."""
    hold.run(1.0, DRUM)
    assert hold.autopilot.mode == HOLD
    return hold


@pytest.fixture
def blocked(hold: Scene) -> Scene:
    """Standing before a log that is known as not drivable: hold 1, no call."""
    hold.run(1.0, LOG)
    assert hold.autopilot.mode == HOLD
    return hold
