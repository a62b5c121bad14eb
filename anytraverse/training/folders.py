"""Reads labelled folders into memory and splits them for training, validation and test.

A folder holds frames NNNN.jpg, label images NNNN.png of class ids, and classes.json with their names. Frames
of near numbers show nearly the same place. So they are split by blocks of numbers, with a gap between blocks,
and never at random.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import TrainingError
from anytraverse.evaluation.datasets import LabelledFrame, open_folder
from anytraverse.evaluation.labels import FILE as CLASSES_FILE
from anytraverse.frame import Image
from anytraverse.training.classes import CLASSES, UNLABELLED, translation

Labels = NDArray[np.uint8]

WIDTH = 400  # pixels to which frames are shrunk: enough for crops of the network's 256
BLOCK, GAP = 100, 25


@dataclass(frozen=True, eq=False)
class Labelled:
    """Holds one frame in memory: RGB (h, w, 3) uint8 and classes (h, w) uint8, some of them `UNLABELLED`."""

    number: int
    image: Image
    labels: Labels


@dataclass(frozen=True, eq=False)
class Folder:
    """Holds the frames of a labelled folder in the order of their numbers."""

    frames: tuple[Labelled, ...]

    def __len__(self) -> int:
        return len(self.frames)

    def of(self, blocks: Collection[int], gap: int = GAP, block: int = BLOCK) -> Folder:
        """Return the frames of these blocks of numbers, without the last `gap` numbers of each block."""
        kept = (f for f in self.frames if f.number // block in blocks and f.number % block < block - gap)
        return Folder(tuple(kept))

    @property
    def blocks(self) -> tuple[int, ...]:
        """The blocks of `BLOCK` numbers that hold frames."""
        return tuple(sorted({frame.number // BLOCK for frame in self.frames}))


@dataclass(frozen=True)
class Split:
    """Assigns blocks of numbers to validation, by which the calibration is chosen, and to the test.

    The test is only reported. All other blocks are for training. Raises TrainingError for a block in both.
    """

    validation: tuple[int, ...]
    test: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if both := set(self.validation) & set(self.test):
            raise TrainingError(f"block {min(both)} is for validation and for the test: choose one of them")

    def parts(self, folder: Folder) -> tuple[Folder, Folder, Folder]:
        """Split into training, validation and test. Raises TrainingError when a part has no frames.

        The test may be empty where no block is assigned to it.
        """
        rest = [block for block in folder.blocks if block not in (*self.validation, *self.test)]
        parts = folder.of(rest), folder.of(self.validation), folder.of(self.test)
        wanted = zip(("training", "validation", "test"), parts, (True, True, self.test), strict=True)
        for name, part, asked in wanted:
            if asked and not len(part):
                raise TrainingError(
                    f"no frames are left for {name}: the folder has the blocks "
                    f"{', '.join(map(str, folder.blocks))} of {BLOCK} numbers, "
                    f"the last {GAP} of each left out: number drives by hundreds"
                )
        return parts


def suggested(folder: Folder, test: tuple[int, ...] = ()) -> Split:
    """Choose every fifth block, at least one, for validation. test: blocks for the test. TrainingError."""
    blocks = [block for block in folder.blocks if block not in test]
    if len(blocks) < 2:
        raise TrainingError(
            f"all frames are in one block of {BLOCK} numbers: give every drive a hundred of its own, so that "
            "a drive can be kept for the score"
        )
    return Split(tuple(blocks[2 % len(blocks) :: 5]), test)


def read_folder(path: Path, width: int = WIDTH, torn: Callable[[str], None] = lambda _: None) -> Folder:
    """Read the labelled frames of a folder, at most `width` pixels wide; damaged ones are reported to `torn`.

    Raises TrainingError when no label is known, DatasetError, OSError.
    """
    stored = open_folder(path)
    table = translation(stored.classes.names)
    table[stored.classes.ignore] = UNLABELLED
    if (table == UNLABELLED).all():
        raise TrainingError(
            f"no label of {path / CLASSES_FILE} is known: {', '.join(stored.classes.names)}. "
            f"Name them by what they show, e.g. {', '.join(CLASSES[:-1])}"
        )
    return Folder(tuple(_shrunk(frame, table, width) for frame in stored.frames(torn)))


def _shrunk(frame: LabelledFrame, table: NDArray[np.uint8], width: int) -> Labelled:
    image, ids = frame.image, frame.labels
    if image.shape[1] > width:
        size = width, max(1, round(image.shape[0] * width / image.shape[1]))
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        ids = np.asarray(cv2.resize(ids, size, interpolation=cv2.INTER_NEAREST_EXACT), dtype=np.uint8)
    return Labelled(frame.number, image, table[ids])
