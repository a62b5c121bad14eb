"""The house is measured: the same files each time, on a busy machine, too."""

from __future__ import annotations

from bench.house import walks


def test_a_walk_counts_the_same_files_each_time() -> None:
    first, second = ([walk[:2] for walk in walks().values()] for _ in range(2))
    assert first == second
    assert all(own > 0 for _, own in first)
