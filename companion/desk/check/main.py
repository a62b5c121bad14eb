"""Runs all checks of `companion check`, prints them as a table, and sets the exit code."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator

from companion.config import ConfigError, load_config, state_folder
from companion.desk.check.here import status
from companion.desk.check.rover import CheckedRover
from companion.desk.check.rules import CheckFinding, Verdict, failed
from companion.desk.check.table import WIDTH, findings


def check(file: str, *, link: str | None = None, as_json: bool = False) -> int:
    """Print the table. Returns 0 when nothing failed, else 1. link: URL of another way to the autopilot."""
    found: list[CheckFinding] = []
    for finding in _findings(file, link):
        found.append(finding)
        print(finding.line(WIDTH), flush=True)
    bad = [finding for finding in found if finding.verdict is Verdict.FAIL]
    print(_summary(found))
    if as_json:
        print(json.dumps({"ok": not bad, "checks": [finding.row() for finding in found]}))
    return 1 if bad else 0


def _summary(found: list[CheckFinding]) -> str:
    counts = Counter(finding.verdict for finding in found)
    parts = (
        (Verdict.FAIL, "to mend, the uppermost first"),
        (Verdict.WARN, "to know of"),
        (Verdict.SKIP, "not checked"),
    )
    told = [f"{counts[verdict]} {what}" for verdict, what in parts if counts[verdict]]
    return "; ".join(told) or "all is well"


def _findings(file: str, link: str | None) -> Iterator[CheckFinding]:
    try:
        config = load_config(file)
    except ConfigError as error:
        yield from (failed("config", str(problem)) for problem in error.problems)
        return
    folder = state_folder(config)
    yield from findings(CheckedRover(config, file, folder, status(folder), link))
