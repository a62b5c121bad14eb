"""Counts the calls of each combination, and shows them: JSON, CSV, a table, a page of plots. Pure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from anytraverse.assessment import Reason
from anytraverse.html_page import document
from anytraverse.line_plot import STYLE, Series, line_plot
from companion.desk.tuning.trial import Combination, TrialOutcome

MOST_PLOTS = 36
_COLUMNS = (
    "scene",
    "roi",
    "tile",
    "region",
    "calls",
    "unknown_scene",
    "unknown_object",
    "first_half",
    "second_half",
    "matches",
    "not_ok",
    "would_hold",
    "refused",
)
_STYLE = (
    STYLE
    + """
.plots { display: grid; gap: .6rem 1.2rem; grid-template-columns: repeat(auto-fill, minmax(16rem, 1fr)); }
.plots h3 { font-size: .9rem; margin: .6rem 0 0; font-weight: normal; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
td, th { text-align: right; padding: .2rem .8rem .2rem 0; border-bottom: 1px solid var(--line); }
.table { overflow-x: auto; }
"""
)
_LINES = (
    ("all", "--grey", None),
    ("scene", "--blue", Reason.UNKNOWN_SCENE.value),
    ("object", "--red", Reason.UNKNOWN_OBJECT.value),
)


def counted(outcome: TrialOutcome, frames: int) -> dict[str, Any]:
    """Return the figures of a combination as JSON values. A call counts for each of its reasons."""
    one = outcome.combination
    reasons = Counter(reason for call in outcome.calls for reason in call.reasons)
    first = sum(2 * call.frame < frames for call in outcome.calls)
    return {
        **combination(one),
        "calls": len(outcome.calls),
        **{reason.value: reasons[reason.value] for reason in (Reason.UNKNOWN_SCENE, Reason.UNKNOWN_OBJECT)},
        "first_half": first,
        "second_half": len(outcome.calls) - first,
        "matches": len(outcome.matches),
        "not_ok": outcome.not_ok,
        "would_hold": outcome.would_hold,
        "refused": len(outcome.refused),
        "at_call": [call.frame + 1 for call in outcome.calls],
        "reasons": [list(call.reasons) for call in outcome.calls],
        "at_match": [frame + 1 for frame in outcome.matches],
    }


def combination(one: Combination) -> dict[str, Any]:
    """Return a combination as JSON values."""
    box = one.region
    return {
        "scene": one.scene,
        "roi": one.roi,
        "tile": one.tile,
        "region": [round(side, 4) for side in (box.left, box.top, box.right, box.bottom)],
    }


def csv_rows(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the rows for a table: without lists, but for the region as text."""
    return csv_rows_of([{key: row[key] for key in _COLUMNS} for row in rows])


def csv_rows_of(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return rows with all their values as cells of a table."""
    return [{key: _cell(value) for key, value in row.items()} for row in rows]


def _cell(value: Any) -> Any:
    if value is None:
        return "off"
    return " ".join(f"{side:g}" for side in value) if isinstance(value, list) else value


def text_of(figures: Mapping[str, Any]) -> str:
    """Return the figures as a table for a terminal: the combinations with the fewest calls first."""
    lines = [
        f"{figures['title']}: {figures['frames']} frames, {len(figures['each'])} combinations in "
        f"{figures['seconds']:g} s",
        "   scene     roi    tile   calls   scene  object  1st half   2nd  region",
    ]
    for row in sorted(figures["each"], key=lambda one: one["calls"])[:MOST_PLOTS]:
        cells = csv_rows([row])[0]
        lines.append(
            f"{cells['scene']:>8}{cells['roi']:>8}{cells['tile']:>8}{cells['calls']:>8}"
            f"{cells['unknown_scene']:>8}{cells['unknown_object']:>8}{cells['first_half']:>10}"
            f"{cells['second_half']:>6}  {cells['region']}"
        )
    if len(figures["each"]) > MOST_PLOTS:
        lines.append(f"... and {len(figures['each']) - MOST_PLOTS} more in calls.csv")
    return "\n".join(lines)


def page(figures: Mapping[str, Any]) -> str:
    """Return the page: the calls of each combination over the drive, all and by reason."""
    rows = figures["each"]
    most = max(1, *(row["calls"] for row in rows))
    shown = rows[:MOST_PLOTS]
    parts = [
        f"<h1>Calls of {escape(figures['title'])}</h1>",
        f'<p class="faint">{figures["frames"]} frames, {len(rows)} combinations, '
        f"{escape(figures['model'])}.<br>"
        f"Words at the start: {escape(figures['prompts'])}<br>Answered by {escape(figures['operator'])}.</p>",
        "<h2>Calls up to each frame</h2>",
        '<p class="faint">A call counts for each of its reasons. All plots have one scale.'
        + (f" The first {MOST_PLOTS} combinations; all are in calls.csv." if len(rows) > MOST_PLOTS else "")
        + "</p>",
        f'<div class="plots">{"".join(_plot(row, figures["frames"], most) for row in shown)}</div>',
        "<h2>Counts</h2>",
        f'<div class="table">{_table(rows)}</div>',
    ]
    return document(f"Calls of {figures['title']}", _STYLE, parts)


def _plot(row: Mapping[str, Any], frames: int, most: int) -> str:
    series = [Series(name, colour, _rising(row, reason, frames)) for name, colour, reason in _LINES]
    cells = csv_rows([row])[0]
    title = f"scene {cells['scene']}, roi {cells['roi']}, tile {cells['tile']}, region {cells['region']}"
    drawn = line_plot(series, "frame", x=(0, frames), y=(0, most), size=(240, 130))
    return f"<div><h3>{escape(title)}: {row['calls']}</h3>{drawn}</div>"


def _rising(row: Mapping[str, Any], reason: str | None, frames: int) -> list[tuple[float, float]]:
    """Return the corners of the count of calls up to each frame."""
    points, count = [(0.0, 0.0)], 0
    for frame, reasons in zip(row["at_call"], row["reasons"], strict=True):
        if reason is None or reason in reasons:
            points += [(frame, count), (frame, count + 1)]
            count += 1
    return [*points, (float(frames), float(count))]


def _table(rows: Sequence[Mapping[str, Any]]) -> str:
    head = "".join(f"<th>{escape(name.replace('_', ' '))}</th>" for name in _COLUMNS)
    cells = [
        f"<tr>{''.join(f'<td>{escape(str(row[key]))}</td>' for key in _COLUMNS)}</tr>"
        for row in csv_rows(rows[:1000])
    ]
    return f"<table><tr>{head}</tr>{''.join(cells)}</table>"
