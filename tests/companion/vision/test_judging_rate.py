"""How often frames are judged on a computer that is slow or hot."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.config import Config
from companion.config.schema import CallSection, CameraSection, MountSection, StoppingSection
from companion.config.stopping import judge_stopping
from companion.vision.judging_rate import CALM_FOR, LONGEST_CALM, JudgingRate, steps

COOL: dict[str, Any] = {"temperature": 50.0, "throttled": False}
TICK = 0.1


class Computer:
    """One that judges frames as often as it is told to, and takes so long for each."""

    def __init__(self, rate: float = 10.0, freshness: float = 1.0, window: int = 3) -> None:
        self.rate = JudgingRate(rate, freshness, window)
        self.now, self._due = 1000.0, 1000.0
        self.changes: list[tuple[float, float]] = []

    def runs(self, seconds: float, takes: float, **figures: Any) -> float:
        """Let time pass. Returns the rate at its end."""
        for _ in range(round(seconds / TICK)):
            self.now += TICK
            before = self.rate.value
            self.rate.tick(self.now, {**COOL, **figures})
            if self.rate.value != before:
                self.changes.append((self.now, self.rate.value))
            while self._due <= self.now:
                self._due += max(1.0 / self.rate.value, takes)
                self.rate.judged(takes)
        return self.rate.value


@pytest.mark.parametrize(
    ("rate", "freshness", "window", "found"),
    [
        (10.0, 1.0, 3, (10.0, 7.5, 5.0, 4.0)),
        (30.0, 1.0, 3, (30.0, 22.5, 15.0, 10.0)),
        (5.0, 1.0, 3, (5.0, 4.0)),
        (5.0, 1.0, 1, (5.0, 3.75, 3.0)),
        (10.0, 1.0, 6, (10.0, 7.5, 7.0)),
        (10.0, 1.0, 10, (10.0,)),
        (3.0, 1.0, 3, (3.0,)),
        (1.0, 2.0, 3, (1.0,)),
        (2.0, 6.0, 3, (2.0, 1.5, 1.0, 2 / 3)),
        (1.746, 3.0 / 1.746, 1, (1.746,)),
        (0.8, 5.0, 2, (0.8, 0.6)),
    ],
)
def test_every_step_judges_the_votes_window_and_one_frame_within_t_or_as_many_as_are_configured(
    rate: float, freshness: float, window: int, found: tuple[float, ...]
) -> None:
    assert steps(rate, freshness, window) == pytest.approx(found)


@given(
    rate=st.floats(0.5, 60.0),
    freshness=st.one_of(st.none(), st.floats(0.2, 10.0)),
    window=st.integers(1, 60),
    step=st.floats(0.0, 3.0),
)
def test_at_no_step_does_the_rover_drive_farther_than_the_check_of_the_stopping_distance_says(
    rate: float, freshness: float | None, window: int, step: float
) -> None:
    config = Config(
        camera=CameraSection(rate=rate),
        mount=MountSection(height=1.0, tilt=7.0),
        stopping=StoppingSection(speed=1.0),
        call=CallSection(votes=1, window=window, freshness=freshness),
    )
    most = _reaction(config, step)
    for lower in steps(rate, config.freshness, window):
        fewer = replace(config.camera, rate=lower)
        call = replace(config.call, freshness=config.freshness)
        assert _reaction(replace(config, camera=fewer, call=call), step) <= most + 1e-9


def _reaction(config: Config, step: float) -> float:
    found = judge_stopping(config, step)
    assert not isinstance(found, str), found
    return found.react


def test_slow_judging_goes_straight_to_the_step_that_it_can_keep() -> None:
    computer = Computer()
    assert computer.runs(5.0, takes=0.14) == 5.0, "at 7.5/s it has 0.133 s"
    assert computer.rate.why == "slow computer"
    assert [rate for _, rate in computer.changes] == [5.0]


def test_judging_that_fits_lowers_nothing() -> None:
    assert Computer().runs(60.0, takes=0.099) == 10.0


def test_judging_that_no_step_can_keep_goes_on_at_the_lowest() -> None:
    assert Computer().runs(20.0, takes=0.5) == 4.0


def test_heat_and_throttling_take_a_step_every_ten_seconds_and_a_moment_of_them_none() -> None:
    computer = Computer()
    for _ in range(20):
        computer.runs(8.0, takes=0.02, throttled=True)
        computer.runs(1.0, takes=0.02)
    assert computer.rate.value == 10.0
    computer.runs(45.0, takes=0.02, temperature=83.0)
    assert [rate for _, rate in computer.changes] == [7.5, 5.0, 4.0]
    assert computer.changes[1][0] - computer.changes[0][0] == pytest.approx(10.0, abs=0.2)
    assert computer.rate.why == "hot computer"
    assert computer.runs(300.0, takes=0.02, temperature=76.0) == 4.0, "not cool yet"
    assert computer.runs(75.0, takes=0.02, temperature=74.0) == 10.0
    assert computer.rate.why == ""


def test_heat_with_throttling_that_comes_and_goes_is_strain_without_a_break() -> None:
    computer = Computer()
    for second in range(12):
        computer.runs(1.0, takes=0.02, temperature=85.0, throttled=second % 2 == 0)
    assert computer.rate.value == 7.5


def test_heat_that_no_step_ends_is_told_where_the_last_one_did_not_help() -> None:
    computer = Computer()
    computer.runs(38.0, takes=0.02, temperature=90.0)
    assert computer.rate.value == 4.0
    assert computer.rate.stuck == ""
    computer.runs(5.0, takes=0.02, temperature=90.0)
    assert computer.rate.stuck == "hot computer"
    computer.runs(30.0, takes=0.02)
    assert (computer.rate.value, computer.rate.stuck) == (5.0, "")
    single = Computer(rate=2.0, freshness=1.5)
    single.runs(11.0, takes=0.3, throttled=True)
    assert (single.rate.value, single.rate.stuck) == (2.0, "throttled computer")
    single.runs(LONGEST_CALM + 1.0, takes=0.3)
    assert single.rate.stuck == ""


@pytest.mark.parametrize("rate", [10.0, 2.0])
def test_throttling_that_comes_and_goes_where_no_step_helps_is_told_a_few_times_an_hour(rate: float) -> None:
    computer, told, before = Computer(rate), 0, ""
    for second in range(3600):
        computer.runs(1.0, takes=0.02, throttled=second % 13 < 12)
        told += bool(computer.rate.stuck) and not before
        before = computer.rate.stuck
    assert 1 <= told <= 12


def test_a_step_up_is_taken_only_where_judging_will_be_easy() -> None:
    computer = Computer()
    computer.runs(5.0, takes=0.11)
    assert computer.runs(600.0, takes=0.08) == 7.5, "0.08 s of 0.1 s would be more than 75 %"
    assert computer.runs(40.0, takes=0.07) == 10.0


def test_unknown_figures_strain_nothing() -> None:
    assert Computer().runs(100.0, takes=0.02, temperature=None, throttled=None) == 10.0


def test_a_computer_that_is_throttled_at_each_step_up_tries_it_more_and_more_seldom() -> None:
    computer = Computer()
    for _ in range(3600 * 10):
        computer.runs(TICK, takes=0.02, throttled=computer.rate.value > 5.0)
    times = [at for at, rate in computer.changes if rate > 5.0]
    assert len(computer.changes) < 30
    assert times[-1] - times[-2] > LONGEST_CALM


LOADS = st.tuples(
    st.floats(1.0, 60.0),
    st.floats(0.0, 2.0),
    st.sampled_from([None, 40.0, 74.0, 77.0, 80.0, 99.0]),
    st.sampled_from([None, False, True]),
)


@pytest.mark.slow
@given(
    rate=st.floats(0.5, 60.0),
    freshness=st.one_of(st.none(), st.floats(0.2, 10.0)),
    window=st.integers(1, 10),
    loads=st.lists(LOADS, max_size=12),
)
def test_whatever_the_load_it_keeps_its_bounds_does_not_flap_and_comes_back(
    rate: float,
    freshness: float | None,
    window: int,
    loads: list[tuple[float, float, float | None, bool | None]],
) -> None:
    fresh = freshness or min(2.0, max(1.0, 3.0 / rate))
    computer = Computer(rate, fresh, window)
    for seconds, takes, temperature, throttled in loads:
        computer.runs(seconds, takes, temperature=temperature, throttled=throttled)
        assert min(rate, max(3.0, window + 1.0) / fresh) <= computer.rate.value <= rate
        assert bool(computer.rate.why) == (computer.rate.value < rate)
    ups = [
        at
        for (at, new), (_, before) in zip(computer.changes, [(0.0, rate), *computer.changes], strict=False)
        if new > before
    ]
    assert all(later - earlier >= CALM_FOR for earlier, later in pairwise(ups))
    assert len(computer.changes) <= 4 * (len(ups) + 1)
    again = 5 * (LONGEST_CALM + max(5, 2.0 * rate + 1.0) / computer.rate.steps[-1])
    assert computer.runs(again, takes=0.5 / rate) == rate
