"""The operator of a demo: the terminal, typed at by a person or by the demo itself."""

from __future__ import annotations

from pathlib import Path

from companion.sim.demo.child import Child


def start_operator(link: str, logs: Path, *, auto: bool) -> Child:
    """The terminal operator; a person's own unless `auto`. Its lines are its events either way."""
    arguments = ["gcs_plugin.terminal.main", "--connect", link]
    log = logs / "operator.log"
    if auto:
        return Child("operator", [*arguments, "--events"], log)
    events = logs / "operator.jsonl"
    return Child("operator", [*arguments, "--log", str(events)], log, interactive=True, events=events)
