from hypothesis import given
from hypothesis import strategies as st

from companion.link.limits import TokenBucket


@given(
    rate=st.floats(1, 2000),
    burst=st.floats(300, 1000),
    asks=st.lists(st.tuples(st.floats(0, 5), st.integers(1, 280)), max_size=60),
)
def test_any_stretch_of_time_carries_at_most_rate_times_time_plus_burst(
    rate: float, burst: float, asks: list[tuple[float, int]]
) -> None:
    bucket = TokenBucket(rate, burst, 0.0)
    now = 0.0
    passed: list[tuple[float, int]] = []
    for pause, size in asks:
        now += pause
        if bucket.take(size, now):
            passed.append((now, size))
    for first in range(len(passed)):
        carried = 0
        for at, size in passed[first:]:
            carried += size
            assert carried <= rate * (at - passed[first][0]) + burst + 1e-6


def test_rate_0_is_unlimited() -> None:
    bucket = TokenBucket(0, 300, 0.0)
    assert all(bucket.take(280, 0.0) for _ in range(100))


def test_a_clock_that_steps_back_gives_nothing_away() -> None:
    bucket = TokenBucket(100, 300, 10.0)
    assert bucket.take(300, 10.0)
    assert not bucket.take(1, 5.0)
    assert not bucket.take(101, 11.0)
    assert bucket.take(100, 11.0)
