"""Counts the calls of each combination, and shows them: JSON, CSV, a table, a page to choose from. Pure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from anytraverse.assessment import Reason
from anytraverse.html_page import document
from anytraverse.plots import HINT, Axis, Curve, Plot, curves
from companion.desk.tuning.choice import STYLE, Choice, OfferedSetting, cell, combination, frontier, parts
from companion.desk.tuning.proposal import changes, fragment
from companion.desk.tuning.trial import Combination, TrialOutcome

_MOST_SHOWN = 36
_COLUMNS = (
    "number",
    "scene",
    "roi",
    "tile",
    "region",
    "calls",
    "noticed",
    "unknown_scene",
    "unknown_object",
    "first_half",
    "second_half",
    "matches",
    "not_ok",
    "would_hold",
    "refused",
)
_LINES = (
    ("all calls", "--green", None),
    ("unknown scene", "--blue", Reason.UNKNOWN_SCENE.value),
    ("unknown object", "--red", Reason.UNKNOWN_OBJECT.value),
)


def counted(number: int, outcome: TrialOutcome, frames: int, noticed: int | None) -> dict[str, Any]:
    """Return the figures of a combination as JSON values. A call counts for each of its reasons.

    number: by which it is taken. noticed: how many of the things of the drive, None where they are not known.
    """
    one = outcome.combination
    reasons = Counter(reason for call in outcome.calls for reason in call.reasons)
    first = sum(2 * call.frame < frames for call in outcome.calls)
    return {
        "number": number,
        **combination(one),
        "calls": len(outcome.calls),
        "noticed": noticed,
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


def csv_rows(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the rows for a table: without lists, but for the region as text."""
    return csv_rows_of([{key: row[key] for key in _COLUMNS} for row in rows])


def csv_rows_of(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return rows with all their values as cells of a table."""
    return [{key: cell(value) for key, value in row.items()} for row in rows]


def text_of(figures: Mapping[str, Any]) -> str:
    """Return the figures as a table for a terminal: the combinations with the fewest calls first."""
    lines = [
        f"{figures['title']}: {figures['frames']} frames, {len(figures['each'])} combinations in "
        f"{figures['seconds']:g} s",
        " number   scene     roi    tile   calls   scene  object  1st half   2nd  region",
    ]
    for row in sorted(figures["each"], key=lambda one: one["calls"])[:_MOST_SHOWN]:
        cells = csv_rows([row])[0]
        lines.append(
            f"{cells['number']:>7}{cells['scene']:>8}{cells['roi']:>8}{cells['tile']:>8}{cells['calls']:>8}"
            f"{cells['unknown_scene']:>8}{cells['unknown_object']:>8}{cells['first_half']:>10}"
            f"{cells['second_half']:>6}  {cells['region']}"
        )
    if len(figures["each"]) > _MOST_SHOWN:
        lines.append(f"... and {len(figures['each']) - _MOST_SHOWN} more in calls.csv")
    return "\n".join(lines)


def page(figures: Mapping[str, Any], now: Combination, command: str) -> str:
    """Return the page: the settings to choose from, and the calls of the chosen one up to each frame.

    now: in force. command: takes a setting, whose first {} is its number.
    """
    choice = choice_of(figures, now, command)
    told = (
        f"{figures['frames']} frames, {len(choice.settings)} combinations, {figures['model']}.<br>"
        f"Words at the start: {escape(figures['prompts'])}<br>Answered by {escape(figures['operator'])}."
    )
    head = [f"<h1>Calls of {escape(figures['title'])}</h1>", f'<p class="faint">{told}</p>']
    return document(
        f"Calls of {figures['title']}", STYLE, [*head, *parts(choice, _rising_plot(figures, choice))]
    )


def choice_of(figures: Mapping[str, Any], now: Combination, command: str) -> Choice:
    """Return the settings to choose from. Proposed: of those that notice most, the one that calls least."""
    rows, things = figures["each"], figures["things"]
    combinations = [Combination.read(row) for row in rows]
    settings = [
        OfferedSetting(
            number,
            one,
            row["calls"],
            row["noticed"] if things else row["would_hold"],
            fragment(one, now, [f"anytraverse calls: {figures['title']}, setting {number}"]),
            {key: row[key] for key in ("unknown_scene", "unknown_object", "first_half", "second_half")},
            curves=_rising(row, figures["frames"]),
        )
        for number, (one, row) in enumerate(zip(combinations, rows, strict=True))
    ]
    settings.sort(key=lambda one: (changes(one.combination, now), one.number))
    proposed = frontier(settings)[-1].number if things else None
    return Choice(
        settings,
        combinations.index(now) if now in combinations else None,
        proposed,
        f"calls in {figures['frames']} frames",
        "things noticed" if things else "times that it would be held",
        f"{figures['frames']} frames" + (f" with {things} thing{'s'[things == 1 :]}" if things else ""),
        command,
        most=things or None,
    )


def _rising_plot(figures: Mapping[str, Any], choice: Choice) -> Plot:
    first = next(iter(choice.shown()))
    note = f"Of the chosen setting, {figures['frames']} frames. A call counts for each of its reasons. {HINT}"
    lines = [
        Curve(name, colour, [row for row in first.curves if row["line"] == name])
        for name, colour, _ in _LINES
    ]
    across = Axis("frame", (0.0, figures["frames"]))
    return curves(
        "Calls up to each frame", note, lines, across, Axis("calls so far", whole=True), stepped=True
    )


def _rising(row: Mapping[str, Any], frames: int) -> list[dict[str, Any]]:
    """Return the count of calls at each call, of all and by reason, as rows of `plots.curves`."""
    rows = []
    for name, _, reason in _LINES:
        at = [
            frame
            for frame, reasons in zip(row["at_call"], row["reasons"], strict=True)
            if reason is None or reason in reasons
        ]
        counts = [(0, 0), *((frame, count) for count, frame in enumerate(at, 1)), (frames, len(at))]
        rows += [{"line": name, "x": frame, "y": count, "of frames": frames} for frame, count in counts]
    return rows
