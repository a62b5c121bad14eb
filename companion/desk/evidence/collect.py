"""Reads what is stored, and makes the parts of evidence of it, in the order of a reader."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from companion.config import Config, state_folder
from companion.desk.check.here import RUNNING, is_alive, read_status
from companion.desk.evidence.calls import calls_part
from companion.desk.evidence.camera import camera_part
from companion.desk.evidence.checked import check_part, run_check
from companion.desk.evidence.computer import computer_part
from companion.desk.evidence.drives import read_drives
from companion.desk.evidence.faults import faults_part
from companion.desk.evidence.link import link_part
from companion.desk.evidence.log import read_log
from companion.desk.evidence.parts import EvidencePart, NotKnown, utc
from companion.desk.evidence.sources import Sources
from companion.desk.evidence.stopping import stopping_part
from companion.desk.evidence.versions import versions_part
from companion.desk.evidence.zone import zone_part
from companion.storage.database import JournalError
from companion.storage.journal_copy import read_stored_calls
from companion.vehicle.state import is_set

VERSION = 1
"""Of evidence.json. What a key means changes only with it."""
_PARTS: Mapping[str, Callable[[Sources], EvidencePart]] = {
    "computer": computer_part,
    "camera": camera_part,
    "stopping": stopping_part,
    "zone": zone_part,
    "faults": faults_part,
    "link": link_part,
    "calls": calls_part,
    "versions": versions_part,
    "check": check_part,
}
_NO_CHECK = "it was left out by --no-check"


def read_sources(config: Config, file: str, *, checks: bool = True) -> Sources:
    """Read all that evidence is made from. It works beside a companion that runs, and changes nothing.

    file: the configuration's. checks: whether `companion check` is run, which may take minutes. Raises
    OSError.
    """
    folder, now = state_folder(config), time.time()
    age, status = read_status(folder)
    running = age is not None and age <= RUNNING and is_alive(status.get("pid"))
    journal, no_journal = None, f"there is no journal in {folder}"
    try:
        journal = read_stored_calls(folder)
    except JournalError as error:
        no_journal = str(error)
    checked, no_check = run_check(file) if checks else ([], _NO_CHECK)
    return Sources(
        config,
        folder,
        now,
        written=None if age is None else now - age,
        status=status,
        running=running,
        journal=journal,
        no_journal=no_journal,
        driven=read_drives(folder),
        logged=read_log(folder),
        checked=checked,
        no_check=no_check,
    )


def evidence(sources: Sources, fingerprint: str) -> dict[str, Any]:
    """Return the document: of it the page is made, too. fingerprint: of the rover's key."""
    parts = {key: part(sources) for key, part in _PARTS.items()}
    unknown = [*_beside(sources), *(one for part in parts.values() for one in part.unknown)]
    return {
        "evidence": VERSION,
        "made_at": utc(sources.now),
        "rover": f"system {sources.config.link.system_id}",
        "key": fingerprint,
        "parts": {key: part.document() for key, part in parts.items()},
        "unknown": [one._asdict() for one in unknown],
    }


def _beside(sources: Sources) -> Iterator[NotKnown]:
    """Yield what no part tells."""
    if not is_set(sources.now):
        yield NotKnown("when this was made", "the computer's clock was never set", "companion check")
    if sources.written is None:
        yield NotKnown("how the companion does", "it has not run with this folder", "companion run")
    if sources.driven.unread:
        what = f"{sources.driven.unread} recordings, or the rest of one"
        yield NotKnown(what, "reading them would have taken too long", "companion record list")
    if sources.driven.damaged:
        what = f"{sources.driven.damaged} damaged recordings"
        yield NotKnown(what, "the disk cannot read them", "a new card or disk")
