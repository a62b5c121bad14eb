"""Opens a folder of your own: pictures `NNNN.jpg`, label images `NNNN.png` of ids, and `classes.json`."""

from __future__ import annotations

import re
from pathlib import Path

from anytraverse.evaluation.datasets import dataset
from anytraverse.evaluation.datasets.codes import IdCode
from anytraverse.evaluation.datasets.dataset import Dataset, FrameFiles, Selection
from anytraverse.evaluation.datasets.splits import ALL
from anytraverse.evaluation.labels import FILE, DatasetError, read_classes

_NAME = re.compile(r"([0-9]{1,9})\.(jpg|png)")


def open_folder(path: Path, split: str = ALL, selection: Selection | None = None) -> Dataset:
    """Find the frames of a folder. Files with other names are ignored.

    Raises DatasetError without frames, when a picture or label image is missing, and for a split, since a
    folder has none; and OSError.
    """
    if split != ALL:
        raise DatasetError(f'a folder has no split "{split}": choose frames with --from and --to')
    if not path.is_dir():
        raise DatasetError(f"{path} is not a folder: give one with NNNN.jpg, NNNN.png and {FILE}")
    classes = read_classes(path)
    pictures, labels = _numbered(path)
    if not pictures:
        raise DatasetError(f"{path} holds no picture NNNN.jpg: name pictures by number, as 0001.jpg")
    files = [
        FrameFiles(
            number,
            pictures.get(number) or labels[number].with_suffix(".jpg"),
            labels.get(number) or pictures[number].with_suffix(".png"),
        )
        for number in sorted(pictures.keys() | labels.keys())
    ]
    code = IdCode(classes, FILE, f"add it there, or write {classes.ignore} for what is not labelled")
    remedy = "add it, or leave the frame out with --from and --to"
    return Dataset(path.resolve().name, path, classes, files, code, selection or Selection(), remedy=remedy)


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
        if len(files) == dataset.MOST_FRAMES:
            raise DatasetError(f"{path} holds more than {dataset.MOST_FRAMES} frames: split it")
        files[number] = file
    return found["jpg"], found["png"]
