"""Finds the parts of a published data set, and says where to get what is missing."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from anytraverse.evaluation.datasets.dataset import FrameFiles
from anytraverse.evaluation.labels import DatasetError

ALL = "all"
"""Every labelled frame, of whichever split."""


@dataclass(frozen=True)
class Origin:
    """Holds where a data set comes from. terms: its licence, or that none is stated."""

    title: str
    page: str
    terms: str

    @property
    def remedy(self) -> str:
        """What to do when something is missing."""
        return f"get {self.title} from {self.page} ({self.terms})"

    def folder(self, path: Path, archive: str) -> Path:
        """Return `path`. Raises DatasetError when it is no folder; archive: what holds it."""
        if not path.is_dir():
            raise DatasetError(f"{path} is missing: it comes with {archive}; {self.remedy}")
        return path

    def check_split(self, split: str, splits: Iterable[str]) -> None:
        """Raise DatasetError when `split` is not `ALL` and not in `splits`."""
        known = (ALL, *splits)
        if split not in known:
            raise DatasetError(f'{self.title} has no split "{split}": choose from {", ".join(known)}')


def unpacked(path: Path, name: str) -> Path:
    """Return the folder `name` in `path`, which the archive made, or `path` itself where it is not there."""
    return path / name if (path / name).is_dir() else path


def numbered(pairs: Sequence[tuple[Path, Path]], where: Path, remedy: str) -> list[FrameFiles]:
    """Number the pairs (picture, label image) by their place, from 0. Raises DatasetError without any."""
    if not pairs:
        raise DatasetError(f"{where} holds no labelled picture: {remedy}")
    return [FrameFiles(number, picture, label) for number, (picture, label) in enumerate(pairs)]
