"""How far ahead the thing of a call is, where the region of interest is in metres."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from anytraverse.ground import GroundCamera, GroundRegion, Lens
from companion.calls.summary import _distance
from companion.wire.call_report import CallReport

CAMERA = GroundCamera(Lens.of_view(75.0, 4 / 3), 1.0, 7.0, 0.6, 0.0, 0.0)
GROUND = GroundRegion(CAMERA, 0.8, 3.4, 2.9, 2.0)


def distance(bottom: float, lean: tuple[float, float] | None = None) -> float | None:
    seen: Any = SimpleNamespace(frame=SimpleNamespace(lean=lean))
    return _distance(CallReport(7, worst_tile_box=(0.4, 0.3, 0.6, bottom)), seen, GROUND)


@pytest.mark.parametrize("metres", [1.0, 2.1, 4.5])
def test_it_is_measured_to_the_near_end_of_the_box(metres: float) -> None:
    assert distance(CAMERA.row(metres)) == pytest.approx(metres)


def test_a_nose_that_goes_up_brings_the_same_row_farther_away() -> None:
    row = CAMERA.row(2.1)
    level, up = distance(row), distance(row, (3.0, 0.0))
    assert level is not None
    assert up is not None
    assert up > level


def test_beyond_what_is_known_above_the_horizon_and_without_a_box_nothing_is_told() -> None:
    assert distance(CAMERA.row(5.6)) is None
    assert distance(0.32) is None
    seen: Any = SimpleNamespace(frame=SimpleNamespace(lean=None))
    assert _distance(CallReport(7), seen, GROUND) is None
