"""Draws the calls up to each frame of the real drive beside the paper's 15 % and 5 %.

Run: python -m bench.calls.plot bench/results/calls.json docs/calls.svg
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from anytraverse.plots import Axis, Curve, curves, svg
from bench.calls.operators import OPERATORS, AnsweredCall
from bench.series import PlottedSeries

TITLE = "Calls up to each frame of the real drive, which is driven twice"
SHARES = {"15 %": 0.15, "5 %": 0.05}
"""Of the frames: the paper's share of calls at first, and later."""
_POINTS = 40
_COLOURS = {"go": "--green", "word": "--blue", "tap": "--red", "15 %": "--grey", "5 %": "--grey"}


def series(
    calls: Mapping[str, Sequence[AnsweredCall]], frames: int, rate: float, again: float
) -> PlottedSeries:
    """Return the calls of both passes up to each frame. again: seconds at which the second pass begins."""
    found = PlottedSeries(TITLE, "frames", "calls")
    for step in range(_POINTS + 1):
        place = 2 * frames * step // _POINTS
        until = place / rate if place <= frames else again + (place - frames) / rate
        for name, each in calls.items():
            found.add(name, place, [sum(call.at <= until for call in each)])
        for name, share in SHARES.items():
            found.add(name, place, [share * place])
    return found


def drawn(lines: Mapping[str, Sequence[Sequence[float]]]) -> str:
    """Return the plot as a file of SVG."""
    given = [
        Curve(name, _COLOURS[name], [{"x": point[0], "y": point[1]} for point in lines[name]])
        for name in (*OPERATORS, *SHARES)
    ]
    width = max(point[0] for points in lines.values() for point in points)
    return svg(curves(TITLE, "", given, Axis("frames, driven twice", (0.0, width)), Axis("calls")), 560, 300)


def main(arguments: list[str] | None = None) -> None:
    """Write the plot of a result."""
    parser = argparse.ArgumentParser(prog="python -m bench.calls.plot", description=__doc__)
    parser.add_argument("result", type=Path, help="what --out of bench.calls wrote")
    parser.add_argument("svg", type=Path)
    given = parser.parse_args(arguments)
    told: dict[str, Any] = json.loads(given.result.read_text(encoding="utf-8"))
    found = next((one for one in told.get("series", ()) if one["title"] == TITLE), None)
    if found is None:
        parser.error(f"{given.result} has no real drive: run python -m bench.calls real --out {given.result}")
    given.svg.write_text(drawn(found["lines"]), encoding="utf-8")


if __name__ == "__main__":
    main()
