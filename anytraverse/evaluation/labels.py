"""Reads `classes.json`: what the ids in a label image stand for."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import AnyTraverseError
from anytraverse.regular_file import read_regular

FILE = "classes.json"
FORM = '{"ignore": 255, "classes": ["grass", "trail"]}, where the place in the list is the id'
_MOST_BYTES = 1_000_000

Labels = NDArray[np.uint8]
"""A class id for each pixel, (height, width), uint8."""
Mask = NDArray[np.bool_]


class DatasetError(AnyTraverseError, ValueError):
    """Reports a labelled folder, or a choice from it, that cannot be scored."""


@dataclass(frozen=True)
class LabelClasses:
    """Holds the classes of a data set.

    names: as written, at most 256; the index is the id, classes of the same name count as one, and an id with
    an empty name is none.
    ignore: the id of pixels that are not labelled, 0 to 255.
    """

    names: tuple[str, ...]
    ignore: int = 255

    @cached_property
    def known(self) -> dict[str, str]:
        """Folded name -> the name as written first, without the ignored id. See `fold`."""
        written: dict[str, str] = {}
        for number, name in enumerate(self.names):
            if number != self.ignore and fold(name):
                written.setdefault(fold(name), name)
        return written

    @property
    def listed(self) -> str:
        """The names as a person is told them."""
        return ", ".join(self.known.values())

    @cached_property
    def _allowed(self) -> Mask:
        allowed = np.zeros(256, dtype=np.bool_)
        allowed[: len(self.names)] = [bool(fold(name)) for name in self.names]
        allowed[self.ignore] = True
        return allowed

    def choose(self, names: Iterable[str]) -> tuple[str, ...]:
        """Return the classes of these names, as written in the data set, each once.

        Raises DatasetError for a name that is not a class, and for an empty list.
        """
        folded = tuple(dict.fromkeys(fold(name) for name in names if name.strip()))
        for name in folded:
            if name not in self.known:
                raise DatasetError(f'"{name}" is not a class of the labels: choose from {self.listed}')
        if not folded:
            raise DatasetError(f"no class is named: choose from {self.listed}, separated by commas")
        return tuple(self.known[name] for name in folded)

    def mask(self, labels: Labels, names: Iterable[str]) -> Mask:
        """Mark the pixels of these classes, (height, width)."""
        wanted = {fold(name) for name in names}
        table = np.zeros(256, dtype=np.bool_)
        table[: len(self.names)] = [fold(name) in wanted for name in self.names]
        table[self.ignore] = False
        inside: Mask = table[labels]
        return inside

    def labelled(self, labels: Labels) -> Mask:
        """Mark the pixels that are labelled, (height, width)."""
        return np.asarray(labels != self.ignore)

    def stray(self, labels: Labels) -> int | None:
        """Return the lowest id in `labels` that has no class and is not `ignore`, or None."""
        ids = np.flatnonzero(np.bincount(labels.ravel(), minlength=256))
        strays = ids[~self._allowed[ids]]
        return int(strays[0]) if strays.size else None


def fold(name: str) -> str:
    """Return a name as classes and words are compared: in lower case, with spaces for _ and -."""
    return " ".join(name.replace("_", " ").replace("-", " ").lower().split())


def read_classes(folder: Path) -> LabelClasses:
    """Read `classes.json` of a folder. Raises DatasetError, which says what to write, and OSError."""
    file = folder / FILE
    try:
        data = read_regular(file, _MOST_BYTES + 1)
    except FileNotFoundError:
        raise DatasetError(f"{file} is missing: write {FORM}") from None
    try:
        if len(data) > _MOST_BYTES:
            raise ValueError("too large")
        found = json.loads(data)
    except (ValueError, RecursionError):
        raise DatasetError(f"{file} is not JSON: write {FORM}") from None
    return _checked(file, found)


def _checked(file: Path, found: Any) -> LabelClasses:
    names = found.get("classes") if isinstance(found, dict) else None
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise DatasetError(f'{file} has no list of names under "classes": write {FORM}')
    if not 1 <= len(names) <= 256:
        raise DatasetError(f"{file} names {len(names)} classes: 1 to 256 fit in a label image")
    ignore = found.get("ignore", 255)
    if type(ignore) is not int or not 0 <= ignore <= 255:
        raise DatasetError(
            f'{file} has {ignore!r} under "ignore": give the id of unlabelled pixels, 0 to 255'
        )
    return LabelClasses(tuple(names), ignore)
