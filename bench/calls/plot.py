"""Draws the calls up to each frame of the real drive beside the paper's 15 % and 5 %.

Run: python -m bench.calls.plot bench/results/calls.json docs/calls.svg
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from anytraverse import line_plot
from bench.calls.operators import OPERATORS, AnsweredCall
from bench.series import PlottedSeries

TITLE = "Calls up to each frame of the real drive, which is driven twice"
SHARES = {"15 %": 0.15, "5 %": 0.05}
"""Of the frames: the paper's share of calls at first, and later."""
_POINTS = 40
_COLOURS = {
    "go": "#009e73", "word": "#0969da", "tap": "#d55e00", "15 %": "#8a929b", "5 %": "#8a929b"
}  # fmt: skip
_LOOK = {"var(--faint)": "#57606a", "var(--line)": "#d5dae0", "var(--grey)": "#8a929b"}


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
        line_plot.Series(name, f"--{place}", [(point[0], point[1]) for point in lines[name]])
        for place, name in enumerate((*OPERATORS, *SHARES))
    ]
    width = max(point[0] for points in lines.values() for point in points)
    height = max(point[1] for points in lines.values() for point in points)
    plot = line_plot.line_plot(
        given, "frames, driven twice", x=(0.0, width), y=(0.0, 1.02 * height), size=(560, 300)
    )
    for place, name in enumerate((*OPERATORS, *SHARES)):
        plot = plot.replace(f"var(--{place})", _COLOURS[name])
    look = "svg { background: #fff; font-family: sans-serif; }" + line_plot.STYLE
    for name, colour in _LOOK.items():
        look = look.replace(name, colour)
    style = f"<style>{look}</style>"
    head, body = plot.split(">", 1)
    return f'{head} xmlns="http://www.w3.org/2000/svg">{style}{body}\n'


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
