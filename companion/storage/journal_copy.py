"""Reads from a copy of the journal, since a companion that runs locks the journal itself."""

from __future__ import annotations

import hashlib
import os
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from anytraverse.memory import Memory
from anytraverse.regular_file import open_regular, read_regular
from companion.storage.batch import from_json
from companion.storage.database import Damaged, Database, JournalError
from companion.storage.journal import LARGEST, number_of
from companion.storage.memory_rows import read_memory
from companion.wire.call_report import RECORD_MEMBERS, CallReport
from companion.wire.json_values import DocumentError

_TRIES = 5
_PAUSE = 0.2
"""Seconds between two tries to copy a journal that is being written."""
_LONGEST_LOG = 2 * LARGEST
"""Bytes of the write-ahead log that are copied at most."""
_CHUNK = 1 << 20
_LONGEST_NOTE = 1000


def read_stored_memory(folder: Path) -> Memory | None:
    """Return the memory in the journal of `folder`, None without one. Changes nothing there.

    Raises JournalError.
    """
    with _stored(folder) as database:
        return None if database is None else read_memory(database.rows)


def read_stored_calls(folder: Path) -> list[CallReport] | None:
    """Return the closed calls in the journal of `folder`, oldest first, None without one. Changes nothing.

    Those that are damaged are left out. Raises JournalError.
    """
    with _stored(folder) as database:
        if database is None:
            return None
        answers = defaultdict[int, list[dict[str, Any]]](list)
        for call, at, record in database.rows(
            "SELECT call_id, answered_at, record FROM answers ORDER BY number"
        ):
            answers[call].append({**(from_json(record) or {}), "at": at})
        found = []
        for call, at, outcome, record in database.rows(
            "SELECT id, closed_at, outcome, record FROM calls ORDER BY number"
        ):
            told = {"id": call, "closed": at, "outcome": outcome, "answers": answers[call]}
            with suppress(DocumentError):
                found.append(CallReport.read({**(from_json(record) or {}), **told}, RECORD_MEMBERS))
        return found


@contextmanager
def _stored(folder: Path) -> Iterator[Database | None]:
    """Open a copy of the journal of `folder`, None without one. Raises JournalError."""
    path = folder / "journal.db"
    try:
        if not path.exists():
            yield None
            return
        with TemporaryDirectory(prefix="companion-") as temporary:
            copy = _copied(path, Path(temporary))
            try:
                with closing(Database(copy, 2 * LARGEST)) as database:
                    yield database
            except Damaged as error:
                raise JournalError(f"{path} is damaged: start the companion, which sets it aside") from error
            except JournalError as error:
                raise JournalError(str(error).replace(str(copy), str(path))) from error
    except PermissionError as error:
        raise JournalError(f"{path} may not be read: type this with sudo") from error
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        raise JournalError(
            f"{path} cannot be copied ({why}): check the disk, and the room in /tmp"
        ) from error


def told_of_damage(folder: Path) -> str:
    """Return what was recovered of the newest damaged journal that lies in `folder`, "" without one."""
    notes = sorted(folder.glob("journal.damaged-*.txt"), key=number_of)
    try:
        content = read_regular(notes[-1], _LONGEST_NOTE, follow=False) if notes else b""
    except OSError:
        return ""
    return "".join(one for one in content.decode(errors="replace") if one.isprintable())


def _copied(path: Path, to: Path) -> Path:
    """Copy the file and its write-ahead log as they were at one moment. Raises OSError, JournalError.

    SQLite appends commits to the log, and now and then writes the log into the file. If the file was the same
    before and after its log was copied, both fit together as after a loss of power.
    """
    copy = to / path.name
    for attempt in range(_TRIES):
        if attempt:
            time.sleep(_PAUSE)
        before = _copy(path, copy, LARGEST)
        try:
            _copy(Path(f"{path}-wal"), Path(f"{copy}-wal"), _LONGEST_LOG)
        except FileNotFoundError:
            Path(f"{copy}-wal").unlink(missing_ok=True)
        if _copy(path, None, LARGEST) == before:
            return copy
    raise JournalError(f"{path} is being written: try again")


def _copy(path: Path, to: Path | None, most: int) -> bytes:
    """Copy a file, and return the checksum of its content. to: None only reads it."""
    checksum, left = hashlib.sha256(), most
    with os.fdopen(open_regular(path), "rb") as source, (to or Path("/dev/null")).open("wb") as target:
        while chunk := source.read(min(_CHUNK, left + 1)):
            left -= len(chunk)
            if left < 0:
                raise JournalError(f"{path} is larger than {most >> 20} MiB: check what wrote it")
            checksum.update(chunk)
            target.write(chunk)
    return checksum.digest()
