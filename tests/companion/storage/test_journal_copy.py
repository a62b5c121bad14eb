"""The memory is read from a copy of the journal: while a companion has it open, and without changing it."""

from __future__ import annotations

import os
import sqlite3
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.history import Place
from anytraverse.memory import Memory, first_memory
from anytraverse.preferences import Preferences
from companion.storage import Batch, Journal, JournalError, TableRow, journal_copy
from companion.storage.journal_copy import read_stored_calls, read_stored_memory
from companion.wire.call_report import CallReport
from companion.wire.ids import Outcome


def taught(memory: Memory, call_id: int) -> Memory:
    """One more scene, and as many words in force as there are scenes, up to ten."""
    words = Preferences.of({f"word {n}": 1.0 for n in range(min(10, call_id))})
    embedding = np.random.default_rng(call_id).random(64).astype(np.float32)
    return replace(memory, preferences=words).remembering(embedding, call_id, Place(), move=True)


def test_what_a_companion_that_runs_has_stored_is_read_and_its_files_stay_as_they_are(tmp_path: Path) -> None:
    journal = Journal(tmp_path)
    journal.commit(Batch(memory=taught(first_memory("m", Preferences()), 7)))
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert "journal.db-wal" in before
    found = read_stored_memory(tmp_path)
    assert found is not None
    assert [entry.call_id for entry in found.history] == [7]
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    journal.commit(Batch(memory=taught(found, 8)))
    journal.close()
    found = read_stored_memory(tmp_path)
    assert found is not None
    assert [entry.call_id for entry in found.history] == [7, 8]


@settings(max_examples=40, deadline=None)
@given(st.lists(st.integers(0, 3), max_size=20))
def test_a_journal_that_is_written_meanwhile_is_read_as_it_was_at_one_moment(
    tmp_path_factory: pytest.TempPathFactory, writes: list[int]
) -> None:
    folder = tmp_path_factory.mktemp("journal")
    journal = Journal(folder)
    memory = first_memory("m", Preferences(), history_limit=9)
    journal.commit(Batch(memory=memory))
    last = 0

    def write(count: int) -> None:
        """Store so many more scenes; 3: one more, and the log goes into the file."""
        nonlocal memory, last
        for _ in range(min(2, count)):
            last += 1
            memory = taught(memory, last)
            journal.commit(Batch(memory=memory))
        if count == 3:
            journal._database._connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()

    copy, left = journal_copy._copy, iter(writes)

    def copied(path: Path, to: Path | None, most: int) -> bytes:
        write(next(left, 0))
        return copy(path, to, most)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(journal_copy, "_copy", copied)
        patched.setattr(journal_copy, "_PAUSE", 0.0)
        try:
            found = read_stored_memory(folder)
        except JournalError as error:
            told = str(error)
            found = None
        else:
            told = ""
    journal.close()
    if found is None:
        assert told == f"{folder}/journal.db is being written: try again"
        assert writes.count(3) >= journal_copy._TRIES
        return
    calls = [entry.call_id for entry in found.history]
    newest = calls[-1] if calls else 0
    assert calls == list(range(max(1, newest - 8), newest + 1))
    assert len(found.preferences) == min(10, newest)
    assert newest <= last


def test_no_journal_is_no_memory_and_makes_none(tmp_path: Path) -> None:
    assert read_stored_memory(tmp_path / "none") is None
    assert list(tmp_path.iterdir()) == []


def test_a_damaged_journal_is_left_to_the_companion(tmp_path: Path) -> None:
    (tmp_path / "journal.db").write_bytes(b"")
    with pytest.raises(JournalError, match="is damaged: start the companion"):
        read_stored_memory(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["journal.db"]


def test_a_newer_journal_is_named_by_its_own_path(tmp_path: Path) -> None:
    Journal(tmp_path).close()
    with sqlite3.connect(tmp_path / "journal.db") as connection:
        connection.execute("PRAGMA user_version = 99")
    connection.close()
    with pytest.raises(JournalError, match=f"^{tmp_path}/journal.db was written by a newer companion"):
        read_stored_memory(tmp_path)


def test_a_journal_beyond_its_bound_is_not_copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Journal(tmp_path).close()
    monkeypatch.setattr(journal_copy, "LARGEST", 8192)
    with pytest.raises(JournalError, match="is larger than"):
        read_stored_memory(tmp_path)


@pytest.mark.parametrize("name", ["journal.db", "journal.db-wal"])
def test_a_named_pipe_in_the_place_of_the_journal_is_not_waited_for(tmp_path: Path, name: str) -> None:
    Journal(tmp_path).close()
    (tmp_path / name).unlink(missing_ok=True)
    os.mkfifo(tmp_path / name)
    with pytest.raises(JournalError, match="no regular file"):
        read_stored_memory(tmp_path)


def test_closed_calls_are_read_with_their_answers_while_a_companion_runs(tmp_path: Path) -> None:
    assert read_stored_calls(tmp_path) is None
    journal = Journal(tmp_path)
    assert read_stored_calls(tmp_path) == []
    closed = [
        TableRow.of_call(CallReport(number, outcome=Outcome.ANSWERED), 100.0 * number) for number in (7, 8)
    ]
    answer = TableRow.of_answer(7, {"motion": "go", "result": "applied"}, 650.0)
    damaged = TableRow("calls", "id, closed_at, outcome, record", (70_000, 1.0, "x", "{"))
    journal.commit(Batch(rows=(answer, *closed, damaged)))
    found = read_stored_calls(tmp_path)
    assert found is not None
    assert [(one.id, one.closed, one.outcome) for one in found] == [
        (7, 700.0, Outcome.ANSWERED),
        (8, 800.0, Outcome.ANSWERED),
    ]
    assert [(one.at, one.motion) for one in found[0].answers] == [(650.0, "go")]
    journal.close()
