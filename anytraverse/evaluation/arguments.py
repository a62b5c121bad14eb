"""Holds what the scoring commands have in common: arguments, progress, output."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from anytraverse.evaluation.datasets import ALL, KINDS, Dataset, LabelledFrame, Selection, open_dataset
from anytraverse.evaluation.labels import DatasetError
from anytraverse.evaluation.progress import Progress
from anytraverse.evaluation.seeing import PerceiverRun
from anytraverse.perception import make_perceiver
from anytraverse.perception.runtime import Runtime
from anytraverse.perception.stored import MOST_BYTES, default_cache
from anytraverse.preferences import Preferences

GB = 1_000_000_000


def add_shared(parser: argparse.ArgumentParser) -> None:
    """Add the arguments for the data set, the words, the perceiver and the choice of frames."""
    parser.add_argument(
        "folder",
        metavar="DIR",
        help="pictures NNNN.jpg, label images NNNN.png of class ids, and classes.json; or a published data "
        f"set: {', '.join(f'{kind}:DIR' for kind in KINDS)}",
    )
    parser.add_argument(
        "--prompts",
        required=True,
        metavar="WORDS",
        help='words and weights from -1 (never drive) to 1 (drive), e.g. "trail: 1; grass: 1; bush: -1"',
    )
    parser.add_argument(
        "--drivable",
        required=True,
        metavar="CLASSES",
        help='label classes that are drivable ground, e.g. "smooth_trail,grass"',
    )
    parser.add_argument("--perceiver", default="builtin", help="which perceiver, by default %(default)s")
    add_choice(parser)
    parser.add_argument("--json", action="store_true", help="print nothing but the last line, the JSON")


def add_choice(parser: argparse.ArgumentParser) -> None:
    """Add the arguments for the cores and the choice of frames."""
    parser.add_argument("--split", metavar="NAME", help='a part of a published data set, e.g. "test"')
    parser.add_argument("--threads", type=int, default=0, metavar="N", help="cores to use, by default all")
    parser.add_argument("--from", dest="first", type=int, metavar="N", help="the lowest number that counts")
    parser.add_argument("--to", dest="last", type=int, metavar="N", help="the highest number that counts")
    parser.add_argument(
        "--every", type=int, default=1, metavar="N", help="take every Nth of these frames, by default all"
    )


def add_dask(parser: argparse.ArgumentParser) -> None:
    """Add the argument for the cluster."""
    parser.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="do the work on a Dask cluster with the same files, e.g. tls://host:8786; who reaches its "
        "scheduler can run any program on its computers, and they on this one",
    )


def add_cache(parser: argparse.ArgumentParser) -> None:
    """Add the arguments for what was seen of frames."""
    parser.add_argument(
        "--cache", type=Path, metavar="DIR", help=f"what was seen of frames, by default {default_cache()}"
    )
    parser.add_argument(
        "--cache-size", type=float, default=MOST_BYTES / GB, metavar="GB", help="by default %(default)g"
    )


def cache_bytes(options: argparse.Namespace) -> int:
    """Return how large the cache may be. Raises DatasetError for a size that cannot be."""
    size = float(options.cache_size)
    if not 0.0 < size < 1e6:
        raise DatasetError(f"--cache-size {size:g}: give gigabytes above 0")
    return round(size * GB)


def open_chosen(options: argparse.Namespace, split: str = ALL) -> Dataset:
    """Open the data set with the chosen frames. split: the default. Raises DatasetError, OSError."""
    selection = Selection(options.first, options.last, options.every)
    return open_dataset(options.folder, options.split or split, selection)


def open_perceiver(options: argparse.Namespace) -> PerceiverRun:
    """Make the perceiver with its words. Raises PreferencesError, PerceiverError."""
    words = Preferences.parse(options.prompts)
    return PerceiverRun(make_perceiver(options.perceiver, Runtime(threads=options.threads)), words)


class Watched:
    """Iterates over the frames of a data set and shows the progress on stderr.

    torn: the number of frames that could not be read. As a context manager it clears the progress bar.
    """

    def __init__(self, folder: Dataset) -> None:
        self.torn = 0
        self._folder = folder
        self._progress = Progress(len(folder), "frames")

    def __enter__(self) -> Watched:
        self._progress.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.__exit__()

    def __iter__(self) -> Iterator[LabelledFrame]:
        for frame in self._folder.frames(self._report_torn):
            yield frame
            self._progress.step()

    def _report_torn(self, what: str) -> None:
        self.torn += 1
        self._progress.say(f"{what}, skipped")
        self._progress.step()


def setting(options: argparse.Namespace, seeing: PerceiverRun, torn: int, images: int) -> dict[str, Any]:
    """Return what was scored, for JSON."""
    return {
        "images": images,
        "torn": torn,
        "folder": options.folder,
        "split": options.split,
        "from": options.first,
        "to": options.last,
        "every": options.every,
        "perceiver": options.perceiver,
        "model_id": seeing.perceiver.model_id,
        "prompts": dict(seeing.words),
    }


def heading(options: argparse.Namespace, figures: dict[str, Any]) -> str:
    """Return what was scored, in one line for a person."""
    torn = f" ({figures['torn']} torn)" if figures["torn"] else ""
    return (
        f"{options.folder}: {figures['images']} frames{torn}, {figures['model_id']}, "
        f"{figures['ms_per_frame']:.1f} ms a frame"
    )


def rounded(value: float | None) -> float | None:
    """Round a score to four digits."""
    return None if value is None else round(value, 4)


def shown(value: float | None) -> str:
    """Format a score for a table, or a dash for None."""
    return "    -" if value is None else f"{value:.3f}"
