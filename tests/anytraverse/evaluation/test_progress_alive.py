"""A long command shows that it is alive, and does not count the time in which it waits for a person."""

from __future__ import annotations

import io
import subprocess
import sys
import time
from pathlib import Path

import pytest

from anytraverse.evaluation.progress import Progress
from anytraverse.evaluation.spreading import spread, tick
from tests.waiting import is_gone, wait_for


class Clock:
    """Stands until it is moved."""

    now = 0.0

    def __call__(self) -> float:
        """Seconds."""
        return self.now


def test_a_long_step_is_told_every_five_seconds() -> None:
    stream, clock = io.StringIO(), Clock()
    progress = Progress(1000, "frames", stream, clock)
    for second in range(1, 13):
        clock.now = second
        progress.beat()
    assert stream.getvalue() == "0/1000 frames, 5 s\n0/1000 frames, 10 s\n"
    progress.step(3, ", 2 calls")
    clock.now = 15.0
    progress.beat()
    assert stream.getvalue().splitlines()[-1] == "3/1000 frames, 15 s, 4985 s left, 2 calls"


def test_where_nothing_is_counted_it_says_what_is_done() -> None:
    stream, clock = io.StringIO(), Clock()
    progress = Progress(0, "loading clipseg", stream, clock)
    clock.now = 5.0
    progress.beat()
    progress.step(7)
    clock.now = 10.0
    progress.beat()
    assert stream.getvalue() == "loading clipseg, 5 s\n7 loading clipseg, 10 s\n"


def test_a_person_thinks_without_being_counted_or_interrupted() -> None:
    stream, clock = io.StringIO(), Clock()
    progress = Progress(10, "frames", stream, clock)
    clock.now = 2.0
    progress.step()
    with progress.waiting():
        clock.now = 602.0
        progress.beat()
    assert progress.elapsed == 2.0
    clock.now = 604.0
    progress.step()
    assert stream.getvalue() == "1/10 frames, 2 s, 18 s left\n2/10 frames, 4 s, 16 s left\n"


def test_more_steps_than_were_announced_leave_no_time() -> None:
    stream, clock = io.StringIO(), Clock()
    progress = Progress(2, "frames", stream, clock)
    clock.now = 6.0
    progress.reach(3)
    progress.reach(2)
    assert stream.getvalue() == "3/2 frames, 6 s, 0 s left\n"


def test_what_is_entered_beats_by_itself_and_ends() -> None:
    class Beaten(Progress):
        beats = 0

        def beat(self) -> None:
            self.beats += 1

    progress = Beaten(1, "frames", io.StringIO())
    with progress:
        deadline = time.monotonic() + 10.0
        while not progress.beats and time.monotonic() < deadline:
            time.sleep(0.01)
    assert progress.beats


def steps_of(job: int) -> int:
    for _ in range(job):
        tick()
    return job


def test_steps_are_counted_in_this_process_and_over_several() -> None:
    for processes in (1, 2):
        seen: list[int] = []
        done: dict[int, int] = {}
        found = spread(steps_of, [3, 4], processes=processes, done=done.__setitem__, ticked=seen.append)
        assert (found, done, seen[-1]) == ([3, 4], {0: 3, 1: 4}, 7)
    tick()
    assert seen[-1] == 7, "outside of it nobody counts"


TWO_JOBS = """
import time
from anytraverse.evaluation.spreading import spread
spread(time.sleep, [600, 600], processes=2, done=print)
"""


@pytest.mark.slow
def test_a_command_that_is_killed_leaves_no_process() -> None:
    with subprocess.Popen([sys.executable, "-c", TWO_JOBS]) as command:
        children = Path(f"/proc/{command.pid}/task/{command.pid}/children")
        try:
            wait_for(lambda: len(children.read_text().split()) == 3)  # two, and their resource tracker
            processes = [int(one) for one in children.read_text().split()]
        finally:
            command.kill()
    wait_for(lambda: all(map(is_gone, processes)))
