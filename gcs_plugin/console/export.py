"""Packs calls into a zip that opens anywhere: a page with the pictures inside, and the data of each. Pure."""

from __future__ import annotations

import base64
import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from html import escape
from typing import Any

from anytraverse.picture_size import jpeg_size

MOST_CALLS = 24
MOST_BYTES = 6_000_000
"""Of pictures in one zip; each is in it twice, as a file and inside the page."""
_EARLIEST = 315_532_800
"""1980 in seconds since 1970: a zip knows no earlier time."""
_LATEST = 253_402_300_799
"""The end of the year 9999 in seconds since 1970."""
_SIZES = {
    "small": "What it saw, as a radio carries it",
    "raw": "What it saw",
    "large": "How it judged that",
    "nearest": "The answered scene most like it",
}
_MARKED = ("small", "raw")
"""Pictures in which the page marks the place meant. The large one has bars, and its own marks."""
_ONLY_HERE = frozenset({"pictures", "size", "since", "key", "large", "small_note", "undo", "todo"})
_STYLE = """
body { font: 1rem/1.45 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem;
  color: #1b1f24; background: #fff; }
section { border-top: 2px solid #c8ced6; margin-top: 2rem; }
.shots { display: flex; flex-wrap: wrap; gap: 1rem; }
figure { margin: 0; flex: 1 1 18rem; }
.pane { position: relative; }
img { display: block; width: 100%; }
svg { position: absolute; inset: 0; width: 100%; height: 100%; }
rect { fill: none; stroke: #ffd400; stroke-width: 3; vector-effect: non-scaling-stroke; }
figcaption, .faint { color: #57606a; }
time { color: #57606a; font-variant-numeric: tabular-nums; }
"""


@dataclass(frozen=True)
class ExportedCall:
    """A call to pack. shown: what the page shows of it. pictures: JPEG by the names of `_SIZES`."""

    shown: Mapping[str, Any]
    pictures: Mapping[str, bytes]


def pack(rover: int, calls: Sequence[ExportedCall], wall: float) -> bytes:
    """Pack the first `MOST_CALLS` of these calls. wall: seconds since 1970.

    Returns a zip: report.html, which needs none of the other files, and for each call a folder with data.json
    and its pictures. Pictures beyond `MOST_BYTES` are left out, which the page says.
    """
    kept, room = [], MOST_BYTES
    for call in calls[:MOST_CALLS]:
        pictures, left_out = {}, []
        for size in _SIZES:
            jpeg = call.pictures.get(size, b"")
            if jpeg_size(jpeg) is None:
                continue
            if len(jpeg) > room:
                left_out.append(size)
                continue
            pictures[size] = jpeg
            room -= len(jpeg)
        kept.append((call.shown, pictures, left_out))
    stamp = datetime.fromtimestamp(min(max(wall, _EARLIEST), _LATEST), timezone.utc).timetuple()[:6]
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:

        def add(path: str, content: bytes, how: int) -> None:
            archive.writestr(zipfile.ZipInfo(path, stamp), content, how)

        add("report.html", _page(rover, kept, wall).encode("utf-8", "replace"), zipfile.ZIP_DEFLATED)
        for shown, pictures, _ in kept:
            folder = f"call-{int(shown['id'])}"
            data = {"rover": rover} | {name: one for name, one in shown.items() if name not in _ONLY_HERE}
            add(f"{folder}/data.json", json.dumps(data, indent=1).encode(), zipfile.ZIP_DEFLATED)
            for size, jpeg in pictures.items():
                add(f"{folder}/{size}.jpg", jpeg, zipfile.ZIP_STORED)
    return packed.getvalue()


def _page(
    rover: int, calls: Sequence[tuple[Mapping[str, Any], Mapping[str, bytes], list[str]]], wall: float
) -> str:
    title = f"Rover {rover}: {len(calls)} call{'' if len(calls) == 1 else 's'}"
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; img-src data:; '
        "style-src 'unsafe-inline'\">"
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{title}</title><style>{_STYLE}</style></head><body>\n<h1>{title}</h1>\n"
        f'<p class="faint">Saved {_time(wall)} by the AnyTraverse console. Times are UTC. '
        "Yellow is what the rover asked about.</p>\n"
        + "\n".join(_section(*call) for call in calls)
        + "\n</body></html>\n"
    )


def _section(shown: Mapping[str, Any], pictures: Mapping[str, bytes], left_out: list[str]) -> str:
    state = "is open" if shown.get("open") else shown.get("outcome") or "closed"
    kind = "Hold" if shown.get("kind") == "hold" else "Call"
    shots = "".join(_figure(size, pictures[size], shown.get("box")) for size in _SIZES if size in pictures)
    missing = [f"{_SIZES[size]}: left out, the report would be too large." for size in left_out]
    if not pictures and not left_out:
        missing.append("Its picture had not come to the console.")
    parts = [
        f"<section><h2>{kind} {_text(shown.get('name'))}: {_text(state)}</h2>",
        _line(shown.get("reason")),
        _line(shown.get("figures"), faint=True),
        _line((shown.get("nearest") or {}).get("text")),
        f'<p class="faint">Opened {_time(shown.get("opened"))}{_closed(shown)}.</p>',
        _line(_place(shown.get("place")), faint=True),
        f'<div class="shots">{shots}</div>' if shots else "",
        *map(_line, missing),
        _line(shown.get("first")),
        _became(shown),
    ]
    return "\n".join(filter(None, parts)) + "</section>"


def _figure(size: str, jpeg: bytes, box: Sequence[float] | None) -> str:
    mark = ""
    if box and size in _MARKED:
        left, top, right, bottom = (100 * float(side) for side in box)
        mark = (
            '<svg viewBox="0 0 100 100" preserveAspectRatio="none"><rect '
            f'x="{left:g}" y="{top:g}" width="{right - left:g}" height="{bottom - top:g}"/></svg>'
        )
    content = base64.b64encode(jpeg).decode()
    return (
        f'<figure><div class="pane"><img alt="{_SIZES[size]}" src="data:image/jpeg;base64,{content}">{mark}'
        f"</div><figcaption>{_SIZES[size]}</figcaption></figure>"
    )


def _became(shown: Mapping[str, Any]) -> str:
    """List the answers, and what the rover said."""
    rows = [(one["at"], f"Operator: {one['said']}. {one['text']}") for one in shown.get("answers", ())]
    rows += [(one["at"], f"Rover: {one['text']}") for one in shown.get("said", ())]
    rows.sort(key=lambda row: row[0])
    items = [f"<li>Answer: {_text(given)}</li>" for given in shown.get("given", ())]
    items += [f"<li>{_time(at)} {_text(text)}</li>" for at, text in rows]
    if shown.get("undone"):
        items.append(f"<li>Operator: undo. {_text(shown['undone'])}</li>")
    return f"<ol>{''.join(items)}</ol>" if items else "<p>It was not answered from this console.</p>"


def _closed(shown: Mapping[str, Any]) -> str:
    return "" if shown.get("open") else f", closed {_time(shown.get('closed'))}"


def _place(place: Sequence[float | None] | None) -> str:
    if not place or place[0] is None or place[1] is None:
        return ""
    return f"At {place[0]:.6f}, {place[1]:.6f}."


def _line(text: Any, *, faint: bool = False) -> str:
    marked = ' class="faint"' if faint else ""
    return f"<p{marked}>{_text(text)}</p>" if text else ""


def _text(text: Any) -> str:
    return escape(str(text or ""))


def _time(at: Any) -> str:
    if not isinstance(at, int | float) or not 0 < at <= _LATEST:
        return "at a time not known"
    return f"<time>{datetime.fromtimestamp(at, timezone.utc):%Y-%m-%d %H:%M:%S}</time>"
