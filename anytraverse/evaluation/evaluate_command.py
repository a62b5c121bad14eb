"""Runs `anytraverse evaluate`: a perceiver on a published data set, as the paper's table asks."""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from anytraverse.evaluation.arguments import add_choice, open_chosen, setting
from anytraverse.evaluation.datasets import KINDS, Dataset, kind_and_path
from anytraverse.evaluation.defaults import Defaults, read_defaults
from anytraverse.evaluation.evaluating import Evaluation
from anytraverse.evaluation.exhibits import Exhibit, draw
from anytraverse.evaluation.labels import DatasetError
from anytraverse.evaluation.matching import asked_names, refuse_asked
from anytraverse.evaluation.page import page
from anytraverse.evaluation.records import Records
from anytraverse.evaluation.report import markdown, text_of
from anytraverse.evaluation.seeing import PerceiverRun
from anytraverse.evaluation.summary import Summary
from anytraverse.evaluation.tally import FORMAT, Rows
from anytraverse.perception import make_perceiver
from anytraverse.perception.runtime import Runtime
from anytraverse.preferences import Preferences
from anytraverse.release import own_version

_EXTREMES = 6
"""How many of the best and of the worst frames are shown."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.description = (
        "Evaluate a perceiver on a labelled data set: IoU of drivable ground beside the paper's figures, "
        "recall of each class, a curve over thresholds, AUROC of the uncertainty, and a page of the best and "
        "worst frames. A run that was stopped goes on where it was. The last line is JSON."
    )
    parser.add_argument(
        "--dataset",
        dest="folder",
        required=True,
        metavar="KIND:DIR",
        help=f"one of {', '.join(f'{kind}:DIR' for kind in KINDS)}; DIR holds it as it was published",
    )
    parser.add_argument("--perceiver", default="builtin", help="which perceiver, by default %(default)s")
    parser.add_argument("--prompts", metavar="WORDS", help="words and weights, by default the paper's")
    parser.add_argument("--drivable", metavar="CLASSES", help="drivable classes, by default the authors'")
    parser.add_argument(
        "--unknown", metavar="CLASSES", help="classes that no word names, to score the uncertainty on"
    )
    add_choice(parser)
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("evaluation"),
        metavar="DIR",
        help="where to write, by default %(default)s",
    )
    parser.add_argument("--json", action="store_true", help="print nothing but the last line, the JSON")


def run(options: argparse.Namespace) -> int:
    """Judge the frames, write the files, print the table and the JSON. Returns 0."""
    kind, _ = kind_and_path(options.folder)
    defaults = read_defaults(kind)
    dataset = open_chosen(options, defaults.split)
    words = defaults.words if options.prompts is None else Preferences.parse(options.prompts)
    drivable = _drivable(options, defaults, dataset)
    seeing = PerceiverRun(make_perceiver(options.perceiver, Runtime(threads=options.threads)), words)
    unknown = _unknown(options, defaults, dataset, seeing)
    for name in unknown:
        if name in drivable:
            raise DatasetError(f'"{name}" is both unknown and drivable: leave it out of one of them')
    summary = Summary(Rows(dataset.classes), drivable, unknown)
    with Records(options.out, _decisive(kind, dataset, seeing), summary.rows.count) as records:
        evaluation = Evaluation(dataset, seeing, records)
        for number, tally in evaluation:
            summary.add(number, dataset.name(number), tally)
    figures = {
        "title": dataset.title,
        "drivable": drivable,
        "paper": defaults.paper,
        "as_paper": _as_paper(options, defaults, dataset, words, drivable),
        **setting(options, seeing, evaluation.torn, len(summary.frames)),
        "split": options.split or defaults.split,
        **summary.figures(min(_EXTREMES, max(1, len(summary.frames) // 2))),
    }
    _write(options.out, figures, summary, _exhibits(figures, dataset, seeing, drivable))
    if not options.json:
        print(text_of(figures))
        print(
            f"  written to {options.out}: evaluation.html, results.md, evaluation.json, frames.csv, curve.csv"
        )
    print(json.dumps(figures, allow_nan=False))
    return 0


def _drivable(options: argparse.Namespace, defaults: Defaults, dataset: Dataset) -> tuple[str, ...]:
    names = defaults.drivable if options.drivable is None else options.drivable.split(",")
    return dataset.classes.choose(names)


def _unknown(
    options: argparse.Namespace, defaults: Defaults, dataset: Dataset, seeing: PerceiverRun
) -> tuple[str, ...]:
    """Return the classes to score the uncertainty on; of the default ones, those that no word asks for."""
    meaning = seeing.perceiver.meaning
    if options.unknown is not None:
        unknown = dataset.classes.choose(options.unknown.split(","))
        refuse_asked(seeing.words, unknown, meaning)
        return unknown
    named = asked_names(seeing.words, defaults.unknown, meaning)
    free = [name for name in defaults.unknown if name not in named]
    return dataset.classes.choose(free) if free else ()


def _decisive(kind: str, dataset: Dataset, seeing: PerceiverRun) -> dict[str, Any]:
    """Return what a frame's tally depends on besides its files."""
    return {
        "format": FORMAT,
        "program": own_version(),
        "data set": kind,
        "folder": str(dataset.path.resolve()),
        "classes": [*dataset.classes.names, dataset.classes.ignore],
        "model": seeing.perceiver.model_id,
        "words": dict(seeing.words),
    }


def _as_paper(
    options: argparse.Namespace,
    defaults: Defaults,
    dataset: Dataset,
    words: Preferences,
    drivable: tuple[str, ...],
) -> bool:
    """Return whether words, classes and split are those of the paper, and all its frames are chosen."""
    whole = options.first is None and options.last is None and options.every == 1
    return (
        bool(defaults.paper)
        and whole
        and words == defaults.words
        and set(drivable) == set(dataset.classes.choose(defaults.drivable))
        and options.split in {None, defaults.split}
    )


def _exhibits(
    figures: Mapping[str, Any], dataset: Dataset, seeing: PerceiverRun, drivable: tuple[str, ...]
) -> dict[int, Exhibit]:
    """Judge the best and the worst frames once more, and draw them."""
    drawn: dict[int, Exhibit] = {}
    for row in (*figures["worst"], *figures["best"]):
        frame = dataset.read(row["frame"])
        drawn[row["frame"]] = draw(frame, seeing.look(frame), dataset.classes, drivable)
    return drawn


def _write(
    folder: Path, figures: Mapping[str, Any], summary: Summary, exhibits: Mapping[int, Exhibit]
) -> None:
    """Write every file whole or not at all. Raises OSError."""
    for name, text in (
        ("evaluation.html", page(figures, exhibits)),
        ("results.md", markdown(figures)),
        ("evaluation.json", json.dumps(figures, indent=1, allow_nan=False) + "\n"),
        ("frames.csv", summary.frames_csv()),
        ("curve.csv", summary.curve_csv()),
    ):
        partial = folder / f".{name}.part"
        partial.write_text(text, encoding="utf-8")
        os.replace(partial, folder / name)
