"""Measures how long the parts of a perceiver take on this machine, and the frame rate that allows.

Speed is judged by CPU time. On a busy machine the clock also counts the time that other programs had. Where
several threads share the work, the clock is less than their CPU time; then the clock counts. So a time is
never below what the part takes on this machine when it is quiet and has the files in memory.
"""

from __future__ import annotations

import resource
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import TypeVar

from anytraverse.assessment import Observation
from anytraverse.engine import AnyTraverse
from anytraverse.frame import Frame, Image
from anytraverse.judging import Settings
from anytraverse.memory import first_memory
from anytraverse.pace import Pace
from anytraverse.perception import Perceiver, Prompt
from anytraverse.preferences import Preferences

T = TypeVar("T")

SHORTEST_FRESHNESS, LONGEST_FRESHNESS = 1.0, 2.0
"""Limits of the default freshness limit, in seconds."""
FASTEST = 30.0
"""The highest frame rate reported, in frames a second; cameras are not faster."""
_BUSY = 1.3


@dataclass(frozen=True)
class Timing:
    """Holds times in milliseconds, medians except for `slowest`; of CPU except for `clock`, see above.

    encode, embed: of a frame. attend_1, attend_4: of one and four words used before. new_word: of one new
    word on a frame already encoded; None for a closed vocabulary. weights: of judging again with other
    weights. step: a whole frame with four words, judged. slowest: the slowest step. clock: a step's time by
    the clock.
    """

    encode: float
    attend_1: float
    attend_4: float
    embed: float
    new_word: float | None
    weights: float
    step: float
    slowest: float
    clock: float

    @property
    def busy(self) -> bool:
        """Whether other programs took so much of this machine that the clock shows it."""
        return self.clock > _BUSY * self.step

    @property
    def rate(self) -> float:
        """The frames a second that the slowest step allows."""
        return min(FASTEST, 1e3 / self.slowest)

    @property
    def freshness(self) -> float:
        """The freshness limit T at that rate, in seconds: three frame periods, at least 1 s, at most 2 s."""
        return min(LONGEST_FRESHNESS, max(SHORTEST_FRESHNESS, 3.0 / self.rate))

    @property
    def pace(self) -> Pace:
        """The pace of the slowest step at that rate, with that freshness limit."""
        return Pace(self.slowest / 1e3, 1.0 / self.rate, self.freshness)


def time_parts(perceiver: Perceiver, images: Sequence[Image], words: Sequence[str], repeat: int) -> Timing:
    """Time every part `repeat` times, over the images in turn, after one run that is not counted.

    Perceivers cache their maps of a frame, so attend_1 and attend_4 each get a frame encoded anew.
    """
    timer = _Timer(perceiver, words[:4])
    for turn in range(repeat + 1):
        timer.turn(turn, images[turn % len(images)])
        if turn == 0:
            timer.taken.clear()
            timer.clocks.clear()
    medians: dict[str, float] = {name: median(values) for name, values in timer.taken.items()}
    return Timing(
        encode=medians["encode"],
        attend_1=medians["attend_1"],
        attend_4=medians["attend_4"],
        embed=medians["embed"],
        new_word=medians.get("new_word"),
        weights=medians["weights"],
        step=medians["step"],
        slowest=max(timer.taken["step"]),
        clock=median(timer.clocks),
    )


def measured(work: Callable[[], T]) -> tuple[T, float, float]:
    """Do some work. Return its result, the milliseconds to judge it by, and those by the clock."""
    clock, cpu = time.perf_counter(), time.process_time()
    result = work()
    cpu, clock = time.process_time() - cpu, time.perf_counter() - clock
    return result, min(cpu, clock) * 1e3, clock * 1e3


def peak_memory() -> float:
    """Return the peak memory of this process (VmHWM), in MB."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii", errors="replace").splitlines()
        return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:")) / 1e3
    except (OSError, StopIteration, ValueError, IndexError):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


class _Timer:
    def __init__(self, perceiver: Perceiver, words: Sequence[str]) -> None:
        self.taken: dict[str, list[float]] = {}
        self.clocks: list[float] = []  # of the steps
        self._perceiver = perceiver
        self._prompts = [Prompt(word) for word in words]
        self._memories = [
            first_memory(perceiver.model_id, Preferences.of(dict.fromkeys(words, weight)))
            for weight in (1.0, 0.5)
        ]
        self._engine = AnyTraverse(perceiver, Settings(), self._memories[0])

    def turn(self, number: int, image: Image) -> None:
        perceiver, engine = self._perceiver, self._engine
        first = self._time("encode", lambda: perceiver.encode(image))
        self._time("attend_1", lambda: perceiver.attend(first, self._prompts[:1]))
        if perceiver.vocabulary is None:
            self._time("new_word", lambda: perceiver.attend(first, [Prompt(f"thing number {number}")]))
        second = self._time("encode", lambda: perceiver.encode(image))
        self._time("attend_4", lambda: perceiver.attend(second, self._prompts))
        self._time("embed", lambda: perceiver.embed(second))
        engine.memory = self._memories[0]
        seen = self._time("step", lambda: self._step(Frame(number, 0.0, image)))
        engine.memory = self._memories[1]
        self._time("weights", lambda: engine.judge(seen, 0.0))

    def _step(self, frame: Frame) -> Observation:
        seen = self._engine.observe(frame)
        self._engine.judge(seen, 0.0)
        return seen

    def _time(self, part: str, work: Callable[[], T]) -> T:
        result, milliseconds, clock = measured(work)
        self.taken.setdefault(part, []).append(milliseconds)
        if part == "step":
            self.clocks.append(clock)
        return result
