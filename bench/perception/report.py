"""Writes the table, the results' file and the last line."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bench.perception.approaches import DISTANCES
from bench.perception.figures import Figure

RESULTS = Path(__file__).resolve().parents[1] / "results" / "perception.json"


def markdown(figures: Mapping[str, Figure | str], first: Mapping[str, Mapping[str, int]]) -> str:
    """Return the table of figures, and the one of distances at which things were first noticed."""
    lines = ["| | figure [95 % interval] (count) |", "|---|---|"]
    lines += [f"| {name.replace('  ', '&nbsp;&nbsp;', 1)} | {figure} |" for name, figure in figures.items()]
    if first:
        heads = [*(f"{d:.1f} m" for d in DISTANCES[1:]), "never"]
        lines += ["", f"| first noticed at | {' | '.join(heads)} |", "|---" * (len(heads) + 1) + "|"]
        lines += [
            f"| {name} | " + " | ".join(str(row.get(head, "")) for head in heads) + " |"
            for name, row in first.items()
        ]
    return "\n".join(lines)


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
