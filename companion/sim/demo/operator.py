"""Starts the operator's terminal for a demo, into which a person or the demo itself types, or the console."""

from __future__ import annotations

from pathlib import Path

from companion.sim.demo.child import LoggedProcess


def start_operator(link: str, logs: Path, *, auto: bool, console: bool = False) -> LoggedProcess:
    """Starts the terminal; with `auto` the demo types, else a person. `lines` gives its events either way.

    console: a person answers in a browser instead.
    """
    program = "gcs_plugin.console" if console else "gcs_plugin.terminal.main"
    arguments = [program, "--connect", link]
    log = logs / "operator.log"
    if auto:
        return LoggedProcess("operator", [*arguments, "--events"], log)
    events = logs / "operator.jsonl"
    return LoggedProcess("operator", [*arguments, "--log", str(events)], log, interactive=True, events=events)
