"""How it is found by how much cost grows."""

from __future__ import annotations

from bench.series import power, slope


def test_a_rise_is_found_with_its_interval_and_its_beginning_does_not_count() -> None:
    noise = [0.02, -0.01, 0.0, 0.01, -0.02, 0.03, -0.03]
    rising = [[1000 * n, 50 + n * 0.01 + noise[n % 7], 0, 0] for n in range(1, 51)]
    found = slope(rising, 1e5)
    assert found.low < 1.0 < found.high
    assert found.high - found.low < 0.2
    filling = [[1000 * n, min(n, 8) + noise[n % 7], 0, 0] for n in range(1, 51)]
    found = slope(filling, 1e5)
    assert found.low < 0 < found.high


def test_power_says_how_cost_grows_at_the_end() -> None:
    assert power([[1, 7, 7, 7], [10, 3, 3, 3], [100, 300, 300, 300]]) == 2.0
    assert power([[10, 3, 3, 3], [100, 3, 3, 3]]) == 0.0
    assert power([[10, 3, 3, 3]]) is None
    assert power([[10, 0, 0, 0], [100, 3, 3, 3]]) is None
