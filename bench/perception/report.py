"""Writes the table, the results' file and the last line."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bench.perception.approaches import DISTANCES
from bench.perception.figures import Figure
from bench.perception.scenes import FEW, MANY
from bench.perception.stops import TRAINED
from bench.perception.taps import TAPPED
from bench.perception.things import KINDS

RESULTS = Path(__file__).resolve().parents[1] / "results" / "perception.json"


_PAIRS = (
    ("drivable IoU, the rover's words", "IoU, rover's words: {}"),
    ("drivable IoU, words for all", "IoU, words for all: {}"),
    ("clean frames stopped", "clean frames stopped: {}"),
    ("drivable although -1: bush, lower half's pixels", "drivable although -1, {}: bush"),
    ("drivable although -1: puddle", "drivable although -1, {}: puddle"),
)
"""Row -> the name of its figure at home and abroad."""
_ABROAD = (
    ("real things over 2 % of the ROI that are not OK", "real things over 2% of the ROI, abroad: not OK"),
    ("real plants over 2 % of the ROI that are not OK", "real plants over 2% of the ROI, abroad: not OK"),
)


def markdown(
    figures: Mapping[str, Figure | str],
    first: Mapping[str, Mapping[str, int]],
    sources: Mapping[str, tuple[str, ...]],
) -> str:
    """Return three tables: the summary, every figure, and at which distances things were first noticed."""
    lines = [*_summary(figures, sources), "", "| | figure [95 % interval] (count) |", "|---|---|"]
    lines += [f"| {name.replace('  ', '&nbsp;&nbsp;', 1)} | {figure} |" for name, figure in figures.items()]
    if first:
        heads = [*(f"{d:.1f} m" for d in DISTANCES[1:]), "never"]
        lines += ["", f"| first noticed at | {' | '.join(heads)} |", "|---" * (len(heads) + 1) + "|"]
        lines += [
            f"| {name} | " + " | ".join(str(row.get(head, "")) for head in heads) + " |"
            for name, row in first.items()
        ]
    return "\n".join(lines)


def _summary(figures: Mapping[str, Figure | str], sources: Mapping[str, tuple[str, ...]]) -> list[str]:
    """Return the lines of the table of home and abroad, with what was measured."""
    rows = [(title, name.format("home"), name.format("abroad")) for title, name in _PAIRS]
    rows[3:3] = [("the same, of drives that it was trained on", f"clean frames stopped: {TRAINED}", "")]
    rows += [(title, "", name) for title, name in _ABROAD]
    for kind, own in sources.items():
        flat = " deep, flat" if kind == "tarp" else " high"
        title = f"never noticed: {kind}, {KINDS[kind].height:g} m{flat} ({'; '.join(own)})"
        rows.append((title, f"  home, {kind}", f"  abroad, {kind}"))
    rows += [(what, f"{what}: home", f"{what}: abroad") for what in TAPPED]
    for count in (FEW, MANY):
        near = f"near recall at {count}: other light, moved"
        rows.append((f"a place seen again matches, of {count} scenes", near, ""))
        foreign = f"foreign match at {count}: frames abroad"
        rows.append((f"a frame from elsewhere matches one of {count} scenes", "", foreign))
    lines = ["| | home | abroad |", "|---|---|---|"]
    for title, home, abroad in rows:
        if home in figures or abroad in figures:
            lines.append(f"| {title} | {figures.get(home, '')} | {figures.get(abroad, '')} |")
    return lines


def write(
    path: Path, told: Mapping[str, Any], figures: Mapping[str, Figure | str], more: Mapping[str, Any]
) -> None:
    """Write the results' file."""
    parts = {
        name: figure.as_json() if isinstance(figure, Figure) else figure for name, figure in figures.items()
    }
    content = {**told, "figures": parts, **more}
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=1) + "\n")
