"""Turns label images as they are stored, ids in grey or colours, into class ids."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.evaluation.labels import DatasetError, LabelClasses, Labels

Colour = tuple[int, int, int]
IGNORED = 255
_MOST_STRAY = 0.01
"""Share of a label image's pixels that may have a colour of no class: they count as not labelled."""


class LabelCode(Protocol):
    """Knows how a data set writes class ids into label images."""

    @property
    def flags(self) -> int:
        """The flags with which `cv2.imdecode` reads the label image."""

    def ids(self, stored: NDArray[Any], file: Path) -> Labels:
        """Return class ids, (height, width) uint8, of a decoded label image. Raises DatasetError."""


class IdCode:
    """Reads label images in grey whose pixels are the ids themselves. source: who names the ids."""

    flags = int(cv2.IMREAD_UNCHANGED)

    def __init__(self, classes: LabelClasses, source: str, remedy: str) -> None:
        self._classes = classes
        self._source = source
        self._remedy = remedy

    def ids(self, stored: NDArray[Any], file: Path) -> Labels:
        """As in `LabelCode`. Raises DatasetError for colours, and for an id without a class."""
        if stored.ndim != 2 or stored.dtype != np.uint8:
            raise DatasetError(
                f"{file} is not one channel of 8 bits: save class ids in grey, not colours or a palette"
            )
        labels: Labels = stored
        stray = self._classes.stray(labels)
        if stray is not None:
            raise DatasetError(
                f"{file} holds the id {stray}, which {self._source} does not name: {self._remedy}"
            )
        return labels


class ColourCode:
    """Reads label images in colours, or with a palette, by their colours.

    classes: the names in the order of `colours`; the id of what is not labelled is `IGNORED`.
    """

    flags = int(cv2.IMREAD_COLOR)

    def __init__(
        self, colours: Mapping[str, Colour], title: str, void: Sequence[Colour] = (), *, strict: bool = True
    ) -> None:
        """colours: class -> red, green, blue. void: colours of what is not labelled.

        strict: whether a label image of which more than 1 % has other colours is refused; they count as not
        labelled. False is for a data set in which what is not labelled has no colour of its own.
        """
        self.classes = LabelClasses(tuple(colours), IGNORED)
        self._title = title
        self._strict = strict
        ids = {_packed(colour): number for number, colour in enumerate(colours.values())}
        ids |= {_packed(colour): IGNORED for colour in void}
        self._known = np.array(sorted(ids), dtype=np.uint32)
        self._ids = np.array([ids[int(colour)] for colour in self._known], dtype=np.uint8)

    def ids(self, stored: NDArray[Any], file: Path) -> Labels:
        """As in `LabelCode`. Raises DatasetError when the colours are another data set's."""
        blue, green, red = (stored[..., channel].astype(np.uint32) for channel in range(3))
        packed = red << 16 | green << 8 | blue
        places = np.searchsorted(self._known, packed).clip(max=len(self._known) - 1)
        found = self._known[places] == packed
        strays = found.size - int(np.count_nonzero(found))
        if strays == found.size or (self._strict and strays > _MOST_STRAY * found.size):
            colours, counts = np.unique(packed[~found], return_counts=True)
            common = int(colours[counts.argmax()])
            raise DatasetError(
                f"{file}: {strays / found.size:.0%} of it has colours of no class of {self._title}, mostly "
                f"{(common >> 16, common >> 8 & 255, common & 255)}: this is no label image in its colours"
            )
        labels: Labels = np.where(found, self._ids[places], np.uint8(IGNORED))
        return labels


def _packed(colour: Colour) -> int:
    red, green, blue = colour
    return red << 16 | green << 8 | blue
