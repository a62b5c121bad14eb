"""Both ends as they ship, the daemon with its journal and the client that backs off, over a bad radio."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench.link.lossy import LINK_CONDITIONS, run
from bench.link.radio_model import LinkConditions, RadioModel

CALLS = 12
WORST = ("loss 30 %", "loss 50 %", "duplicates", "reordering", "all of it")
"""The rest, and ten times as many calls, with `make bench-link`."""


@pytest.mark.parametrize("weather", WORST)
def test_every_call_is_answered_once_and_the_operator_knows(weather: str, tmp_path: Path) -> None:
    outcome = run(LINK_CONDITIONS[weather], CALLS, tmp_path, step_s=0.05)
    assert (outcome.calls, outcome.lost, outcome.twice) == (CALLS, 0, 0)
    assert len(outcome.known) == CALLS


def passed(weather: LinkConditions, frames: int, until: float) -> list[int]:
    ether = RadioModel(weather, "1")
    for number in range(frames):
        ether.put(bytes([number]) * 50, number * 0.01)
    return [frame[0] for frame in ether.take(until)]


def test_the_radio_is_as_bad_as_it_says() -> None:
    whole = list(range(200))
    assert passed(LinkConditions(), 200, 3.0) == whole
    assert passed(LinkConditions(), 200, 1.0) == whole[: len(passed(LinkConditions(), 200, 1.0))] != whole
    assert 70 < len(passed(LinkConditions(loss=0.5), 200, 9.0)) < 130
    doubled = passed(LinkConditions(twice=0.3), 200, 9.0)
    assert set(doubled) == set(whole)
    assert 230 < len(doubled) < 290
    shuffled = passed(LinkConditions(shuffled=0.3), 200, 9.0)
    assert sorted(shuffled) == whole != shuffled
    narrow = passed(LinkConditions(rate=1000.0), 200, 1.05)
    assert len(narrow) == 19
    assert len(passed(LinkConditions(rate=1000.0), 200, 60.0)) < 200
    stalled = RadioModel(LinkConditions(stall_every=0.001), "1")
    stalled.put(b"x", 1.0)
    assert stalled.take(1.5) == []
