"""Shows evidence as a page that opens anywhere, without a network and without scripts. Pure."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from itertools import groupby
from typing import Any

from anytraverse.html_page import document
from companion.desk.evidence.package import PROVES
from companion.desk.evidence.parts import Value

_STYLE = """
table { border-collapse: collapse; font-variant-numeric: tabular-nums; margin: .6rem 0 1.4rem; width: 100%; }
th { vertical-align: bottom; } caption { text-align: left; font-weight: 600; padding: .4rem 0; }
td, th { text-align: left; padding: .25rem 1rem .25rem 0; border-bottom: 1px solid var(--line);
  vertical-align: top; overflow-wrap: break-word; }
.wide { overflow-x: auto; } .figures { max-width: 52rem; table-layout: fixed; }
.figures caption { color: var(--faint); font-weight: normal; }
td.n { font-weight: 600; overflow-wrap: anywhere; }
.fail { color: var(--red); font-weight: 600; } .warn { font-weight: 600; }
code, pre { overflow-wrap: anywhere; }
pre { white-space: pre-wrap; border: 1px solid var(--line); padding: .6rem; }
summary { min-height: 2.75rem; padding: .6rem 0; cursor: pointer; }
@media (max-width: 40rem) {
  .wide thead, .wide td:empty { display: none; }
  .wide tr { display: block; padding: .4rem 0; border-bottom: 1px solid var(--line); }
  .wide td { display: block; border: 0; padding: 0; overflow-wrap: anywhere; }
  .wide td::before { content: attr(data-of) ": "; color: var(--faint); font-weight: normal; }
}
nav a { display: inline-block; padding: .6rem 1rem .6rem 0; } a { color: var(--blue); }
"""
_TIME = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ", re.ASCII)
_NOT_KNOWN = "unknown"


def page(told: Mapping[str, Any], config: str) -> str:
    """Return the page. told: the document for a program. config: without secrets."""
    title = f"Evidence of a rover, {told['rover']}"
    parts, unknown = told["parts"], told["unknown"]
    named = {key: part["title"] for key, part in parts.items()}
    named |= {_NOT_KNOWN: "What is not known", "config": "Configuration"}
    links = " ".join(f'<a href="#{key}">{escape(name)}</a>' for key, name in named.items())
    head = [
        f"<h1>{escape(title)}</h1>",
        f"<p>Made {_when(str(told['made_at']))}. {escape(PROVES)} README.txt has the commands that check it, "
        "and name the key.</p>",
        "<p>Every figure says where it was read, over how many samples, and from when to when, in UTC. "
        f'<a href="#{_NOT_KNOWN}">What is not known</a> is listed with what would tell it. '
        "What this software did in simulations is in docs/risks.md of the project.</p>",
        f"<nav>{links}</nav>",
    ]
    body = [line for key, part in parts.items() for line in _part(key, part)]
    lacking = [
        {"what": one["what"], "why": one["why"], "what would tell it": one["command"]} for one in unknown
    ]
    tail = [
        f'<h2 id="{_NOT_KNOWN}">What is not known</h2>',
        _table("", lacking) if lacking else "<p>Nothing that is asked for here.</p>",
        '<h2 id="config">Configuration</h2>',
        f"<details><summary>without passwords and tokens</summary><pre>{escape(config)}</pre></details>",
    ]
    return document(title, _STYLE, [*head, *body, *tail])


def _part(key: str, part: Mapping[str, Any]) -> Iterator[str]:
    yield f'<h2 id="{key}">{escape(part["title"])}</h2>'
    for rests, group in groupby(part["figures"], key=_rests):
        rows = "".join(map(_figure, group))
        yield f'<table class="figures"><caption>{escape(rests)}</caption><tbody>{rows}</tbody></table>'
    if not part["figures"] and not part["tables"]:
        yield "<p>Nothing is known.</p>"
    for one in part["tables"]:
        rows, left_out = one["rows"], one["left_out"]
        more = f" (the last {len(rows)}; {left_out} earlier ones are left out)" if left_out else ""
        yield _table(f"{one['title']}{more}", rows)
    if part["note"]:
        yield f'<p class="faint">{escape(part["note"])}</p>'


def _rests(one: Mapping[str, Any]) -> str:
    """Say on what a figure rests."""
    samples = "" if one["samples"] is None else f"samples: {one['samples']}"
    span = " to ".join(dict.fromkeys(_when(at) for at in (one["from"], one["to"]) if at is not None))
    return ", ".join(filter(None, (one["source"], samples, span)))


def _when(at: str) -> str:
    """Format a time for a person."""
    return at.replace("T", " ").removesuffix("Z")


def _figure(one: Mapping[str, Any]) -> str:
    figure = f"{_cell(one['value'])} {one['unit']}".strip()
    return f'<tr><td>{escape(one["name"])}</td><td class="n">{escape(figure)}</td></tr>'


def _table(title: str, rows: Sequence[Mapping[str, Any]]) -> str:
    caption = f"<caption>{escape(title)}</caption>" if title else ""
    head = "".join(f"<th>{escape(column)}</th>" for column in (rows[0] if rows else ()))
    body = "".join(f"<tr>{''.join(map(_td, row.values(), row))}</tr>" for row in rows)
    return (
        f'<div class="wide"><table>{caption}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'
    )


def _td(value: Value | None, column: str) -> str:
    kind = f' class="{value}"' if value in ("fail", "warn") else ""
    return f'<td data-of="{escape(column)}"{kind}>{escape(_cell(value))}</td>'


def _cell(value: Value | None) -> str:
    match value:
        case None:
            return ""
        case bool():
            return "yes" if value else "no"
        case float():
            return f"{value:.4g}" if abs(value) < 1000 else f"{value:.0f}"
    return _when(value) if isinstance(value, str) and _TIME.fullmatch(value) else str(value)
