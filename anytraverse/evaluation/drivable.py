"""Scores how well drivable ground is found, and how well each word finds its class."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import median

from anytraverse.evaluation.datasets import LabelledFrame
from anytraverse.evaluation.labels import DatasetError, LabelClasses
from anytraverse.evaluation.matching import Matches
from anytraverse.evaluation.scores import Overlap, Ranking
from anytraverse.evaluation.seeing import PerceiverRun, stretched, stretched_mask

HALF = 0.5
"""The traversability above which a pixel counts as drivable."""


@dataclass(frozen=True)
class WordScore:
    """Holds how well a word's attention tells its classes from the other labelled pixels.

    classes: their names, empty when no class matches the word. pixels: the number in these classes.
    auroc: None without a match, or when all or none of the labelled pixels are of these classes.
    """

    classes: tuple[str, ...]
    pixels: int
    auroc: float | None


@dataclass(frozen=True)
class DrivableScore:
    """Holds the scores of some frames.

    ground: IoU of traversability above 0.5. known: IoU of `Maps.drivable`, by which the rover judges.
    milliseconds: median time of encoding, attending and pooling.
    """

    images: int
    ground: Overlap
    known: Overlap
    words: dict[str, WordScore]
    milliseconds: float


def score_drivable(
    frames: Iterable[LabelledFrame],
    seeing: PerceiverRun,
    classes: LabelClasses,
    drivable: Sequence[str],
    matches: Matches,
) -> DrivableScore:
    """Score frames against the classes `drivable`, at the labels' size and without unlabelled pixels.

    Raises DatasetError when nothing is drivable by the labels nor by the maps; and PerceiverError.
    """
    ground, known, times = Overlap(), Overlap(), []
    rankings = {word: Ranking() for word, names in matches.items() if names}
    for frame in frames:
        seen = seeing.look(frame)
        times.append(seen.milliseconds)
        shape = frame.labels.shape
        counted = classes.labelled(frame.labels)
        truth = classes.mask(frame.labels, drivable)
        ground.add(frame.number, stretched(seen.maps.traversability, shape) > HALF, truth, counted)
        known.add(frame.number, stretched_mask(seen.maps.drivable, shape), truth, counted)
        for word, attention in zip(seeing.words, seen.maps.attention, strict=True):
            if word in rankings:
                fits, own = stretched(attention, shape), classes.mask(frame.labels, matches[word])
                rankings[word].add(fits[own & counted], fits[~own & counted])
    if ground.pooled is None:
        raise DatasetError("no pixel is labelled drivable or found so: name other classes with --drivable")
    words = {word: _word_score(matches.get(word, ()), rankings.get(word)) for word in seeing.words}
    return DrivableScore(len(times), ground, known, words, median(times))


def _word_score(classes: tuple[str, ...], ranking: Ranking | None) -> WordScore:
    if ranking is None:
        return WordScore((), 0, None)
    return WordScore(classes, ranking.positives, ranking.auroc)
