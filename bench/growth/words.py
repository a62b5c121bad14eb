"""Measures a frame by the number of words in use: encoded, judged, judged again, and the memory it keeps."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from anytraverse.assessment import Observation
from anytraverse.engine import AnyTraverse
from anytraverse.frame import Frame
from anytraverse.judging import Settings
from anytraverse.memory import first_memory
from anytraverse.perception import make_perceiver
from anytraverse.perception.builtin.words import GROUND_WORDS
from anytraverse.perception.runtime import Runtime
from anytraverse.preferences import Preferences
from bench.clipseg.frames import make_frame
from bench.series import PlottedSeries, cpu_ms

COUNTS = (1, 2, 4, 8, 16)
_EXPORT_WITHIN = 600.0


def measure(*, quick: bool, bundle: Path | None) -> list[PlottedSeries]:
    """Measures `builtin`, and CLIPSeg in fp32; quick: only the former. bundle: CLIPSeg's, None: random."""
    cv2.setNumThreads(1)
    times = PlottedSeries("Time of a 640x480 frame", "words in use", "ms of CPU")
    kept = PlottedSeries("Memory that a judged frame keeps, for answers to its call", "words in use", "MB")
    _measure("builtin", 5 if quick else 15, times, kept)
    if not quick:
        with tempfile.TemporaryDirectory(prefix="growth-") as folder:
            _measure(f"clipseg:{bundle or _random_bundle(Path(folder) / 'bundle')}", 5, times, kept)
    return [times, kept]


def _random_bundle(out: Path) -> Path:
    """Makes a bundle of CLIPSeg with random weights, which cost what trained ones do."""
    command = [sys.executable, "-m", "anytraverse.cli", "export", "random", str(out)]
    subprocess.run(command, check=True, timeout=_EXPORT_WITHIN, stdout=sys.stderr)
    return out


def _measure(name: str, rounds: int, times: PlottedSeries, kept: PlottedSeries) -> None:
    perceiver = make_perceiver(name, Runtime(threads=1, precision="fp32"))
    kind = name.partition(":")[0]
    for count in COUNTS:
        words = {word: 1.0 - 2.0 * (place % 2) for place, word in enumerate(list(GROUND_WORDS)[:count])}
        memory = first_memory(perceiver.model_id, Preferences.of(words))
        engine = AnyTraverse(perceiver, Settings.of(perceiver.defaults), memory)
        frame = Frame(1, 0.0, make_frame(640, 480, 0))
        engine.step(frame, 0.0)  # which becomes the reference
        seen = engine.observe(frame)
        times.add(f"{kind}, encode and embed", count, cpu_ms(partial(engine.observe, frame), rounds))
        times.add(f"{kind}, attend and judge", count, cpu_ms(partial(judge_new, engine, seen), rounds))
        times.add(f"{kind}, judge again", count, cpu_ms(partial(engine.judge, seen, 0.0), rounds))
        kept.add(kind, count, [_megabytes(engine.judge(seen, 0.0))])
        print(f"{kind}, {count} words: {times.lines[f'{kind}, attend and judge'][-1][1]} ms", flush=True)


def judge_new(engine: AnyTraverse, seen: Observation) -> None:
    """Judges a frame as if no maps had been made of it before."""
    seen.attended = {}
    if hasattr(seen.features, "maps"):
        seen.features.maps = {}
    engine.judge(seen, 0.0)


def _megabytes(found: Any) -> float:
    """Returns the MB (10^6 bytes) of all arrays that can be reached from here, each once."""
    seen: dict[int, int] = {}
    waiting: list[Any] = [found]
    known: set[int] = set()
    while waiting:
        one = waiting.pop()
        if id(one) in known:
            continue
        known.add(id(one))
        if isinstance(one, np.ndarray):
            owner = one
            while isinstance(owner.base, np.ndarray):
                owner = owner.base
            seen[id(owner)] = owner.nbytes
        elif isinstance(one, dict):
            waiting += [*one.keys(), *one.values()]
        elif isinstance(one, (list, tuple)):
            waiting += one
        elif type(one).__module__.startswith("anytraverse"):
            waiting += vars(one).values() if hasattr(one, "__dict__") else ()
    return sum(seen.values()) / 1e6
