"""Runs an hour's frames as fast as they go, and measures whether memory, disk or times rise with them.

In virtual time and one process: the daemon as it ships with journal, log, pictures and link, and the engine
with `builtin`. Calls are opened and answered, a parameter is set every two seconds, and the link is cut for
half a minute of every five: the rover and the operator are those of `bench.faults.endurance`. Other programs
slow down a computer for minutes; so times are compared with those of a yardstick, the network on one picture.
"""

from __future__ import annotations

import logging
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from pathlib import Path
from statistics import median

import numpy as np

from anytraverse.perception import make_perceiver
from anytraverse.perception.runtime import Runtime
from bench.faults.endurance import CutRadio, Endurance, EnduranceOperator, bytes_in, own_memory, pass_period
from bench.link.radio_model import LinkConditions
from bench.series import PlottedSeries
from bench.virtual_time import virtual_time
from companion.storage.log_file import log_to_file

FRAMES = 36_000
QUICK = 600
_SAMPLES = 50


def measure(*, quick: bool, bundle: Path | None) -> list[PlottedSeries]:
    """Measures an hour at ten frames/s; quick: one minute. `bundle` is not needed."""
    del bundle
    with tempfile.TemporaryDirectory(prefix="growth-") as folder:
        return drive(QUICK if quick else FRAMES, Path(folder))


def drive(frames: int, folder: Path) -> list[PlottedSeries]:
    """Judges so many frames, and returns memory, disk and times over them."""
    logging.getLogger().setLevel(logging.INFO)
    memory = PlottedSeries("Memory of daemon and engine", "frames", "MB")
    disk = PlottedSeries("Files of the rover", "frames", "MB")
    times = PlottedSeries("Time of a frame, and of the daemon's turns in it", "frames", "ms of CPU")
    against = PlottedSeries("The same, in times of the yardstick", "frames", "times")
    every = max(1, frames // _SAMPLES)
    judged, turned, measured = list[float](), list[float](), list[float]()
    measure_yardstick = _yardstick()
    with virtual_time() as clock, ExitStack() as closed:
        radio = CutRadio(LinkConditions(), "1")
        rover = closed.enter_context(closing(Endurance(folder, radio, 1)))
        closed.enter_context(log_to_file(folder, rover.writer))
        operator = EnduranceOperator(radio)
        for number in range(1, frames + 1):
            radio.cut = number % 3000 >= 2700
            begun = time.process_time()
            rover.frame(thing=number % 300 >= 260)
            judged.append((time.process_time() - begun) * 1e3)
            if number % 20 == 0:
                operator.set_parameter()
            if number % min(20, every) == 0:
                measured.append(measure_yardstick())
            begun = time.process_time()
            pass_period(clock, radio, rover, operator)
            turned.append((time.process_time() - begun) * 1e3)
            if number % every == 0:
                memory.add("own memory", number, [own_memory()])
                disk.add("journal, log, calls, pictures", number, [bytes_in(folder) / 1e6])
                times.add("yardstick, median", number, [median(measured)])
                for name, found in (("judged", judged), ("turns of the daemon", turned)):
                    times.add(f"{name}, median", number, [median(found)])
                    times.add(f"{name}, 99 %", number, [float(np.quantile(found, 0.99))])
                    against.add(name, number, [median(found) / median(measured)])
                    found.clear()
                measured.clear()
        print(f"{frames} frames, {operator.calls} calls, {operator.acknowledged} acknowledged", flush=True)
    return [memory, disk, times, against]


def _yardstick() -> Callable[[], float]:
    """Returns what measures the ms of CPU time of the network on one picture, always the same."""
    perceiver = make_perceiver("builtin", Runtime(threads=1))
    picture = np.random.default_rng(0).integers(0, 256, (96, 128, 3), dtype=np.uint8)

    def measure_it() -> float:
        begun = time.process_time()
        perceiver.encode(picture)
        return (time.process_time() - begun) * 1e3

    return measure_it
