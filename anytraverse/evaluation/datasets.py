"""Reads a labelled folder: pictures `NNNN.jpg`, label images `NNNN.png` of class ids, and `classes.json`."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.decoding import PictureTooLargeError, decode
from anytraverse.evaluation.labels import Classes, DatasetError, Labels, read_classes
from anytraverse.frame import Image

_NAME = re.compile(r"([0-9]{1,9})\.(jpg|png)")
_MOST_FRAMES = 200_000
_MOST_BYTES = 64_000_000
_ENDS = {b"\xff\xd8": (b"\xff\xd9", 1024), b"\x89P": (b"IEND", 12)}
"""First bytes of JPEG and PNG files -> (end mark, how many last bytes hold it in a complete file)."""


class TornPictureError(DatasetError):
    """Reports a picture or label image that is cut off or damaged; other files may be good."""


@dataclass(frozen=True)
class Selection:
    """Selects frames: numbers from `first` to `last`, both included, and of these every `every`-th.

    Raises DatasetError for a range that holds no number, and for `every` below 1.
    """

    first: int | None = None
    last: int | None = None
    every: int = 1

    def __post_init__(self) -> None:
        if self.first is not None and self.last is not None and self.first > self.last:
            raise DatasetError(f"no number lies from {self.first} to {self.last}: give the smaller one first")
        if self.every < 1:
            raise DatasetError(f"every {self.every} is no step: give 1 or more")

    def of(self, numbers: list[int]) -> list[int]:
        """Return the selected ones of `numbers`, which must be in rising order."""
        low = -math.inf if self.first is None else self.first
        high = math.inf if self.last is None else self.last
        return [number for number in numbers if low <= number <= high][:: self.every]


@dataclass(frozen=True, eq=False)
class LabelledFrame:
    """Holds a picture, RGB (height, width, 3) uint8, and its labels, class ids (height, width) uint8."""

    number: int
    name: str
    image: Image
    labels: Labels


class LabelledFolder:
    """Reads the chosen frames of a folder, in the order of their numbers, one at a time.

    Files with other names are ignored.
    """

    def __init__(self, path: Path, selection: Selection | None = None) -> None:
        """Raises DatasetError without frames, or when a picture or label image is missing; and OSError."""
        if not path.is_dir():
            raise DatasetError(f"{path} is not a folder: give one with NNNN.jpg, NNNN.png and classes.json")
        self.path = path
        self.classes: Classes = read_classes(path)
        pictures, labels = _numbered(path)
        if not pictures:
            raise DatasetError(f"{path} holds no picture NNNN.jpg: name pictures by number, as 0001.jpg")
        chosen = (selection or Selection()).of(sorted(pictures.keys() | labels.keys()))
        if not chosen:
            numbers = f"{min(pictures)} to {max(pictures)}"
            raise DatasetError(f"{path} has no frame in the chosen range: its numbers go from {numbers}")
        for number in chosen:
            if number not in labels:
                raise DatasetError(_missing_half(pictures[number], "label image", ".png"))
            if number not in pictures:
                raise DatasetError(_missing_half(labels[number], "picture", ".jpg"))
        self._files = {number: (pictures[number], labels[number]) for number in chosen}

    def __len__(self) -> int:
        return len(self._files)

    @property
    def numbers(self) -> tuple[int, ...]:
        """The chosen numbers, rising."""
        return tuple(self._files)

    def read(self, number: int) -> LabelledFrame:
        """Read one frame.

        Raises TornPictureError for a damaged file, DatasetError for labels that do not fit, OSError.
        """
        picture, label = self._files[number]
        image = _decoded(picture, cv2.IMREAD_COLOR)
        labels = _decoded(label, cv2.IMREAD_UNCHANGED)
        if labels.ndim != 2 or labels.dtype != np.uint8:
            raise DatasetError(
                f"{label} is not one channel of 8 bits: save class ids in grey, not colours or a palette"
            )
        if labels.shape != image.shape[:2]:
            raise DatasetError(
                f"{label} is {_size(labels)} and {picture.name} is {_size(image)}: "
                "save label images in the size of their pictures"
            )
        stray = self.classes.stray(labels)
        if stray is not None:
            raise DatasetError(
                f"{label} holds the id {stray}, which classes.json does not name: "
                f"add it there, or write {self.classes.ignore} for what is not labelled"
            )
        rgb = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)
        return LabelledFrame(number, picture.name, rgb, labels)

    def frames(self, torn: Callable[[str], None]) -> Iterator[LabelledFrame]:
        """Yield all chosen frames; damaged ones are reported to `torn` and skipped.

        Raises as `read` does, and DatasetError when every frame is damaged.
        """
        whole = 0
        for number in self._files:
            try:
                frame = self.read(number)
            except TornPictureError as error:
                torn(str(error))
                continue
            whole += 1
            yield frame
        if not whole:
            raise DatasetError(f"{self.path} has no frame that can be read: copy the folder again")


def _numbered(path: Path) -> tuple[dict[int, Path], dict[int, Path]]:
    """Return the pictures and the label images by their number."""
    found: dict[str, dict[int, Path]] = {"jpg": {}, "png": {}}
    for file in path.iterdir():
        match = _NAME.fullmatch(file.name)
        if match is None:
            continue
        number, files = int(match[1]), found[match[2]]
        if number in files:
            raise DatasetError(f"{file} has the same number as {files[number].name}: rename one")
        if len(files) == _MOST_FRAMES:
            raise DatasetError(f"{path} holds more than {_MOST_FRAMES} frames: split it")
        files[number] = file
    return found["jpg"], found["png"]


def _decoded(file: Path, flags: int) -> NDArray[np.uint8]:
    with file.open("rb") as stream:
        data = stream.read(_MOST_BYTES + 1)
    if len(data) > _MOST_BYTES:
        raise DatasetError(f"{file} is larger than {_MOST_BYTES // 1_000_000} MB: make the picture smaller")
    mark, reach = _ENDS.get(data[:2], (b"", 1))
    try:
        whole = bool(data) and mark in data[-reach:]
        picture = decode(data, flags) if whole else None
    except PictureTooLargeError as error:
        raise DatasetError(f"{file}: {error}") from error
    if picture is None:
        raise TornPictureError(f"{file.name}: torn, or not a picture")
    return picture


def _missing_half(file: Path, what: str, suffix: str) -> str:
    missing = file.with_suffix(suffix).name
    return f"{file} has no {what} {missing}: add it, or leave the frame out with --from and --to"


def _size(picture: NDArray[np.uint8]) -> str:
    return f"{picture.shape[1]}x{picture.shape[0]}"
