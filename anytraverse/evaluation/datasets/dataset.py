"""Reads the frames of a labelled data set, one at a time: pictures, and label images as class ids."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.decoding import PictureTooLargeError, decode
from anytraverse.evaluation.datasets.codes import LabelCode
from anytraverse.evaluation.labels import DatasetError, LabelClasses, Labels
from anytraverse.frame import Image
from anytraverse.regular_file import read_regular

MOST_FRAMES = 200_000
_MOST_BYTES = 64_000_000
_ENDS = {b"\xff\xd8": (b"\xff\xd9", 1024), b"\x89P": (b"IEND", 12)}
"""First bytes of JPEG and PNG files -> (end mark, how many last bytes hold it in a complete file)."""
_SAME_SHAPE = 0.02
"""By how much the aspect ratio of a label image of another size may differ from its picture's."""


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


@dataclass(frozen=True)
class FrameFiles:
    """Names the picture and the label image of a frame.

    number: the one in the name, or the place in the split as published, from 0.
    """

    number: int
    picture: Path
    label: Path


@dataclass(frozen=True, eq=False)
class LabelledFrame:
    """Holds a picture, RGB (height, width, 3) uint8, and its labels, class ids (height, width) uint8.

    name: the picture's path in the data set's folder. The labels have the picture's size, or in a data set
    that is published so, another size of the same shape.
    """

    number: int
    name: str
    image: Image
    labels: Labels


class Dataset:
    """Reads the chosen frames of a data set, in the order of their numbers, one at a time.

    title: its name for people. path: its folder. classes: what the ids in `LabelledFrame.labels` stand for.
    """

    def __init__(
        self,
        title: str,
        path: Path,
        classes: LabelClasses,
        files: Sequence[FrameFiles],
        code: LabelCode,
        selection: Selection,
        *,
        remedy: str,
        one_size: bool = True,
    ) -> None:
        """Choose from `files`, whose numbers must rise.

        code: how label images are written. remedy: what to do when a file is missing. one_size: whether a
        label image of another size than its picture is refused. Raises DatasetError when no frame is chosen,
        when there are more than 200,000, and when a picture or label image is missing.
        """
        if len(files) > MOST_FRAMES:
            raise DatasetError(f"{path} holds more than {MOST_FRAMES} frames: split it")
        by_number = {one.number: one for one in files}
        chosen = selection.of(list(by_number))
        if not chosen:
            numbers = f"{min(by_number)} to {max(by_number)}"
            raise DatasetError(f"{path} has no frame in the chosen range: its numbers go from {numbers}")
        self.title = title
        self.path = path
        self.classes = classes
        self._files = {number: by_number[number] for number in chosen}
        self._code = code
        self._one_size = one_size
        for one in self._files.values():
            for file, other, what in (
                (one.label, one.picture, "label image"),
                (one.picture, one.label, "picture"),
            ):
                if not file.is_file():
                    raise DatasetError(f"{other} has no {what} {self._missing(file, other)}: {remedy}")

    @staticmethod
    def _missing(file: Path, other: Path) -> str:
        return file.name if file.parent == other.parent else str(file)

    def __len__(self) -> int:
        return len(self._files)

    @property
    def numbers(self) -> tuple[int, ...]:
        """The chosen numbers, rising."""
        return tuple(self._files)

    @property
    def files(self) -> tuple[FrameFiles, ...]:
        """The files of the chosen frames, in the order of `numbers`."""
        return tuple(self._files.values())

    def name(self, number: int) -> str:
        """Return the path of a frame's picture in the data set's folder, with forward slashes."""
        return self._files[number].picture.relative_to(self.path).as_posix()

    def read(self, number: int) -> LabelledFrame:
        """Read one frame.

        Raises TornPictureError for a damaged file, DatasetError for labels that do not fit, OSError.
        """
        one = self._files[number]
        image = _decoded(one.picture, cv2.IMREAD_COLOR)
        labels = self._code.ids(_decoded(one.label, self._code.flags), one.label)
        if not (labels.shape == image.shape[:2] or (not self._one_size and _alike(labels, image))):
            raise DatasetError(
                f"{one.label} is {_size(labels)} and {one.picture.name} is {_size(image)}: "
                "save label images in the size of their pictures"
            )
        rgb = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)
        return LabelledFrame(number, self.name(number), rgb, labels)

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


def _decoded(file: Path, flags: int) -> NDArray[np.uint8]:
    data = read_regular(file, _MOST_BYTES + 1)
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


def _alike(labels: Labels, image: NDArray[np.uint8]) -> bool:
    """Return whether both have nearly the same aspect ratio."""
    ratio = labels.shape[0] * image.shape[1] / (labels.shape[1] * image.shape[0])
    return bool(abs(ratio - 1) <= _SAME_SHAPE)


def _size(picture: NDArray[np.uint8]) -> str:
    return f"{picture.shape[1]}x{picture.shape[0]}"
