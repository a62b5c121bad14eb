"""Runs `anytraverse sweep`: several sets of words side by side, for which each frame is encoded once."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from typing import Any

from anytraverse.evaluation.arguments import shown
from anytraverse.evaluation.asking import Asked, add_asked, conclude
from anytraverse.evaluation.evaluating import Evaluation
from anytraverse.evaluation.labels import DatasetError
from anytraverse.evaluation.records import MOST_WORDS
from anytraverse.evaluation.summary import Summary, as_csv

_COLUMNS = (
    ("iou_mean", "mean IoU"),
    ("best_iou_mean", "best"),
    ("best_threshold", "above"),
    ("auroc", "AUROC"),
    ("drivable_above_half", "ground >.5"),
    ("unknown_above_half", "things >.5"),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.description = (
        "Compare sets of words on a labelled data set: IoU of drivable ground at 0.5 and at the best "
        "threshold, and how well the uncertainty tells things from ground. Frames that were judged with a "
        "set of words, here or by `evaluate` with the same --out, are not judged again. The last line is "
        "JSON."
    )
    add_asked(parser)
    parser.add_argument(
        "--prompts",
        action="append",
        required=True,
        metavar="WORDS",
        help='a set of words and weights, e.g. "trail: 1; bush: -1"; once for each set',
    )


def run(options: argparse.Namespace) -> int:
    """Judge the frames with each set of words, write the files, print the table and the JSON. Returns 0."""
    asked = Asked.of(options, list(dict.fromkeys(options.prompts)))
    if len(asked.words) > MOST_WORDS:
        raise DatasetError(f"{len(asked.words)} sets of words: {MOST_WORDS} at most can be compared")
    summaries = [asked.summary() for _ in asked.words]
    with asked.records() as records:
        evaluation = Evaluation(asked.dataset, asked.runs(), records)
        for number, tallies in evaluation:
            for summary, tally in zip(summaries, tallies, strict=True):
                summary.add(number, asked.dataset.name(number), tally)
    rows = [_row(words.format(), summary) for words, summary in zip(asked.words, summaries, strict=True)]
    figures = {
        "title": asked.dataset.title,
        "folder": options.folder,
        "split": asked.split,
        "from": options.first,
        "to": options.last,
        "every": options.every,
        "images": len(summaries[0].frames),
        "torn": evaluation.torn,
        "perceiver": options.perceiver,
        "model_id": asked.perceiver.model_id,
        "roi_threshold": asked.perceiver.defaults.roi,
        "drivable": asked.drivable,
        "unknown": asked.unknown,
        "rows": rows,
    }
    written = {
        "sweep.md": markdown(figures),
        "sweep.csv": as_csv([{key: row[key] for key in ("prompts", *dict(_COLUMNS))} for row in rows]),
        "sweep.json": json.dumps(figures, indent=1, allow_nan=False) + "\n",
    }
    conclude(options, written, text_of(figures), figures)
    return 0


def _row(prompts: str, summary: Summary) -> dict[str, Any]:
    """Return the figures of a set of words for JSON."""
    figures = summary.figures(0)
    best = max(figures["curve"], key=lambda step: (step["iou_mean"] or 0.0, -abs(step["threshold"] - 0.5)))
    kept = ("iou_mean", "iou_authors", "iou_pooled", "iou_known_mean", "auroc")
    return {
        "prompts": prompts,
        **{key: figures[key] for key in kept},
        "best_threshold": best["threshold"],
        "best_iou_mean": best["iou_mean"],
        "drivable_above_half": figures["drivable_above_half"],
        "unknown_above_half": figures["unknown_above_half"],
        "curve": figures["curve"],
        "calls": figures["calls"],
    }


def _cells(row: Mapping[str, Any]) -> Sequence[str]:
    return [shown(row[key]).strip() for key, _ in _COLUMNS]


def text_of(figures: Mapping[str, Any]) -> str:
    """Return the sets of words as a table for a terminal, one under the other."""
    lines = [f"{figures['title']}: {figures['images']} frames, {figures['model_id']}"]
    lines.append("  " + "".join(f"{name:>12}" for _, name in _COLUMNS) + "   words")
    for row in figures["rows"]:
        lines += ["  " + "".join(f"{cell:>12}" for cell in _cells(row)) + f"   {row['prompts']}"]
    return "\n".join(lines)


def markdown(figures: Mapping[str, Any]) -> str:
    """Return the sets of words as a Markdown table."""
    lines = [
        f"# {figures['title']}: sets of words",
        "",
        f"{figures['images']} frames, `{figures['perceiver']}`. Drivable: {', '.join(figures['drivable'])}.",
        "",
        "| words | " + " | ".join(name for _, name in _COLUMNS) + " |",
        "|---" * (1 + len(_COLUMNS)) + "|",
        *(f"| {row['prompts']} | " + " | ".join(_cells(row)) + " |" for row in figures["rows"]),
    ]
    return "\n".join(lines) + "\n"
