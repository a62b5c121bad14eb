"""Scores drivable ground against labels, and how much of what words exclude is drivable all the same."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anytraverse.evaluation.labels import fold
from anytraverse.evaluation.seeing import stretched, stretched_mask
from anytraverse.perception import Perceiver
from bench.perception.figures import Figure, pooled, together
from bench.perception.frames import Frames, LabelledSet
from bench.perception.judged import EVERY, ROVER, Judge

Parts = list[tuple[int, int]]
EXCLUDED: dict[str, frozenset[str]] = {
    "bush": frozenset(("bush", "low vegetation")),
    "puddle": frozenset(("water", "puddle")),
}
"""What the rover's words exclude -> its labels."""


def measure_ground(perceiver: Perceiver, frames: Frames) -> dict[str, Figure]:
    """Measure the drivable IoU of every set, with the rover's words and with words for all."""
    found: dict[str, Figure] = {}
    for title, words in (("rover's words", ROVER), ("words for all", EVERY)):
        judge = Judge.of(perceiver, words)
        for place, sets in (("home", frames.home), ("abroad", frames.abroad)):
            parts = [_measure(judge, one) for one in sets]
            for one, (overlaps, _) in zip(sets, parts, strict=True):
                found[f"IoU, {title}: {one.name}"] = pooled(overlaps)
            found[f"IoU, {title}: {place}"] = together([overlaps for overlaps, _ in parts])
            if words == ROVER:
                for name in EXCLUDED:
                    shares = pooled([pair for _, excluded in parts for pair in excluded[name]])
                    found[f"drivable although -1, {place}: {name}"] = shares
    return found


def _measure(judge: Judge, labelled: LabelledSet) -> tuple[Parts, dict[str, Parts]]:
    """Return for each frame intersection and union, and for each excluded kind drivable and all pixels.

    The IoU is that of the traversability above 0.5, over all labelled pixels, as `anytraverse score` counts;
    what is excluded is counted in the lower half of the frame, by the map by which the rover judges.
    """
    overlaps: Parts = []
    excluded: dict[str, Parts] = {name: [] for name in EXCLUDED}
    for frame in labelled.frames:
        maps = judge.see(frame.image).maps
        assert maps is not None
        shape = frame.labels.shape
        counted, true = frame.labels != labelled.ignore, np.isin(frame.labels, labelled.drivable)
        ground = stretched(maps.traversability, shape) > 0.5
        overlaps.append((_count(ground & true & counted), _count((ground | true) & counted)))
        lower = stretched_mask(maps.drivable, shape)[shape[0] // 2 :]
        for name, labels in EXCLUDED.items():
            own = np.isin(frame.labels[shape[0] // 2 :], _ids(labelled, labels))
            if own.any():
                excluded[name].append((_count(lower & own), _count(own)))
    return overlaps, excluded


def _ids(labelled: LabelledSet, labels: frozenset[str]) -> Sequence[int]:
    return [n for n, name in enumerate(labelled.names) if fold(name) in labels and n != labelled.ignore]


def _count(mask: np.ndarray) -> int:
    return int(np.count_nonzero(mask))
