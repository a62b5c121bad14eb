"""Writes the page of a rehearsal: one HTML file with its pictures inside, that opens anywhere. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from itertools import groupby
from typing import Any

from anytraverse.html_page import document, figure
from companion.desk.drives.rehearsal import AskedCall, Rehearsal
from companion.pages import wording

_STYLE = """
h3 { margin: 1.2rem 0 .2rem; font-size: 1rem; }
p { margin: .2rem 0; }
.shots { max-width: 62rem; }
figure { margin: .4rem 0; }
code { overflow-wrap: anywhere; }
.tenths { display: flex; gap: .3rem; align-items: end; height: 7rem; max-width: 30rem; margin: 1rem 0;
  padding: 0; list-style: none; }
.tenths li { flex: 1; text-align: center; font-size: .85rem; }
.tenths div { background: var(--green); border-radius: 2px 2px 0 0; }
"""
_TALLEST = 70


def page(title: str, rehearsal: Rehearsal, figures: Mapping[str, Any], answers: str) -> str:
    """Return the page. title: names the drive. answers: where the file of answers is."""
    parts = [
        f"<h1>{escape(title)}</h1>",
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
    return document(title, _STYLE, parts)


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
            figure(call.raw, "What the camera saw"),
            figure(call.judged, "How it was judged"),
            "</div>",
            *(said or ['<p class="faint">Not answered.</p>']),
        ]
    )
