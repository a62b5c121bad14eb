"""The threshold of a match rises with the number of scenes, so that foreign frames match at a stated rate."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from anytraverse.errors import SettingsError
from anytraverse.evaluation.labels import DatasetError
from anytraverse.evaluation.scene_matching import RATES, Matching, Places, fitted_match, measured_match
from anytraverse.judging import Thresholds
from anytraverse.perception import DefaultThresholds

SIZE = 24


def places(seed: int, remembered: int = 300, foreign: int = 400) -> Places:
    """Places at random on the sphere; a place that is seen again lies close to itself."""
    rng = np.random.default_rng(seed)

    def unit(rows: NDArray[np.float64]) -> NDArray[np.float32]:
        return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True), dtype=np.float32)

    known = unit(rng.normal(size=(remembered, SIZE)))
    same = rng.integers(0, remembered, 200)
    return Places(
        known,
        unit(known[same] + 0.08 * rng.normal(size=(200, SIZE))),
        same,
        unit(rng.normal(size=(foreign, SIZE))),
    )


def defaults(match: tuple[tuple[int, float], ...]) -> DefaultThresholds:
    return DefaultThresholds(roi=0.3, scene=0.3, match=match)


def by_scenes(found: tuple[Matching, ...]) -> dict[int, Matching]:
    return {one.scenes: one for one in found}


def test_the_stated_rate_is_kept_over_the_whole_memory_where_one_threshold_for_all_does_not() -> None:
    seen = places(1)
    table = fitted_match(seen)
    assert [scenes for scenes, _ in table] == sorted(RATES)
    for one in measured_match(seen, defaults(table)):
        assert one.false <= RATES[one.scenes]
    fixed = by_scenes(measured_match(seen, defaults((*table[:1], (256, table[0][1])))))
    assert fixed[40].false > 0.5
    assert fixed[256].false > 0.9


def test_the_rate_holds_on_frames_that_the_threshold_was_not_fitted_to_and_near_frames_still_match() -> None:
    found = by_scenes(measured_match(places(3), defaults(fitted_match(places(2)))))
    assert found[40].false <= 0.08
    assert found[256].false <= 0.14
    assert found[40].recall >= 0.95
    assert (found[40].foreign, found[40].again) == (400, 200)


def test_the_threshold_never_falls_even_where_more_false_matches_are_allowed() -> None:
    table = fitted_match(places(4), {1: 0.01, 2: 0.9, 4: 0.95})
    assert table[0][1] == table[1][1] == table[2][1]
    Thresholds.of(defaults(table))


def test_the_same_seed_gives_the_same_table_and_a_rate_of_0_lets_no_foreign_frame_match() -> None:
    seen = places(5, foreign=60)
    assert fitted_match(seen, seed=7, draws=20) == fitted_match(seen, seed=7, draws=20)
    table = fitted_match(seen, {40: 0.0}, draws=20)
    assert measured_match(seen, defaults(table), (40,), draws=20)[0].false == 0.0


def test_more_scenes_than_frames_cannot_be_measured() -> None:
    with pytest.raises(DatasetError, match="256 scenes cannot be drawn from 100 frames"):
        fitted_match(places(6, remembered=100))


@pytest.mark.parametrize("spoilt", ["nan", "none", "length", "row"])
def test_embeddings_that_say_nothing_are_refused(spoilt: str) -> None:
    seen = places(7, remembered=20, foreign=5)
    foreign, same = seen.foreign.copy(), seen.same.copy()
    if spoilt == "nan":
        foreign[0, 0] = np.nan
    elif spoilt == "none":
        foreign = foreign[:0]
    elif spoilt == "length":
        foreign = foreign[:, :-1]
    else:
        same[0] = 20
    with pytest.raises(DatasetError):
        Places(seen.remembered, seen.again, same, foreign)


def test_settings_refuse_a_table_that_does_not_rise() -> None:
    for match in (((0, 0.5),), ((4, 0.5), (4, 0.6)), ((1, 0.6), (4, 0.5)), ((1, 1.1),), ((1, float("nan")),)):
        with pytest.raises(SettingsError, match="match"):
            Thresholds(match=match)
