"""Makes plots of Vega-Lite: in a page that opens without a network, or as a file of SVG.

The library is the extra `plots`. Without it a page has everything but its plots, and says what to install.
"""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import cache
from html import escape
from textwrap import wrap
from typing import Any, NamedTuple

HINT = "Hover for figures. Ctrl and the wheel zoom, a drag moves, a double click shows all again."
COLOURS = ("--green", "--blue", "--red", "--violet", "--grey", "--faint", "--ink")
STYLE = """
.plot { width: 100%; height: 24rem; } .plot:focus-visible { outline: 2px solid var(--blue); }
#vg-tooltip-element.vg-tooltip { font: .85rem/1.4 system-ui, sans-serif; color: var(--ink);
  background: var(--paper); border: 1px solid var(--faint); max-width: 20rem; }
#vg-tooltip-element.vg-tooltip table tr td.key { color: var(--faint); max-width: 12rem; }
#vg-tooltip-element.vg-tooltip table tr td.value { max-width: 12rem; }
"""
_WIDE = 40
"""Characters that fit beside or below a plot on a phone."""
_BESIDE, _PADDING = 0.05, 8
"""What is shown beyond the ends of an axis: as a share of its length, and in pixels where it has no span."""
_SCHEMA = "https://vega.github.io/schema/vega-lite/v6.json"
_VERSION = "v6.4"
_WHOLE = "datum.value % 1 ? '' : datum.label"
"""Labels nothing between whole numbers: of 0 to 1 the library takes the half, whatever the least step."""
_TEXT = {"labelFontSize": 12, "titleFontSize": 12, "titleFontWeight": "normal", "labelLimit": 0}
_LOOK = {
    "background": None,
    "font": "system-ui, sans-serif",
    "view": {"stroke": None},
    "axis": {
        **_TEXT,
        "titleLimit": 0,
        "labelFlush": False,
        "labelOverlap": True,
        "labelSeparation": 8,
        "tickCount": 8,
        "labelColor": "var(--faint)",
        "titleColor": "var(--ink)",
        "gridColor": "var(--line)",
        "domainColor": "var(--faint)",
        "tickColor": "var(--faint)",
    },
    "legend": {**_TEXT, "orient": "top", "title": None, "labelColor": "var(--ink)"},
}
_ON_PAPER = {
    "--ink": "#1b1f24",
    "--faint": "#57606a",
    "--line": "#d5dae0",
    "--green": "#009e73",
    "--red": "#d55e00",
    "--violet": "#7e2fbe",
    "--blue": "#0969da",
    "--grey": "#8a929b",
}
_DRAW = """
for (const place of document.querySelectorAll(".plot")) {
  const spec = JSON.parse(place.nextElementSibling.textContent);
  place.drawn = vegaEmbed(place, spec, { renderer: "svg", actions: false }).then((made) => made.view);
}
"""


class Plot(NamedTuple):
    """Holds a plot. note: what it shows, and how many frames are behind it. spec: Vega-Lite.

    Colours in the spec are those of `html_page`, written var(--green).
    """

    title: str
    note: str
    spec: dict[str, Any]


class Axis(NamedTuple):
    """Describes an axis. title: with its unit. span: the values at its ends, None: those of the points.

    whole: there is nothing between two whole numbers.
    """

    title: str
    span: tuple[float, float] | None = None
    logarithmic: bool = False
    ticks: Sequence[float] | None = None
    whole: bool = False

    def encoded(self, field: str) -> dict[str, Any]:
        """Return the encoding of a field on it."""
        scale: dict[str, Any] = {"padding": _PADDING, "nice": False}
        if self.span is not None:
            low, high = self.span
            beside = _BESIDE * (high - low)  # so that points at its ends are whole
            scale = {"domain": [low - beside, high + beside], "nice": False}
        if self.logarithmic:
            scale["type"] = "log"
        axis: dict[str, Any] = {} if self.ticks is None else {"axis": {"values": list(self.ticks)}}
        if self.whole:
            axis = {"axis": {"tickMinStep": 1, "format": "d", "labelExpr": _WHOLE}}
        title = wrap(self.title, _WIDE)
        return {"field": field, "type": "quantitative", "title": title, "scale": scale, **axis}


class Curve(NamedTuple):
    """Holds a line. points: "x" and "y" of each, "low" and "high" where it has a spread, and what to tell."""

    name: str
    colour: str
    points: Sequence[Mapping[str, Any]]


def curves(
    title: str,
    note: str,
    lines: Sequence[Curve],
    x: Axis,
    y: Axis,
    *,
    mark: tuple[str, float] | None = None,
    stepped: bool = False,
) -> Plot:
    """Return lines over one axis. mark: a value of x at which a dashed line stands, with its name."""
    rows = [{"line": line.name, **point} for line in lines for point in line.points]
    told = dict.fromkeys(key for row in rows for key in row if key not in ("x", "y", "low", "high", "line"))
    scale = {"domain": [line.name for line in lines], "range": [f"var({line.colour})" for line in lines]}
    shown_as = {"scale": scale, "legend": legend(scale["domain"])}
    colour = {"field": "line", "type": "nominal", **shown_as}
    across, up = x.encoded("x"), y.encoded("y")
    shown = [("line", "line"), ("x", x.title), ("y", y.title), *((key, key) for key in told)]
    hover = {"tooltip": [{"field": field, "title": name} for field, name in shown]}
    layer: list[dict[str, Any]] = [
        {
            "mark": {"type": "line", "clip": True, "interpolate": "step-after" if stepped else "linear"},
            "encoding": {"x": across, "y": up, "color": colour},
        },
        {
            "mark": {"type": "point", "filled": True, "clip": True, "size": 30},
            "encoding": {"x": across, "y": up, "color": colour},
        },
        {  # a larger place to hit
            "params": [zoomed()],
            "mark": {"type": "point", "filled": True, "clip": True, "size": 300, "opacity": 0},
            "encoding": {"x": across, "y": up, **hover},
        },
    ]
    if any("low" in row for row in rows):
        spread = {"x": across, "y": {**up, "field": "low"}, "y2": {"field": "high"}, "color": colour}
        layer.insert(0, {"mark": {"type": "rule", "clip": True, "strokeWidth": 2}, "encoding": spread})
    if mark is not None:
        layer.insert(0, vertical(*mark))
    return Plot(title, note, whole(f"{title}. {note}", rows, layer))


def legend(names: Collection[str]) -> dict[str, Any]:
    """Return a legend of so many columns that these names fit on a phone."""
    return {"columns": 1 if any(2 * len(name) > _WIDE for name in names) else 2}


def whole(description: str, rows: Sequence[Mapping[str, Any]], layer: Sequence[Any]) -> dict[str, Any]:
    """Return a specification. rows: its data. layer: what is drawn of them, the lowest first."""
    return {
        "$schema": _SCHEMA,
        "description": description,
        "width": "container",
        "height": "container",
        "autosize": {"type": "fit", "contains": "padding", "resize": True},
        "padding": 8,
        "data": {"name": "rows", "values": list(rows)},
        "layer": list(layer),
        "config": _LOOK,
    }


def zoomed() -> dict[str, Any]:
    """Return the parameter of one layer by which a plot is zoomed and moved. The wheel alone scrolls."""
    wheel = "wheel![event.ctrlKey || event.metaKey]"
    return {"name": "zoom", "select": {"type": "interval", "zoom": wheel}, "bind": "scales"}


def vertical(name: str, value: float) -> dict[str, Any]:
    """Return a layer: a dashed line at a value of x, which a hover names."""
    return {
        "data": {"values": [{"at": value, "what": name}]},
        "mark": {"type": "rule", "clip": True, "strokeDash": [4, 4], "color": "var(--faint)", "size": 2},
        "encoding": {
            "x": {"field": "at", "type": "quantitative"},
            "tooltip": [{"field": "what", "title": "line at"}, {"field": "at", "title": "value"}],
        },
    }


def installed() -> bool:
    """Return whether the library is there."""
    return importlib.util.find_spec("vl_convert") is not None


def section(plot: Plot, name: str = "") -> str:
    """Return a plot as HTML, for a page that ends with `drawing`. name: the id of the element it is drawn in.

    Without the library: what to install.
    """
    head = f'<h2>{escape(plot.title)}</h2><p class="faint">{escape(plot.note)}</p>'
    if not installed():
        return f"{head}<p>No plot: install the extra plots where this page is written.</p>"
    data = json.dumps(plot.spec, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    named = f' id="{escape(name)}"' if name else ""
    return f'{head}<div class="plot"{named}></div><script type="application/json">{data}</script>'


def drawing() -> Iterable[str]:
    """Return what draws the sections before it. Nothing without the library."""
    if installed():
        yield f"<script>{_library()}</script>"
        yield f"<script>{_DRAW}</script>"


@cache
def _library() -> str:
    """Bundle the library, which takes a second."""
    import vl_convert

    bundle: str = vl_convert.javascript_bundle("window.vegaEmbed = vegaEmbed;", _VERSION)
    return bundle


def svg(plot: Plot, width: int, height: int) -> str:
    """Return a plot as a file of SVG with its title, in the colours of a light page. Sides in pixels.

    Raises ImportError without the library.
    """
    import vl_convert

    layer = [
        {**one, "mark": {**one["mark"], "clip": False}}  # clips are numbered, in each process anew
        for one in plot.spec["layer"]
        if one["mark"].get("opacity") != 0  # nobody hovers
    ]
    spec = {**plot.spec, "width": width, "height": height, "title": plot.title, "layer": layer}
    text = json.dumps(spec, allow_nan=False)
    for name, colour in _ON_PAPER.items():
        text = text.replace(f"var({name})", colour)
    drawn: str = vl_convert.vegalite_to_svg({**json.loads(text), "background": "#fff"}, _VERSION)
    return drawn + "\n"
