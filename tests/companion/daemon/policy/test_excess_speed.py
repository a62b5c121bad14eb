"""How much faster than configured the vehicle drives: only what lasts counts."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.config.stopping import OVERSHOOT
from companion.daemon.policy.excess_speed import FALLS_AFTER, RISES_AFTER, ExcessSpeed


def after(configured: float | None, speeds: Sequence[float | None], every: float = 0.1) -> list[float | None]:
    """What counts after each report of the speed, as commanded."""
    followed, told = ExcessSpeed(configured), list[float | None]()
    for number, speed in enumerate(speeds):
        if speed is not None:
            followed.reported(OVERSHOOT * speed, number * every)
        told.append(followed.speed)
    return told


def test_a_speed_in_excess_counts_after_a_second_and_for_five_seconds_more() -> None:
    told = after(1.0, [1.0] * 10 + [1.5] * 20 + [1.0] * 60)
    rises, falls = 10 + round(RISES_AFTER / 0.1), 30 + round(FALLS_AFTER / 0.1)
    assert told[: rises - 1] == [None] * (rises - 1)
    assert told[rises + 1 : falls - 1] == [1.5] * (falls - rises - 2)
    assert told[falls + 1 :] == [None] * (len(told) - falls - 1)


@given(speeds=st.lists(st.floats(0.0, 1.1) | st.none(), max_size=80))
def test_what_is_no_faster_than_configured_never_counts(speeds: list[float | None]) -> None:
    assert set(after(1.0, speeds)) <= {None}


@given(speeds=st.lists(st.floats(0.0, 6.0) | st.none(), max_size=120))
def test_it_is_never_more_than_was_driven_nor_less_than_was_driven_for_a_second(
    speeds: list[float | None],
) -> None:
    told = after(1.0, speeds)
    for number, counted in enumerate(told):
        assert counted is None or counted <= max(speed or 0.0 for speed in speeds[: number + 1]) + 0.126
        if number >= 11:
            lately = speeds[number - 11 : number + 1]
            if None not in lately:
                assert min(speed or 0.0 for speed in lately) <= (counted or 1.0) + 0.126


@pytest.mark.parametrize("glitch", [3.0, 50.0])
def test_a_glitch_does_not_count(glitch: float) -> None:
    assert set(after(1.0, [1.0] * 5 + [glitch] * 9 + [1.0] * 5)) == {None}


@pytest.mark.parametrize("gap", [1.1, 1.5, 2.5, 8.0])
def test_one_wrong_report_and_then_none_counts_for_nothing(gap: float) -> None:
    followed = ExcessSpeed(1.0)
    for at, speed in ((0.0, 1.0), (0.5, 1.0), (1.0, 6.0), (1.0 + gap, 1.0), (1.5 + gap, 1.0)):
        for _ in range(3):  # each turn of the main loop sees the newest report
            followed.reported(speed, at)
        assert followed.speed is None


def test_what_counts_stays_while_no_report_comes_and_a_human_ends_it() -> None:
    followed = ExcessSpeed(1.0)
    for number in range(6):
        followed.reported(2.0 * OVERSHOOT, 0.5 * number)
    assert followed.speed == 2.0
    followed.reported(1.0, 60.0)
    assert followed.speed == 2.0, "slow for the first time after a minute without a report"
    followed.forget()
    assert followed.speed is None


def test_without_a_configured_speed_nothing_is_in_excess() -> None:
    assert set(after(None, [4.0] * 30)) == {None}
