"""How often something may fail at most, after some runs."""

from __future__ import annotations

import pytest

from bench.bounds import failure_below, told


@pytest.mark.parametrize(("runs", "below"), [(1, 0.95), (5, 0.4508), (59, 0.0496), (299, 0.00997)])
def test_clean_runs_prove_a_bound(runs: int, below: float) -> None:
    assert failure_below(runs) == pytest.approx(below, rel=0.002)
    assert failure_below(runs) == pytest.approx(1.0 - 0.05 ** (1.0 / runs))


@pytest.mark.parametrize(("runs", "wrong", "below"), [(5, 1, 0.6574), (20, 1, 0.2161), (59, 2, 0.1031)])
def test_a_wrong_run_raises_it(runs: int, wrong: int, below: float) -> None:
    assert failure_below(runs, wrong) == pytest.approx(below, abs=0.0005)
    assert failure_below(runs, wrong) > failure_below(runs)


def test_it_is_told_rounded_up() -> None:
    shown = [told(runs) for runs in (5, 20, 59, 299, 200_000)]
    assert shown == ["< 45.1 %", "< 14 %", "< 4.96 %", "< 0.997 %", "< 0.0015 %"]
    assert (told(3, 3), told(0)) == ("< 100 %", "")


@pytest.mark.parametrize(("runs", "wrong"), [(5, 6), (5, -1)])
def test_impossible_numbers_are_refused(runs: int, wrong: int) -> None:
    with pytest.raises(ValueError, match="cannot be wrong"):
        failure_below(runs, wrong)
