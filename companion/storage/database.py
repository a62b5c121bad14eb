"""Opens, checks and writes the SQLite file, in transactions that survive kill -9 and a loss of power."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from companion.system.atomic_write import sync_folder


class JournalError(Exception):
    """The journal cannot be opened or written. What it holds stays. The text says what to do."""


class Damaged(JournalError):  # noqa: N818
    """The file's content is damaged, so that it cannot be read as a journal."""


VERSION = 5
_APPLICATION_ID = 0x41547251
"""SQLite's application_id, by which a journal is told from another program's file."""
_CACHE = 256
"""KiB of pages that SQLite keeps in memory. Its 2 MB by default fill as calls accumulate, over hours."""
_PAGE = 4096
_WAIT = 1.0
ERRORS = (sqlite3.Error, UnicodeDecodeError)
"""UnicodeDecodeError: SQLite's message about a damaged file may quote bytes that are not UTF-8."""
_DAMAGE_TEXTS = ("no such column", "Could not decode")
"""Beginnings of messages by which SQLite reports a damaged file as another error."""

_REFUSED = (
    "stamp INTEGER NOT NULL, position INTEGER NOT NULL, embedding BLOB NOT NULL,"
    " PRIMARY KEY (stamp, position)"
)
_ADOPTION = (
    "only INTEGER PRIMARY KEY CHECK (only = 1), stamp INTEGER NOT NULL, call_id INTEGER NOT NULL,"
    " similarity REAL NOT NULL, clock INTEGER NOT NULL, embedding BLOB NOT NULL, reference BLOB, time REAL"
)
_GIVEN = (
    "INSERT INTO words SELECT -4, ROW_NUMBER() OVER (ORDER BY newest DESC), word, weight, newest"
    " FROM (SELECT word, weight, MAX(stamp) AS newest FROM words"
    " WHERE word NOT IN (SELECT word FROM words WHERE owner = -1) GROUP BY word)"
    " ORDER BY newest DESC LIMIT 256"
)
"""Counts the words of scenes, of the configuration and of before the newest match as given. The numbers are
OWNER_GIVEN, OWNER_IN_USE and MOST_GIVEN of this version."""
_FRAME = "only INTEGER PRIMARY KEY CHECK (only = 1), frame_id INTEGER NOT NULL, png BLOB NOT NULL"
TABLES = {
    "memory": "only INTEGER PRIMARY KEY CHECK (only = 1), model_id TEXT NOT NULL, clock INTEGER NOT NULL,"
    " scenes INTEGER NOT NULL, reference BLOB",
    "entries": "stamp INTEGER PRIMARY KEY, matched INTEGER NOT NULL, call_id INTEGER NOT NULL,"
    " embedding BLOB NOT NULL, latitude REAL, longitude REAL, heading REAL, time REAL,"
    " roll REAL, pitch REAL, yaw REAL, surroundings BLOB",
    "words": "owner INTEGER NOT NULL, position INTEGER NOT NULL, word TEXT NOT NULL, weight REAL NOT NULL,"
    " stamp INTEGER NOT NULL, PRIMARY KEY (owner, position)",
    "vectors": "id INTEGER PRIMARY KEY, model_id TEXT NOT NULL, vector BLOB NOT NULL,"
    " UNIQUE (model_id, vector)",
    "examples": "owner INTEGER NOT NULL, word TEXT NOT NULL, position INTEGER NOT NULL,"
    " vector INTEGER NOT NULL REFERENCES vectors, PRIMARY KEY (owner, word, position)",
    "settled": "word TEXT PRIMARY KEY, stamp INTEGER NOT NULL",
    "supervision": "only INTEGER PRIMARY KEY CHECK (only = 1), state TEXT NOT NULL",
    "calls": "number INTEGER PRIMARY KEY, id INTEGER NOT NULL, closed_at REAL NOT NULL,"
    " outcome TEXT NOT NULL, record TEXT NOT NULL",
    "answers": "number INTEGER PRIMARY KEY, call_id INTEGER NOT NULL, answered_at REAL NOT NULL,"
    " record TEXT NOT NULL",
    "frame": _FRAME,
    "refused": _REFUSED,
    "adoption": _ADOPTION,
}
"""Table -> its columns. `owner` of words and examples: an entry's stamp, or an OWNER_ of `memory_rows`.
refused: frames that are another place than the entry of that stamp. adoption: the newest match.
"""
FRAME_SINCE = 3
"""The first version whose file contains the frame of the open call."""
_UPGRADES = {
    2: tuple(f"ALTER TABLE entries ADD COLUMN {name} REAL" for name in ("roll", "pitch", "yaw")),
    FRAME_SINCE: (f"CREATE TABLE frame ({_FRAME})",),
    4: (f"CREATE TABLE refused ({_REFUSED})", f"CREATE TABLE adoption ({_ADOPTION})"),
    5: ("ALTER TABLE entries ADD COLUMN surroundings BLOB", _GIVEN),
}
"""Version -> the statements that upgrade a file of the version before."""
_NEW_TABLES = {"frame", "refused", "adoption"}
"""Tables that a file of an older version may lack."""
_LONGEST_LOG = 4 << 20
"""Bytes of the write-ahead log from which on `tidy` copies it into the file."""


class Database:
    """Reads and writes one SQLite file. Used by one thread at a time.

    A second process cannot open the file: two daemons must not steer one rover.
    found_version: the file's version before it was opened, 0: a new file.
    Raises JournalError when the file cannot be opened, Damaged when its content is damaged.
    """

    def __init__(self, path: Path, largest: int) -> None:
        """largest: bytes that the file may grow to. Beyond that, writing fails as on a full disk."""
        self.path = path
        try:
            self._was_empty = path.is_file() and path.stat().st_size == 0
            self._connection = sqlite3.connect(
                path, timeout=_WAIT, isolation_level=None, check_same_thread=False
            )
        except (OSError, sqlite3.Error) as error:
            raise JournalError(
                f"{path} cannot be opened ({error}): check that the folder is writable"
            ) from error
        try:
            self._open(largest)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the file. May be called more than once."""
        with suppress(sqlite3.Error):
            self._connection.close()

    @contextmanager
    def writing(self) -> Iterator[sqlite3.Connection]:
        """Run the block as one transaction, which is on disk when the block is left.

        Raises JournalError; then nothing has changed.
        """
        try:
            self._connection.execute("BEGIN IMMEDIATE")
            try:
                yield self._connection
                self._connection.execute("COMMIT")
            except BaseException:
                with suppress(sqlite3.Error):
                    self._connection.execute("ROLLBACK")
                raise
        except ERRORS as error:
            raise self._as_journal_error(error) from error

    def tidy(self) -> None:
        """Copy the write-ahead log into the file, if the log has grown long. Raises JournalError.

        SQLite would do so within a commit, whose caller would wait for it.
        """
        try:
            if os.stat(f"{self.path}-wal").st_size >= _LONGEST_LOG:
                self._connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
        except OSError as error:
            raise JournalError(f"{self.path}-wal cannot be read: {error}") from error
        except ERRORS as error:
            raise self._as_journal_error(error) from error

    def copy_to(self, target: Path) -> None:
        """Write all that is committed into one file, which replaces `target` once it is on disk.

        Raises OSError, JournalError.
        """
        partial = target.with_name(f".{target.name}.part")
        partial.unlink(missing_ok=True)
        try:
            self.rows("VACUUM INTO ?", str(partial))
            with partial.open("rb") as file:
                os.fsync(file.fileno())
            os.replace(partial, target)
        except BaseException:
            with suppress(OSError):
                partial.unlink(missing_ok=True)
            raise
        sync_folder(target.parent)

    @property
    def size(self) -> int:
        """The bytes of the file with all that is committed."""
        ((size,),) = self.rows("SELECT page_count * page_size FROM pragma_page_count, pragma_page_size")
        return int(size)

    def rows(self, query: str, *values: object) -> list[tuple[Any, ...]]:
        """Run a query and return its rows. Raises JournalError, Damaged."""
        try:
            return self._connection.execute(query, values).fetchall()
        except ERRORS as error:
            raise self._as_journal_error(error) from error

    def _open(self, largest: int) -> None:
        try:
            self._set_up(largest)
        except ERRORS as error:
            raise self._as_journal_error(error) from error

    def _set_up(self, largest: int) -> None:
        execute = self._connection.execute
        for pragma in (
            f"page_size = {_PAGE}",
            "locking_mode = EXCLUSIVE",  # keeps a second companion out
            "journal_mode = WAL",
            "synchronous = FULL",  # else a commit may be lost with the power
            "wal_autocheckpoint = 0",  # `tidy` does it
            f"cache_size = -{_CACHE}",
            "foreign_keys = ON",
            f"max_page_count = {max(1, largest // _PAGE)}",
        ):
            execute(f"PRAGMA {pragma}").fetchall()
        (ours,), (version,) = (
            execute(f"PRAGMA {name}").fetchone() for name in ("application_id", "user_version")
        )
        self.found_version = int(version)
        found = {name for (name,) in execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        # An empty file is a journal that lost its content. No other process is about to fill it, since this
        # one holds the lock by now.
        if self._was_empty:
            raise Damaged("the file is empty")
        if not found and version == 0:
            self._create()
            return
        if ours != _APPLICATION_ID:
            raise JournalError(
                f"{self.path} belongs to another program: move it away, or choose another folder"
            )
        if version > VERSION:
            raise JournalError(
                f"{self.path} was written by a newer companion (its version {version}, ours {VERSION}): "
                "install that one again, or move the file away to begin afresh"
            )
        wanted = TABLES.keys() - (_NEW_TABLES if version < VERSION else set())
        if not found >= wanted:
            raise Damaged(f"tables are missing: {', '.join(sorted(wanted - found))}")
        conflicts = [text for (text,) in execute("PRAGMA quick_check(1)")]
        if conflicts != ["ok"]:
            raise Damaged(str(conflicts[0]))
        if version < VERSION:
            self._upgrade_from(version)

    def _create(self) -> None:
        with self.writing() as connection:
            for name, columns in TABLES.items():
                connection.execute(f"CREATE TABLE {name} ({columns})")
            connection.execute(f"PRAGMA application_id = {_APPLICATION_ID}")
            connection.execute(f"PRAGMA user_version = {VERSION}")

    def _upgrade_from(self, version: int) -> None:
        self._back_up(version)
        with self.writing() as connection:
            for newer in range(version + 1, VERSION + 1):
                for statement in _UPGRADES.get(newer, ()):
                    connection.execute(statement)
            connection.execute(f"PRAGMA user_version = {VERSION}")

    def _back_up(self, version: int) -> None:
        """Copy the file to `journal.version-N.db` beside it, before its version N is upgraded."""
        try:
            self.copy_to(self.path.with_name(f"{self.path.stem}.version-{version}.db"))
        except (OSError, JournalError) as error:
            raise JournalError(
                f"{self.path} is of an older version, and no copy of it can be made before it is upgraded "
                f"({error}): make room on the disk"
            ) from error

    def _as_journal_error(self, error: sqlite3.Error | UnicodeDecodeError) -> JournalError:
        # For damage SQLite raises DatabaseError itself, for all other errors a subclass of it.
        torn = type(error) in (sqlite3.DatabaseError, UnicodeDecodeError)
        if torn or str(error).startswith(_DAMAGE_TEXTS):
            return Damaged(f"{error}: start again, which sets it aside")
        if "locked" in str(error):
            return JournalError(f"{self.path} is in use: another companion runs here; stop it first")
        if "full" in str(error):
            return JournalError(f"{self.path} cannot be written ({error}): make room on the disk")
        return JournalError(f"{self.path} cannot be used ({error}): check the disk and who may write there")
