"""Labelled folders: frames NNNN.jpg, label images NNNN.png of class ids, and classes.json with their names.

Frames of near numbers show nearly the same place. So they are split by blocks of numbers, with a gap between
blocks, and never at random.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import TrainingError
from anytraverse.frame import Image
from anytraverse.training.classes import UNLABELLED, class_of, translation

Labels = NDArray[np.uint8]

WIDTH = 400  # pixels at which frames are kept: enough for crops of the network's 256
BLOCK, GAP = 100, 25
FORMATS = (".jpg", ".jpeg", ".png")


@dataclass(frozen=True, eq=False)
class Labelled:
    """One frame in memory: RGB (h, w, 3) uint8 and classes (h, w) uint8, `UNLABELLED` where there is none."""

    number: int
    image: Image
    labels: Labels


@dataclass(frozen=True, eq=False)
class Folder:
    """The frames of a labelled folder in order of their numbers."""

    frames: tuple[Labelled, ...]

    def __len__(self) -> int:
        return len(self.frames)

    def of(self, blocks: Collection[int], gap: int = GAP, block: int = BLOCK) -> Folder:
        """The frames of these blocks of numbers, without the last `gap` numbers of each."""
        kept = (f for f in self.frames if f.number // block in blocks and f.number % block < block - gap)
        return Folder(tuple(kept))

    @property
    def blocks(self) -> tuple[int, ...]:
        """The blocks of `BLOCK` numbers that hold frames."""
        return tuple(sorted({frame.number // BLOCK for frame in self.frames}))


@dataclass(frozen=True)
class Split:
    """Blocks of numbers to choose by (validation) and to report only (test); all others are for training.

    Raises TrainingError when a block is in both.
    """

    validation: tuple[int, ...]
    test: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if both := set(self.validation) & set(self.test):
            raise TrainingError(f"block {min(both)} is for validation and for the test: choose one of them")

    def parts(self, folder: Folder) -> tuple[Folder, Folder, Folder]:
        """For training, for validation, for the test. TrainingError when one that is asked for is empty."""
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


def suggested(folder: Folder) -> Split:
    """Every fifth block for validation, at least one, and none for a test."""
    blocks = folder.blocks
    if len(blocks) < 2:
        raise TrainingError(
            f"all frames are in one block of {BLOCK} numbers: give every drive a hundred of its own, so that "
            "a drive can be kept for the score"
        )
    return Split(tuple(blocks[2 % len(blocks) :: 5]))


def read_folder(path: Path, width: int = WIDTH) -> Folder:
    """The labelled frames of a folder, at most `width` pixels wide. Raises TrainingError."""
    names = _names(path)
    table = translation(names)
    frames = []
    for picture in sorted(p for p in path.iterdir() if p.suffix.lower() in FORMATS[:2]):
        label = picture.with_suffix(".png")
        if not picture.stem.isdecimal() or not label.is_file():
            continue
        frames.append(_frame(picture, label, table, width))
    if not frames:
        raise TrainingError(f"{path} has no frame NNNN.jpg with a label image NNNN.png beside it")
    return Folder(tuple(frames))


def _names(path: Path) -> Sequence[str]:
    try:
        names = json.loads((path / "classes.json").read_text(encoding="utf-8"))["classes"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise TrainingError(
            f'{path} needs a classes.json that names its label ids: {{"classes": ["grass", ...]}} ({error})'
        ) from error
    if (
        not isinstance(names, list)
        or not all(isinstance(name, str) for name in names)
        or len(names) > UNLABELLED
    ):
        raise TrainingError(f"{path}/classes.json: classes must be a list of at most {UNLABELLED} names")
    if all(class_of(name) is None for name in names):
        raise TrainingError(f"no label of {path}/classes.json is known: {', '.join(names)}")
    return names


def _frame(picture: Path, label: Path, table: NDArray[np.uint8], width: int) -> Labelled:
    image = cv2.imread(str(picture), cv2.IMREAD_COLOR)
    ids = cv2.imread(str(label), cv2.IMREAD_UNCHANGED)
    if image is None or ids is None or ids.ndim != 2 or ids.shape != image.shape[:2]:
        raise TrainingError(
            f"{picture.name} and {label.name}: a picture and a grey image of class ids of its size"
        )
    size = width, round(image.shape[0] * width / image.shape[1])
    if image.shape[1] > width:
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        ids = cv2.resize(ids, size, interpolation=cv2.INTER_NEAREST_EXACT)
    rgb = np.ascontiguousarray(image[..., ::-1], dtype=np.uint8)
    return Labelled(int(picture.stem), rgb, table[np.asarray(ids, dtype=np.uint8)])
