"""Makes a page that opens anywhere: one HTML file with its style and its pictures inside. Pure."""

from __future__ import annotations

import base64
from collections.abc import Iterable
from html import escape

_STYLE = """
:root { color-scheme: light dark; --ink: #1b1f24; --faint: #57606a; --paper: #fff; --line: #d5dae0;
  --green: #009e73; --red: #d55e00; --violet: #7e2fbe; --blue: #0969da; --grey: #8a929b; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e9ec; --faint: #9aa4ae; --paper: #14171a;
  --line: #353b42; --violet: #b98ae6; --blue: #58a6ff; } }
* { box-sizing: border-box; }
body { font: 1rem/1.45 system-ui, sans-serif; max-width: 74rem; margin: 2rem auto; padding: 0 1rem;
  color: var(--ink); background: var(--paper); }
h1 { margin-bottom: .2rem; } h2 { margin-top: 2.4rem; border-top: 2px solid var(--line); padding-top: 1rem; }
.faint, figcaption, th { color: var(--faint); font-weight: normal; }
.shots { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 15rem), 1fr)); gap: .6rem; }
figure { margin: 0; } img { display: block; width: 100%; height: auto; }
"""


def document(title: str, style: str, parts: Iterable[str]) -> str:
    """Return the page. title: text. style: CSS beside that of all pages. parts: HTML of the body."""
    head = [
        '<!doctype html><html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{escape(title)}</title><style>{_STYLE}{style}</style></head><body><main>",
    ]
    return "\n".join([*head, *parts, "</main></body></html>\n"])


def figure(jpeg: bytes, caption: str, width: int | None = None) -> str:
    """Return a picture with its caption, which is text. width: its pixels, if they are known."""
    source = f"data:image/jpeg;base64,{base64.b64encode(jpeg).decode()}"
    sized = "" if width is None else f' width="{width}"'
    text = escape(caption)
    return f'<figure><img alt="{text}"{sized} src="{source}"><figcaption>{text}</figcaption></figure>'
