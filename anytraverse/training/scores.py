"""Scores a network as it is used on a rover: drivable IoU at 0.5, AUROC of classes, uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.frame import Image
from anytraverse.perception.builtin.attention import attention, posteriors
from anytraverse.perception.builtin.calibration import Calibration, Floats
from anytraverse.perception.builtin.network import Outputs
from anytraverse.training.classes import CLASSES, DRIVABLE, UNKNOWN, UNLABELLED
from anytraverse.training.folders import Folder, Labels

Flags = NDArray[np.bool_]
Network = Callable[[Image], Outputs]
"""A frame of any size -> the network's outputs."""

SCALE = 2  # labels are scored at every second pixel of the frames in memory

VIEWS: dict[str, tuple[float, float, float]] = {
    "as filmed": (1.0, 1.0, 1.0),
    "half the light": (0.5, 0.5, 0.5),
    "1.7 times the light": (1.7, 1.7, 1.7),
    "warm": (1.2, 1.0, 0.8),
    "cold": (0.8, 1.0, 1.2),
}
"""Gains of red, green and blue under which a network is scored."""


@dataclass(frozen=True)
class Score:
    """Holds the score of a network.

    iou: of drivable ground at 0.5, pooled over all pixels; iou_mean: its mean over frames.
    unexplained: share of drivable pixels whose uncertainty is above 0.5.
    """

    iou: float
    iou_mean: float
    unexplained: float


def gained(image: Image, gains: tuple[float, float, float]) -> Image:
    """Multiply the channels of a frame, and clip to 0 to 255 as a sensor does."""
    return np.asarray(np.clip(image * np.asarray(gains, dtype=np.float32), 0, 255), dtype=np.uint8)


def outputs(
    network: Network, folder: Folder, gains: tuple[float, float, float] = (1.0, 1.0, 1.0)
) -> list[tuple[Outputs, Labels]]:
    """Run the network on each frame; return its outputs and its labels at `SCALE`."""
    return [(network(gained(f.image, gains)), f.labels[::SCALE, ::SCALE]) for f in folder.frames]


def score(results: Iterable[tuple[Outputs, Labels]], calibration: Calibration) -> Score:
    """Calculate the score when all known classes are asked for by name."""
    both = either = unexplained = ground = 0
    each = []
    for made, labels in results:
        traversability, uncertainty = maps(made, calibration, labels.shape)
        judged, true = labels != UNLABELLED, np.isin(labels, DRIVABLE)
        found = (traversability >= 0.5) & judged
        both, either = both + (found & true).sum(), either + (found | true).sum()
        unexplained, ground = unexplained + (uncertainty[true] > 0.5).sum(), ground + true.sum()
        if (found | true).any():
            each.append(float((found & true).sum() / (found | true).sum()))
    return Score(
        float(both / max(either, 1)), float(np.mean(each or [0.0])), float(unexplained / max(ground, 1))
    )


def maps(made: Outputs, calibration: Calibration, shape: tuple[int, ...]) -> tuple[Floats, Floats]:
    """Make traversability and uncertainty maps of a shape (rows, columns), with a word for every class."""
    found = attention(posteriors(made, calibration), _WORDS, [weight > 0 for weight in _WEIGHTS])
    signed = found * _WEIGHTS[:, None, None]
    best = np.take_along_axis(signed, np.abs(signed).argmax(axis=0)[None], axis=0)[0]
    return resized(np.clip(best, 0, 1), shape), resized(1 - found.max(axis=0), shape)


def _words() -> tuple[Floats, Floats]:
    """Make a word "trail" for its two classes and one for each other known class: (N, C), weights (N,)."""
    table = np.eye(len(CLASSES), dtype=np.float32)[1:UNKNOWN]
    table[0, 0] = 1.0
    weights = np.array([1.0 if index in DRIVABLE else -1.0 for index in range(1, UNKNOWN)], dtype=np.float32)
    return table, weights


_WORDS, _WEIGHTS = _words()


def resized(values: Floats, shape: tuple[int, ...]) -> Floats:
    """Resize a map to (rows, columns), linearly."""
    return np.asarray(
        cv2.resize(values, (shape[1], shape[0]), interpolation=cv2.INTER_LINEAR), dtype=np.float32
    )


def auroc(scores: Floats, true: Flags) -> float:
    """Calculate the chance that a true one scores above a false one, ties counting half; NaN without both."""
    positive, count = int(true.sum()), len(scores)
    if positive in {0, count}:
        return float("nan")
    _, inverse, counts = np.unique(scores, return_inverse=True, return_counts=True)
    ranks = np.cumsum(counts) - (counts - 1) / 2
    total = float(ranks[inverse][true].sum())
    return (total - positive * (positive + 1) / 2) / (positive * (count - positive))


def class_ranks(results: Iterable[tuple[Outputs, Labels]], calibration: Calibration) -> dict[str, float]:
    """Calculate the AUROC of each class's posterior against all other labels."""
    found: list[Floats] = []
    true: list[Labels] = []
    for made, labels in results:
        probabilities = posteriors(made, calibration)
        small = np.stack([resized(one, labels.shape) for one in probabilities], axis=-1)[::2, ::2]
        judged = labels[::2, ::2] != UNLABELLED
        found.append(small[judged])
        true.append(labels[::2, ::2][judged])
    scores, names = np.concatenate(found), np.concatenate(true)
    return {name: auroc(scores[:, index], names == index) for index, name in enumerate(CLASSES)}
