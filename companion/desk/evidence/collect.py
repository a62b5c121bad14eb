"""Reads what is stored, and makes the parts of evidence of it, in the order of a reader."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
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
_PARTS: Sequence[Callable[[Sources], EvidencePart]] = (
    computer_part,
    camera_part,
    stopping_part,
    zone_part,
    faults_part,
    link_part,
    calls_part,
    versions_part,
    check_part,
)
_TOLD_EVERY = 5.0
_NO_CHECK = "it was left out by --no-check"


def read_sources(config: Config, file: str, *, checks: bool = True) -> Sources:
    """Read all that evidence is made from. It works beside a companion that runs, and changes nothing.

    file: the configuration's. checks: whether `companion check` is run, which may take minutes. Raises
    OSError.
    """
    folder, now = state_folder(config), time.time()
    age, status = read_status(folder)
    running = age is not None and age <= RUNNING and is_alive(status.get("pid"))
    no_journal = ""
    try:
        journal = read_stored_calls(folder)
        no_journal = "" if journal is not None else f"there is no journal in {folder}"
    except JournalError as error:
        journal, no_journal = None, str(error)
    checked, no_check = run_check(file) if checks else ([], _NO_CHECK)
    return Sources(
        config,
        folder,
        now,
        age=age,
        status=status,
        running=running,
        journal=journal,
        no_journal=no_journal,
        driven=read_drives(folder, _Told()),
        logged=read_log(folder),
        checked=checked,
        no_check=no_check,
    )


def evidence(sources: Sources, fingerprint: str) -> tuple[dict[str, Any], list[EvidencePart], list[NotKnown]]:
    """Return the document for a program, the parts, and all that is not known.

    fingerprint: of the rover's key.
    """
    parts = [part(sources) for part in _PARTS]
    unknown = [*_beside(sources), *(one for part in parts for one in part.unknown)]
    document = {
        "evidence": VERSION,
        "made_at": utc(sources.now),
        "rover": rover_name(sources),
        "key": fingerprint,
        "parts": {part.key: part.document() for part in parts},
        "unknown": [one.document() for one in unknown],
    }
    return document, parts, unknown


def rover_name(sources: Sources) -> str:
    """Name the rover, as far as that is configured: by its MAVLink system id."""
    return f"system {sources.config.link.system_id}"


def _beside(sources: Sources) -> list[NotKnown]:
    """List what no part tells."""
    found = []
    if not is_set(sources.now):
        found.append(NotKnown("when this was made", "the computer's clock was never set", "companion check"))
    if sources.age is None:
        found.append(NotKnown("how the companion does", "it has not run with this folder", "companion run"))
    if sources.driven.unread:
        what = f"{sources.driven.unread} older recordings"
        found.append(NotKnown(what, "reading them would have taken too long", "companion record list"))
    if sources.driven.damaged:
        what = f"{sources.driven.damaged} damaged recordings"
        found.append(NotKnown(what, "the disk cannot read them", "a new card or disk"))
    return found


class _Told:
    """Says on stderr how far reading is, every five seconds."""

    def __init__(self) -> None:
        self._at = time.monotonic()

    def __call__(self, done: int, of: int) -> None:
        if time.monotonic() - self._at >= _TOLD_EVERY:
            self._at = time.monotonic()
            print(f"recording {done + 1} of {of}", file=sys.stderr, flush=True)
