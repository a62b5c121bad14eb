"""Holds what an evaluation asks: data set, perceiver, words and classes, and whether they are the paper's."""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from anytraverse.evaluation.arguments import add_choice, add_dask, open_chosen
from anytraverse.evaluation.datasets import KINDS, Dataset, kind_and_path
from anytraverse.evaluation.defaults import Defaults, read_defaults, usual_classes
from anytraverse.evaluation.evaluating import Evaluation, WorkShare
from anytraverse.evaluation.labels import DatasetError
from anytraverse.evaluation.matching import WordMatch, asked_names, match_words, parse_matches, refuse_asked
from anytraverse.evaluation.progress import doing
from anytraverse.evaluation.records import TallyStore
from anytraverse.evaluation.seeing import PerceiverRun, maps_identity
from anytraverse.evaluation.summary import TallySummary
from anytraverse.evaluation.tally import FORMAT, Rows
from anytraverse.perception import Perceiver, make_perceiver
from anytraverse.perception.runtime import Runtime
from anytraverse.preferences import Preferences
from anytraverse.release import own_version


def add_asked(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that `EvaluationRequest` reads, and --out and --json."""
    parser.add_argument(
        "--dataset",
        dest="folder",
        required=True,
        metavar="KIND:DIR",
        help=f"one of {', '.join(f'{kind}:DIR' for kind in KINDS)}; DIR holds it as it was published",
    )
    parser.add_argument("--perceiver", default="builtin", help="which perceiver, by default %(default)s")
    parser.add_argument("--drivable", metavar="CLASSES", help="drivable classes, by default the authors'")
    parser.add_argument(
        "--unknown", metavar="CLASSES", help="classes that no word names, to score the uncertainty on"
    )
    parser.add_argument(
        "--match",
        default="",
        metavar="LIST",
        help='the classes of words, "bush=low_vegetation"; by default those of the same name or meaning',
    )
    add_choice(parser)
    out = Path("evaluation")
    parser.add_argument(
        "--out", type=Path, default=out, metavar="DIR", help="where to write, by default %(default)s"
    )
    add_dask(parser)
    parser.add_argument("--json", action="store_true", help="print nothing but the last line, the JSON")


@dataclass(frozen=True)
class EvaluationRequest:
    """Holds what one run of a command asks of a data set and a perceiver.

    words: sets of words. drivable, unknown: classes, none in both and no unknown one that a word asks for.
    """

    options: argparse.Namespace
    kind: str
    defaults: Defaults
    dataset: Dataset
    perceiver: Perceiver
    words: tuple[Preferences, ...]
    drivable: tuple[str, ...]
    unknown: tuple[str, ...]

    @classmethod
    def of(cls, options: argparse.Namespace, prompts: Sequence[str]) -> EvaluationRequest:
        """Open what the options name. prompts: sets of words; none: the paper's.

        Raises DatasetError, PreferencesError, PerceiverError, OSError.
        """
        kind, _ = kind_and_path(options.folder)
        defaults = read_defaults(kind)
        with doing(f"opening {options.folder}"):
            dataset = open_chosen(options, defaults.split)
        words = tuple(Preferences.parse(text) for text in prompts) or (defaults.words,)
        drivable = defaults.choose_drivable(options.drivable, dataset.classes)
        with doing(f"loading {options.perceiver}"):
            perceiver = make_perceiver(options.perceiver, Runtime(threads=options.threads))
        unknown = _unknown(options, defaults, dataset, perceiver, [word for one in words for word in one])
        for name in unknown:
            if name in drivable:
                raise DatasetError(f'"{name}" is both unknown and drivable: leave it out of one of them')
        return cls(options, kind, defaults, dataset, perceiver, words, drivable, unknown)

    def matches(self) -> dict[str, WordMatch]:
        """Return the classes of all words. Raises DatasetError."""
        words = dict.fromkeys(word for one in self.words for word in one)
        given = parse_matches(self.options.match)
        return match_words(words, self.dataset.classes, self.perceiver.meaning, given, usual_classes())

    def runs(self) -> list[PerceiverRun]:
        """Return the perceiver with each set of words. Raises PreferencesError."""
        return [PerceiverRun(self.perceiver, words) for words in self.words]

    def judged(self, records: TallyStore) -> Evaluation:
        """Return the evaluation of all frames, judged on the cluster where there is one.

        Raises PreferencesError, DatasetError, SpreadError.
        """
        evaluation = Evaluation(self.dataset, self.runs(), records)
        if self.options.dask is not None:
            prompts = tuple(words.format() for words in self.words)
            options = self.options
            share = WorkShare(
                f"{self.kind}:{self.dataset.path.resolve()}",
                self.split,
                _absolute(options.perceiver),
                maps_identity(options.perceiver, self.perceiver),
                options.threads,
                prompts,
            )
            evaluation.on_cluster(share, options.dask)
        return evaluation

    def records(self) -> TallyStore:
        """Open the records in --out. Raises DatasetError, OSError."""
        classes = self.dataset.classes
        run = {
            "format": FORMAT,
            "program": own_version(),
            "data set": self.kind,
            "folder": str(self.dataset.path.resolve()),
            "classes": [*classes.names, classes.ignore],
            "model": maps_identity(self.options.perceiver, self.perceiver),
        }
        return TallyStore(self.options.out, run, Rows(classes).count)

    def summary(self) -> TallySummary:
        """Return a summary to which no frame has been added."""
        return TallySummary(Rows(self.dataset.classes), self.drivable, self.unknown)

    @property
    def split(self) -> str:
        """The split in use."""
        return str(self.options.split or self.defaults.split)

    def as_paper(self, words: Preferences) -> bool:
        """Return whether words, classes and split are those of the paper, and all its frames are chosen."""
        options, defaults = self.options, self.defaults
        return (
            bool(defaults.paper)
            and (options.first, options.last, options.every) == (None, None, 1)
            and words == defaults.words
            and set(self.drivable) == set(self.dataset.classes.choose(defaults.drivable))
            and self.split == defaults.split
        )


def _absolute(perceiver: str) -> str:
    """Return a perceiver's name as a process in another folder needs it."""
    kind, _, argument = perceiver.partition(":")
    return f"{kind}:{os.path.abspath(argument)}" if os.path.isdir(argument) else perceiver


def _unknown(
    options: argparse.Namespace,
    defaults: Defaults,
    dataset: Dataset,
    perceiver: Perceiver,
    words: Sequence[str],
) -> tuple[str, ...]:
    """Return the classes to score the uncertainty on; of the default ones, those that no word asks for."""
    if options.unknown is not None:
        unknown = dataset.classes.choose(options.unknown.split(","))
        refuse_asked(words, unknown, perceiver.meaning)
        return unknown
    named = asked_names(words, defaults.unknown, perceiver.meaning)
    free = [name for name in defaults.unknown if name not in named]
    return dataset.classes.choose(free) if free else ()


def conclude(
    options: argparse.Namespace, files: Mapping[str, str], table: str, figures: Mapping[str, Any]
) -> None:
    """Write the files into --out, and print the table, and the figures as the last line.

    files: name -> text; each is written whole or not at all. Raises OSError.
    """
    for name, text in files.items():
        partial = options.out / f".{name}.part"
        partial.write_text(text, encoding="utf-8")
        os.replace(partial, options.out / name)
    if not options.json:
        print(table)
        print(f"  written to {options.out}: {', '.join(files)}")
    print(json.dumps(figures, allow_nan=False))
