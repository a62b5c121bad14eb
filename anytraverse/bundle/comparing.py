"""Compares masks and embeddings of the same frames: int8's with fp32's, to decide whether int8 may run.

The main figure is each word's IoU, pooled over all its masks. A mean over masks would be dominated by masks
of a few pixels; an IoU pooled over all words would be dominated by the ground and hide an error on a rock. A
lower limit for single masks makes one broken frame count among many good ones. Where fp32 marks nothing or
everything, an IoU has no meaning: there only a small share of the picture may differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]

LEVEL = 0.5
"""A mask holds the pixels whose attention is at least this."""
SPECK = 0.001
"""A mask that covers less of the picture counts as empty; one that leaves less uncovered counts as full."""
LARGE = 0.01
"""`LEAST_SINGLE_IOU` applies to masks that cover at least this share of the picture."""
FEWEST_MASKS = 10
LEAST_IOU = 0.97
LEAST_SINGLE_IOU = 0.90
MOST_STRAY = 0.01
LEAST_COSINE = 0.99
LEAST_GAIN = 1.1


@dataclass(frozen=True, eq=False)
class TimedOutputs:
    """Holds maps (words, h, w) in [0, 1], an embedding (d,) of length 1, and milliseconds for both."""

    maps: Array
    embedding: Array
    milliseconds: float


@dataclass
class BundleComparison:
    """Collects the differences, frame by frame.

    failure: why int8 fails whatever the figures, or "". stray: the largest share of a picture that differs
    where fp32's mask is empty or full. cosine: the smallest between the embeddings of a frame.
    """

    words: Sequence[str]
    frames: int = 0
    failure: str = ""
    stray: float = 0.0
    cosine: float = 1.0
    _single: dict[str, list[float]] = field(default_factory=dict)
    _large: list[float] = field(default_factory=list)
    _both: dict[str, int] = field(default_factory=dict)
    _either: dict[str, int] = field(default_factory=dict)

    def add(self, fp32: TimedOutputs, int8: TimedOutputs) -> None:
        """Add the results of both variants for one frame."""
        self.frames += 1
        if not (np.isfinite(int8.maps).all() and np.isfinite(int8.embedding).all()):
            self.failure = "it gave numbers that are not finite"
        elif fp32.maps.shape != int8.maps.shape or fp32.embedding.shape != int8.embedding.shape:
            self.failure = "its outputs are of another size"
        else:
            self.add_maps(fp32.maps, int8.maps)
            self.cosine = min(self.cosine, max(-1.0, float(fp32.embedding @ int8.embedding)))

    def add_maps(self, reference: Array, other: Array) -> None:
        """Add the maps of one frame, both (words, h, w)."""
        for word, mask, another in zip(self.words, reference >= LEVEL, other >= LEVEL, strict=True):
            share = float(mask.mean())
            if SPECK <= share <= 1 - SPECK:
                self._add_masks(word, share, int((mask & another).sum()), int((mask | another).sum()))
            else:
                self.stray = max(self.stray, float((mask != another).mean()))

    def _add_masks(self, word: str, share: float, both: int, either: int) -> None:
        self._single.setdefault(word, []).append(both / either)
        if share >= LARGE:
            self._large.append(both / either)
        self._both[word] = self._both.get(word, 0) + both
        self._either[word] = self._either.get(word, 0) + either

    @property
    def masks(self) -> int:
        """The number of masks compared."""
        return len(self._ious)

    @property
    def by_word(self) -> dict[str, tuple[int, float]]:
        """Word -> its number of masks, and their pooled IoU; words without masks are left out."""
        return {
            word: (len(self._single[word]), both / self._either[word]) for word, both in self._both.items()
        }

    @property
    def worst_word(self) -> tuple[str, float] | None:
        """The word with the smallest pooled IoU, and that IoU; None without masks."""
        pooled = [(word, iou) for word, (_, iou) in self.by_word.items()]
        return min(pooled, key=lambda item: item[1]) if pooled else None

    @property
    def iou_worst(self) -> float | None:
        """The smallest IoU of a single mask; None without masks."""
        return min(self._ious) if self._ious else None

    @property
    def iou_mean(self) -> float | None:
        """The mean IoU of single masks; None without masks."""
        return sum(self._ious) / len(self._ious) if self._ious else None

    @property
    def _ious(self) -> list[float]:
        return [iou for ious in self._single.values() for iou in ious]

    def verdict(self, gain: float) -> tuple[bool, str]:
        """Return whether int8 may run, and the reason. gain: fp32's time for a step over int8's."""
        worst, floor = self.worst_word, min(self._large, default=1.0)
        if self.failure:
            return False, self.failure
        if worst is None or self.masks < FEWEST_MASKS:
            return False, (
                f"only {self.masks} masks to compare, at least {FEWEST_MASKS} are needed: "
                "give more frames, or --words for what they show"
            )
        word, iou = worst
        if iou < LEAST_IOU:
            return False, f'IoU of "{word}" with fp32 is {iou:.3f}, at least {LEAST_IOU} is needed'
        if floor < LEAST_SINGLE_IOU:
            return False, f"IoU of one mask is {floor:.3f}, at least {LEAST_SINGLE_IOU} is needed"
        if self.stray > MOST_STRAY:
            return False, f"{self.stray:.1%} of a picture is marked otherwise where fp32 marks nothing or all"
        if self.cosine < LEAST_COSINE:
            return False, f"cosine of embeddings is {self.cosine:.4f}, at least {LEAST_COSINE} is needed"
        if gain < LEAST_GAIN:
            return False, f"it is {gain:.2f} times as fast as fp32, at least {LEAST_GAIN} is needed to pay"
        return True, f'worst IoU {iou:.3f} ("{word}"), {gain:.1f} times as fast as fp32'
