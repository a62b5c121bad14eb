"""Reads the algorithm's memory from the journal's rows, and writes the rows that changed."""

from __future__ import annotations

import sqlite3
from collections import defaultdict
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from anytraverse.history import Embedding, Entry, History, Place
from anytraverse.memory import Memory
from anytraverse.perception import Example
from anytraverse.preferences import Preferences, Setting
from companion.storage.database import Damaged

OWNER_IN_USE = -1
OWNER_CONFIGURED = -2
"""`owner` of the words in use and of the configured words; a remembered scene's is its stamp, 0 or more."""

Examples = Mapping[str, tuple[Example, ...]]
Query = Callable[[str], list[tuple[Any, ...]]]

_FLOATS = np.dtype("<f4")


def read_memory(rows: Query) -> Memory | None:
    """Read the memory; None when none was ever stored. Raises Damaged."""
    try:
        found = rows("SELECT model_id, clock, scenes, reference FROM memory")
        if not found:
            return None
        ((model_id, clock, scenes, reference),) = found
        words, examples = _read_words(rows), _read_examples(rows)
        entries = [
            Entry(
                embedding=_vector(embedding),
                preferences=Preferences(words.get(stamp)),
                order=stamp,
                matched=matched,
                call_id=call_id,
                examples=examples.get(stamp, {}),
                place=_place(*place),
            )
            for stamp, matched, call_id, embedding, *place in rows(
                "SELECT stamp, matched, call_id, embedding,"
                " latitude, longitude, heading, time, roll, pitch, yaw FROM entries"
            )
        ]
        return Memory(
            model_id=model_id,
            preferences=Preferences(words.get(OWNER_IN_USE)),
            configured=Preferences(words.get(OWNER_CONFIGURED)),
            examples=examples.get(OWNER_IN_USE, {}),
            settled=dict(rows("SELECT word, stamp FROM settled")),
            reference=None if reference is None else _vector(reference),
            history=History(entries, scenes),
            clock=clock,
        )
    except (ValueError, TypeError, LookupError) as error:
        raise Damaged(f"the memory cannot be read: {error}") from error


def write_memory(connection: sqlite3.Connection, memory: Memory, stored: Memory | None) -> None:
    """Write the rows in which `memory` differs from `stored`, what they hold now. None: replace all rows."""
    reference = None if memory.reference is None else _blob(memory.reference)
    connection.execute(
        "REPLACE INTO memory VALUES (1, ?, ?, ?, ?)",
        (memory.model_id, memory.clock, memory.history.limit, reference),
    )
    if stored is None:
        for table in ("entries", "words", "examples", "settled"):
            connection.execute(f"DELETE FROM {table}")
    _write_words(connection, OWNER_IN_USE, memory.preferences, stored.preferences if stored else None)
    _write_words(connection, OWNER_CONFIGURED, memory.configured, stored.configured if stored else None)
    _write_examples(connection, OWNER_IN_USE, memory.examples, stored.examples if stored else None)
    if stored is None or memory.settled != stored.settled:
        connection.execute("DELETE FROM settled")
        connection.executemany("INSERT INTO settled VALUES (?, ?)", memory.settled.items())
    before = {entry.order: entry for entry in stored.history} if stored is not None else {}
    after = {entry.order: entry for entry in memory.history}
    # Compared by identity: entries are never changed, only replaced.
    for stamp, old in before.items():
        if after.get(stamp) is not old:
            for table, column in (("entries", "stamp"), ("words", "owner"), ("examples", "owner")):
                connection.execute(f"DELETE FROM {table} WHERE {column} = ?", (stamp,))
    for stamp, entry in after.items():
        if before.get(stamp) is not entry:
            _write_entry(connection, entry)
    connection.execute("DELETE FROM vectors WHERE id NOT IN (SELECT vector FROM examples)")


def _read_words(rows: Query) -> dict[int, dict[str, Setting]]:
    words: dict[int, dict[str, Setting]] = defaultdict(dict)
    for owner, word, weight, stamp in rows(
        "SELECT owner, word, weight, stamp FROM words ORDER BY owner, position"
    ):
        words[owner][word] = Setting(weight, stamp)
    return words


def _read_examples(rows: Query) -> dict[int, dict[str, tuple[Example, ...]]]:
    vectors = {
        number: Example(model_id, _vector(vector))
        for number, model_id, vector in rows("SELECT id, model_id, vector FROM vectors")
    }
    examples: dict[int, dict[str, tuple[Example, ...]]] = defaultdict(dict)
    for owner, word, number in rows(
        "SELECT owner, word, vector FROM examples ORDER BY owner, word, position"
    ):
        examples[owner][word] = (*examples[owner].get(word, ()), vectors[number])
    return examples


def _write_words(
    connection: sqlite3.Connection, owner: int, words: Preferences, stored: Preferences | None = None
) -> None:
    rows = [
        (owner, position, word, setting.weight, setting.order)
        for position, (word, setting) in enumerate(words.settings.items())
    ]
    if stored is None or list(words.settings.items()) != list(stored.settings.items()):
        connection.execute("DELETE FROM words WHERE owner = ?", (owner,))
        connection.executemany("INSERT INTO words VALUES (?, ?, ?, ?, ?)", rows)


def _write_examples(
    connection: sqlite3.Connection, owner: int, examples: Examples, stored: Examples | None = None
) -> None:
    if stored is not None and dict(examples) == dict(stored):
        return
    connection.execute("DELETE FROM examples WHERE owner = ?", (owner,))
    for word, of_word in examples.items():
        for position, example in enumerate(of_word):
            vector = (example.model_id, _blob(example.vector))
            connection.execute("INSERT OR IGNORE INTO vectors (model_id, vector) VALUES (?, ?)", vector)
            connection.execute(
                "INSERT INTO examples SELECT ?, ?, ?, id FROM vectors WHERE model_id = ? AND vector = ?",
                (owner, word, position, *vector),
            )


def _write_entry(connection: sqlite3.Connection, entry: Entry) -> None:
    place = entry.place
    connection.execute(
        "INSERT INTO entries VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        (
            entry.order,
            entry.matched,
            entry.call_id,
            _blob(entry.embedding),
            place.latitude,
            place.longitude,
            place.heading,
            place.time,
            *(place.attitude or (None, None, None)),
        ),
    )
    _write_words(connection, entry.order, entry.preferences)
    _write_examples(connection, entry.order, entry.examples)


def _place(
    latitude: float | None, longitude: float | None, heading: float | None, time: float | None, *angles: float
) -> Place:
    return Place(
        latitude, longitude, heading, time, None if None in angles else (angles[0], angles[1], angles[2])
    )


def _blob(vector: Embedding) -> bytes:
    return np.ascontiguousarray(vector, _FLOATS).tobytes()


def _vector(blob: bytes) -> Embedding:
    vector = np.frombuffer(blob, _FLOATS).astype(np.float32)
    if vector.size == 0 or not np.isfinite(vector).all():
        raise ValueError("a vector is empty or not finite")
    return vector
