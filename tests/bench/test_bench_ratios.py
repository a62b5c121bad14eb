"""How many times faster: by pairs of the same round."""

import pytest

from bench.ratios import ratio, spread


def test_a_ratio_is_the_median_of_pairs_not_of_medians() -> None:
    assert ratio([2.0, 30.0, 4.0], [1.0, 10.0, 1.0]).median == 3.0


def test_a_slow_round_that_meets_both_changes_nothing() -> None:
    assert ratio([2.0, 2.0, 20.0], [1.0, 1.0, 10.0]) == spread([2.0])


def test_a_round_that_one_of_them_lacks_is_refused() -> None:
    with pytest.raises(ValueError, match="shorter"):
        ratio([1.0, 2.0], [1.0])


def test_no_values_have_no_median() -> None:
    with pytest.raises(ValueError, match="no values"):
        spread([])


def test_a_spread_is_written_with_its_quartiles() -> None:
    assert f"{spread([1.0, 2.0, 3.0, 4.0, 5.0]).times(10):.1f}" == "30.0 [20.0, 40.0]"
