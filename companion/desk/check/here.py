"""Finds the companion that runs on this computer, and its journal."""

from __future__ import annotations

import json
import os
import tempfile
import time
from pathlib import Path
from typing import Any

from anytraverse.regular_file import open_regular
from companion.desk.check.rover import CheckedRover
from companion.desk.check.rules import CheckFinding, failed, passed, warned
from companion.storage.database import JournalError
from companion.storage.journal_copy import read_stored_memory
from companion.system.computer import existing

RUNNING = 5.0
"""Seconds after which a status file is outdated. A running companion writes it once a second."""
_LONGEST = 1 << 20
"""Bytes of the status file that are read at most; it has some 3 kB."""


def read_status(folder: Path) -> tuple[float | None, dict[str, Any]]:
    """Read the status file: seconds since it was written, None without a readable file, and its content.

    Raises PermissionError.
    """
    try:
        with os.fdopen(open_regular(folder / "status.json"), "rb") as file:
            age = time.time() - os.fstat(file.fileno()).st_mtime
            said = json.loads(file.read(_LONGEST))
    except PermissionError:
        raise
    except (OSError, ValueError, RecursionError):
        return None, {}
    return (age, said) if isinstance(said, dict) else (None, {})


def status(folder: Path) -> dict[str, Any] | None:
    """Read the status of a companion that runs with this folder; None when none runs."""
    try:
        age, said = read_status(folder)
    except PermissionError:
        return None
    return said if age is not None and age <= RUNNING and is_alive(said.get("pid")) else None


def is_alive(pid: object) -> bool:
    """Whether this process exists. True, too, when that cannot be known.

    Without this check a companion that has just ended would seem to run, until its status file is outdated.
    """
    if not isinstance(pid, int) or pid <= 0:
        return True
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):  # the file may hold any number
        return False
    except OSError:
        pass
    return True


CHECK = "journal"


def check_journal(rover: CheckedRover) -> list[CheckFinding]:
    """Check that the folder can be written, and that what is remembered can be read. Leave no file there.

    A file of root's would keep out the daemon, which runs as another user.
    """
    folder = rover.folder
    if rover.running is not None:
        return [passed(CHECK, f"{folder}, in use by the companion that runs")]
    place = existing(folder)
    try:
        with tempfile.TemporaryFile(dir=place):
            pass
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        whose = "check [journal] folder, and who owns it"
        return [failed(CHECK, f"{place} cannot be written ({why}): {whose}, or type this with sudo")]
    what = f"{folder} can be written" if place == folder else f"{folder} can be made"
    if os.geteuid() == 0 and place.stat().st_uid != 0:
        what += f" by root; the service runs as {_owner(place)}"
    try:
        memory = read_stored_memory(folder)
    except JournalError as error:
        return [warned(CHECK, f"{what}; {error}")]
    if memory is not None:
        what += f"; {len(memory.history)} scenes of model {memory.model_id}"
    return [passed(CHECK, what)]


def _owner(path: Path) -> str:
    try:
        return path.owner()
    except KeyError:
        return f"user {path.stat().st_uid}"
