"""Runs `anytraverse sweep`: several sets of words side by side, for which each frame is encoded once."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from anytraverse.evaluation.arguments import add_cache, cache_bytes, rounded, shown
from anytraverse.evaluation.asking import EvaluationRequest, add_asked, conclude
from anytraverse.evaluation.labels import DatasetError
from anytraverse.evaluation.matching import told
from anytraverse.evaluation.records import MOST_WORDS
from anytraverse.evaluation.seeing import maps_identity
from anytraverse.evaluation.summary import TallySummary, as_csv
from anytraverse.evaluation.weights import WeightScore, WeightSweep, read_weights
from anytraverse.perception.stored import PerceptionStore, StoredPerceiver, default_cache
from anytraverse.preferences import Preferences

_BEST, _OTHERS = 5, 3
"""How many sets of weights are judged in full: the best by small maps, and others, to see the error."""
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
        default=[],
        metavar="WORDS",
        help='a set of words and weights, e.g. "trail: 1; bush: -1"; once for each set',
    )
    parser.add_argument(
        "--weights",
        metavar="WORDS",
        help='words with several weights each, "trail: 0.6,0.8,1; bush: -1": all choices are compared by '
        "small maps, and the best of them in full",
    )
    add_cache(parser)


def run(options: argparse.Namespace) -> int:
    """Judge the frames with each set of words, write the files, print the table and the JSON. Returns 0."""
    sets = read_weights(options.weights) if options.weights is not None else []
    given = list(dict.fromkeys(options.prompts))
    if not (given or sets):
        raise DatasetError("nothing is compared: give --prompts for each set of words, or --weights")
    asked = EvaluationRequest.of(options, [*given, *(one.format() for one in sets[:1])])
    ranked = _ranked(asked, sets) if sets else []
    words = [*map(Preferences.parse, given), *(one.words for one in in_full(ranked))]
    asked = replace(asked, words=tuple(dict.fromkeys(words)))
    if len(asked.words) > MOST_WORDS:
        raise DatasetError(f"{len(asked.words)} sets of words: {MOST_WORDS} at most can be compared")
    matches = asked.matches()
    summaries = [asked.summary() for _ in asked.words]
    with asked.records() as records:
        evaluation = asked.judged(records)
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
        "matches": {word: one._asdict() for word, one in matches.items()},
        "rows": rows,
        "weights": _weights(ranked, rows) if ranked else None,
    }
    written = {
        "sweep.md": markdown(figures),
        "sweep.csv": as_csv([{key: row[key] for key in ("prompts", *dict(_COLUMNS))} for row in rows]),
        "sweep.json": json.dumps(figures, indent=1, allow_nan=False) + "\n",
    }
    if ranked:
        written["weights.csv"] = as_csv([_weight_row(one) for one in ranked])
    conclude(options, written, text_of(figures), figures)
    return 0


def _ranked(asked: EvaluationRequest, sets: Sequence[Preferences]) -> list[WeightScore]:
    """Score sets of weights by small maps, the best first. No frame is perceived that was seen before."""
    options = asked.options
    identity = maps_identity(options.perceiver, asked.perceiver)
    store = PerceptionStore(options.cache or default_cache(), identity, cache_bytes(options))
    perceiver = StoredPerceiver(asked.perceiver, store)
    scores = WeightSweep(asked.dataset, perceiver, asked.drivable).scores(sets)
    return sorted(scores, key=lambda one: -(one.iou_mean or 0.0))


def in_full(ranked: Sequence[WeightScore]) -> list[WeightScore]:
    """Return the sets of weights that are judged in full, too: the best ones, and some of all the others."""
    others = ranked[_BEST:]
    step = max(1, -(-len(others) // _OTHERS))
    return [*ranked[:_BEST], *others[step - 1 :: step]]


def _weights(ranked: Sequence[WeightScore], rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return how many sets of weights were compared, and by how much the small maps were wrong."""
    full = {row["prompts"]: row["iou_mean"] for row in rows}
    apart = [
        abs(one.iou_mean - exact)
        for one in ranked
        if one.iou_mean is not None and (exact := full.get(one.words.format())) is not None
    ]
    return {
        "sets": len(ranked),
        "judged_in_full": len(apart),
        "error_mean": rounded(sum(apart) / len(apart)) if apart else None,
        "error_max": rounded(max(apart, default=None)),
        "best": [_weight_row(one) for one in ranked[:_BEST]],
    }


def _weight_row(one: WeightScore) -> dict[str, Any]:
    return {
        "prompts": one.words.format(),
        "iou_mean": rounded(one.iou_mean),
        "iou_pooled": rounded(one.iou_pooled),
        "best_iou_mean": rounded(one.best_iou_mean),
        "best_threshold": one.best_threshold,
    }


def _row(prompts: str, summary: TallySummary) -> dict[str, Any]:
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
    lines.append(f"classes of the words: {told(figures['matches'])}")
    if (weights := figures["weights"]) is not None:
        lines.append(
            f"{weights['sets']} sets of weights by small maps: all in weights.csv; "
            f"{weights['judged_in_full']} of them are judged in full above. Mean IoU of small maps is wrong "
            f"by {shown(weights['error_mean'])} in the mean, {shown(weights['error_max'])} at most"
        )
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
