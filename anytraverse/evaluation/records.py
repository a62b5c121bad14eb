"""Stores the tally of each judged frame, so that no frame is judged twice with the same words."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from anytraverse.evaluation.datasets import FrameFiles
from anytraverse.evaluation.labels import DatasetError
from anytraverse.evaluation.tally import DamagedTallyError, Tally
from anytraverse.preferences import Preferences

FILE = "records.sqlite"
MOST_WORDS = 64
"""How many sets of words are kept; beyond that the least recently used goes."""
_TABLES = """
BEGIN EXCLUSIVE;
CREATE TABLE IF NOT EXISTS run (settings TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS words (id INTEGER PRIMARY KEY, text TEXT NOT NULL UNIQUE, used INTEGER NOT NULL);
CREATE TABLE IF NOT EXISTS tallies
    (words INTEGER, name TEXT, stamp TEXT NOT NULL, tally BLOB NOT NULL, PRIMARY KEY (words, name));
COMMIT;
"""


class TallyStore:
    """Keeps tallies by words and frame in a file of SQLite, which survives a kill at any point.

    What else decides the maps is stored with them: a folder holds the tallies of one data set and one
    perceiver, and those of another are refused. A context manager.
    """

    def __init__(self, folder: Path, run: Mapping[str, Any], rows: int) -> None:
        """Open or make the records in `folder`.

        run: what the tallies depend on besides frame and words, JSON. rows: of a tally. Raises DatasetError
        when the folder holds another run's, when another program writes them, and when they are damaged; and
        OSError.
        """
        folder.mkdir(parents=True, exist_ok=True)
        self._file = folder / FILE
        self._rows = rows
        settings = json.dumps(dict(run), sort_keys=True)
        with self._refusals():
            self._connection = sqlite3.connect(self._file, timeout=0.5, isolation_level=None)
            try:
                self._execute("PRAGMA locking_mode=EXCLUSIVE")
                self._execute("PRAGMA synchronous=NORMAL")
                self._connection.executescript(_TABLES)
                found = self._execute("SELECT settings FROM run").fetchone()
                if found is None:
                    self._execute("INSERT INTO run VALUES (?)", settings)
                elif found[0] != settings:
                    raise DatasetError(self._other(json.loads(found[0]), json.loads(settings)))
            except BaseException:
                self._connection.close()
                raise

    def __enter__(self) -> TallyStore:
        return self

    def __exit__(self, *_: object) -> None:
        self._connection.close()

    def use(self, words: Preferences) -> int:
        """Return the key of a set of words; beyond `MOST_WORDS` the least recently used is forgotten."""
        text = json.dumps(dict(words), sort_keys=True)
        with self._refusals():
            (last,) = self._execute("SELECT COALESCE(MAX(used), 0) FROM words").fetchone()
            self._execute(
                "INSERT INTO words (text, used) VALUES (?, ?) ON CONFLICT (text) DO UPDATE SET used = ?",
                text,
                last + 1,
                last + 1,
            )
            (key,) = self._execute("SELECT id FROM words WHERE text = ?", text).fetchone()
            self._execute(
                "DELETE FROM words WHERE id NOT IN (SELECT id FROM words ORDER BY used DESC LIMIT ?)",
                MOST_WORDS,
            )
            self._execute("DELETE FROM tallies WHERE words NOT IN (SELECT id FROM words)")
        return int(key)

    def holds(self, words: int, name: str, files: FrameFiles) -> bool:
        """Return whether `get` returns a tally."""
        return self._find("1", words, name, files) is not None

    def get(self, words: int, name: str, files: FrameFiles) -> Tally | None:
        """Return the tally of a frame; None when there is none of the files as they are now.

        words: what `use` returned. Raises DatasetError.
        """
        with self._refusals():
            found = self._find("tally", words, name, files)
            return Tally.unpacked(found[0], self._rows) if found else None

    def add(self, words: int, name: str, files: FrameFiles, tally: Tally) -> None:
        """Store a tally; it is there after a kill. Raises DatasetError, e.g. when the disk is full."""
        with self._refusals():
            self._execute(
                "INSERT OR REPLACE INTO tallies VALUES (?, ?, ?, ?)",
                words,
                name,
                _stamp(files),
                tally.packed(),
            )

    def _find(self, column: str, words: int, name: str, files: FrameFiles) -> Any:
        where = "WHERE words = ? AND name = ? AND stamp = ?"
        with self._refusals():
            return self._execute(
                f"SELECT {column} FROM tallies {where}", words, name, _stamp(files)
            ).fetchone()

    def _execute(self, statement: str, *values: object) -> sqlite3.Cursor:
        return self._connection.execute(statement, values)

    @contextmanager
    def _refusals(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.OperationalError as error:
            if "locked" in str(error):
                raise DatasetError(
                    f"{self._file}: another run writes it: wait, or choose another --out"
                ) from error
            raise DatasetError(f"{self._file}: {error}: make room, or choose another --out") from error
        except (sqlite3.DatabaseError, DamagedTallyError, json.JSONDecodeError) as error:
            raise DatasetError(f"{self._file} is damaged ({error}): remove it, and run again") from error

    def _other(self, found: Mapping[str, Any], settings: Mapping[str, Any]) -> str:
        differing = sorted(key for key in {*found, *settings} if found.get(key) != settings.get(key))
        return (
            f"{self._file.parent} holds another run, with other {', '.join(differing)}: "
            f"choose another --out, or remove {self._file}"
        )


def _stamp(files: FrameFiles) -> str:
    """Return what changes when a frame's files change: their sizes and times of change."""
    states = (files.picture.stat(), files.label.stat())
    return " ".join(f"{state.st_size}:{state.st_mtime_ns}" for state in states)
