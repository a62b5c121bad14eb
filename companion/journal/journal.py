"""The journal: one folder with one SQLite file and the frame of the open call."""

from __future__ import annotations

import json
import logging
import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from anytraverse.memory import Memory
from companion.calls.decisions import Call
from companion.durable import sync_folder, write_durably
from companion.journal.database import Database
from companion.journal.errors import Damaged, JournalError
from companion.journal.records import CallRecord, record_of
from companion.journal.rows import read_memory, write_memory

_log = logging.getLogger(__name__)

LARGEST = 64 << 20
MAX_CALLS = 1000
"""Closed calls, and answers, that are kept; the oldest go."""

_Opened = tuple[Database, Memory | None, dict[str, Any] | None]


class Journal:
    """What must survive a restart. One thread uses it; what it was told to keep is on disk when it returns.

    recovered_from: where a damaged journal was set aside when this one was opened; None: it was whole.
    """

    def __init__(self, folder: Path, largest: int = LARGEST) -> None:
        """Open or begin the journal in `folder`; largest: bytes that it may grow to.

        A damaged one is set aside under another name, with a warning, and a fresh one begun. Raises
        JournalError when the folder cannot be used, another companion uses it, or a newer one wrote it.
        """
        self._folder = folder
        self._path = self._folder / "journal.db"
        self._frame = self._folder / "call.png"
        self.recovered_from: Path | None = None
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise JournalError(
                f"folder {self._folder} cannot be made ({error.strerror}): check [journal] folder"
            ) from error
        try:
            opened = self._open(largest)
        except Damaged as damage:
            self.recovered_from = self._set_aside(damage)
            opened = self._open(largest)
        self._database, self._memory, self._supervision = opened

    def close(self) -> None:
        """Give the file back; more than once is fine."""
        self._database.close()

    def save_memory(self, memory: Memory) -> None:
        """Keep what the algorithm must not lose; only changed rows are written. Raises JournalError."""
        with self._database.writing() as connection:
            write_memory(connection, memory, self._memory)
        self._memory = memory

    def load_memory(self) -> Memory | None:
        """The memory kept last, or None."""
        return self._memory

    def save_supervision(self, state: Mapping[str, Any]) -> None:
        """Keep the state of the open call and the hold: JSON values. Raises JournalError."""
        text = _json(state)
        with self._database.writing() as connection:
            connection.execute("REPLACE INTO supervision VALUES (1, ?)", (text,))
        kept: dict[str, Any] = json.loads(text)
        self._supervision = kept

    def load_supervision(self) -> dict[str, Any] | None:
        """The state kept last, or None."""
        return self._supervision

    def save_frame(self, png: bytes) -> None:
        """Keep the frame of the open call in place of the one before. Raises JournalError."""
        try:
            write_durably(self._frame, png)
        except OSError as error:
            raise JournalError(f"{self._frame} cannot be written ({error}): make room on the disk") from error

    def load_frame(self) -> bytes | None:
        """The frame kept last, PNG; None when there is none, or it cannot be read."""
        try:
            return self._frame.read_bytes()
        except OSError as error:
            if not isinstance(error, FileNotFoundError):
                _log.warning("the frame of the open call is lost: %s", error)
            return None

    def record_call(self, call: Call, at: float | None = None) -> None:
        """Keep what a closed call was about. at: seconds since 1970, by default now. Raises JournalError."""
        row = (call.id, at or time.time(), call.outcome.name.lower(), _json(record_of(call)))
        self._append("calls", "id, closed_at, outcome, record", row)

    def record_answer(self, call_id: int, record: Mapping[str, Any], at: float | None = None) -> None:
        """Keep what was answered to a call: JSON values. at: as for a call. Raises JournalError."""
        row = (call_id, at or time.time(), _json(record))
        self._append("answers", "call_id, answered_at, record", row)

    def calls(self, limit: int = 20) -> list[CallRecord]:
        """The calls closed last, the newest first. Raises JournalError."""
        found = self._database.rows(
            "SELECT id, closed_at, outcome, record FROM calls ORDER BY number DESC LIMIT ?", limit
        )
        return [
            CallRecord(number, closed_at, outcome, json.loads(record), self.answers(number))
            for number, closed_at, outcome, record in found
        ]

    def answers(self, call_id: int) -> tuple[Mapping[str, Any], ...]:
        """What was answered to a call, in order. Raises JournalError."""
        query = "SELECT record FROM answers WHERE call_id = ? ORDER BY number"
        return tuple(json.loads(record) for (record,) in self._database.rows(query, call_id))

    def _open(self, largest: int) -> _Opened:
        """Open the file and read all that a start needs, so that damage shows now and not later."""
        database = Database(self._path, largest)
        try:
            return database, read_memory(database.rows), _read_state(database)
        except BaseException:
            database.close()
            raise

    def _set_aside(self, damage: Damaged) -> Path:
        number = 1
        while (aside := self._folder / f"journal.damaged-{number}.db").exists():
            number += 1
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
        _log.warning("the journal was damaged (%s): set aside as %s, begun afresh", damage, aside)
        return aside

    def _append(self, table: str, columns: str, row: tuple[object, ...]) -> None:
        marks = ", ".join("?" * len(row))
        with self._database.writing() as connection:
            connection.execute(f"INSERT INTO {table} ({columns}) VALUES ({marks})", row)
            connection.execute(
                f"DELETE FROM {table} WHERE number <= (SELECT max(number) FROM {table}) - ?", (MAX_CALLS,)
            )


def _json(values: Mapping[str, Any]) -> str:
    try:
        return json.dumps(dict(values))
    except (TypeError, ValueError) as error:
        raise JournalError(f"what cannot be written as JSON cannot be kept: {error}") from error


def _read_state(database: Database) -> dict[str, Any] | None:
    found = database.rows("SELECT state FROM supervision")
    try:
        state = json.loads(found[0][0]) if found else None
    except (ValueError, TypeError) as error:
        raise Damaged(f"the state of the calls cannot be read: {error}") from error
    if state is not None and not isinstance(state, dict):
        raise Damaged("the state of the calls is no table")
    return state
