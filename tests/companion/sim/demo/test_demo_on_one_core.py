"""The whole demo on one core that it shares with a program that never rests."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import cv2
import pytest

from companion.sim.demo.animation import LARGEST

_LIMIT = 1400.0
_SILENT = 15.0
"""Seconds: it says something after 7 s of silence, and a busy core may keep even that from it for a while."""


@pytest.mark.slow
def test_on_one_busy_core_all_of_the_job_is_shown_in_its_own_time(tmp_path: Path) -> None:
    core = {min(os.sched_getaffinity(0))}
    animation = tmp_path / "demo.webp"
    options = ["--auto", "--seed", "1", "--out", str(tmp_path / "out"), "--animation", str(animation)]
    busy = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    os.sched_setaffinity(busy.pid, core)
    lines, times = list[str](), [time.monotonic()]
    try:
        demo = subprocess.Popen(
            [sys.executable, "-m", "companion", "demo", *options],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        os.sched_setaffinity(demo.pid, core)
        assert demo.stdout is not None
        for line in demo.stdout:
            lines.append(line.rstrip("\n"))
            times.append(time.monotonic())
            if times[-1] - times[0] > _LIMIT:
                demo.terminate()
        code = demo.wait(30.0)
    finally:
        busy.kill()
        busy.wait()
    told = "\n".join(lines)
    assert code == 0, told
    assert "All of the job was shown." in told
    assert any(line.startswith("This computer judges ") for line in lines)
    gaps = [after - before for before, after in pairwise(times)]
    assert max(gaps) < _SILENT, told
    figures = json.loads(lines[-1])
    assert (figures["collisions"], figures["resumes"]) == (0, figures["holds"])
    assert figures["kept_off_named_things"] >= 1
    done, read = cv2.imreadanimation(str(animation))
    assert done
    assert sum(read.durations) == pytest.approx(10_000, abs=100)
    assert animation.stat().st_size <= LARGEST
