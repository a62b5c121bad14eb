"""How long frames take, as it counts for hold."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.vision.measured_pace import BAD_FOR, GOOD_FOR, MeasuredPace


class Judging:
    """Frames one after the other, ten a second at most."""

    def __init__(self, first: float = 0.02, scene_every: int = 1) -> None:
        self.pace, self.now = MeasuredPace(scene_every), 100.0
        self.pace.started(first, self.now)

    def runs(self, seconds: float, *takes: float) -> float:
        """Let time pass. Returns what counts at its end."""
        until, number = self.now + seconds, 0
        while self.now < until - 1e-6:
            taken = takes[number % len(takes)]
            self.pace.judged(taken, self.now + taken)
            self.now, number = self.now + max(0.1, taken), number + 1
        return self.pace.step


@pytest.mark.parametrize("slow", [0.3, 0.5, 1.1])
def test_slow_frames_count_after_five_seconds_and_quick_ones_after_ten(slow: float) -> None:
    judging = Judging()
    assert judging.runs(20.0, 0.02) == pytest.approx(0.02)
    begun = judging.now
    while judging.pace.step < slow:
        judging.runs(0.1, slow)
    assert BAD_FOR - 0.1 <= judging.now - begun <= BAD_FOR + slow + 0.1
    begun = judging.now
    while judging.pace.step > 0.02:
        judging.runs(0.1, 0.02)
    assert GOOD_FOR - 0.1 <= judging.now - begun <= GOOD_FOR + 0.3


def stepped(pace: MeasuredPace, taken: float, since: float, until: float) -> list[float]:
    """What counts after each frame of those that follow each other without a pause."""
    found = []
    while since < until:
        since += taken
        pace.judged(taken, since)
        found.append(pace.step)
    return found


def test_it_counts_at_five_and_ten_seconds_since_the_first_such_frame_began() -> None:
    pace = MeasuredPace(1)
    pace.started(1.0, 0.0)
    assert stepped(pace, 1.0, 0.0, BAD_FOR) == [0.0, 0.0, 0.0, 0.0, 1.0]
    assert stepped(pace, 0.25, BAD_FOR, BAD_FOR + GOOD_FOR)[-2:] == [1.0, 0.25]
    assert stepped(pace, 1.0, BAD_FOR + GOOD_FOR, 2 * BAD_FOR + GOOD_FOR)[-2:] == [0.25, 1.0]


def test_what_warming_up_took_counts_for_a_request_at_once_and_for_a_fault_with_the_frames() -> None:
    judging = Judging(first=0.6)
    assert (judging.pace.newest, judging.pace.step) == (0.6, 0.0)
    judging.runs(0.5, 0.02)
    assert judging.pace.newest == 0.02
    assert judging.runs(20.0, 0.02) < 0.6


def test_neither_a_slow_frame_nor_a_quick_one_among_others_counts() -> None:
    assert Judging().runs(60.0, 0.02, 0.02, 0.02, 0.6) == pytest.approx(0.02)
    assert Judging(0.6).runs(60.0, 0.6, 0.6, 0.6, 0.02) == pytest.approx(0.6)


def test_the_frames_with_an_embedding_count_where_only_some_have_one() -> None:
    assert Judging(scene_every=5).runs(30.0, 0.6, 0.02, 0.02, 0.02, 0.02) == pytest.approx(0.6)


def test_a_new_process_changes_nothing_until_its_frames_have() -> None:
    judging = Judging()
    judging.runs(8.0, 0.6)
    judging.pace.started(0.02, judging.now)
    assert judging.pace.step == 0.6
    assert judging.runs(5.0, 0.02) == 0.6
    assert judging.runs(6.0, 0.02) == pytest.approx(0.02)


@pytest.mark.slow
@given(st.lists(st.tuples(st.floats(0.0, 30.0), st.floats(0.001, 3.0)), max_size=12), st.integers(1, 10))
def test_whatever_came_before_it_follows_what_lasts(runs: list[tuple[float, float]], every: int) -> None:
    judging = Judging(scene_every=every)
    for seconds, takes in runs:
        judging.runs(seconds, takes)
    assert 0.0 <= judging.pace.step <= 3.0
    assert judging.runs(0.1 * every + 2 * GOOD_FOR, 0.05) == 0.05
