"""Starts the operator's terminal for a demo; a person or the demo itself types into it."""

from __future__ import annotations

from pathlib import Path

from companion.sim.demo.child import Child


def start_operator(link: str, logs: Path, *, auto: bool) -> Child:
    """Starts the terminal; with `auto` the demo types, else a person. `lines` gives its events either way."""
    arguments = ["gcs_plugin.terminal.main", "--connect", link]
    log = logs / "operator.log"
    if auto:
        return Child("operator", [*arguments, "--events"], log)
    events = logs / "operator.jsonl"
    return Child("operator", [*arguments, "--log", str(events)], log, interactive=True, events=events)
