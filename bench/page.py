"""Makes the page of results: one HTML file with tables and plots, that opens anywhere. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from anytraverse.html_page import document
from anytraverse.plots import STYLE, drawing, section
from bench.comparing import ALIKE, BETTER, UNKNOWN, WORSE, Change
from bench.plot import plot
from bench.result import FAILED, RAN, BenchResult, MeasuredFigure

_STYLE = (
    STYLE
    + """
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
td, th { text-align: left; padding: .25rem .9rem .25rem 0; border-bottom: 1px solid var(--line);
  vertical-align: top; }
.wide { overflow-x: auto; }
.plots { display: grid; gap: 1rem 2.5rem;
  grid-template-columns: repeat(auto-fit, minmax(min(100%, 30rem), 1fr)); }
.plots h2 { margin: .6rem 0; font-size: 1rem; border: 0; }
.failed, .worse { color: var(--red); font-weight: 600; } .better { color: var(--green); font-weight: 600; }
code { overflow-wrap: anywhere; }
"""
)
_FACTS = (
    "cpu",
    "cores",
    "memory_mb",
    "governor",
    "os",
    "python",
    "numpy",
    "onnxruntime",
    "opencv-python-headless",
)


def page(
    results: Mapping[str, BenchResult], changed: Sequence[Change] = (), against: str = "", other: str = ""
) -> str:
    """Returns the page. changed: since the results in `against`. other: how its machine differs."""
    parts = ["<h1>Benchmarks</h1>", _machine(list(results.values())), _summary(results)]
    if against:
        parts += [f"<h2>Compared with {escape(against)}</h2>", *_compared(changed, other)]
    before = {(one.name, one.what): one for one in changed}
    for name, result in results.items():
        if result.state in (RAN, FAILED):
            parts += _result(name, result, before)
    return document("Benchmarks", _STYLE, [*parts, *drawing()])


def _machine(results: Sequence[BenchResult]) -> str:
    """Tells of each machine what the results of it share."""
    told: dict[str, list[str]] = {}
    for one in results:
        facts = [f"{key} {one.run[key]}" for key in _FACTS if one.run.get(key) is not None]
        told.setdefault(", ".join(facts), []).append(one.name)
    lines = [
        f"{escape(facts)}{': ' + escape(', '.join(names)) if len(told) > 1 else ''}"
        for facts, names in told.items()
    ]
    return f'<p class="faint">{"<br>".join(lines)}</p>'


def _summary(results: Mapping[str, BenchResult]) -> str:
    heads = ("benchmark", "what it measures", "state", "seconds", "load", "commit", "when (UTC)")
    rows = []
    for name, one in results.items():
        quick = ", quick" if one.quick and one.state == RAN else ""
        state = f'<span class="{one.state}">{one.state}</span>{quick}'
        why = f'<br><span class="faint">{escape(one.why)}</span>' if one.why else ""
        link = f'<a href="#{escape(name)}">{escape(name)}</a>' if one.state in (RAN, FAILED) else escape(name)
        run = {**one.run, "when": str(one.run.get("when", ""))[:16].replace("T", " ")}
        told = [
            f"{one.seconds:.0f}" if one.seconds else "",
            *(run.get(key, "") for key in ("load", "commit", "when")),
        ]
        rows.append([link, escape(one.measures), state + why, *(escape(str(cell)) for cell in told)])
    return _table(heads, rows)


def _compared(changed: Sequence[Change], other: str) -> list[str]:
    counts = ", ".join(
        f"{sum(one.verdict == verdict for one in changed)} {verdict}"
        for verdict in (WORSE, BETTER, ALIKE, UNKNOWN)
    )
    parts = [f'<p class="faint">{len(changed)} figures: {counts}.</p>']
    if other:
        parts.append(f'<p class="worse">Another machine: {escape(other)}.</p>')
    rows = [
        [escape(one.name), escape(one.what), _value(one.before), _value(one.now), _share(one)]
        for one in sorted(changed, key=lambda one: (one.verdict != WORSE, one.verdict != BETTER))
        if one.verdict in (WORSE, BETTER)
    ]
    if rows:
        parts.append(_table(("benchmark", "figure", "before", "now", "change"), rows))
    return parts


def _result(name: str, result: BenchResult, before: Mapping[tuple[str, str], Change]) -> list[str]:
    parts = [
        f'<h2 id="{escape(name)}">{escape(name)}</h2>',
        f'<p>{escape(result.measures)}.<br><code class="faint">{escape(result.command)}</code></p>',
    ]
    if result.why:
        parts.append(f'<p class="{result.state}">{escape(result.why)}</p>')
    rows = []
    for what, figure in result.figures.items():
        change = before.get((name, what))
        earlier = [_value(change.before), _share(change)] if change else ["", ""]
        rows.append([escape(what), _value(figure), *earlier])
    if rows:
        heads = ("figure", "measured", "before", "change") if before else ("figure", "measured")
        parts.append(_table(heads, [row[: len(heads)] for row in rows]))
    if result.series:
        parts.append(f'<div class="plots">{"".join(map(_series, result.series))}</div>')
    return parts


def _series(series: Mapping[str, Any]) -> str:
    powers = series.get("power", {})
    points = {line: {point[0]: point for point in all_} for line, all_ in series["lines"].items()}
    places = sorted({x for line in points.values() for x in line})
    shown = places[:: max(1, len(places) // 10)]
    rows = [
        [escape(line), *(f"{own[x][1]:.4g}" if x in own else "" for x in shown), f"{powers.get(line, '')}"]
        for line, own in points.items()
    ]
    heads = (f"{series['unit']} at {series['x']}", *(f"{x:,}" for x in shown), "power at the end")
    made = plot(series)
    return (
        f"<section>{section(made) if made is not None else ''}"
        f"<details><summary>as a table</summary>{_table(heads, rows)}</details></section>"
    )


def _value(figure: MeasuredFigure) -> str:
    spread = "" if figure.spread is None else f" [{figure.spread[0]:.4g}, {figure.spread[1]:.4g}]"
    return escape(f"{figure.value:.4g} {figure.unit}".strip() + spread)


def _share(change: Change) -> str:
    told = change.verdict if change.share is None else f"{change.share:+.0%}, {change.verdict}"
    return f'<span class="{change.verdict.partition(" ")[0]}">{escape(told)}</span>'


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Makes a table of cells that are HTML."""
    head = "".join(f"<th>{escape(one)}</th>" for one in heads)
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows)
    return f'<div class="wide"><table><tr>{head}</tr>{body}</table></div>'
