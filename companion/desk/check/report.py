"""Runs the checks inside a companion that runs, logs what they find, and serves them as /check.json."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping, Sequence, Set
from pathlib import Path
from typing import Any

from companion.config import Config
from companion.desk.check.rover import CheckedRover
from companion.desk.check.rules import CheckFinding, Verdict
from companion.desk.check.table import findings

log = logging.getLogger(__name__)

EVERY = 10.0
"""Seconds between two refreshes."""


class CheckReport:
    """Holds the newest findings. One thread refreshes them, any thread may read them."""

    def __init__(self, config: Config, clock: Callable[[], float] = time.monotonic) -> None:
        self._config = config
        self._folder: Path = config.journal.path
        self._clock = clock
        self._found: tuple[float, Sequence[CheckFinding]] | None = None
        self._wrong: Set[str] = frozenset()
        self._logged: set[str] = set()

    def refresh(self, figures: Mapping[str, Any]) -> None:
        """Run all checks on what the companion says of itself. It takes milliseconds, unless the disk hangs.

        figures: as in the status file. What a check finds twice in a row is logged, once a check.
        """
        found = list(findings(CheckedRover(self._config, "", self._folder, figures, inside=True)))
        self._found = self._clock(), found
        wrong = {finding.check: finding for finding in found if finding.verdict >= Verdict.WARN}
        for name, finding in wrong.items():
            if name in self._wrong and name not in self._logged:
                self._logged.add(name)
                level = logging.ERROR if finding.verdict is Verdict.FAIL else logging.WARNING
                log.log(level, "check: %s", finding.line(0))
        self._wrong = wrong.keys()

    def document(self) -> Mapping[str, Any]:
        """Return the content of /check.json: JSON values."""
        if self._found is None:
            return {"state": "starting"}
        at, found = self._found
        ok = all(finding.verdict is not Verdict.FAIL for finding in found)
        return {
            "ok": ok,
            "age": round(self._clock() - at, 1),
            "checks": [finding.row() for finding in found],
        }
