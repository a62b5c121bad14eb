"""Keeps a copy beside the journal. Reads what is left of a damaged one or its copy, and says which counts."""

from __future__ import annotations

import logging
import shutil
import sqlite3
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from anytraverse.history import History
from anytraverse.memory import Memory
from companion.storage.batch import from_json
from companion.storage.database import ERRORS, TABLES, Damaged, Database, JournalError
from companion.storage.memory_rows import KEYS, OWNER_CONFIGURED, OWNER_IN_USE, read_memory

_log = logging.getLogger(__name__)

AGE = 86_400.0
"""Seconds after which the daily copy is made anew."""
_LOOKED_EVERY = 3600.0
LEAST_FREE = 64 << 20
"""Bytes that stay free on the disk beside the copy: for the journal itself."""
WITHIN = 10.0
"""Seconds that reading one file may take."""
_STEPS = 100
"""Steps of SQLite between two looks at the clock."""
_RECORDS = ("calls", "answers")


class Salvaged(NamedTuple):
    """What could be read of a file.

    memory: None where the row with its model is lost. words: whether those in force could be read; without
    them the configured ones count. state: of calls and settings. rows: table -> rows of calls, answers and
    the open call's frame.
    """

    memory: Memory | None = None
    words: bool = False
    state: Mapping[str, Any] | None = None
    rows: Mapping[str, Sequence[tuple[Any, ...]]] = {}

    @property
    def scenes(self) -> int:
        """How many scenes it has."""
        return len(self.memory.history) if self.memory is not None else 0


def salvage(path: Path, within: float = WITHIN) -> Salvaged:
    """Read what can be read of a file. Changes nothing there. Raises no error for whatever it holds."""
    if not path.is_file():
        return Salvaged()
    with closing(sqlite3.connect(":memory:")) as read:
        for name, columns in TABLES.items():
            read.execute(f"CREATE TABLE {name} ({columns})")
        try:
            with _opened(path, within) as damaged:
                lost = _copy(damaged, read)
        except ERRORS:
            return Salvaged()
        return _usable(read, lost)


def best(damaged: Salvaged, copy: Salvaged) -> tuple[Salvaged, bool]:
    """Return what goes on, and whether it is the copy.

    The damaged file counts, which is newer, unless it lacks words in force or has fewer scenes than the copy.
    Then the copy counts, and of the damaged file the scenes that are newer than it. No older one is taken
    from the other file: it may have been forgotten since.
    """
    newer, older = damaged.memory, copy.memory
    if older is None or (newer is not None and newer.model_id != older.model_id):
        return damaged, False
    if damaged.words and damaged.scenes >= copy.scenes:
        return damaged, False
    since = [one for one in newer.history if one.order > older.clock] if newer is not None else []
    history = History([*older.history, *since], older.history.limit)
    clock = max(older.clock, newer.clock if newer is not None else 0)
    return damaged._replace(memory=replace(older, history=history, clock=clock), words=copy.words), True


@contextmanager
def _opened(path: Path, within: float) -> Iterator[sqlite3.Connection]:
    """Open a file for reading alone, with its write-ahead log where it has one."""
    # Without a log SQLite would have to make one, unless it is told that nobody else writes.
    how = "mode=ro" if Path(f"{path}-wal").exists() else "mode=ro&immutable=1"
    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?{how}", uri=True)) as connection:
        until = time.monotonic() + within
        connection.set_progress_handler(lambda: time.monotonic() > until, _STEPS)
        connection.text_factory = _text
        yield connection


def _text(raw: bytes) -> str | None:
    try:
        return raw.decode()
    except UnicodeDecodeError:
        return None


def _copy(damaged: sqlite3.Connection, read: sqlite3.Connection) -> set[int]:
    """Copy all rows that can be read. Return the owners of which rows are lost."""
    lost = set[int]()
    for table in TABLES:
        names = [name for _, name, *_ in read.execute(f"PRAGMA table_info({table})")]
        rows, whole = _scanned(damaged, table, names)
        marks = ", ".join("?" * len(names))
        for row in rows:
            kept = read.execute(f"INSERT OR IGNORE INTO {table} VALUES ({marks})", row).rowcount
            whole = whole and kept > 0
        if not whole:
            lost |= _owners_lost(damaged, read, table)
    return lost


def _scanned(damaged: sqlite3.Connection, table: str, names: Sequence[str]) -> tuple[list[Any], bool]:
    """Read a table from both ends up to what is damaged. Return its rows, and whether they are all."""
    found: dict[int, tuple[Any, ...]] = {}
    whole = True
    for order, rises in (("ASC", True), ("DESC", False)):
        last: int | None = None
        query = f"SELECT rowid, {', '.join(names)} FROM {table} NOT INDEXED ORDER BY rowid {order}"
        try:
            for number, *values in damaged.execute(query):
                if number in found or (last is not None and (number > last) is not rises):
                    whole = False
                    break
                found[number], last = tuple(values), number
            else:
                break
        except ERRORS:
            whole = False
    return list(found.values()), whole


def _owners_lost(damaged: sqlite3.Connection, read: sqlite3.Connection, table: str) -> set[int]:
    """Return whose rows of a damaged table are lost, by its index; all, where that is damaged, too."""
    if table not in KEYS:
        return {OWNER_IN_USE} if table in ("settled", "adoption") else set()
    query = f"SELECT {', '.join(KEYS[table])} FROM {table}"
    try:
        known = set(damaged.execute(f"{query} INDEXED BY sqlite_autoindex_{table}_1"))
    except ERRORS:
        stamps = (stamp for (stamp,) in read.execute("SELECT stamp FROM entries"))
        return {OWNER_IN_USE, OWNER_CONFIGURED, *stamps}
    return {owner for owner, *_ in known - set(read.execute(query)) if isinstance(owner, int)}


def _usable(read: sqlite3.Connection, lost: set[int]) -> Salvaged:
    """Check what was read, and leave out what cannot be used."""

    def rows(query: str) -> list[tuple[Any, ...]]:
        return read.execute(query).fetchall()

    try:
        memory = read_memory(rows, lost)
    except Damaged:
        memory = None
    found = {table: rows(f"SELECT * FROM {table}") for table in (*_RECORDS, "frame")}
    kept = {table: [row for row in found[table] if from_json(row[-1]) is not None] for table in _RECORDS}
    kept["frame"] = [row for row in found["frame"] if isinstance(row[-1], bytes)]
    state = next((from_json(state) for (state,) in rows("SELECT state FROM supervision")), None)
    return Salvaged(memory, memory is not None and min(lost, default=0) >= 0, state, kept)


class DailyCopy:
    """One file, which is replaced as a whole. The thread that writes the journal makes it.

    A rover may boot without a clock: a copy from the future counts as old, and without any clock one is made
    after a day of running.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._outdated = False
        self._look_at = float("-inf")

    def outdated(self) -> None:
        """Have the copy replaced by the next `keep`: what was forgotten must not come back from it."""
        self._outdated, self._look_at = True, float("-inf")

    def date(self) -> str:
        """Return when the copy was made, local time, for a person."""
        try:
            return time.strftime("%Y-%m-%d %H:%M", time.localtime(self.path.stat().st_mtime))
        except OSError:
            return "an unknown time"

    def keep(self, database: Database) -> None:
        """Copy the journal where that is due and the disk has room. Raises JournalError."""
        now = time.monotonic()
        if now < self._look_at:
            return
        self._look_at = now + _LOOKED_EVERY
        try:
            if self._outdated:
                self.path.unlink(missing_ok=True)
            elif not self._is_old():
                return
            free = shutil.disk_usage(self.path.parent).free
            if free < database.size + LEAST_FREE:
                _log.warning("the journal is not copied: %d MB are free on its disk", free // 1_000_000)
                return
            database.copy_to(self.path)
        except OSError as error:
            raise JournalError(f"{self.path} cannot be written ({error.strerror}): check the disk") from error
        self._outdated = False

    def _is_old(self) -> bool:
        with suppress(FileNotFoundError):
            return not 0.0 <= time.time() - self.path.stat().st_mtime < AGE
        return True
