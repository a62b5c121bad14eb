"""Writes the page of a rehearsal: one HTML file with its pictures inside, that opens anywhere. Pure."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from html import escape
from itertools import groupby
from typing import Any

from companion.browser import wording
from companion.drives.rehearsal import AskedCall, Rehearsal

_STYLE = """
:root { color-scheme: light dark; --ink: #1b1f1d; --faint: #55605a; --paper: #fff; --line: #d5dad6;
  --bar: #009e73; }
@media (prefers-color-scheme: dark) { :root { --ink: #e8ece9; --faint: #a3afa8; --paper: #121614;
  --line: #323b36; } }
* { box-sizing: border-box; }
body { font: 1rem/1.45 system-ui, sans-serif; max-width: 74rem; margin: 2rem auto; padding: 0 1rem;
  color: var(--ink); background: var(--paper); }
h1 { margin-bottom: .2rem; } h2 { margin-top: 2.2rem; border-top: 2px solid var(--line); padding-top: 1rem; }
h3 { margin: 1.2rem 0 .2rem; font-size: 1rem; }
p { margin: .2rem 0; } .faint, figcaption { color: var(--faint); }
.shots { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 18rem), 1fr)); gap: .6rem;
  max-width: 62rem; }
figure { margin: .4rem 0; } img { display: block; width: 100%; height: auto; }
code { overflow-wrap: anywhere; }
.tenths { display: flex; gap: .3rem; align-items: end; height: 7rem; max-width: 30rem; margin: 1rem 0;
  padding: 0; list-style: none; }
.tenths li { flex: 1; text-align: center; font-size: .85rem; }
.tenths div { background: var(--bar); border-radius: 2px 2px 0 0; }
"""
_TALLEST = 70


def page(title: str, rehearsal: Rehearsal, figures: Mapping[str, Any], answers: str) -> str:
    """Return the page. title: names the drive. answers: where the file of answers is."""
    parts = [
        '<!doctype html><html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head><body><h1>{escape(title)}</h1>",
        f"<p>{_headline(figures)}</p>",
        _tenths(figures["by_tenth"]),
    ]
    if any(not call.by_person for call in rehearsal.calls):
        parts.append(
            "<p>Calls that nobody answered got a go, so that each place is asked about once. They are not "
            f"remembered. Write an answer for each into <code>{escape(answers)}</code>, and rehearse again "
            "with <code>--answers</code>.</p>"
        )
    by_group = sorted(rehearsal.calls, key=lambda call: (call.group, call.id))
    for group, found in groupby(by_group, key=lambda call: call.group):
        alike = list(found)
        parts.append(f"<h2>Scene {group}: {len(alike)} {'call' if len(alike) == 1 else 'calls'}</h2>")
        parts += map(_call, alike)
    return "\n".join([*parts, "</body></html>\n"])


def _headline(figures: Mapping[str, Any]) -> str:
    return (
        f"Calls: {figures['calls']}, in {figures['groups']} scenes; answered: {figures['answered']}. "
        f"Remembered places known again: {figures['matches']}. "
        f"Frames: {figures['frames']}, {figures['drive_s']:g} s of the drive; not OK: {figures['not_ok']}. "
        f"Holds, if policy hold were in force: {figures['would_hold']}."
    )


def _tenths(tenths: list[int]) -> str:
    most = max(1, *tenths)
    bars = (
        f'<li>{count or ""}<div style="height:{round(_TALLEST * count / most)}px"></div>{number}</li>'
        for number, count in enumerate(tenths, 1)
    )
    return f'<p class="faint">Calls in each tenth of the drive</p><ol class="tenths">{"".join(bars)}</ol>'


def _call(call: AskedCall) -> str:
    said = [f"<p><code>{escape(line)}</code>: {escape(text)}</p>" for line, text, _ in call.said]
    return "".join(
        [
            f"<h3>C{call.id} at {call.at:.1f} s, {escape(call.frame)}</h3>",
            f"<p>{escape(wording.reason(call.data))}</p>",
            f'<p class="faint">{escape(wording.figures(call.data))}</p>',
            '<div class="shots">',
            _figure(call.raw, "What the camera saw"),
            _figure(call.judged, "How it was judged"),
            "</div>",
            *(said or ['<p class="faint">Not answered.</p>']),
        ]
    )


def _figure(jpeg: bytes, caption: str) -> str:
    source = f"data:image/jpeg;base64,{base64.b64encode(jpeg).decode()}"
    return f'<figure><img src="{source}" alt="{caption}"><figcaption>{caption}</figcaption></figure>'
