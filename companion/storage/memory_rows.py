"""Reads the algorithm's memory from the journal's rows, and writes the rows that changed."""

from __future__ import annotations

import math
import sqlite3
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from anytraverse.history import MAX_REFUSED, Embedding, Entry, History, Place
from anytraverse.memory import MOST_GIVEN, Adoption, Memory
from anytraverse.perception import Example
from anytraverse.preferences import Preferences, Setting, check_weight, clean_word
from companion.storage.database import Damaged

OWNER_IN_USE = -1
OWNER_CONFIGURED = -2
OWNER_BEFORE_MATCH = -3
OWNER_GIVEN = -4
"""`owner` of rows with words: words in use, configured words, words in use before the newest match, and words
that an operator gave and that are out of use. The owner of a scene's words is its stamp, 0 or more."""

Examples = Mapping[str, tuple[Example, ...]]
Query = Callable[[str], list[tuple[Any, ...]]]

_FLOATS = np.dtype("<f4")

KEYS = {
    "words": ("owner", "position"),
    "examples": ("owner", "word", "position"),
    "refused": ("stamp", "position"),
}
"""Tables with the rows of owners -> their keys, the owner first."""
_OF_ENTRIES = (("entries", "stamp"), ("words", "owner"), ("examples", "owner"), ("refused", "stamp"))
"""Tables with rows of entries, and the column of the entry's stamp."""
_UNUSABLE = (ValueError, TypeError, LookupError)
"""What a row leads to that cannot be used."""


def read_memory(rows: Query, lost: set[int] | None = None) -> Memory | None:
    """Read the memory; None when none was ever stored. Raises Damaged.

    lost: owners of rows that are lost. They are left out and, added to it, those of rows that cannot be used:
    scenes by their stamp; words in force by OWNER_IN_USE, then the configured ones are. None: such a row
    raises Damaged.
    """
    try:
        found = rows("SELECT model_id, clock, scenes, reference FROM memory")
        if not found:
            return None
        ((model_id, clock, scenes, reference),) = found
        words, examples, refused = _read_words(rows), _read_examples(rows, lost), _read_refused(rows, lost)
        entries = []
        for stamp, matched, call_id, embedding, surroundings, *place in rows(
            "SELECT stamp, matched, call_id, embedding, surroundings,"
            " latitude, longitude, heading, time, roll, pitch, yaw FROM entries"
        ):
            if lost is not None and stamp in lost:
                continue
            with _tolerated(lost, stamp):
                entry = Entry(
                    embedding=_vector(embedding),
                    preferences=Preferences(words.get(stamp)),
                    order=stamp,
                    matched=_whole(matched),
                    call_id=_whole(call_id),
                    examples=examples.get(stamp, {}),
                    place=_place(*place),
                    refused=tuple(refused.get(stamp, ())),
                    surroundings=None if surroundings is None else _vector(surroundings),
                )
                entries.append(entry)
        memory = Memory(model_id=model_id, history=History(entries, scenes), clock=_whole(clock))
        with _tolerated(lost, OWNER_CONFIGURED):
            configured = Preferences(words.get(OWNER_CONFIGURED))
            if lost is None or OWNER_CONFIGURED not in lost:
                memory = replace(memory, preferences=configured, configured=configured)
        with _tolerated(lost, OWNER_IN_USE):
            in_force = replace(
                memory,
                preferences=Preferences(words.get(OWNER_IN_USE)),
                examples=examples.get(OWNER_IN_USE, {}),
                settled=dict(rows("SELECT word, stamp FROM settled")),
                given=_given(words.get(OWNER_GIVEN, {})),
                reference=None if reference is None else _vector(reference),
                adoption=_read_adoption(
                    rows, Preferences(words.get(OWNER_BEFORE_MATCH)), examples.get(OWNER_BEFORE_MATCH, {})
                ),
            )
        return in_force if lost is None or min(lost, default=0) >= 0 else memory
    except _UNUSABLE as error:
        raise Damaged(f"the memory cannot be read: {error}") from error


@contextmanager
def _tolerated(lost: set[int] | None, owner: int | None) -> Iterator[None]:
    """Add the owner of a row that cannot be used to `lost`. Without that set the error goes on."""
    try:
        yield
    except _UNUSABLE:
        if lost is None:
            raise
        lost |= {owner} if owner is not None else set()


def write_memory(connection: sqlite3.Connection, memory: Memory, stored: Memory | None) -> None:
    """Write the rows in which `memory` differs from `stored`, what they hold now. None: replace all rows."""
    reference = None if memory.reference is None else _blob(memory.reference)
    connection.execute(
        "REPLACE INTO memory VALUES (1, ?, ?, ?, ?)",
        (memory.model_id, memory.clock, memory.history.limit, reference),
    )
    if stored is None:
        for table in ("entries", "words", "examples", "settled", "refused", "adoption"):
            connection.execute(f"DELETE FROM {table}")
    _write_words(connection, OWNER_IN_USE, memory.preferences, stored.preferences if stored else None)
    _write_words(connection, OWNER_CONFIGURED, memory.configured, stored.configured if stored else None)
    if stored is None or list(memory.given.items()) != list(stored.given.items()):
        given = {word: Setting(weight) for word, weight in memory.given.items()}
        _replace_words(connection, OWNER_GIVEN, given)
    _write_examples(connection, OWNER_IN_USE, memory.examples, stored.examples if stored else None)
    if stored is None or memory.settled != stored.settled:
        connection.execute("DELETE FROM settled")
        connection.executemany("INSERT INTO settled VALUES (?, ?)", memory.settled.items())
    if stored is None or memory.adoption is not stored.adoption:
        _write_adoption(connection, memory.adoption)
    before = {entry.order: entry for entry in stored.history} if stored is not None else {}
    after = {entry.order: entry for entry in memory.history}
    # Compared by identity: entries are never changed, only replaced.
    for stamp, old in before.items():
        if after.get(stamp) is not old:
            for table, column in _OF_ENTRIES:
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


def _given(words: Mapping[str, Setting]) -> dict[str, float]:
    if len(words) > MOST_GIVEN:
        raise ValueError(f"more than {MOST_GIVEN} words were given")
    return {clean_word(word): check_weight(word, setting.weight) for word, setting in words.items()}


def _read_examples(rows: Query, lost: set[int] | None) -> dict[int, dict[str, tuple[Example, ...]]]:
    vectors = dict[int, Example]()
    for number, model_id, vector in rows("SELECT id, model_id, vector FROM vectors"):
        with _tolerated(lost, None):  # whoever has it is lost
            vectors[number] = Example(model_id, _vector(vector))
    examples: dict[int, dict[str, tuple[Example, ...]]] = defaultdict(dict)
    for owner, word, number in rows(
        "SELECT owner, word, vector FROM examples ORDER BY owner, word, position"
    ):
        with _tolerated(lost, owner):
            examples[owner][word] = (*examples[owner].get(word, ()), vectors[number])
    return examples


def _read_refused(rows: Query, lost: set[int] | None) -> dict[int, list[Embedding]]:
    refused: dict[int, list[Embedding]] = defaultdict(list)
    for stamp, embedding in rows("SELECT stamp, embedding FROM refused ORDER BY stamp, position"):
        with _tolerated(lost, stamp):
            refused[stamp].append(_vector(embedding))
            if len(refused[stamp]) > MAX_REFUSED:
                raise ValueError(f"scene {stamp} has more than {MAX_REFUSED} refused frames")
    return refused


def _read_adoption(rows: Query, words: Preferences, examples: Examples) -> Adoption | None:
    found = rows("SELECT stamp, call_id, similarity, clock, embedding, reference, time FROM adoption")
    if not found:
        return None
    ((stamp, call_id, similarity, clock, embedding, reference, time),) = found
    if not all(isinstance(one, int) for one in (stamp, call_id, clock)) or not -1.0 <= similarity <= 1.0:
        raise ValueError("the newest match is out of range")
    if time is not None and not math.isfinite(time):
        raise ValueError("the time of the newest match is not finite")
    before = None if reference is None else _vector(reference)
    return Adoption(stamp, call_id, similarity, clock, _vector(embedding), words, examples, before, time)


def _write_adoption(connection: sqlite3.Connection, one: Adoption | None) -> None:
    connection.execute("DELETE FROM adoption")
    _write_words(connection, OWNER_BEFORE_MATCH, one.preferences if one else Preferences())
    _write_examples(connection, OWNER_BEFORE_MATCH, one.examples if one else {})
    if one is not None:
        reference = None if one.reference is None else _blob(one.reference)
        figures = (
            one.order,
            one.call_id,
            one.similarity,
            one.clock,
            _blob(one.embedding),
            reference,
            one.time,
        )
        connection.execute("INSERT INTO adoption VALUES (1, ?, ?, ?, ?, ?, ?, ?)", figures)


def _write_words(
    connection: sqlite3.Connection, owner: int, words: Preferences, stored: Preferences | None = None
) -> None:
    if stored is None or list(words.settings.items()) != list(stored.settings.items()):
        _replace_words(connection, owner, words.settings)


def _replace_words(connection: sqlite3.Connection, owner: int, words: Mapping[str, Setting]) -> None:
    rows = [
        (owner, position, word, setting.weight, setting.order)
        for position, (word, setting) in enumerate(words.items())
    ]
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
        "INSERT INTO entries VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
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
            None if entry.surroundings is None else _blob(entry.surroundings),
        ),
    )
    _write_words(connection, entry.order, entry.preferences)
    _write_examples(connection, entry.order, entry.examples)
    connection.executemany(
        "INSERT INTO refused VALUES (?, ?, ?)",
        [(entry.order, position, _blob(one)) for position, one in enumerate(entry.refused)],
    )


def _whole(number: object) -> int:
    if not isinstance(number, int):
        raise TypeError(f"{number!r} is no whole number")
    return number


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
