"""The counts and intervals of `make bench-perception`."""

from __future__ import annotations

import pytest

from bench.perception.figures import Figure, pooled, share, share_of_tries, together


def test_a_share_has_the_interval_of_wilson() -> None:
    found = share([True] * 2 + [False] * 16)
    assert (found.count, found.of) == (2, 18)
    assert found.value == pytest.approx(1 / 9)
    assert found.low == pytest.approx(0.0310, abs=2e-4)  # Wilson's interval of 2 of 18, by hand
    assert found.high == pytest.approx(0.3280, abs=2e-4)
    assert str(found) == ".111 [.031, .328] (2/18)"


def test_none_of_few_is_no_certainty() -> None:
    none, every = share([False] * 6), share([True] * 6)
    assert none.low == 0.0
    assert none.high == pytest.approx(0.390, abs=1e-3)
    assert (every.value, every.high) == (1.0, 1.0)


def test_nothing_counted_is_told_as_not_measured() -> None:
    for found in (share([]), share_of_tries([]), pooled([]), together([[], [(0, 0)]])):
        assert found.value is None
        assert str(found) == "not measured (0)"
        assert found.as_json()["ci95"] is None


def test_pixels_are_pooled_over_frames_and_frames_are_drawn_again() -> None:
    frames = [(90, 100), (10, 100), (50, 100), (70, 100)]
    found = pooled(frames)
    assert found.value == 0.55
    assert found.low is not None
    assert found.high is not None
    assert 0.1 <= found.low < 0.4
    assert 0.7 < found.high <= 0.9
    assert found == pooled(frames)


def test_every_set_counts_alike_in_a_mean_over_sets() -> None:
    found = together([[(1, 2)] * 30, [(1000, 1000)]])
    assert found.value == 0.75
    assert found.of == 31


def test_several_tries_with_one_frame_do_not_narrow_the_interval() -> None:
    once = share([True, False, True, False])
    often = share_of_tries([[True] * 50, [False] * 50, [True] * 50, [False] * 50])
    assert (once.low, once.high) == (often.low, often.high)
    assert often == Figure(0.5, once.low, once.high, 4)
