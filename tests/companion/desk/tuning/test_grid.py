"""Grids are read as they are written, and never make more than can be compared."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anytraverse.errors import AnyTraverseError
from anytraverse.judging import Settings
from anytraverse.regions import Box
from companion.desk.tuning.trial import MOST, Grid, GridError, around, read_region, read_tiles, read_values

REGION = Box(0.3, 0.5, 0.7, 0.9)


def test_values_are_listed_or_stepped() -> None:
    assert read_values("0.8,0.9,0.8", "scene") == (0.8, 0.9)
    assert read_values("0.8:0.95:0.05", "scene") == (0.8, 0.85, 0.9, 0.95)
    assert read_tiles("0.4,off") == (0.4, None)
    assert read_tiles("off") == (None,)
    assert read_region("0.3,0.5,0.7,0.9") == REGION


@given(st.text(alphabet="0123456789.,:-eoffnai ", max_size=20))
def test_any_text_is_read_or_refused(text: str) -> None:
    with suppress(AnyTraverseError):
        assert all(isinstance(one, float) for one in read_values(text, "roi"))
    with suppress(AnyTraverseError):
        assert read_tiles(text)
    with suppress(AnyTraverseError):
        assert isinstance(read_region(text), Box)


def test_a_grid_that_is_too_large_or_out_of_range_is_refused() -> None:
    base = Settings()
    many = tuple(number / 10_000 for number in range(1, 102))
    with pytest.raises(GridError, match=f"{MOST} at most"):
        Grid(many, many, (None,), (REGION,)).combinations(base)
    regions = tuple(Box(0.1, 0.1, 0.2 + number / 100, 0.9) for number in range(11))
    with pytest.raises(GridError, match="10 at most"):
        Grid((0.9,), (0.3,), (None,), regions).combinations(base)
    narrow = Grid((0.9,), (0.3,), (None,), (Box(0.46, 0.6, 0.54, 0.95),))
    with pytest.raises(AnyTraverseError, match=r"ROI 0\.08 wide, vehicle 0\.30"):
        narrow.combinations(base)
    assert len(replace(narrow, misfit_allowed=True).combinations(base)) == 1
    with pytest.raises(AnyTraverseError, match="roi is"):
        Grid((0.9,), (1.5,), (None,), (REGION,)).combinations(base)


def test_a_combination_changes_these_settings_and_no_other() -> None:
    base = Settings(tile_share=0.1)
    for one in around(replace(base, region=REGION)).combinations(base):
        applied = one.applied(base)
        limits = applied.thresholds
        assert (limits.scene, limits.roi, limits.tile, applied.region) == (
            one.scene,
            one.roi,
            one.tile,
            REGION,
        )
        assert applied.tile_share == 0.1
        assert limits.trav == base.thresholds.trav
