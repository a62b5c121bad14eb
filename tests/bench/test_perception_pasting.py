"""Cut-outs look as a camera of the stated mount would see them."""

from __future__ import annotations

import numpy as np
import pytest

from anytraverse.frame import Image
from anytraverse.regions import Box
from bench.perception.pasting import HEIGHT, Cutout, covered, paste

WHITE = np.full((60, 30, 4), 255, dtype=np.uint8)
FRAME: Image = np.full((480, 640, 3), 120, dtype=np.uint8)
FOCAL = 320 / np.tan(np.deg2rad(35))  # pixels, of 70 degrees over 640


def changed_rows(cutout: Cutout, distance: float) -> tuple[int, int]:
    covered_half = paste(FRAME, cutout, distance, 0.0)[:, 320, 0] > (int(FRAME[0, 0, 0]) + 255) / 2
    rows = np.flatnonzero(covered_half)
    return int(rows[0]), int(rows[-1])


@pytest.mark.parametrize("distance", [10.0, 5.0, 2.8])
def test_a_thing_stands_where_the_ground_is_and_is_as_high_as_it_would_be(distance: float) -> None:
    top, bottom = changed_rows(Cutout(WHITE, 0.45, "made"), distance)
    assert bottom == pytest.approx(240 + FOCAL * HEIGHT / distance, abs=2)
    assert top == pytest.approx(240 + FOCAL * (HEIGHT - 0.45) / distance, abs=2)


def test_a_thing_higher_than_the_camera_reaches_over_the_horizon() -> None:
    top, _ = changed_rows(Cutout(WHITE, 1.7, "made"), 6.0)
    assert top == pytest.approx(240 - FOCAL * 1.2 / 6.0, abs=2)


def test_a_flat_thing_lies_on_the_ground_and_throws_no_shadow() -> None:
    flat = Cutout(WHITE, 1.2, "made", flat=True)
    pasted = paste(FRAME, flat, 3.0, 0.0)
    assert (pasted >= FRAME).all()
    top, bottom = changed_rows(flat, 3.0)
    assert bottom == pytest.approx(240 + FOCAL * HEIGHT / 3.0, abs=2)
    assert top == pytest.approx(240 + FOCAL * HEIGHT / 4.2, abs=2)


def test_the_frame_itself_stays_as_it_was_and_its_edges_cut_a_thing() -> None:
    before = FRAME.copy()
    pasted = paste(FRAME, Cutout(WHITE, 3.0, "made"), 1.0, 0.6)
    assert (before == FRAME).all()
    assert pasted.shape == FRAME.shape
    assert (pasted[:, -1] != FRAME[:, -1]).any()


def test_a_thing_covers_more_of_the_region_the_nearer_it_is() -> None:
    bounds = Box(1 / 3, 0.6, 2 / 3, 0.95)
    parts = [covered(FRAME.shape, Cutout(WHITE, 0.45, "made"), d, 0.0, bounds) for d in (10.0, 4.0, 2.8, 2.0)]
    assert parts[0] == 0.0
    assert parts == sorted(parts)
    assert covered(FRAME.shape, Cutout(WHITE, 50.0, "made"), 1.0, 0.0, bounds) == pytest.approx(1.0)
