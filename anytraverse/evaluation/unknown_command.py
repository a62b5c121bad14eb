"""Runs `anytraverse score-unknown`: how well uncertainty tells things without a word from drivable ground."""

from __future__ import annotations

import argparse
import json
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
from anytraverse.evaluation.labels import DatasetError
from anytraverse.evaluation.matching import refuse_asked
from anytraverse.evaluation.unknown import UnknownScore, score_unknown


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.description = (
        "Score the uncertainty map on labelled frames: AUROC of classes that no word names against drivable "
        "ground, and how much of that ground is taken for unknown. The last line is JSON."
    )
    add_shared(parser)
    parser.add_argument(
        "--unknown",
        required=True,
        metavar="CLASSES",
        help='label classes that no prompt names, e.g. "obstacle,person"',
    )


def run(options: argparse.Namespace) -> int:
    """Score the frames, print the table and the JSON. Returns 0."""
    folder = open_chosen(options)
    unknown = folder.classes.choose(options.unknown.split(","))
    drivable = folder.classes.choose(options.drivable.split(","))
    for name in unknown:
        if name in drivable:
            raise DatasetError(f'"{name}" is both unknown and drivable: leave it out of one of them')
    seeing = open_perceiver(options)
    refuse_asked(seeing.words, unknown, seeing.perceiver.meaning)
    with Watched(folder) as frames:
        score = score_unknown(frames, seeing, folder.classes, unknown, drivable)
    figures = figures_of(score) | setting(options, seeing, frames, score.images) | {"drivable": drivable}
    if not options.json:
        print(text_of(score, heading(options, figures)))
    print(json.dumps(figures, allow_nan=False))
    return 0


def figures_of(score: UnknownScore) -> dict[str, Any]:
    """Return all scores for JSON."""
    return {
        "auroc": rounded(score.together.auroc),
        "drivable_above_half": rounded(score.drivable_above.value),
        "unknown_above_half": rounded(score.unknown_above.value),
        "pixels": {"unknown": score.together.positives, "drivable": score.together.negatives},
        "unknown": {
            name: {"auroc": rounded(ranking.auroc), "pixels": ranking.positives}
            for name, ranking in score.classes.items()
        },
        "ms_per_frame": round(score.milliseconds, 2),
    }


def text_of(score: UnknownScore, first: str) -> str:
    """Return all scores as a table for a person; first: its first line."""
    lines = [first, f"  {'unknown against drivable':32}{'AUROC':>8}{'pixels':>12}"]
    rows = [*score.classes.items()]
    if len(rows) > 1:
        rows.append(("together", score.together))
    for name, ranking in rows:
        lines.append(f"    {name:30}{shown(ranking.auroc):>8}{ranking.positives:>12}")
    lines.append("  uncertainty above 0.5")
    for name, share in (
        ("of unknown pixels", score.unknown_above),
        ("of drivable pixels", score.drivable_above),
    ):
        lines.append(f"    {name:30}{shown(share.value):>8}{share.total:>12}")
    return "\n".join(lines)
