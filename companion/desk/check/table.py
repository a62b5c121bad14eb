"""Lists all checks of `companion check`, in the order in which a person mends what they find, and runs them.

The command prints what they find; a companion that runs logs it, and serves it as /check.json.
"""

from __future__ import annotations

import json
import logging
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from pathlib import Path
from typing import Any, NamedTuple

from companion.config import Config, ConfigError, load_config, state_folder
from companion.desk.check.camera import (
    check_camera,
    check_exposure,
    check_frames,
    check_infrared,
    check_perceiver,
)
from companion.desk.check.computer import (
    check_clock,
    check_heat,
    check_load,
    check_service,
    check_space,
    check_speed,
    check_versions,
)
from companion.desk.check.here import check_journal, status
from companion.desk.check.link import check_autopilot, check_forwarding, check_link, check_signing
from companion.desk.check.observers import check_live, check_page, check_recording, check_video
from companion.desk.check.rights import check_reach, check_rights
from companion.desk.check.rover import CheckedRover
from companion.desk.check.rules import CheckFinding, Verdict, failed, passed
from companion.desk.check.stopping import check_course, check_stopping, check_tile, check_zone

log = logging.getLogger(__name__)
EVERY = 10.0
"""Seconds between two refreshes."""


class Check(NamedTuple):
    """One row of the table. look: checks, and returns one finding or more. what: what it checks."""

    name: str
    look: Callable[[CheckedRover], Iterable[CheckFinding]]
    what: str


def _config(rover: CheckedRover) -> list[CheckFinding]:
    where = f"{rover.file}, " if rover.file else ""
    return [passed("config", f"{where}policy {rover.config.call.policy}")]


# fmt: off
CHECKS = (
    Check("config",     _config,          "whether the configuration is sound"),
    Check("versions",   check_versions,   "whether all packages are there, and the installed release runs"),
    Check("service",    check_service,    "whether systemd starts the companion at boot"),
    Check("rights",     check_rights,     "whether the service's users may use their files and devices"),
    Check("reach",      check_reach,      "what of the network the vision process reaches"),
    Check("disk",       lambda rover: [check_space(rover.folder)],
                                          "whether there is room for journal, pictures and logs"),
    Check("disk speed", check_speed,      "how long a write takes until it is on the disk"),
    Check("journal",    check_journal,    "whether what is learnt can be stored, and what is stored be read"),
    Check("clock",      check_clock,      "whether the clock was set, and runs on without power"),
    Check("heat",       check_heat,       "temperature, throttling, and the supply's voltage"),
    Check("load",       check_load,       "CPU and memory in use"),
    Check("camera",     check_camera,     "whether a first picture comes, shaped as `[mount] aspect` says"),
    Check("frames",     check_frames,     "how many pictures a second come, and how old they are"),
    Check("exposure",   check_exposure,   "whether the picture is too dark, too bright, or of one colour"),
    Check("infrared",   check_infrared,   "whether the camera has no infrared filter, and that is handled"),
    Check("perceiver",  check_perceiver,  "whether the model loads, and keeps the freshness limit T"),
    Check("link",       check_link,       "whether an autopilot is heard within 10 s, on any connection"),
    Check("autopilot",  check_autopilot,  "its parameters that would make a hold unsafe or useless"),
    Check("forwarding", check_forwarding, "whether a ground station is heard, and may answer"),
    Check("signing",    check_signing,    "whether frames are signed, and the key fits"),
    Check("course",     check_course,     "whether it would be seen that the vehicle drives backwards"),
    Check("stopping",   check_stopping,   "whether the vehicle stops within what its camera sees"),
    Check("tile",       check_tile,       "whether the vehicle fits into the ROI, and how large a tile is"),
    Check("zone",       check_zone,       "whether things were noticed in time where a person carried them"),
    Check("page",       check_page,       "whether the page for a browser is shown, and to whom"),
    Check("video",      check_video,      "whether the MAVLink camera's video is served, and where"),
    Check("recording",  check_recording,  "whether recordings are written, where, and how many there are"),
    Check("live view",  check_live,       "whether the live view is served, and to whom"),
)
# fmt: on
WIDTH = 24


def findings(rover: CheckedRover) -> Iterator[CheckFinding]:
    """Run all checks in order, as `survived` does."""
    for check in CHECKS:
        yield from survived(check, rover)


def survived(check: Check, rover: CheckedRover) -> Iterator[CheckFinding]:
    """Run a check. One that fails in an unforeseen way is a finding, too."""
    try:
        yield from check.look(rover)
    except Exception as error:  # the other checks still count
        what = f"{type(error).__name__}: {error}"
        yield failed(check.name, f"this check itself fails ({what[:200]}): report that")


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
        return {"ok": ok, "age": round(self._clock() - at, 1), "checks": [finding.row() for finding in found]}


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
