"""Jobs beside everything else: one that hangs or fails harms nothing."""

from __future__ import annotations

import logging
import threading
import time

import pytest

from companion.system.error_guard import BackgroundJob
from tests.waiting import wait_for


def test_while_a_job_hangs_the_next_ones_are_left_out_and_the_end_does_not_wait() -> None:
    released, done = threading.Event(), list[int]()
    with BackgroundJob() as background:
        assert background.run(released.wait)
        assert not background.run(lambda: done.append(1))
        began = time.monotonic()
    assert time.monotonic() - began < 2.0
    released.set()
    wait_for(lambda: background.run(lambda: done.append(2)))
    wait_for(lambda: done == [2])


def test_a_job_that_fails_is_logged_once_and_the_next_one_runs(caplog: pytest.LogCaptureFixture) -> None:
    done = list[int]()
    with caplog.at_level(logging.ERROR), BackgroundJob() as background:
        for _ in range(2):
            wait_for(lambda: background.run(lambda: 1 / 0))
        wait_for(lambda: background.run(lambda: done.append(1)))
        wait_for(lambda: done == [1])
    assert len(caplog.records) == 1
