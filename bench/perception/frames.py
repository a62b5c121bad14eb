"""Reads the frames: held-out drives of home, other places (abroad), and which of them are clean."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from anytraverse.errors import AnyTraverseError
from anytraverse.evaluation.datasets import LabelledFrame, open_folder
from anytraverse.evaluation.labels import fold
from anytraverse.frame import Image
from anytraverse.judging import Settings
from anytraverse.look import read_picture
from anytraverse.training.folders import BLOCK, GAP

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
"""Beside the checkout."""

DRIVABLE = frozenset(
    (
        "smooth trail", "rough trail", "trail", "path", "road", "dirt", "drivable dirt", "soil", "sand",
        "gravel", "asphalt", "concrete", "drivable pavement", "mulch", "mud", "grass", "traversable grass",
        "low grass",
    )
)  # fmt: skip
"""Labels that mean drivable ground. Every other label is not drivable: plants, water, things, the sky."""
PLANTS = frozenset(
    (
        "bush", "tree", "low vegetation", "high vegetation", "vegetation", "crops", "forest", "high grass",
        "misc vegetation", "tree crown", "tree trunk", "tree foliage",
    )
)  # fmt: skip
NOTHING = frozenset(("sky", "background", "ego vehicle", "not trail", "other terrain", "nondrivable dirt"))
"""Labels of no thing: neither drivable, nor plants, nor something to be noticed."""
NOISY = frozenset(("obstacle",))
"""In the frames of home this label is mostly noise: it is not drivable, and nobody must notice it."""


@dataclass(frozen=True, eq=False)
class LabelledSet:
    """Holds the frames of one place in memory, and what their labels mean."""

    name: str
    frames: tuple[LabelledFrame, ...]
    names: tuple[str, ...]
    ignore: int

    def ids(self, *groups: frozenset[str]) -> list[int]:
        """Return the ids of the labels in these groups."""
        return [
            number
            for number, name in enumerate(self.names)
            if number != self.ignore and any(fold(name) in group for group in groups)
        ]

    @cached_property
    def drivable(self) -> list[int]:
        """Ids of drivable ground."""
        return self.ids(DRIVABLE)

    @cached_property
    def things(self) -> list[int]:
        """Ids of things, water among them, that a rover must not drive into."""
        other = {*self.ids(DRIVABLE, PLANTS, NOTHING, NOISY), self.ignore}
        return [number for number in range(len(self.names)) if number not in other]

    @property
    def clean(self) -> tuple[LabelledFrame, ...]:
        """The frames in whose region of interest every pixel is labelled as drivable."""
        return tuple(frame for frame in self.frames if self.roi_share(frame, self.drivable) == 1.0)

    def roi_share(self, frame: LabelledFrame, ids: Sequence[int]) -> float:
        """Return which share of the region of interest has one of these labels."""
        inside = Settings().region.mask(*frame.labels.shape)
        return float(np.isin(frame.labels[inside], ids).mean())


@dataclass(frozen=True, eq=False)
class Frames:
    """Holds all frames. home, abroad: labelled sets. trained: the other drives of home.

    clean: pictures without labels of drivable ground. strange: pictures without labels of other places.
    """

    home: tuple[LabelledSet, ...]
    abroad: tuple[LabelledSet, ...]
    trained: LabelledSet
    clean: tuple[Image, ...] = ()
    strange: tuple[Image, ...] = ()


def read_frames(data: Path, blocks: Sequence[int]) -> Frames:
    """Read the folder of frames that docs/builtin.md names. Raises AnyTraverseError, OSError."""
    trail = open_folder(data / "trail")
    every = tuple(trail.frames(print))
    home = tuple(
        LabelledSet(f"block {block}", _of_block(every, block), trail.classes.names, trail.classes.ignore)
        for block in blocks
    )
    if empty := [one.name for one in home if not one.frames]:
        raise AnyTraverseError(f"{data / 'trail'} has no frame of {empty[0]}: choose others with --blocks")
    abroad = tuple(_read_set(folder) for folder in sorted((data / "abroad").iterdir()) if folder.is_dir())
    rest = tuple(f for f in every if f.number // BLOCK not in blocks and f.number % BLOCK < BLOCK - GAP)
    trained = LabelledSet("other drives", rest, trail.classes.names, trail.classes.ignore)
    return Frames(home, abroad, trained, _pictures(data / "sequence"), _pictures(data / "frames"))


def _of_block(frames: Sequence[LabelledFrame], block: int) -> tuple[LabelledFrame, ...]:
    """Return a block's frames without its last ones, as `anytraverse.training.folders` splits them."""
    return tuple(f for f in frames if f.number // BLOCK == block and f.number % BLOCK < BLOCK - GAP)


def _read_set(folder: Path) -> LabelledSet:
    stored = open_folder(folder)
    return LabelledSet(folder.name, tuple(stored.frames(print)), stored.classes.names, stored.classes.ignore)


def _pictures(folder: Path) -> tuple[Image, ...]:
    return tuple(read_picture(str(path)) for path in sorted(folder.glob("*.jpg"))) if folder.is_dir() else ()


def spread(count: int, most: int) -> list[int]:
    """Choose at most `most` of `count` places, evenly."""
    return [index * count // most for index in range(most)] if count > most else list(range(count))
