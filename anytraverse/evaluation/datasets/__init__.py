"""Opens labelled data sets by name, as "rellis:DIR". One file a kind."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from anytraverse.evaluation.datasets.dataset import (
    Dataset,
    FrameFiles,
    LabelledFrame,
    Selection,
    TornPictureError,
)
from anytraverse.evaluation.datasets.deepscene import open_deepscene
from anytraverse.evaluation.datasets.folder import open_folder
from anytraverse.evaluation.datasets.rellis import open_rellis
from anytraverse.evaluation.datasets.rugd import open_rugd
from anytraverse.evaluation.datasets.splits import ALL
from anytraverse.evaluation.datasets.ycor import open_ycor
from anytraverse.evaluation.labels import DatasetError

__all__ = [
    "ALL",
    "FOLDER",
    "KINDS",
    "Dataset",
    "FrameFiles",
    "LabelledFrame",
    "Selection",
    "TornPictureError",
    "kind_and_path",
    "open_dataset",
    "open_folder",
]

FOLDER = "folder"
KINDS: Mapping[str, Callable[[Path, str, Selection], Dataset]] = {
    FOLDER: open_folder,
    "rellis": open_rellis,
    "rugd": open_rugd,
    "deepscene": open_deepscene,
    "ycor": open_ycor,
}
"""Kind -> its function, which finds the files of a split."""


def kind_and_path(name: str) -> tuple[str, Path]:
    """Split "rellis:DIR" into kind and path; a folder's name alone is a folder. Raises DatasetError."""
    kind, colon, path = name.partition(":")
    if not colon or Path(name).is_dir():
        return FOLDER, Path(name)
    if kind not in KINDS or not path:
        kinds = ", ".join(f"{known}:DIR" for known in KINDS)
        raise DatasetError(f'"{name}" is no data set: write one of {kinds}')
    return kind, Path(path).expanduser()


def open_dataset(name: str, split: str = ALL, selection: Selection | None = None) -> Dataset:
    """Find the frames of a data set; nothing is read yet but lists and names.

    name: as for `kind_and_path`. split: a part of it as published, e.g. "test".
    Raises DatasetError, which says what is missing and where to get it, and OSError.
    """
    kind, path = kind_and_path(name)
    return KINDS[kind](path, split, selection or Selection())
