"""How old a view becomes, against a played camera whose newest frame is judged whenever there is time."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anytraverse.pace import Pace


def oldest_view(step: float, period: float, camera: float) -> float:
    """The greatest age of the newest view over some forty frames. camera: seconds between its frames."""
    free_at = due = oldest = 0.0
    view, taken = 0.0, -1
    while free_at < 40 * max(step, period):
        newest = math.floor(free_at / camera + 1e-9)
        taken = newest if newest > taken else taken + 1
        now = max(free_at, taken * camera)
        if now < due - period / 2:
            free_at = now
            continue
        due = max(due + period, now - period)
        free_at = now + step
        oldest = max(oldest, free_at - view)
        view = taken * camera
    return oldest


@given(
    step=st.floats(0.005, 2.0),
    period=st.floats(0.05, 2.0),
    faster=st.integers(1, 20),
)
def test_no_view_becomes_older_than_two_steps_and_a_period(step: float, period: float, faster: int) -> None:
    """Give or take a frame of the camera."""
    camera = period / faster
    assert oldest_view(step, period, camera) <= Pace(step, period, 1.0).worst_age + camera


@given(period=st.floats(0.05, 1.0), share=st.floats(1.0, 3.0))
def test_a_perceiver_slower_than_its_camera_nearly_reaches_that_age(period: float, share: float) -> None:
    step = 1.05 * share * period
    assert oldest_view(step, period, period) >= Pace(step, period, 1.0).worst_age - 1.1 * period


@pytest.mark.parametrize(
    ("step", "rate", "freshness", "keeps"),
    [
        (0.02, 10.0, 1.0, True),
        (0.45, 10.0, 1.0, True),
        (0.46, 10.0, 1.0, False),
        (0.5, 2.0, 1.5, True),
        (0.51, 2.0, 1.5, False),
        (0.66, 1.5, 2.0, True),
        (0.7, 1.5, 2.0, False),
        (0.0, 0.5, 2.0, True),
        (0.1, 0.5, 2.0, False),
    ],
)
def test_a_perceiver_keeps_the_freshness_limit_or_not(
    step: float, rate: float, freshness: float, keeps: bool
) -> None:
    assert Pace(step, 1.0 / rate, freshness).keeps is keeps
