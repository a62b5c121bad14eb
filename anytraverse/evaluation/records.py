"""Stores the tally of each judged frame, so that a run that was killed goes on where it was."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from anytraverse.evaluation.datasets import Files
from anytraverse.evaluation.labels import DatasetError
from anytraverse.evaluation.tally import DamagedTallyError, Tally

FILE = "records.sqlite"
_TABLES = """
CREATE TABLE IF NOT EXISTS run (settings TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS frames
    (name TEXT PRIMARY KEY, stamp TEXT NOT NULL, milliseconds REAL NOT NULL, tally BLOB NOT NULL);
"""


class Records:
    """Keeps tallies by frame in a file of SQLite, which survives a kill at any point. A context manager.

    What decides the maps is stored with them: a folder holds one run, and another one is refused.
    """

    def __init__(self, folder: Path, run: Mapping[str, Any], rows: int) -> None:
        """Open or make the records in `folder`.

        run: what the tallies depend on, JSON. rows: of a tally. Raises DatasetError when the folder holds
        another run's, when another program writes them, and when they are damaged; and OSError.
        """
        folder.mkdir(parents=True, exist_ok=True)
        self._file = folder / FILE
        self._rows = rows
        settings = json.dumps(dict(run), sort_keys=True)
        with self._refusals():
            self._connection = sqlite3.connect(self._file, timeout=0.5, isolation_level=None)
            try:
                self._connection.execute("PRAGMA locking_mode=EXCLUSIVE")
                self._connection.execute("PRAGMA synchronous=NORMAL")
                self._connection.executescript(f"BEGIN EXCLUSIVE;{_TABLES}COMMIT;")
                found = self._connection.execute("SELECT settings FROM run").fetchone()
                if found is None:
                    self._connection.execute("INSERT INTO run VALUES (?)", (settings,))
                elif found[0] != settings:
                    raise DatasetError(self._other(json.loads(found[0]), json.loads(settings)))
            except BaseException:
                self._connection.close()
                raise

    def __enter__(self) -> Records:
        return self

    def __exit__(self, *_: object) -> None:
        self._connection.close()

    def get(self, name: str, files: Files) -> Tally | None:
        """Return the tally of a frame; None when there is none of the files as they are now."""
        with self._refusals():
            found = self._connection.execute(
                "SELECT tally, milliseconds FROM frames WHERE name = ? AND stamp = ?", (name, _stamp(files))
            ).fetchone()
            return Tally.unpacked(found[0], found[1], self._rows) if found else None

    def holds(self, name: str, files: Files) -> bool:
        """Return whether `get` returns a tally."""
        with self._refusals():
            found = self._connection.execute(
                "SELECT 1 FROM frames WHERE name = ? AND stamp = ?", (name, _stamp(files))
            ).fetchone()
        return found is not None

    def add(self, name: str, files: Files, tally: Tally) -> None:
        """Store a tally; it is there after a kill. Raises DatasetError, e.g. when the disk is full."""
        with self._refusals():
            self._connection.execute(
                "INSERT OR REPLACE INTO frames VALUES (?, ?, ?, ?)",
                (name, _stamp(files), tally.milliseconds, tally.packed()),
            )

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


def _stamp(files: Files) -> str:
    """Return what changes when a frame's files change: their sizes and times of change."""
    states = (files.picture.stat(), files.label.stat())
    return " ".join(f"{state.st_size}:{state.st_mtime_ns}" for state in states)
