"""Frames that waited in a buffer: they are dropped, and their delay is known, whatever the stream does."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.cameras.late_frames import DROPPED_AFTER_A_GAP, LateFrames, StreamClock

_LIMIT = 1.0


def _late(times: list[float]) -> list[bool]:
    late = LateFrames(_LIMIT)
    return [late.is_late(now) for now in times]


def test_a_steady_stream_has_no_late_frame() -> None:
    assert not any(_late([0.1 * number for number in range(100)]))


def test_the_frame_after_a_gap_and_the_next_two_are_late() -> None:
    steady = [0.1 * number for number in range(20)]
    after = [5.0 + 0.1 * number for number in range(20)]
    assert _late(steady + after) == [False] * 20 + [True] * DROPPED_AFTER_A_GAP + [False] * 17


def test_frames_that_come_faster_than_usual_after_a_gap_are_late_until_the_backlog_is_gone() -> None:
    steady = [0.1 * number for number in range(20)]
    backlog = [5.0 + 0.002 * number for number in range(30)]
    live = [5.158 + 0.1 * number for number in range(10)]
    assert _late(steady + backlog + live) == [False] * 20 + [True] * 30 + [False] * 10


def test_a_backlog_after_the_very_first_frame_is_late_too() -> None:
    backlog = [5.0 + 0.002 * number for number in range(30)]
    live = [5.158 + 0.1 * number for number in range(60)]
    assert _late([0.0, *backlog, *live]) == [False] + [True] * 30 + [now < 10.0 for now in live]


def test_a_stream_that_stays_faster_than_before_is_not_late_for_ever() -> None:
    steady = [0.5 * number for number in range(10)]
    faster = [6.0 + 0.05 * number for number in range(200)]
    late = _late(steady + faster)
    assert late[10]
    assert not any(late[10 + 40 :])


@given(st.lists(st.floats(0.0, 4.0), min_size=1, max_size=60))
def test_no_frame_within_a_gap_passes_and_each_gap_costs_a_bounded_time(intervals: list[float]) -> None:
    late, now, gap_ends, gap = LateFrames(_LIMIT), 0.0, -math.inf, 0.0
    assert not late.is_late(now)
    since_gap = DROPPED_AFTER_A_GAP
    for interval in intervals:
        now += interval
        if interval > _LIMIT:
            gap_ends, gap, since_gap = now, interval, 0
        since_gap += 1
        told = late.is_late(now)
        if since_gap <= DROPPED_AFTER_A_GAP:
            assert told
        elif now >= gap_ends + gap:
            assert not told


def test_a_stream_without_delay_has_none() -> None:
    clock = StreamClock()
    assert [clock.delay(100.0 + 0.1 * n, 0.1 * n) for n in range(50)] == pytest.approx([0.0] * 50, abs=1e-9)


def test_a_frame_that_waited_shows_its_delay() -> None:
    clock = StreamClock()
    for n in range(20):
        clock.delay(100.0 + 0.1 * n, 0.1 * n)
    assert clock.delay(105.0, 2.0) == pytest.approx(3.0, abs=0.01)
    assert clock.delay(105.01, 2.1) == pytest.approx(2.91, abs=0.01)


def test_a_clock_that_drifts_does_not_make_frames_old() -> None:
    clock = StreamClock()
    delays = [clock.delay(n * 1.0, n * (1.0 - 1e-4)) for n in range(20_000)]
    assert max(delays) < 0.01


@pytest.mark.parametrize("stamp", [math.nan, math.inf])
def test_a_stamp_that_is_no_number_says_nothing(stamp: float) -> None:
    assert StreamClock().delay(1.0, stamp) == 0.0


def test_a_camera_that_sets_its_clock_back_starts_anew() -> None:
    clock = StreamClock()
    for n in range(20):
        clock.delay(100.0 + 0.1 * n, 50.0 + 0.1 * n)
    assert clock.delay(102.0, 0.0) == 0.0
    assert clock.delay(102.1, 0.1) == pytest.approx(0.0, abs=1e-9)


@given(st.lists(st.tuples(st.floats(0.0, 10.0), st.floats(-100.0, 100.0)), max_size=60))
def test_a_delay_is_never_negative(steps: list[tuple[float, float]]) -> None:
    clock, arrived, position = StreamClock(), 0.0, 0.0
    for interval, step in steps:
        arrived, position = arrived + interval, position + step
        assert clock.delay(arrived, position) >= 0.0
