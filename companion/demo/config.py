"""The configuration that a demo runs with: written out, so that a newcomer can read and change it."""

from __future__ import annotations

import json
from pathlib import Path

_MARK = "# Written by `companion demo`."
_TEXT = """\
{mark} config/companion.toml explains every setting.
[camera]
source = {camera}
rate = 10

[vehicle]
file = ""

[link]
url = {link}

[journal]
folder = {state}

[pictures]
keep = 200

[call]
policy = {policy}

# At 2.5 m/s the rover needs 3 m to stop: its ROI reaches 8 m ahead.
[roi]
left = 0.35
top = 0.5
right = 0.65
bottom = 0.95

[corridor]
bottom = 0.3
top = 0.12

[words]
"grass" = 1.0
"dirt path" = 1.0
"bush" = -1.0
"tree" = -1.0
"sky" = -1.0
"""


def written_by_demo(path: Path) -> bool:
    """Whether this configuration is an earlier demo's, and nobody's work."""
    return path.is_file() and path.read_bytes().startswith(_MARK.encode())


def write_config(out: Path, *, camera: str, link: str, policy: str) -> Path:
    """companion.toml in `out`, with the state beside it."""
    path = out / "companion.toml"
    values = {"camera": camera, "link": link, "policy": policy, "state": str(out / "state")}
    # What JSON makes of a string is a TOML string too, whatever is in a path.
    text = _TEXT.format(mark=_MARK, **{name: json.dumps(value) for name, value in values.items()})
    path.write_text(text, encoding="utf-8")
    return path
