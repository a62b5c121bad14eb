"""Plots the report's figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bench.clipseg.frames import COUNTS, SIZES
from bench.clipseg.lineup import CONTESTANTS
from bench.clipseg.results import Results

COLOURS = {
    "resize": "#b8b8b8",
    "tower": "#3b6ea5",
    "decoder": "#e39b3d",
    "scores": "#c94f4f",
    "tail": "#8db3d9",
    "scene": "#7a4f9a",
    "maps": "#5aa469",
    "pooling": "#b5d99c",
}


def draw(results: Results, path: Path) -> None:
    """Writes the PNG `path`: CPU time by parts for every number of prompts, and peak memory."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(20, 6), width_ratios=[3, 1], layout="constrained")
    _draw_times(left, results)
    _draw_memory(right, results)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _draw_times(axes: Any, results: Results) -> None:
    size = SIZES[0]
    bar = 0.8 / len(results.names)
    told: set[str] = set()
    for group, count in enumerate(COUNTS):
        for index, name in enumerate(results.names):
            label, samples = CONTESTANTS[name].label, results.of(name, size, count)
            if not samples:
                continue
            place, height = group + (index - (len(results.names) - 1) / 2) * bar, 0.0
            for part in [part for part in COLOURS if any(part in sample.parts for sample in samples)]:
                milliseconds = results.part(name, part, size, count).median * 1e3
                axes.bar(
                    place,
                    milliseconds,
                    0.9 * bar,
                    bottom=height,
                    color=COLOURS[part],
                    label=None if part in told else part,
                )
                told.add(part)
                height += milliseconds
            faster = results.times_faster(name, size, count)
            told_faster = f"  {faster.median:.2f}x" if faster and index else ""
            axes.text(place, height, f" {label}{told_faster}", rotation=90, ha="center", va="bottom", size=7)
    axes.set_xticks(range(len(COUNTS)), [f"{count} prompt{'s' * (count > 1)}" for count in COUNTS])
    axes.set_ylim(0, axes.get_ylim()[1] * 1.35)
    axes.set_ylabel("process CPU time of a step, ms")
    axes.set_title(f"One thread, {size[0]}x{size[1]}")
    axes.legend(ncols=len(told), loc="upper center", bbox_to_anchor=(0.5, -0.06), frameon=False)


def _draw_memory(axes: Any, results: Results) -> None:
    peaks = [results.peak_mb(name, SIZES[0]) or 0.0 for name in results.names]
    bars = axes.barh([CONTESTANTS[name].label for name in results.names], peaks, color="#3b6ea5")
    axes.bar_label(bars, fmt=" %.0f")
    axes.invert_yaxis()
    axes.set_xlim(0, 1.2 * max(peaks))
    axes.set_xlabel("peak resident memory, MB")
