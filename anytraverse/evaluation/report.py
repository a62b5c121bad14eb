"""Writes the figures of an evaluation as text for a terminal and as Markdown, beside the paper's."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from anytraverse.evaluation.arguments import shown
from anytraverse.evaluation.datasets import ALL
from anytraverse.evaluation.matching import told

Figures = Mapping[str, Any]
"""What `evaluation.json` holds; docs/scoring.md describes its keys."""

HEADLINES = (
    ("iou_authors", "mean IoU as the authors count", "pixels without a label count as not drivable"),
    ("iou_mean", "mean IoU over labelled pixels", "traversability above 0.5, mean over frames"),
    ("iou_pooled", "pooled IoU over labelled pixels", "all pixels of all frames together"),
    ("iou_known_mean", "mean IoU of known and drivable", "what the rover takes for drivable"),
    ("auroc", "AUROC of the uncertainty", "things that no word names, against drivable ground"),
)
"""Key, name and meaning of the figures that stand first."""


def asked(figures: Figures) -> str:
    """Return the words and weights in one line."""
    return "; ".join(f"{word}: {weight:g}" for word, weight in figures["prompts"].items())


def scope(figures: Figures) -> str:
    """Return which frames were scored, in one line."""
    parts = [f"{figures['images']} frames"]
    if figures["torn"]:
        parts[0] += f" ({figures['torn']} torn)"
    if figures["split"] != ALL:
        parts.append(f"split {figures['split']}")
    if figures["from"] is not None or figures["to"] is not None:
        parts.append(f"numbers {figures['from'] or 'first'} to {figures['to'] or 'last'}")
    if figures["every"] != 1:
        parts.append(f"one of {figures['every']}")
    return ", ".join(parts)


def comparison(figures: Figures) -> list[tuple[str, float | None, str]]:
    """Return method, mean IoU and a remark for the paper's methods and for this run, which comes last."""
    rows = [(method, iou, "the paper's figure") for method, iou in figures["paper"].items()]
    same = "" if figures["as_paper"] or not figures["paper"] else ", not asked as in the paper"
    remark = f"measured here on {figures['images']} frames{same}"
    return [*rows, (figures["model_id"], figures["iou_authors"], remark)]


def text_of(figures: Figures) -> str:
    """Return the figures as a table for a terminal."""
    lines = [
        f"{figures['title']}: {scope(figures)}, {figures['model_id']}, "
        f"{figures['ms_per_frame']:.1f} ms a frame"
    ]
    lines += ["  mean IoU"]
    lines += [f"    {method:32}{shown(iou):>8}   {remark}" for method, iou, remark in comparison(figures)]
    lines += ["  figures"]
    lines += [f"    {name:32}{shown(figures[key]):>8}   {meaning}" for key, name, meaning in HEADLINES]
    lines += [f"  {'classes':34}{'recall':>8}"]
    for name, row in figures["classes"].items():
        side = "drivable" if row["drivable"] else "not drivable"
        lines.append(f"    {name:32}{shown(row['recall']):>8}   {side}")
    lines.append(f"  words         {told(figures['matches'])}")
    return "\n".join(lines)


def markdown(figures: Figures) -> str:
    """Return the figures as a Markdown page with the table beside the paper's figures."""
    lines = [
        f"# {figures['title']}: drivable ground",
        "",
        "| method | mean IoU | |",
        "|---|---|---|",
        *(f"| {method} | {shown(iou).strip()} | {remark} |" for method, iou, remark in comparison(figures)),
        "",
        f"Frames: {scope(figures)}. Words: `{asked(figures)}`. Drivable: {', '.join(figures['drivable'])}.",
        f"Classes of the words: {told(figures['matches'])}.",
        f"Perceiver: `{figures['perceiver']}`, {figures['ms_per_frame']:.1f} ms a frame.",
        "",
        "| figure | value | what it is |",
        "|---|---|---|",
        *(f"| {name} | {shown(figures[key]).strip()} | {meaning} |" for key, name, meaning in HEADLINES),
        "",
        "| class | drivable | recall | pixels |",
        "|---|---|---|---|",
    ]
    for name, row in figures["classes"].items():
        drivable = "yes" if row["drivable"] else "no"
        lines.append(f"| {name} | {drivable} | {shown(row['recall']).strip()} | {row['pixels']} |")
    lines += ["", "| threshold | mean IoU | pooled IoU | precision | recall |", "|---|---|---|---|---|"]
    for row in figures["curve"]:
        cells = (row[key] for key in ("iou_mean", "iou_pooled", "precision", "recall"))
        lines.append(
            f"| {row['threshold']:.2f} | " + " | ".join(shown(cell).strip() for cell in cells) + " |"
        )
    return "\n".join(lines) + "\n"
