"""Runs `companion check --json` in a process that is ended when it takes too long, and tells its rows."""

from __future__ import annotations

import json
import os
import signal
import subprocess
from collections.abc import Mapping
from typing import Any

from companion.desk.evidence.parts import EvidencePart, EvidenceTable, NotKnown
from companion.desk.evidence.sources import Sources
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
    rows = [_row(one) for one in list_of(_read(said).get("checks"))]
    return rows, "" if rows else "companion check said nothing that can be read"


def check_part(sources: Sources) -> EvidencePart:
    """List what the check found."""
    if not sources.checked:
        lacking = NotKnown("what companion check finds", sources.no_check, "companion check")
        return EvidencePart("check", "Check", unknown=(lacking,))
    rows = [(one["verdict"], one["check"], one["text"]) for one in sources.checked]
    unknown = [
        NotKnown(f"check: {check}", text, "companion check")
        for verdict, check, text in rows
        if verdict == "skip"
    ]
    table = EvidenceTable.of("What companion check says now", ("verdict", "check", "what"), rows)
    return EvidencePart("check", "Check", (), (table,), tuple(unknown))


def _row(raw: Any) -> Mapping[str, str]:
    told = mapping_of(raw)
    return {name: clean(str(told.get(name, ""))[:_LONGEST_TEXT]) for name in ("verdict", "check", "text")}


def _read(said: bytes) -> Mapping[str, Any]:
    lines = said.decode(errors="replace").splitlines()
    try:
        return mapping_of(json.loads(lines[-1])) if lines else {}
    except (ValueError, RecursionError):
        return {}
