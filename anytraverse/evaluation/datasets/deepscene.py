"""Opens DeepScene, the Freiburg Forest: a robot's drives on forest paths, in six colours.

Layout and colours are those of the data set's README (deepscene.cs.uni-freiburg.de). Names of pictures and
label images agree up to the first "_", by which public readers pair them, too. That README has no colour
for what is not labelled, so that every other colour counts as such. Not verified, for want of the archive:
whether label images have the size of their pictures. Where only the size differs, they are scored at their
own.
"""

from __future__ import annotations

from pathlib import Path

from anytraverse.evaluation.datasets.codes import ColourCode
from anytraverse.evaluation.datasets.dataset import Dataset, Selection
from anytraverse.evaluation.datasets.splits import ALL, Origin, numbered, unpacked
from anytraverse.evaluation.labels import DatasetError

ORIGIN = Origin("DeepScene (Freiburg Forest)", "http://deepscene.cs.uni-freiburg.de", "see the terms there")
SPLITS = ("train", "test")
_ARCHIVE = "freiburg_forest_annotated"
_PICTURES, _LABELS = "rgb", "GT_color"
_COLOURS = {
    "road": (170, 170, 170),
    "grass": (0, 255, 0),
    "vegetation": (102, 102, 51),
    "tree": (0, 60, 0),
    "sky": (0, 120, 255),
    "obstacle": (0, 0, 0),
}
CODE = ColourCode(_COLOURS, ORIGIN.title, strict=False)


def open_deepscene(path: Path, split: str, selection: Selection) -> Dataset:
    """Find the frames of a split, or of both. Raises DatasetError, OSError."""
    ORIGIN.check_split(split, SPLITS)
    root = unpacked(ORIGIN.folder(path, f"{_ARCHIVE}.tar.gz"), _ARCHIVE)
    pairs = []
    for part in SPLITS if split == ALL else (split,):
        labels = _by_sample(ORIGIN.folder(root / part / _LABELS, f"{_ARCHIVE}.tar.gz"), ".png")
        pictures = _by_sample(ORIGIN.folder(root / part / _PICTURES, f"{_ARCHIVE}.tar.gz"), ".jpg")
        absent = root / part / _PICTURES
        pairs += [(pictures.get(name, absent / f"{name}_Clipped.jpg"), labels[name]) for name in labels]
    files = numbered(pairs, root, ORIGIN.remedy)
    return Dataset(
        ORIGIN.title, root, CODE.classes, files, CODE, selection, remedy=ORIGIN.remedy, one_size=False
    )


def _by_sample(folder: Path, suffix: str) -> dict[str, Path]:
    """Return the files by their names up to the first "_"."""
    found: dict[str, Path] = {}
    for file in sorted(folder.glob(f"*{suffix}")):
        name = file.stem.partition("_")[0]
        if name in found:
            raise DatasetError(f"{file} and {found[name].name} have the same sample's name: keep one")
        found[name] = file
    return found
