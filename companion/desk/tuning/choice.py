"""Shows settings to choose from: calls against what was noticed, and the TOML of the chosen one. Pure."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

from anytraverse.plots import HINT, Axis, Plot, drawing, legend, section, vertical, whole, zoomed
from anytraverse.plots import STYLE as PLOTS
from companion.desk.tuning.trial import Combination

STYLE = (
    PLOTS
    + """
pre { white-space: pre-wrap; overflow-wrap: anywhere; padding: .6rem; border: 1px solid var(--line); }
select, button { font: inherit; min-height: 2.75rem; max-width: 100%; }
.warning { border-left: 4px solid var(--red); padding-left: .6rem; font-weight: 600; }
"""
)
_SCRIPT = Path(__file__).with_name("static") / "choose.js"
_SETTING, _BEST, _NOW, _PROPOSED = "a setting", "none notices more", "in force now", "proposed"
_ROLES = {
    _SETTING: ("--grey", "circle"),
    _BEST: ("--blue", "circle"),
    _NOW: ("--red", "square"),
    _PROPOSED: ("--green", "diamond"),
}
"""Role -> colour and shape; the later ones are drawn over the earlier ones."""


@dataclass(frozen=True)
class OfferedSetting:
    """Holds a combination to choose. number: by which it is taken. calls, noticed: its place in the plot.

    toml: what puts it into force. told: more figures for the hover. warnings: what it loses. curves: rows of
    the plot of its calls up to each frame, see `plots.curves`.
    """

    number: int
    combination: Combination
    calls: float
    noticed: int
    toml: str
    told: Mapping[str, Any] = field(default_factory=dict)
    warnings: Sequence[str] = ()
    curves: Sequence[Mapping[str, Any]] = ()

    @property
    def place(self) -> tuple[float, int]:
        """Its place in the plot."""
        return self.calls, self.noticed


@dataclass(frozen=True)
class Choice:
    """Holds what can be chosen, and how it is shown.

    settings: all, the one with the fewest changes first among those of one place. now, proposed: numbers,
    None for none. calls, noticed: titles of the axes, with units. most: how much can be noticed, None: it is
    not known. wanted: calls at most, None for any. behind: how many frames it is about, in words. command:
    takes a setting, whose first {} is its number.
    """

    settings: Sequence[OfferedSetting]
    now: int | None
    proposed: int | None
    calls: str
    noticed: str
    behind: str
    command: str
    most: int | None = None
    wanted: float | None = None

    def shown(self) -> list[OfferedSetting]:
        """Return one setting for each place of the plot, and those in force and proposed. By rising calls."""
        marked = [one for one in self.settings if one.number in (self.now, self.proposed)]
        taken = {one.place for one in marked}
        for one in self.settings:
            if one.place not in taken:
                taken.add(one.place)
                marked.append(one)
        return sorted(marked, key=lambda one: (*one.place, one.number))


def frontier(settings: Iterable[OfferedSetting]) -> list[OfferedSetting]:
    """Return the settings that none surpasses: as few calls and more noticed, by rising calls."""
    found: list[OfferedSetting] = []
    for one in sorted(settings, key=lambda one: (one.calls, -one.noticed)):
        if not found or one.noticed > found[-1].noticed:
            found.append(one)
    return found


def choice_plot(choice: Choice) -> Plot:
    """Return the plot: a point for each setting, calls across and noticed up, with the proposal marked."""
    shown, best = choice.shown(), frontier(choice.settings)
    alike = Counter(one.place for one in choice.settings)
    rows = [_row(choice, one, best, alike) for one in shown]
    rows.sort(key=lambda row: list(_ROLES).index(row["role"]))
    widest = max([*(one.calls for one in shown), choice.wanted or 0.0]) or 1.0
    highest = choice.most or max(one.noticed for one in shown) or 1
    counted = all(isinstance(one.calls, int) for one in shown)
    x = Axis(choice.calls, (0.0, widest), whole=counted).encoded("x")
    y = Axis(choice.noticed, (0.0, highest), whole=True).encoded("y")
    hover = [{"field": key, "title": title} for key, title in _titles(choice, rows[0]).items()]
    roles = {role: look for role, look in _ROLES.items() if any(row["role"] == role for row in rows)}
    colour = {"domain": list(roles), "range": [f"var({name})" for name, _ in roles.values()]}
    shape = {"domain": list(roles), "range": [form for _, form in roles.values()]}
    layer: list[dict[str, Any]] = [
        {
            "data": {"values": [{"x": one.calls, "y": one.noticed} for one in best]},
            "mark": {"type": "line", "clip": True, "color": "var(--blue)", "interpolate": "step-after"},
            "encoding": {"x": x, "y": y},
        },
        {
            "data": {"name": "chosen", "values": []},
            "mark": {"type": "point", "clip": True, "size": 420, "strokeWidth": 2, "color": "var(--ink)"},
            "encoding": {"x": x, "y": y},
        },
        {
            "params": [zoomed()],
            "mark": {"type": "point", "filled": True, "clip": True, "opacity": 1, "cursor": "pointer"},
            "encoding": {
                "x": x,
                "y": y,
                "color": {"field": "role", "type": "nominal", "scale": colour, "legend": legend(roles)},
                "shape": {"field": "role", "type": "nominal", "scale": shape},
                "size": {"condition": {"test": f"datum.role === '{_SETTING}'", "value": 60}, "value": 160},
                "tooltip": hover,
            },
        },
    ]
    if choice.wanted is not None:
        layer.insert(0, vertical("wanted at most", choice.wanted))
    also = "; the dashes are the wanted rate" if choice.wanted is not None else ""
    note = (
        f"{choice.behind}, {len(choice.settings)} settings. A point is a setting, or several with the same "
        f"outcome. Blue: none notices more for as few calls{also}. Click a point to take it. {HINT}"
    )
    title = f"{choice.calls[:1].upper()}{choice.calls[1:]} against {choice.noticed}"
    return Plot(title, note, whole(f"{title}. {note}", rows, layer))


def parts(choice: Choice, curves: Plot | None = None) -> list[str]:
    """Return the plot, and below it the chosen setting with what to write for it, as HTML.

    curves: a plot of the calls up to each frame, whose rows are those of the chosen setting.
    """
    shown, best = choice.shown(), {one.number for one in frontier(choice.settings)}
    by_number, alike = {one.number: one for one in shown}, Counter(one.place for one in choice.settings)
    first = next((by_number[one] for one in (choice.proposed, choice.now) if one is not None), shown[0])
    options = "".join(
        f'<option value="{one.number}"{" selected" if one is first else ""}>'
        f"{escape(_label(choice, one, best))}</option>"
        for one in shown
    )
    told = {
        one.number: {
            "row": {"x": one.calls, "y": one.noticed},
            "figures": _figures(choice, one, alike),
            "toml": one.toml,
            "command": _command(choice, one),
            "warnings": list(one.warnings),
            "curves": list(one.curves),
        }
        for one in shown
    }
    data = json.dumps(told, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    warned = "".join(f'<p class="warning">{escape(line)}</p>' for line in first.warnings)
    return [
        section(choice_plot(choice), "choice"),
        "<h2>The setting to take</h2>",
        f'<p><label for="take">Setting</label> <select id="take">{options}</select></p>',
        f'<p id="figures" class="faint">{escape(_figures(choice, first, alike))}</p>',
        f'<div id="warnings">{warned}</div>',
        "<p>To put into companion.toml:</p>",
        f'<pre id="toml">{escape(first.toml)}</pre>',
        '<p><button type="button" data-copies="toml">Copy the TOML</button></p>',
        "<p>Or let this write it there, which keeps your comments:</p>",
        f'<pre id="command">{escape(_command(choice, first))}</pre>',
        '<p><button type="button" data-copies="command">Copy the command</button></p>',
        '<p id="copied" role="status"></p>',
        *([section(curves, "curves")] if curves is not None else []),
        f'<script id="settings" type="application/json">{data}</script>',
        *drawing(),
        f"<script>{_SCRIPT.read_text(encoding='utf-8')}</script>",
    ]


def cell(value: Any) -> Any:
    """Return a value of a combination as it is shown: "off" for None, sides of a region with spaces."""
    if value is None:
        return "off"
    return " ".join(f"{side:g}" for side in value) if isinstance(value, list) else value


def combination(one: Combination) -> dict[str, Any]:
    """Return a combination as JSON values."""
    box = one.region
    return {
        "scene": one.scene,
        "roi": one.roi,
        "tile": one.tile,
        "region": [box.left, box.top, box.right, box.bottom],
    }


def _role(choice: Choice, one: OfferedSetting, best: Iterable[int]) -> str:
    if one.number == choice.proposed:
        return _PROPOSED
    if one.number == choice.now:
        return _NOW
    return _BEST if one.number in best else _SETTING


def _row(
    choice: Choice, one: OfferedSetting, best: Sequence[OfferedSetting], alike: Mapping[Any, int]
) -> dict[str, Any]:
    places = {each.place for each in best}
    role = _role(choice, one, [one.number] if one.place in places else [])
    shown = {key: cell(value) for key, value in combination(one.combination).items()}
    told = {"settings with this outcome": alike[one.place], "frames behind it": choice.behind}
    return {"number": one.number, "x": one.calls, "y": one.noticed, "role": role, **shown, **one.told, **told}


def _titles(choice: Choice, row: Mapping[str, Any]) -> dict[str, str]:
    """Return the fields of a row that are told, and their titles."""
    first = {"number": "setting", "role": "role", "x": choice.calls, "y": choice.noticed}
    return first | {key: key.replace("_", " ") for key in row if key not in first}


def _figures(choice: Choice, one: OfferedSetting, alike: Mapping[Any, int]) -> str:
    """Return the figures of a setting in one line, for whoever cannot hover."""
    row = _row(choice, one, [], alike)
    return "; ".join(
        f"{title}: {row[key]}" for key, title in _titles(choice, row).items() if key not in ("number", "role")
    )


def _command(choice: Choice, one: OfferedSetting) -> str:
    return choice.command.replace("{}", str(one.number), 1)  # the names of files may hold braces


def _label(choice: Choice, one: OfferedSetting, best: Iterable[int]) -> str:
    of = f" of {choice.most}" if choice.most else ""
    role = _role(choice, one, best)
    marked = "" if role == _SETTING else f", {role}"
    return f"{one.number}: {choice.calls} {one.calls:g}, {choice.noticed} {one.noticed}{of}{marked}"
