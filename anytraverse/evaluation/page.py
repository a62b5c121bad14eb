"""Writes the page of an evaluation: one HTML file with its pictures inside, that opens anywhere. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from anytraverse.evaluation.exhibits import WIDTH, Exhibit
from anytraverse.evaluation.report import HEADLINES, Figures, asked, comparison, scope
from anytraverse.html_page import document, figure
from anytraverse.plots import HINT, Axis, Curve, Plot, curves, drawing, section
from anytraverse.plots import STYLE as PLOTS

_STYLE = """
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
td, th { text-align: left; padding: .25rem .9rem .25rem 0; border-bottom: 1px solid var(--line);
  vertical-align: top; }
th { white-space: nowrap; }
td.n, th.n { text-align: right; }
tr.own td { font-weight: 600; }
.beside { display: grid; gap: 1rem 2.5rem;
  grid-template-columns: repeat(auto-fit, minmax(min(100%, 27rem), 1fr)); }
.beside > *, .wide { overflow-x: auto; }
.bar { display: inline-block; height: .7em; border-radius: 2px; background: var(--green); }
.bar.no { background: var(--red); }
.track { min-width: 6rem; }
.key { display: inline-block; width: .8em; height: .8em; border-radius: 2px; margin-right: .35em; }
.legend { margin: .3rem 0; } .legend b { margin-right: 1rem; }
.legend span { margin-right: 1.4rem; white-space: nowrap; }
.frame { margin: 1.2rem 0; } .frame h3 { margin: 0 0 .4rem; font-size: 1rem; overflow-wrap: anywhere; }
"""
_CURVES = (
    ("iou_mean", "mean IoU", "--green"),
    ("iou_pooled", "pooled IoU", "--blue"),
    ("precision", "precision", "--violet"),
    ("recall", "recall", "--red"),
)
_CALLS = (
    ("things", "holds a thing", "--green"),
    ("clean", "all drivable", "--red"),
)
_LEGENDS = (
    (
        "judged",
        (("--green", "drivable"), ("--red", "not drivable"), ("--violet", "stripes: unknown")),
    ),
    (
        "right and wrong",
        (
            ("--green", "drivable, and found so"),
            ("--red", "found drivable, and is not"),
            ("--violet", "drivable, and not found"),
            ("--grey", "not labelled"),
        ),
    ),
)
_HALF = ("0.5, in use", 0.5)
_FEW = 30
"""Frames below which it is told what one of them weighs."""
_CAPTIONS = ("picture", "judged", "right and wrong")


def page(figures: Figures, exhibits: Mapping[int, Exhibit]) -> str:
    """Return the page. exhibits: by the number of a frame, for those under "best" and "worst"."""
    parts = [
        f"<h1>{escape(figures['title'])}</h1>",
        f'<p class="faint">{escape(scope(figures))}. {escape(figures["model_id"])}, '
        f"{figures['ms_per_frame']:.1f} ms a frame.<br>Words: {escape(asked(figures))}<br>"
        f"Drivable: {escape(', '.join(figures['drivable']))}</p>",
        f'<div class="beside"><div>{_compared(figures)}</div><div>{_headlines(figures)}</div></div>',
        section(ground_plot(figures)),
        section(calls_plot(figures)),
        f"<h2>Classes</h2>{_classes(figures['classes'], figures['matches'])}",
        "<h2>The worst frames</h2>",
        *(_legend(name, keys) for name, keys in _LEGENDS),
        *_frames(figures["worst"], exhibits),
        "<h2>The best frames</h2>",
        *_frames(figures["best"], exhibits),
        *drawing(),
    ]
    return document(f"{figures['title']}, {figures['model_id']}", _STYLE + PLOTS, parts)


def _number(value: float | None) -> str:
    return "&ndash;" if value is None else f"{value:.3f}"


def _compared(figures: Figures) -> str:
    rows = comparison(figures)
    cells = [
        f"<tr{' class=own' if row is rows[-1] else ''}><td>{escape(method)}</td>"
        f'<td class="n">{_number(iou)}</td><td class="faint">{escape(remark)}</td></tr>'
        for row in rows
        for method, iou, remark in (row,)
    ]
    head = '<tr><th>method</th><th class="n">mean IoU</th><th>remark</th></tr>'
    return f"<table>{head}{''.join(cells)}</table>"


def _headlines(figures: Figures) -> str:
    cells = [
        f'<tr><td>{name}<br><span class="faint">{meaning}</span></td>'
        f'<td class="n">{_number(figures[key])}</td></tr>'
        for key, name, meaning in HEADLINES
    ]
    return f"<table>{''.join(cells)}</table>"


def _classes(classes: Mapping[str, Mapping[str, Any]], matches: Mapping[str, Mapping[str, Any]]) -> str:
    words = {name: word for word, one in matches.items() for name in one["classes"]}
    total = sum(row["pixels"] for row in classes.values()) or 1
    cells = [
        f"<tr><td>{escape(name)}</td><td>{escape(words.get(name, '-'))}</td>"
        f"<td>{'yes' if row['drivable'] else 'no'}</td>"
        f'<td class="n">{_number(row["recall"])}</td><td class="track">'
        f'<i class="bar{"" if row["drivable"] else " no"}" style="width:{100 * row["recall"]:.1f}%"></i></td>'
        f'<td class="n">{row["pixels"] / total:.1%}</td></tr>'
        for name, row in sorted(
            classes.items(), key=lambda item: (not item[1]["drivable"], -item[1]["pixels"])
        )
    ]
    head = (
        "<tr><th>class</th><th>word</th><th>drivable</th>"
        '<th class="n">recall</th><th>share</th><th class="n">pixels</th></tr>'
    )
    return (
        '<p class="faint">Recall is the share of a class that is judged as its label says, at 0.5.</p>'
        '<div class="wide" tabindex="0" role="region" aria-label="Classes">'
        f"<table>{head}{''.join(cells)}</table></div>"
    )


def ground_plot(figures: Figures) -> Plot:
    """Return IoU, precision and recall over the threshold of the traversability."""
    rows = figures["curve"]
    lines = [
        Curve(name, colour, [_point(row, key, row["frames"]) for row in rows if row[key] is not None])
        for key, name, colour in _CURVES
    ]
    note = (
        f"Of {figures['images']} frames. The mean IoU is over those with drivable ground, labelled or found; "
        f"the others are over all pixels of all frames. {HINT}"
    )
    across = Axis("traversability above which a pixel counts as drivable", (0.0, 1.0))
    return curves("Other thresholds", note, lines, across, Axis("share, 0 to 1", (0.0, 1.0)), mark=_HALF)


def calls_plot(figures: Figures) -> Plot:
    """Return the shares of frames whose region of interest is above a threshold of the uncertainty."""
    calls = figures["calls"]
    lines = [
        Curve(
            f"{name}, {_frames_behind(calls[key])}",
            colour,
            [_point(row, key, calls[key]) for row in calls["curve"] if row[key] is not None],
        )
        for key, name, colour in _CALLS
    ]
    steps = [calls[key] for key, _, _ in _CALLS if 0 < calls[key] < _FEW]
    few = "".join(f" One of {_frames_behind(count)} is a step of {1 / count:.0%}." for count in steps)
    note = (
        f"Share of frames above each threshold: of {_frames_behind(calls['clean'])} whose region of interest "
        f"is all drivable, and of {_frames_behind(calls['things'])} in which things without a word cover 1 % "
        f"of it.{few} {HINT}"
    )
    across = Axis("mean uncertainty of the region above which the rover calls", (0.0, 1.0))
    mark = ("the perceiver's own", figures["roi_threshold"])
    up = Axis("share of frames, 0 to 1", (0.0, 1.0))
    return curves("Uncertain regions of interest", note, lines, across, up, mark=mark)


def _point(row: Mapping[str, Any], key: str, frames: int) -> dict[str, Any]:
    return {"x": row["threshold"], "y": row[key], "frames": frames}


def _frames_behind(frames: int) -> str:
    return f"{frames} frame{'' if frames == 1 else 's'}"


def _legend(name: str, keys: Sequence[tuple[str, str]]) -> str:
    marks = (
        f'<span><i class="key" style="background:var({colour})"></i>{text}</span>' for colour, text in keys
    )
    return f'<p class="legend faint"><b>{name}</b>{"".join(marks)}</p>'


def _frames(rows: Sequence[Mapping[str, Any]], exhibits: Mapping[int, Exhibit]) -> list[str]:
    parts = []
    for row in rows:
        shots = [
            figure(jpeg, caption, WIDTH)
            for caption, jpeg in zip(_CAPTIONS, exhibits[row["frame"]], strict=True)
        ]
        parts.append(
            f'<section class="frame"><h3>{escape(row["name"])} '
            f'<span class="faint">frame {row["frame"]}, IoU {_number(row["iou"])}</span></h3>'
            f'<div class="shots">{"".join(shots)}</div></section>'
        )
    return parts
