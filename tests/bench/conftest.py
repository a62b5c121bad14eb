"""Made samples, so that the figures quoted from them can be worked out by hand."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import pytest

from bench.clipseg.contestants import Figures, Sample
from bench.clipseg.frames import COUNTS, SIZES
from bench.clipseg.measuring import Samples


class MakeSample(Protocol):
    def __call__(
        self, cpu: float = 1.0, peak: float = 100.0, uncertainty: float = 0.5, **parts: float
    ) -> Sample: ...


MakeSamples = Callable[[Mapping[str, Sequence[float]]], Samples]


@pytest.fixture
def sample() -> MakeSample:
    """Makes one sample of so many CPU seconds."""

    def make(cpu: float = 1.0, peak: float = 100.0, uncertainty: float = 0.5, **parts: float) -> Sample:
        return Sample(cpu, cpu, parts, Figures(0.25, uncertainty, (0.6, 0.8)), peak)

    return make


@pytest.fixture
def samples_of(sample: MakeSample) -> MakeSamples:
    """The same CPU seconds for a contestant in every case; a tenth of each step is the scene's embedding."""

    def make(seconds: Mapping[str, Sequence[float]]) -> Samples:
        return {
            (name, size, count): [sample(cpu, scene=cpu / 10, tower=cpu / 2) for cpu in rounds]
            for size in SIZES
            for count in COUNTS
            for name, rounds in seconds.items()
        }

    return make
