"""Runs `anytraverse score`: IoU of drivable ground on a labelled drive, and AUROC of each word."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from statistics import median
from typing import Any

from anytraverse.evaluation.arguments import (
    Watched,
    add_shared,
    heading,
    open_chosen,
    open_perceiver,
    rounded,
    setting,
    shown,
)
from anytraverse.evaluation.defaults import usual_classes
from anytraverse.evaluation.drivable import DrivableScore, WordScore, score_drivable
from anytraverse.evaluation.matching import USUAL, WordMatch, match_words, parse_matches, told
from anytraverse.evaluation.robustness import AS_FILMED, GroundScore, parse_degradations, score_degraded

_WORST = 5


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.description = (
        "Score drivable ground on labelled frames: IoU of the traversability map above 0.5, and how well "
        "each word finds its class. The last line is JSON."
    )
    add_shared(parser)
    either = parser.add_mutually_exclusive_group()
    either.add_argument(
        "--match",
        default="",
        metavar="LIST",
        help='the classes of words, e.g. "dirt path=smooth_trail,dirt path=rough_trail"; '
        "by default those of the same name or meaning",
    )
    either.add_argument(
        "--degrade",
        metavar="LIST",
        help='score drivable ground on degraded frames, too: "all", or names as in "fog,glare"',
    )


def run(options: argparse.Namespace) -> int:
    """Score the frames, print the table and the JSON. Returns 0."""
    if options.degrade is not None:
        return _run_degraded(options)
    given = parse_matches(options.match)
    folder = open_chosen(options)
    drivable = folder.classes.choose(options.drivable.split(","))
    seeing = open_perceiver(options)
    matches = match_words(seeing.words, folder.classes, seeing.perceiver.meaning, given, usual_classes())
    own = {word: one.classes for word, one in matches.items()}
    with Watched(folder) as frames:
        score = score_drivable(frames, seeing, folder.classes, drivable, own)
    figures = (
        figures_of(score, matches)
        | setting(options, seeing, frames.torn, score.images)
        | {"drivable": drivable}
    )
    if not options.json:
        print(text_of(score, heading(options, figures), figures["words"]))
    print(json.dumps(figures, allow_nan=False))
    return 0


def _run_degraded(options: argparse.Namespace) -> int:
    names = parse_degradations(options.degrade)
    folder = open_chosen(options)
    drivable = folder.classes.choose(options.drivable.split(","))
    seeing = open_perceiver(options)
    with Watched(folder) as frames:
        scores, times = score_degraded(frames, seeing, folder.classes, drivable, names)
    rows = {name: ground_figures(score) for name, score in scores.items()}
    figures = {"degraded": rows, "ms_per_frame": round(median(times), 2), "drivable": drivable}
    figures |= setting(options, seeing, frames.torn, len(times))
    if not options.json:
        print(degraded_text(rows, heading(options, figures)))
    print(json.dumps(figures, allow_nan=False))
    return 0


def ground_figures(score: GroundScore) -> dict[str, float | None]:
    """Return the scores under one degradation for JSON."""
    return {
        "iou_pooled": rounded(score.ground.pooled),
        "iou_known_pooled": rounded(score.known.pooled),
        "uncertainty_mean": rounded(score.uncertainty.value),
        "drivable_above_half": rounded(score.above.value),
    }


def degraded_text(rows: Mapping[str, Mapping[str, float | None]], first: str) -> str:
    """Return the scores as a table for a person, each with its difference to "as filmed".

    rows: what `ground_figures` returned, by name; `AS_FILMED` is one of them. first: the first line.
    """
    filmed = rows[AS_FILMED]
    heads = "".join(f"{head:>16}" for head in ("IoU", "known IoU", "uncertainty", "above 0.5"))
    lines = [first, f"  {'drivable ground':16}{heads}"]
    for name, row in rows.items():
        cells = "".join(_cell(value, None if row is filmed else filmed[key]) for key, value in row.items())
        lines.append(f"    {name:14}{cells}".rstrip())
    return "\n".join(lines)


def _cell(value: float | None, before: float | None) -> str:
    change = "" if value is None or before is None else f"{value - before:+.3f}"
    return f"{shown(value):>8}{change:>8}"


def figures_of(score: DrivableScore, matches: Mapping[str, WordMatch]) -> dict[str, Any]:
    """Return all scores for JSON."""
    return {
        "iou_pooled": rounded(score.ground.pooled),
        "iou_mean": rounded(score.ground.mean),
        "iou_known_pooled": rounded(score.known.pooled),
        "iou_known_mean": rounded(score.known.mean),
        "ms_per_frame": round(score.milliseconds, 2),
        "words": {
            word: {
                "auroc": rounded(own.auroc),
                "classes": own.classes,
                "how": matches[word].how,
                "pixels": own.pixels,
            }
            for word, own in score.words.items()
        },
        "worst": [{"frame": number, "iou": rounded(iou)} for number, iou in score.ground.worst(_WORST)],
    }


def text_of(score: DrivableScore, first: str, words: Mapping[str, Any]) -> str:
    """Return all scores as a table for a person. first: its first line. words: of `figures_of`."""
    lines = [first, f"  {'IoU of drivable ground':32}{'pooled':>8}{'mean':>8}"]
    for label, overlap in (("traversability above 0.5", score.ground), ("known and drivable", score.known)):
        lines.append(f"    {label:30}{shown(overlap.pooled):>8}{shown(overlap.mean):>8}")
    lines.append(f"  {'words':32}{'AUROC':>8}")
    for word, own in score.words.items():
        lines.append(f"    {word:30}{shown(own.auroc):>8}   {_classes_text(own)}")
    if any(one["how"] == USUAL for one in words.values()):
        lines.append(f"  classes       {told(words)}")
    worst = ", ".join(f"{number} ({iou:.2f})" for number, iou in score.ground.worst(_WORST))
    lines.append(f"  worst frames  {worst}")
    return "\n".join(lines)


def _classes_text(word: WordScore) -> str:
    if not word.classes:
        return "no label class matches: name one with --match"
    classes = ", ".join(word.classes)
    return classes if word.auroc is not None else f"{classes}: there is none of it, or nothing else"
