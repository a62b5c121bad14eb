"""Measures what a frame costs, in a process of its own that runs nothing else, on one core.

Run: python -m bench.perception.cost [--perceiver builtin] [--frames 150]. The only line is one JSON object:
milliseconds of CPU time of the whole chain at 640x480 with ten words of which two tapped, and memory in MB.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from anytraverse.engine import AnyTraverse
from anytraverse.frame import Frame, Image
from anytraverse.memory import first_memory
from anytraverse.operations import Tap
from anytraverse.perception import make_perceiver
from anytraverse.perception.runtime import Runtime
from anytraverse.preferences import Preferences
from bench.perception.judged import shipped

WORDS = "trail: 1; grass: 1; dirt: 1; gravel: 1; bush: -1; tree: -1; sky: -0.5; water: -1"
_WARM = 5
_OFTEN = 10
_LONGEST = 300.0
"""Seconds that the process may take."""


def measure_cost(perceiver: str, frames: int) -> dict[str, float]:
    """Run this file in a new process. Raises CalledProcessError, TimeoutExpired."""
    command = [
        sys.executable,
        "-m",
        "bench.perception.cost",
        "--perceiver",
        perceiver,
        "--frames",
        str(frames),
    ]
    alone = os.environ | {"OPENBLAS_NUM_THREADS": "1"}  # as the vision process runs
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=_LONGEST, env=alone)
    figures: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return figures


def size_mb(perceiver: str) -> float | None:
    """Return the MB of a built-in perceiver's network and calibration; None for another perceiver."""
    kind, _, argument = perceiver.partition(":")
    if kind != "builtin" or argument == "lexicon":
        return None
    from anytraverse.perception.builtin.perceiver import SHIPPED

    model = Path(argument).expanduser() if argument else SHIPPED
    files = [path for path in model.parent.iterdir() if path.stem == model.stem]
    return sum(path.stat().st_size for path in files) / 1e6


def _measure(name: str, count: int) -> dict[str, Any]:
    """Judge `count` frames by `step`, as the vision process does, which is loaded, too."""
    import companion.vision.process  # noqa: F401  # for its memory

    cv2.setNumThreads(1)
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    perceiver = make_perceiver(name, Runtime(threads=1))
    engine = AnyTraverse(
        perceiver, shipped(perceiver), first_memory(perceiver.model_id, Preferences.parse(WORDS))
    )
    pictures = _pictures(np.random.default_rng(8))
    called = engine.observe(Frame(1, 0.0, pictures[0]))
    taps = (Tap(1, (0.1, 0.5, 0.3, 0.8), "drum", -1.0), Tap(1, (0.6, 0.5, 0.8, 0.8), "log", -1.0))
    engine.answer(taps, 0.0, call=called, go=True)
    assert len(engine.memory.preferences) == 10
    spent, wall, shares = [], [], [_pss_mb()]
    for number in range(_WARM + count):
        begin, clock = time.process_time(), time.perf_counter()
        engine.step(Frame(number, float(number), pictures[number % len(pictures)]), float(number))
        spent.append((time.process_time() - begin) * 1e3)
        wall.append((time.perf_counter() - clock) * 1e3)
        if number % _OFTEN == 0:
            shares.append(_pss_mb())
    low, high = np.quantile(spent[_WARM:], (0.5, 0.95))
    return {
        "ms_frame": round(float(low), 2),
        "ms_frame_p95": round(float(high), 2),
        "ms_wall": round(float(np.median(wall[_WARM:])), 2),
        "peak_rss_mb": _peak_rss_mb(),
        "peak_pss_mb": max(shares),
    }


def _pictures(rng: np.random.Generator) -> list[Image]:
    """Make pictures of soft noise: what they show does not change what they cost."""
    coarse = [rng.integers(0, 255, (12, 16, 3), dtype=np.uint8) for _ in range(4)]
    return [np.asarray(cv2.resize(one, (640, 480)), dtype=np.uint8) for one in coarse]


def _peak_rss_mb() -> float:
    """Return the highest resident memory of this process so far."""
    return _megabytes(Path("/proc/self/status"), "VmHWM")


def _pss_mb() -> float:
    """Return the resident memory, of pages that other processes share only this one's part."""
    return _megabytes(Path("/proc/self/smaps_rollup"), "Pss")


def _megabytes(path: Path, name: str) -> float:
    line = next(line for line in path.read_text().splitlines() if line.startswith(f"{name}:"))
    return round(int(line.split()[1]) / 1024, 1)


def main() -> None:
    """Prints the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--perceiver", default="builtin")
    parser.add_argument("--frames", type=int, default=150)
    given = parser.parse_args()
    alone = os.environ.get("OPENBLAS_NUM_THREADS") == "1"
    print(json.dumps((_measure if alone else measure_cost)(given.perceiver, given.frames)))


if __name__ == "__main__":
    main()
