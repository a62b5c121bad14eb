"""Runs `anytraverse evaluate`: a perceiver on a published data set, as the paper's table asks."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from typing import Any

from anytraverse.evaluation.arguments import setting
from anytraverse.evaluation.asking import EvaluationRequest, add_asked, conclude
from anytraverse.evaluation.exhibits import Exhibit, draw
from anytraverse.evaluation.page import page
from anytraverse.evaluation.report import markdown, text_of
from anytraverse.evaluation.seeing import PerceiverRun
from anytraverse.plots import installed
from anytraverse.release import to_install

_EXTREMES = 6
"""How many of the best and of the worst frames are shown."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.description = (
        "Evaluate a perceiver on a labelled data set: IoU of drivable ground beside the paper's figures, "
        "recall of each class, curves over thresholds, AUROC of the uncertainty, and a page of the best and "
        "worst frames. A run that was stopped goes on where it was. The last line is JSON."
    )
    add_asked(parser)
    parser.add_argument("--prompts", metavar="WORDS", help="words and weights, by default the paper's")


def run(options: argparse.Namespace) -> int:
    """Judge the frames, write the files, print the table and the JSON. Returns 0."""
    asked = EvaluationRequest.of(options, [] if options.prompts is None else [options.prompts])
    (seeing,) = asked.runs()
    matches = asked.matches()
    summary = asked.summary()
    with asked.records() as records:
        evaluation = asked.judged(records)
        for number, (tally,) in evaluation:
            summary.add(number, asked.dataset.name(number), tally)
    figures = {
        "title": asked.dataset.title,
        "drivable": asked.drivable,
        "paper": asked.defaults.paper,
        "as_paper": asked.as_paper(seeing.words),
        "roi_threshold": asked.perceiver.defaults.roi,
        **setting(options, seeing, evaluation.torn, len(summary.frames)),
        "split": asked.split,
        "matches": {word: one._asdict() for word, one in matches.items()},
        **summary.figures(min(_EXTREMES, max(1, len(summary.frames) // 2))),
    }
    written = {
        "evaluation.html": page(figures, _exhibits(figures, asked, seeing)),
        "results.md": markdown(figures),
        "evaluation.json": json.dumps(figures, indent=1, allow_nan=False) + "\n",
        "frames.csv": summary.frames_csv(),
        "curve.csv": summary.curve_csv(),
    }
    conclude(options, written, text_of(figures), figures)
    if not installed():
        print(f"evaluation.html has no plots: {to_install('plots')}", file=sys.stderr)
    return 0


def _exhibits(
    figures: Mapping[str, Any], asked: EvaluationRequest, seeing: PerceiverRun
) -> dict[int, Exhibit]:
    """Judge the best and the worst frames once more, and draw them."""
    drawn: dict[int, Exhibit] = {}
    for row in (*figures["worst"], *figures["best"]):
        frame = asked.dataset.read(row["frame"])
        drawn[row["frame"]] = draw(frame, seeing.look(frame), asked.dataset.classes, asked.drivable)
    return drawn
