"""Stores what was measured, and computes the figures that are quoted from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bench.clipseg.contestants import Sample
from bench.clipseg.frames import COUNTS, SIZES
from bench.clipseg.lineup import CONTESTANTS, OURS, REFERENCE
from bench.clipseg.measuring import Samples
from bench.ratios import Spread, ratio, spread
from bench.series import PlottedSeries

EMBEDDING_PARTS = ("scene", "tail")


@dataclass(frozen=True)
class Results:
    """The measurements. samples: of each contestant and case. missing: why a contestant has none."""

    samples: Samples
    missing: Mapping[str, str] = field(default_factory=dict)

    @property
    def names(self) -> list[str]:
        """Returns the contestants that were measured, the reference first."""
        return [name for name in CONTESTANTS if any(key[0] == name for key in self.samples)]

    @property
    def sizes(self) -> list[tuple[int, int]]:
        return [size for size in SIZES if any(key[1] == size for key in self.samples)]

    def of(self, name: str, size: tuple[int, int], count: int) -> list[Sample]:
        """Returns the samples of a contestant and case; empty when it was not measured."""
        return self.samples.get((name, size, count), [])

    def cpu(self, name: str, size: tuple[int, int], count: int) -> list[float]:
        """Returns the process CPU seconds of each round."""
        return [sample.cpu for sample in self.of(name, size, count)]

    def times_faster(self, name: str, size: tuple[int, int], count: int) -> Spread | None:
        """Computes the reference's CPU time over this contestant's, pair by pair; None without samples."""
        ours = self.cpu(name, size, count)
        return ratio(self.cpu(REFERENCE, size, count), ours) if ours else None

    def times_faster_without_embedding(self, name: str, size: tuple[int, int], count: int) -> Spread | None:
        """Computes the same without the scene's embedding in either."""
        ours = self.of(name, size, count)
        if not ours:
            return None
        return ratio(
            [_maps_alone(sample) for sample in self.of(REFERENCE, size, count)],
            [_maps_alone(sample) for sample in ours],
        )

    def part(self, name: str, part: str, size: tuple[int, int], count: int) -> Spread:
        """Returns the CPU seconds of one part."""
        return spread([sample.parts.get(part, 0.0) for sample in self.of(name, size, count)])

    def peak_mb(self, name: str, size: tuple[int, int]) -> float | None:
        """Returns the highest resident memory (MB) after the cases of this size; smaller sizes ran before."""
        peaks = [sample.peak_mb for count in COUNTS for sample in self.of(name, size, count)]
        return max(peaks) if peaks else None

    def roi_difference(self, name: str) -> float | None:
        """Computes the largest difference of a ROI mean from its `like`'s on the same frame and words.

        None where it is compared with none, or that one was not measured.
        """
        return max(
            (
                max(
                    abs(one.figures.roi_uncertainty - other.figures.roi_uncertainty),
                    abs(one.figures.roi_traversability - other.figures.roi_traversability),
                )
                for one, other in self._pairs(name, CONTESTANTS[name].like)
            ),
            default=None,
        )

    def embedding_cosine(self, name: str) -> float | None:
        """Computes the smallest cosine of an embedding and the reference's; None for another encoder's."""
        if not CONTESTANTS[name].same_encoder:
            return None
        return min(
            float(np.dot(one.figures.embedding, other.figures.embedding))
            for one, other in self._pairs(name, REFERENCE)
        )

    def _pairs(self, name: str, like: str) -> list[tuple[Sample, Sample]]:
        if like not in self.names:
            return []
        return [
            pair
            for (who, size, count), samples in self.samples.items()
            if who == name
            for pair in zip(self.of(like, size, count), samples, strict=True)
        ]


def _maps_alone(sample: Sample) -> float:
    return sample.cpu - sum(sample.parts.get(part, 0.0) for part in EMBEDDING_PARTS)


def figures(results: Results) -> dict[str, Any]:
    """Returns the figures of the last line: null, with a reason beside it, for a missing one."""
    line: dict[str, Any] = {}
    for size in results.sizes:
        suffix = "" if size == SIZES[0] else f"_{size[0]}x{size[1]}"
        for name in OURS:
            for count in COUNTS:
                line |= _ratio(f"ratio_{name}_k{count}", suffix, results, (name, size, count))
        for name in CONTESTANTS:
            peak = results.peak_mb(name, size)
            line[f"rss_mb_{name}{suffix}"] = None if peak is None else round(peak)
    for name in OURS:
        if name not in results.names:
            line[f"{name}_reason"] = results.missing.get(name, "not measured")
            continue
        for key, value, digits in (
            ("roi_difference", results.roi_difference(name), 5),
            ("embedding_cosine", results.embedding_cosine(name), 6),
        ):
            if value is not None:
                line[f"{key}_{name}"] = round(value, digits)
    return line | {"series": [_times(results, size).as_json() for size in results.sizes]}


def _times(results: Results, size: tuple[int, int]) -> PlottedSeries:
    """Returns the CPU time of a step by the number of prompts, for a plot."""
    series = PlottedSeries(f"A step at {size[0]}x{size[1]}", "prompts", "ms of CPU")
    for name in results.names:
        for count in COUNTS:
            if seconds := results.cpu(name, size, count):
                series.add(CONTESTANTS[name].label, count, [1e3 * one for one in seconds])
    return series


def _ratio(
    key: str, suffix: str, results: Results, case: tuple[str, tuple[int, int], int]
) -> dict[str, float | list[float] | None]:
    faster, alone = results.times_faster(*case), results.times_faster_without_embedding(*case)
    if faster is None or alone is None:
        return {key + suffix: None}
    return {
        key + suffix: round(faster.median, 3),
        f"{key}_quartiles{suffix}": [round(faster.low, 3), round(faster.high, 3)],
        f"{key}_maps_alone{suffix}": round(alone.median, 3),
    }
