"""Finds the things of a labelled drive that no word means, and which of them a rover noticed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from anytraverse.evaluation.datasets import Dataset, TornPictureError
from anytraverse.evaluation.summary import THING
from anytraverse.regions import Region

_APART = 3
"""Frames without a class after which it is another thing. A call opens after two of three."""
_LEAST = 2
Runs = Sequence[tuple[int, int]]
"""First and last frames, by their places in the drive from 0, rising."""


class LabelledThing(NamedTuple):
    """A thing on the way. first, last: the frames of the drive in whose region of interest it is."""

    name: str
    first: int
    last: int


def things_of(dataset: Dataset, names: Sequence[str], region: Region) -> list[LabelledThing]:
    """Return each appearance of these classes in a region, where they cover 1 % of it in two frames or more.

    Raises DatasetError, OSError.
    """
    seen: dict[str, list[list[int]]] = {name: [] for name in names}
    for place, number in enumerate(dataset.numbers):
        try:
            labels = dataset.read(number).labels
        except TornPictureError:
            continue
        inside = labels[region.mask(*labels.shape)]
        for name, runs in seen.items():
            if dataset.classes.mask(inside, [name]).mean() < THING:
                continue
            if runs and place - runs[-1][-1] <= _APART:
                runs[-1].append(place)
            else:
                runs.append([place])
    return [
        LabelledThing(name, run[0], run[-1])
        for name, runs in seen.items()
        for run in runs
        if len(run) >= _LEAST
    ]


def noticed(things: Sequence[LabelledThing], stood: Runs) -> int:
    """Return near how many things a rover called or would have stood: while they were there, or just after.

    stood: frames of `TrialOutcome.stood`.
    """
    return sum(any(a <= one.last + _APART and b >= one.first for a, b in stood) for one in things)
