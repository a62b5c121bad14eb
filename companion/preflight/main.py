"""Runs all checks of `companion check`, prints them as a table, and sets the exit code."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from companion.config import Config, ConfigError, load_config
from companion.policy.hold_gate import unchecked
from companion.policy.stopping import judge_stopping
from companion.preflight.autopilot import CHECK, Asked, ask_first
from companion.preflight.here import (
    Perceives,
    check_camera,
    check_disk,
    check_journal,
    check_perceiver,
    state_folder,
    status,
)
from companion.preflight.rules import Finding, Verdict, failed, passed, warned

_WIDTH = 24


def check(file: str, *, link: str | None = None, as_json: bool = False) -> int:
    """Print the table. Returns 0 when nothing failed, else 1. link: URL of another way to the autopilot."""
    findings: list[Finding] = []
    for finding in _findings(file, link):
        findings.append(finding)
        print(finding.line(_WIDTH), flush=True)
    bad = [finding for finding in findings if finding.verdict is Verdict.FAIL]
    if as_json:
        print(json.dumps({"ok": not bad, "checks": [finding.row() for finding in findings]}))
    return 1 if bad else 0


def _findings(file: str, link: str | None) -> Iterator[Finding]:
    try:
        config = load_config(file)
    except ConfigError as error:
        yield from (failed("config", str(problem)) for problem in error.problems)
        return
    yield passed("config", f"{file}, policy {config.call.policy}")
    folder = state_folder(config)
    running = status(folder)
    perceives = check_perceiver(config)
    yield perceives.finding
    yield check_camera(config, running)
    yield check_journal(folder, running=running is not None)
    yield check_disk(folder)
    asked = Asked()
    if running is not None and link is None:
        yield _link_of_running(running)
    else:
        connections = config.link.settings().connections().values()
        asked = ask_first(config, [link] if link else [one.url for one in connections])
        yield from asked.findings
    yield check_stopping(config, perceives, asked)


def _link_of_running(said: dict[str, Any]) -> Finding:
    """Report the link's state from a running companion's status: the companion owns the link."""
    trouble = (said.get("link") or {}).get("trouble")
    state = f"the companion runs (state {said.get('state', 'unknown')}) and owns the link"
    if trouble:
        return failed(CHECK, f"{state}: {trouble}")
    return warned(CHECK, f"not asked: {state}: stop it first, or give the check a way of its own with --link")


def check_stopping(config: Config, perceives: Perceives, asked: Asked) -> Finding:
    """Check that the vehicle can stop before an obstacle that the camera shows."""
    name, fastest = asked.speed if asked.speed is not None else ("", None)
    judged = judge_stopping(config, perceives.step, perceives.tile, fastest, asked.overrun)
    if isinstance(judged, str):
        if config.call.policy == "hold" and not config.stopping.unchecked:
            return failed("stopping", unchecked(judged))
        return warned("stopping", f"not checked: {judged}")
    configured = config.stopping.speed
    by = ""
    if fastest is not None and (configured is None or fastest > configured):
        by = f"{name} says {fastest:g} m/s; "
    if judged.enough:
        return passed("stopping", by + judged.describe())
    if config.call.policy == "hold":
        return failed("stopping", f"policy hold is refused: {by}{judged.describe()}")
    return warned("stopping", by + judged.describe())
