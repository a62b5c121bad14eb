"""Opens YCOR, the Yamaha-CMU Off-Road data set: an ATV's drives, with label images that have a palette.

The archive is that of theairlab.org/yamaha-offroad-dataset; layout, colours and names of classes are as
public readers of the data set state them. The label images are read by their colours, so that the order of
the palette does not matter. Not verified against the archive itself.
"""

from __future__ import annotations

from pathlib import Path

from anytraverse.evaluation.datasets.codes import ColourCode
from anytraverse.evaluation.datasets.dataset import Dataset, Selection
from anytraverse.evaluation.datasets.splits import ALL, Origin, numbered, unpacked

ORIGIN = Origin("YCOR", "https://theairlab.org/yamaha-offroad-dataset/", "see the terms there")
SPLITS = ("train", "valid")
_ARCHIVE = "yamaha_v0"
_COLOURS = {
    "smooth_trail": (178, 176, 153),
    "traversable_grass": (128, 255, 0),
    "rough_trail": (156, 76, 30),
    "puddle": (255, 0, 128),
    "obstacle": (255, 0, 0),
    "non_traversable_low_vegetation": (0, 160, 0),
    "high_vegetation": (40, 80, 0),
    "sky": (1, 88, 255),
}
CODE = ColourCode(_COLOURS, ORIGIN.title, void=[(255, 255, 255)])


def open_ycor(path: Path, split: str, selection: Selection) -> Dataset:
    """Find the frames of a split, or of both. Raises DatasetError, OSError."""
    ORIGIN.check_split(split, SPLITS)
    root = unpacked(ORIGIN.folder(path, f"{_ARCHIVE}.zip"), _ARCHIVE)
    pairs = []
    for part in SPLITS if split == ALL else (split,):
        folder = ORIGIN.folder(root / part, f"{_ARCHIVE}.zip")
        pairs += [(label.with_name("rgb.jpg"), label) for label in sorted(folder.glob("*/labels.png"))]
    files = numbered(pairs, root, ORIGIN.remedy)
    return Dataset(ORIGIN.title, root, CODE.classes, files, CODE, selection, remedy=ORIGIN.remedy)
