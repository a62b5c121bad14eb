"""Stores memory, state, frame, calls and answers in the journal: one SQLite file in its own folder."""

from __future__ import annotations

import json
import logging
import os
import sqlite3
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from anytraverse.memory import Memory
from companion.storage.batch import Batch, TableRow, as_json, from_json
from companion.storage.database import FRAME_SINCE, Damaged, Database, JournalError
from companion.storage.memory_rows import read_memory, write_memory
from companion.storage.salvage import DailyCopy, best, salvage
from companion.system.atomic_write import sync_folder
from companion.wire.call_report import RECORD_MEMBERS, CallReport

_log = logging.getLogger(__name__)

LARGEST = 64 << 20
"""Bytes that the file may grow to."""
MAX_CALLS = 1000
"""Closed calls, and answers, that are stored; the oldest are deleted."""

MAX_DAMAGED = 3
"""Damaged journals that are left beside it, the newest ones."""

_Opened = tuple[Database, Memory | None, str | None]


class Journal:
    """Stores what must survive a restart; it is on disk when a method returns. Used by one thread at a time.

    recovered_from: where a damaged journal was moved when this one was opened; None: it was not damaged.
    recovered: what was read of it, and of the copy beside it, for a person; "" where it was not damaged.
    """

    def __init__(self, folder: Path, largest: int = LARGEST) -> None:
        """Open or create the journal in `folder`. largest: bytes that the file may grow to.

        Renames a damaged journal, with a warning, and creates a new one of what can be read of it, or of the
        daily copy. Raises JournalError when the folder cannot be used, another companion uses it, or a newer
        version wrote it.
        """
        self._folder = folder
        self._path = self._folder / "journal.db"
        self._copy = DailyCopy(self._folder / "journal.copy.db")
        self.recovered_from: Path | None = None
        self.recovered = ""
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise JournalError(
                f"folder {self._folder} cannot be made ({error.strerror}): check [journal] folder"
            ) from error
        try:
            self._database, self._memory, self._state = self._open(largest)
        except Damaged as damage:
            self.recovered_from = self._set_aside(damage)
            self._database, self._memory, self._state = self._open(largest)
            self._recover(self.recovered_from, damage)
        if not self._database.found_version:
            self._copy.outdated()
        self._import_old_frame()

    def close(self) -> None:
        """Close the file. May be called more than once."""
        self._database.close()

    def commit(self, batch: Batch) -> None:
        """Store the batch in one transaction. Raises JournalError; then nothing of it is stored."""
        with self._database.writing() as connection:
            if batch.memory is not None:
                write_memory(connection, batch.memory, self._memory)
            if batch.state is not None:
                connection.execute("REPLACE INTO supervision VALUES (1, ?)", (batch.state,))
            if batch.frame is not None:
                connection.execute("REPLACE INTO frame VALUES (1, ?, ?)", batch.frame)
            for row in batch.rows:
                _append(connection, row)
        if batch.memory and self._memory and len(batch.memory.history) < len(self._memory.history):
            self._copy.outdated()
        self._memory = batch.memory or self._memory
        self._state = batch.state or self._state

    def tidy(self) -> None:
        """Do the maintenance that no caller should wait for. Raises JournalError."""
        self._database.tidy()
        self._copy.keep(self._database)

    def load_memory(self) -> Memory | None:
        """Return the memory stored last, or None."""
        return self._memory

    def load_supervision(self) -> dict[str, Any] | None:
        """Return the state stored last, or None."""
        return None if self._state is None else _table(self._state)

    def load_frame(self, frame_id: int) -> bytes | None:
        """Return the PNG of this frame; None when another one, or none, is stored. Raises JournalError."""
        found = self._database.rows("SELECT png FROM frame WHERE frame_id = ?", frame_id)
        return found[0][0] if found and isinstance(found[0][0], bytes) else None

    def calls(self, limit: int = 20) -> list[CallReport]:
        """Return the calls that were closed last, newest first. Raises JournalError."""
        found = self._database.rows(
            "SELECT id, closed_at, outcome, record FROM calls ORDER BY number DESC LIMIT ?", limit
        )
        told = (
            {**(from_json(record) or {}), "id": number, "closed": at, "outcome": outcome}
            for number, at, outcome, record in found
        )
        return [
            CallReport.read({**one, "answers": [*self.answers(one["id"])]}, RECORD_MEMBERS) for one in told
        ]

    def answers(self, call_id: int) -> tuple[Mapping[str, Any], ...]:
        """Return the answers to a call, oldest first, without damaged ones. Raises JournalError."""
        query = "SELECT record FROM answers WHERE call_id = ? ORDER BY number"
        found = [from_json(record) for (record,) in self._database.rows(query, call_id)]
        for _ in range(found.count(None)):
            _log.warning("an answer to call %d is lost: its record is damaged", call_id)
        return tuple(record for record in found if record is not None)

    def _open(self, largest: int) -> _Opened:
        """Open the file and read all that a start needs, so that damage shows now and not later."""
        database = Database(self._path, largest)
        try:
            return database, read_memory(database.rows), _read_state(database)
        except BaseException:
            database.close()
            raise

    def _import_old_frame(self) -> None:
        """Take over the open call's frame from the file call.png, where versions 1 and 2 stored it."""
        old = self._folder / "call.png"
        try:
            call = (self.load_supervision() or {}).get("call")
            if self._database.found_version < FRAME_SINCE and isinstance(call, dict) and old.exists():
                self.commit(Batch(frame=(int(call["frame_id"]), old.read_bytes())))
            old.unlink(missing_ok=True)
        except (OSError, JournalError, LookupError, TypeError, ValueError) as error:
            _log.warning("the frame of the open call is lost: %s", error)

    def _recover(self, aside: Path, damage: Damaged) -> None:
        """Store what can be read of a damaged journal, or of the copy, and say what that is."""
        found, copied = salvage(aside), salvage(self._copy.path)
        left, of_copy = best(found, copied)
        state = found.state
        if state is None and left.memory is not None:  # no id may be given twice
            newest = (copied.state or {}).get("last_id")
            ids = [entry.call_id for entry in left.memory.history]
            newest = max([*ids, newest if isinstance(newest, int) else 0])
            state = {"last_id": newest, "mode": None, "call": None, "hold": None}
        try:
            self.commit(Batch(left.memory, None if state is None else as_json(state)))
            self._restore(found.rows)
        except JournalError as error:
            self.recovered = f"a new one is begun ({error})"
        else:
            self.recovered = f"{left.scenes} scenes recovered"
            self.recovered += f" from the copy of {self._copy.date()}" if of_copy else ""
            self.recovered += ", words as configured" if left.memory and not left.words else ""
        why = " ".join(str(damage).split())
        told = f"the journal was damaged ({why}), set aside as {aside}: {self.recovered}"
        _log.warning("%s", told)
        with suppress(OSError):
            aside.with_suffix(".txt").write_text(f"{told}\n", encoding="utf-8")

    def _restore(self, tables: Mapping[str, Sequence[tuple[Any, ...]]]) -> None:
        """Store rows of other tables. Raises JournalError."""
        with self._database.writing() as connection:
            for table, rows in tables.items():
                for row in rows:
                    connection.execute(f"REPLACE INTO {table} VALUES ({', '.join('?' * len(row))})", row)

    def _set_aside(self, damage: Damaged) -> Path:
        before = sorted(self._folder.glob("journal.damaged-*.db"), key=number_of)
        number = number_of(before[-1]) + 1 if before else 1
        aside = self._folder / f"journal.damaged-{number}.db"
        try:
            for suffix in ("-shm", "-wal", ""):
                part = Path(f"{self._path}{suffix}")
                if part.exists():
                    os.replace(part, f"{aside}{suffix}")
            sync_folder(self._folder)
        except OSError as error:
            raise JournalError(
                f"{self._path} is damaged ({damage}) and cannot be moved ({error.strerror}): move it by hand"
            ) from error
        self._delete_old_damaged([*before, aside])
        return aside

    def _delete_old_damaged(self, aside: list[Path]) -> None:
        """Delete all but the newest damaged journals: a failing card must not fill up with them."""
        for old in aside[:-MAX_DAMAGED]:
            for suffix in ("-shm", "-wal", ""):
                with suppress(OSError):
                    Path(f"{old}{suffix}").unlink(missing_ok=True)
            with suppress(OSError):
                old.with_suffix(".txt").unlink(missing_ok=True)


def number_of(aside: Path) -> int:
    """Return the number of a damaged journal that was set aside."""
    number = aside.stem.rpartition("-")[2]
    return int(number) if number.isdecimal() else 0


def _append(connection: sqlite3.Connection, row: TableRow) -> None:
    marks = ", ".join("?" * len(row.values))
    connection.execute(f"INSERT INTO {row.table} ({row.columns}) VALUES ({marks})", row.values)
    connection.execute(
        f"DELETE FROM {row.table} WHERE number <= (SELECT max(number) FROM {row.table}) - ?", (MAX_CALLS,)
    )


def _table(state: str) -> dict[str, Any]:
    table = json.loads(state)
    if not isinstance(table, dict):
        raise Damaged("the state of the calls is no table")
    return table


def _read_state(database: Database) -> str | None:
    found = database.rows("SELECT state FROM supervision")
    if not found:
        return None
    try:
        state = str(found[0][0])
        _table(state)
    except (ValueError, TypeError, RecursionError) as error:
        raise Damaged(f"the state of the calls cannot be read: {error}") from error
    return state
