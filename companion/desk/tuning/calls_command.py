"""Runs `anytraverse calls`: which calls a drive raises, by each of many thresholds."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from anytraverse.engine import AnyTraverse
from anytraverse.evaluation.arguments import add_cache, add_choice, add_dask, cache_bytes
from anytraverse.evaluation.asking import conclude
from anytraverse.evaluation.datasets import Selection, kind_and_path, open_dataset
from anytraverse.evaluation.defaults import read_defaults, usual_classes
from anytraverse.evaluation.labels import DatasetError
from anytraverse.evaluation.matching import match_words
from anytraverse.evaluation.progress import doing
from anytraverse.evaluation.summary import as_csv
from anytraverse.perception.stored import default_cache
from anytraverse.plots import installed
from anytraverse.preferences import Preferences
from anytraverse.release import to_install
from anytraverse.resources import resource
from companion.config import Config, ConfigError, load_config
from companion.desk.drives.drive import DriveError
from companion.desk.drives.frames import open_drive
from companion.desk.tuning.episode import Episode, given_answers
from companion.desk.tuning.proposal import named_times, weighed
from companion.desk.tuning.report import counted, csv_rows, page, text_of
from companion.desk.tuning.running import Where, processes_of, run_episode
from companion.desk.tuning.things import noticed, things_of
from companion.desk.tuning.trial import (
    Combination,
    Grid,
    GridError,
    TrialOutcome,
    around,
    read_region,
    read_tiles,
    read_values,
)
from companion.vision.warm_up import load_engine


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.description = (
        "Count the calls that a drive raises by each combination of thresholds and regions of interest. "
        "Every call is answered at once: from the frame's labels, or by a go. A frame is perceived once for "
        "all combinations, and not again by a later run. The last line is JSON."
    )
    parser.add_argument(
        "--episode",
        required=True,
        metavar="DRIVE",
        help="a folder of pictures, a video, a recording, or labelled frames: as for `anytraverse evaluate`",
    )
    parser.add_argument(
        "--operator",
        choices=("labels", "go", "answers"),
        help="who answers: the labels' classes, a go, or somebody who did before; by default the labels "
        "where there are some",
    )
    parser.add_argument(
        "--answers", metavar="FILE", help="of `companion rehearse`; of a recording those that were recorded"
    )
    parser.add_argument("--config", metavar="FILE", help="a companion.toml, by default the one that ships")
    parser.add_argument("--prompts", metavar="WORDS", help="the words at the start, by default the config's")
    parser.add_argument("--perceiver", metavar="NAME", help="by default the config's")
    parser.add_argument("--drivable", metavar="CLASSES", help="by default the authors'")
    parser.add_argument("--rate", type=float, metavar="N", help="frames a second, by default [camera] rate")
    for name, help_text in (
        ("scene", "thresholds of the scene's similarity, 0.8,0.9 or 0.8:0.95:0.05"),
        ("roi", "thresholds of the region's mean uncertainty"),
        ("tile", "thresholds of the worst tile's uncertainty; off: not judged"),
    ):
        parser.add_argument(f"--{name}", metavar="LIST", help=help_text)
    parser.add_argument(
        "--region", action="append", metavar="L,T,R,B", help="a region of interest; once for each"
    )
    parser.add_argument(
        "--misfits",
        action="store_true",
        help="allow regions that the vehicle does not fit in, with which no frame is OK",
    )
    add_choice(parser)
    _add_where(parser)
    parser.add_argument(
        "--out", type=Path, default=Path("calls"), metavar="DIR", help="by default %(default)s"
    )
    parser.add_argument("--json", action="store_true", help="print nothing but the last line, the JSON")


def _add_where(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--jobs", type=int, default=0, metavar="N", help="processes, by default all cores")
    add_dask(parser)
    add_cache(parser)


def run(options: argparse.Namespace) -> int:
    """Judge the drive, write the files, print the table and the JSON. Returns 0."""
    try:
        return _run(options)
    except (ConfigError, DriveError) as error:  # of the companion, not of anytraverse
        raise GridError(str(error)) from error


def _run(options: argparse.Namespace) -> int:
    config = _config(options)
    with doing(f"opening {options.episode}"):
        episode, answered = _episode(options, config)
    with doing(f"loading {config.perceiver.name}"):
        engine, _ = load_engine(config, None)
    grid = _grid(options, around(engine.settings))
    combinations = grid.combinations(engine.settings)
    options.out.mkdir(parents=True, exist_ok=True)
    drive, _ = episode.opened()
    wanted = _noticing(episode, config, engine)
    judged = run_episode(config, episode, combinations, _where(options))
    figures: dict[str, Any] = {
        "title": drive.title,
        "episode": options.episode,
        "frames": judged.frames,
        "rate": episode.rate,
        "model": engine.perceiver.model_id,
        "prompts": config.preferences.format(),
        "operator": answered,
        "seconds": round(judged.perceiving_s + judged.judging_s, 1),
        "judging_s": round(judged.judging_s, 1),
        "things": wanted.things,
        "each": [
            counted(number, one, judged.frames, wanted.noticed(one))
            for number, one in enumerate(judged.outcomes)
        ],
    }
    source, file = (
        shlex.quote(str(options.out / "calls.json")),
        shlex.quote(options.config or "companion.toml"),
    )
    command = f"companion tune --take {{}} --from {source} --write {file}"
    written = {
        "calls.html": page(figures, Combination.of(engine.settings), command),
        "calls.csv": as_csv(csv_rows(figures["each"])),
        "calls.json": json.dumps(figures, allow_nan=False) + "\n",
    }
    short = {**figures, "each": [_short(row) for row in figures["each"]]}
    conclude(options, written, text_of(figures), short)
    if not installed():
        print(f"calls.html has no plot: {to_install('plots')}", file=sys.stderr)
    return 0


class _Noticing(NamedTuple):
    """Says what there is to notice in a drive. things: how many, None: it is not known."""

    things: int | None
    noticed: Callable[[TrialOutcome], int | None]


def _noticing(episode: Episode, config: Config, engine: AnyTraverse) -> _Noticing:
    """Return what the labels show that no word means, or else what was named in the answers."""
    if episode.drivable is not None:
        dataset = open_dataset(episode.where, episode.split, episode.selection)
        matches = match_words(
            config.preferences, dataset.classes, engine.perceiver.meaning, {}, usual_classes()
        )
        known = {name for one in matches.values() for name in one.classes}.union(episode.drivable)
        names = [name for name in dataset.classes.known.values() if name not in known]
        things = things_of(dataset, names, engine.settings.region)
        return _Noticing(len(things), lambda one: noticed(things, one.stood))
    named = named_times(episode.answers)
    if named:
        return _Noticing(len(named), lambda one: weighed(one, named, 1.0).kept)
    return _Noticing(None, lambda _: None)


def _where(options: argparse.Namespace) -> Where:
    """Return where the work is done. Raises GridError, DatasetError."""
    cache = options.cache or default_cache()
    return Where(cache, cache_bytes(options), processes_of(options.jobs), options.dask)


def _config(options: argparse.Namespace) -> Config:
    config = load_config(options.config or resource("config/companion.toml"))
    perceiver = replace(config.perceiver, threads=options.threads)
    if options.perceiver is not None:
        perceiver = replace(perceiver, name=options.perceiver)
    words = config.words if options.prompts is None else dict(Preferences.parse(options.prompts))
    return replace(config, perceiver=perceiver, words=words)


def _episode(options: argparse.Namespace, config: Config) -> tuple[Episode, str]:
    """Return the drive with its operator, and who that is."""
    rate = config.camera.rate if options.rate is None else options.rate
    if not 0.1 <= rate <= 1000.0:
        raise GridError(f"--rate {rate:g}: give frames a second, 0.1 to 1000")
    plain = Episode(options.episode, rate)
    chosen = (options.split, options.first, options.last, options.every) != (None, None, None, 1)
    labelled = options.operator == "labels" or chosen or options.drivable is not None
    script = options.operator == "answers" or options.answers is not None
    if options.operator == "go" or script:
        if labelled or (script and options.operator == "go"):
            raise GridError(
                "--operator go and answers take a whole drive, without --split, --from, --to, --every, "
                "and --answers belongs to answers"
            )
        if not script:
            return plain, "a go to every call"
        given = given_answers(open_drive(options.episode, rate), options.answers)
        if not given:
            raise GridError("no answers were recorded: give --answers FILE, or --operator go")
        return replace(plain, answers=given), f"{len(given)} answers that were given, and else a go"
    kind, _ = kind_and_path(options.episode)
    defaults = read_defaults(kind)
    selection = Selection(options.first, options.last, options.every)
    split = options.split or defaults.split
    try:
        dataset = open_dataset(options.episode, split, selection)
    except DatasetError:
        if labelled:
            raise
        return plain, "a go to every call, as the drive has no labels"
    drivable = defaults.choose_drivable(options.drivable, dataset.classes, "; or --operator go")
    return replace(plain, split=split, selection=selection, drivable=drivable), "the labels"


def _grid(options: argparse.Namespace, small: Grid) -> Grid:
    return Grid(
        small.scene if options.scene is None else read_values(options.scene, "scene"),
        small.roi if options.roi is None else read_values(options.roi, "roi"),
        small.tile if options.tile is None else read_tiles(options.tile),
        small.regions if options.region is None else tuple(map(read_region, options.region)),
        options.misfits,
    )


def _short(row: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in row.items() if key not in ("at_call", "reasons", "at_match")}
