"""Answered scenes: the most similar one is found, and the list stays bounded."""

from __future__ import annotations

import gc
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.history import _COMPARABLE, Embedding, Entry, History, cosine, is_embedding
from anytraverse.preferences import Preferences


def vector(*values: float) -> Embedding:
    """An embedding."""
    return np.array(values, dtype=np.float32)


def at(angle: float) -> Embedding:
    """A scene in the plane, in degrees."""
    return vector(math.cos(math.radians(angle)), math.sin(math.radians(angle)))


def entry(embedding: Embedding, order: int, matched: int | None = None, call_id: int = 0) -> Entry:
    """An entry without words."""
    return Entry(embedding, Preferences(), order, order if matched is None else matched, call_id)


@given(st.lists(st.integers(0, 359), min_size=1, max_size=12), st.integers(0, 359))
@settings(max_examples=80)
def test_the_most_similar_scene_is_found_not_the_least(angles: list[int], seen: int) -> None:
    history = History([entry(at(angle), order) for order, angle in enumerate(angles)])
    best = history.best(at(seen))
    assert best is not None
    closest = max(math.cos(math.radians(angle - seen)) for angle in angles)
    assert best.similarity == pytest.approx(closest, abs=1e-6)
    assert cosine(best.entry.embedding, at(seen)) == pytest.approx(best.similarity)


def test_of_equal_scenes_the_youngest_is_found() -> None:
    best = History([entry(at(0), 1), entry(at(0), 2)]).best(at(0))
    assert best is not None
    assert best.entry.order == 2


def test_an_empty_history_matches_nothing() -> None:
    assert History().best(at(0)) is None


@pytest.mark.parametrize("broken", [vector(math.nan, 1), vector(math.inf, 0), vector(0, 0), vector(1, 0, 0)])
def test_a_broken_entry_is_passed_over(broken: Embedding) -> None:
    history = History([entry(broken, 1), entry(at(50), 2), entry(broken, 3)])
    best = history.best(at(0))
    assert best is not None
    assert best.entry.order == 2
    assert History([entry(broken, 1)]).best(at(0)) is None


def test_a_broken_scene_matches_nothing() -> None:
    history = History([entry(at(0), 1)])
    for broken in (vector(math.nan, 0), vector(0, 0), vector(1, 0, 0), np.ones((1, 2), dtype=np.float32)):
        assert history.best(broken) is None


@given(st.lists(st.floats(-1e6, 1e6, width=32), min_size=2, max_size=5), st.floats(1e-3, 1e3))
@settings(max_examples=80)
def test_the_cosine_knows_no_norm_and_never_leaves_its_range(values: list[float], factor: float) -> None:
    one = vector(*values)
    other = (one * np.float32(factor)).astype(np.float32)
    similarity = cosine(one, other)
    if is_embedding(one) and is_embedding(other):
        assert similarity <= 1
        assert similarity == pytest.approx(1, abs=1e-3) or np.abs(other).max() < 1e-30
    else:
        assert math.isnan(similarity)


@given(st.lists(st.tuples(st.booleans(), st.integers(0, 30)), max_size=40))
@settings(max_examples=80)
def test_beyond_the_limit_the_least_recently_matched_goes(steps: list[tuple[bool, int]]) -> None:
    history, recency = History(limit=4), list[int]()
    for clock, (adds, which) in enumerate(steps, start=1):
        if adds or not recency:
            history = history.added(entry(at(clock), clock))
            recency = [*recency, clock][-4:]
        else:
            order = sorted(recency)[which % len(recency)]
            touched = next(one for one in history if one.order == order)
            history = history.touched(touched, clock)
            recency = [*(one for one in recency if one != order), order]
        assert [one.order for one in history] == sorted(recency)


def test_what_one_call_taught_is_forgotten_and_the_rest_stays() -> None:
    history = History([entry(at(0), 1), entry(at(10), 2, call_id=7), entry(at(20), 3, call_id=8)])
    assert [one.call_id for one in history.without_call(7)] == [0, 8]
    assert history.without_call(9).limit == history.limit
    assert len(history) == 3


def test_a_history_is_compared_again_with_scenes_of_any_length_and_follows_its_changes() -> None:
    history = History([entry(at(0), 1), entry(vector(0, 0, 1), 2), entry(at(90), 3)])
    for seen, order in ((at(10), 1), (vector(0, 1, 1), 2), (at(80), 3), (at(10), 1)):
        best = history.best(seen)
        assert best is not None
        assert best.entry.order == order
    assert history.best(vector(1, 0, 0, 0)) is None
    after = history.added(entry(at(10), 4))
    assert [
        one.matches(at(10), 0.999)[0].entry.order for one in (after, history.added(entry(at(11), 5)))
    ] == [4, 5]
    assert not history.matches(at(10), 0.999)


@pytest.mark.slow
def test_what_a_history_was_compared_by_goes_with_it_and_is_not_sent() -> None:
    history = History([entry(at(0), 1)])
    known = len(_COMPARABLE)
    history.best(at(5))
    assert len(_COMPARABLE) == known + 1
    assert vars(history).keys() == vars(History()).keys()
    del history
    gc.collect()
    assert len(_COMPARABLE) <= known


@given(st.integers(0, 2**32 - 1), st.integers(1, 70), st.integers(2, 300))
def test_a_frame_that_resembles_a_refused_one_as_much_as_the_scene_does_not_match_it(
    seed: int, count: int, length: int
) -> None:
    rng = np.random.default_rng(seed)
    scenes = rng.standard_normal((count, length)).astype(np.float32)
    entries = [Entry(one, Preferences(), n, n, refused=(one.copy(),)) for n, one in enumerate(scenes)]
    frame = (scenes[0] + 0.1 * rng.standard_normal(length)).astype(np.float32)
    assert History(entries).best(frame) is None
