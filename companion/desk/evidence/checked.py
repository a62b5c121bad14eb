"""Runs `companion check --json` in a process that is ended when it takes too long, and tells its rows."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Mapping
from typing import Any

from companion.desk.evidence.parts import EvidencePart
from companion.desk.evidence.sources import Sources
from companion.observers.recording.contents import read_json
from companion.system.isolated import isolated
from companion.wire.json_values import list_of, mapping_of
from companion.wire.packing import clean

LONGEST = 180.0
"""Seconds. Without a companion that runs, a check may wait 40 s for each connection."""
_LONGEST_TEXT = 1000


def run_check(file: str, longest: float = LONGEST) -> tuple[list[Mapping[str, str]], str]:
    """Return the rows of a check with this configuration, and why there are none, "" where there are.

    longest: seconds after which it is ended.
    """
    command = isolated("companion", "check", "--json", "--config", file)
    try:
        running = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, stdin=subprocess.DEVNULL,
            start_new_session=True,
        )  # fmt: skip
    except OSError as error:
        return [], f"companion check cannot be run: {error.strerror}"
    with running:
        try:
            said, _ = running.communicate(timeout=longest)
        except subprocess.TimeoutExpired:
            return [], f"companion check did not end within {longest:g} s"
        finally:
            if running.poll() is None:
                os.killpg(running.pid, signal.SIGKILL)
    told = read_json((said.splitlines() or [b""])[-1])
    rows = [_row(one) for one in list_of(told.get("checks"))]
    return rows, "" if rows else "companion check said nothing that can be read"


def check_part(sources: Sources) -> EvidencePart:
    """List what the check found."""
    part = EvidencePart("Check")
    if not sources.checked:
        part.lack("what companion check finds", sources.no_check, "companion check")
        return part
    part.tabulate("What companion check says now", sources.checked)
    for one in sources.checked:
        if one["verdict"] == "skip":
            part.lack(f"check: {one['check']}", one["what"], "companion check")
    return part


def _row(raw: Any) -> Mapping[str, str]:
    told = mapping_of(raw)
    named = {"verdict": "verdict", "check": "check", "what": "text"}
    return {name: clean(str(told.get(key, ""))[:_LONGEST_TEXT]) for name, key in named.items()}
