"""CPU time by parts."""

import pytest

from bench.clipseg.parts import Parts


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The process's CPU time: its last element."""
    now = [0.0]
    monkeypatch.setattr("bench.clipseg.parts.time.process_time", lambda: now[-1])
    return now


def test_a_part_within_a_part_counts_for_itself_alone(clock: list[float]) -> None:
    parts = Parts()

    def resize() -> None:
        clock.append(clock[-1] + 2.0)

    with parts.time("tower"):
        clock.append(clock[-1] + 1.0)
        parts.timed("resize", resize)()
        clock.append(clock[-1] + 4.0)
    assert parts.take() == {"tower": 5.0, "resize": 2.0}


def test_what_was_taken_does_not_count_again(clock: list[float]) -> None:
    parts = Parts()
    for seconds in (1.0, 2.0):
        with parts.time("decoder"):
            clock.append(clock[-1] + seconds)
    assert parts.take() == {"decoder": 3.0}
    assert parts.take() == {}
