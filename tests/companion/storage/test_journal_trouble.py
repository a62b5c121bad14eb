"""Killed, full, torn, foreign, newer, taken: what the journal does in trouble."""

from __future__ import annotations

import json
import logging
import os
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anytraverse.history import Place
from anytraverse.memory import Memory, first_memory
from anytraverse.preferences import Preferences
from companion.storage import Batch, Journal, JournalError
from companion.storage.batch import as_json
from companion.storage.database import VERSION

_WRITER = """
import sys, pathlib, numpy as np
from anytraverse.history import Place
from anytraverse.memory import first_memory
from anytraverse.preferences import Preferences
from companion.storage import Batch, Journal
from companion.storage.batch import as_json
journal = Journal(pathlib.Path(sys.argv[1]))
memory = first_memory("m", Preferences.of({"grass": 1.0}))
number = 0
while True:
    number += 1
    memory = memory.remembering(np.full(16, number, np.float32), number, Place(), move=True)
    journal.commit(Batch(memory=memory))
    print("memory", memory.clock, flush=True)
    journal.commit(Batch(state=as_json({"last_id": number})))
    print("last_id", number, flush=True)
"""


def _memory(clock: int = 1) -> Memory:
    return replace(first_memory("m", Preferences.of({"grass": 1.0})), clock=clock)


def _begin(folder: Path) -> None:
    journal = Journal(folder)
    journal.commit(Batch(memory=_memory().remembering(np.ones(4, np.float32), 1, Place(), move=True)))
    journal.commit(Batch(state=as_json({"last_id": 5})))
    journal.close()


def _edit(folder: Path, *statements: str) -> None:
    connection = sqlite3.connect(folder / "journal.db", isolation_level=None)
    for statement in statements:
        connection.execute(statement)
    connection.close()


@pytest.mark.slow
@pytest.mark.parametrize("lines", [1, 2, 37, 80])
def test_what_was_reported_as_kept_is_there_after_kill_9(tmp_path: Path, lines: int) -> None:
    writer = subprocess.Popen(
        [sys.executable, "-c", _WRITER, str(tmp_path)], stdout=subprocess.PIPE, text=True, bufsize=1
    )
    assert writer.stdout is not None
    said = {"memory": 0, "last_id": 0}
    for _ in range(lines):
        name, number = writer.stdout.readline().split()
        said[name] = int(number)
    writer.send_signal(signal.SIGKILL)
    for line in writer.stdout:
        if line.endswith("\n"):
            name, number = line.split()
            said[name] = int(number)
    writer.wait(10)
    journal = Journal(tmp_path)
    memory, state = journal.load_memory(), journal.load_supervision() or {"last_id": 0}
    journal.close()
    assert journal.recovered_from is None
    assert memory is not None
    assert said["memory"] <= memory.clock <= said["memory"] + 1
    assert len(memory.history) == min(memory.clock, memory.history.limit)
    assert memory.reference is not None
    assert memory.reference[0] == memory.clock
    assert said["last_id"] <= state["last_id"] <= said["last_id"] + 1


def test_a_full_disk_is_said_and_the_last_state_stays(tmp_path: Path) -> None:
    _begin(tmp_path)
    journal = Journal(tmp_path, largest=(tmp_path / "journal.db").stat().st_size)
    kept = journal.load_memory()
    assert kept is not None
    memory = kept
    with pytest.raises(JournalError, match=r"full.*make room"):  # noqa: PT012
        for number in range(200):
            memory = kept.remembering(np.full(4000, number, np.float32), 2, Place(), move=True)
            journal.commit(Batch(memory=memory))
    survivor = journal.load_memory()
    assert survivor is not memory
    assert survivor is not None
    journal.commit(Batch(state=as_json({"last_id": 6})))
    journal.close()
    again = Journal(tmp_path)
    found = again.load_memory()
    assert found is not None
    assert found.clock == survivor.clock
    assert again.load_supervision() == {"last_id": 6}
    again.commit(Batch(memory=memory))
    again.close()


def test_after_a_failure_the_next_save_writes_all_that_is_missing(tmp_path: Path) -> None:
    _begin(tmp_path)
    journal = Journal(tmp_path, largest=(tmp_path / "journal.db").stat().st_size)
    kept = journal.load_memory()
    assert kept is not None
    big = kept.remembering(np.ones(20_000, np.float32), 2, Place(), move=False)
    with pytest.raises(JournalError):
        journal.commit(Batch(memory=big))
    small = replace(big.remembering(np.zeros(4, np.float32), 2, Place(), move=False), clock=44)
    journal.commit(Batch(memory=small))
    journal.close()
    again = Journal(tmp_path)
    found = again.load_memory()
    again.close()
    assert found is not None
    assert found.clock == 44
    assert [entry.order for entry in found.history] == [entry.order for entry in small.history]


def _overwrite(folder: Path) -> None:
    (folder / "journal.db").write_bytes(b"this is no database" * 500)


def _cut(folder: Path) -> None:
    path = folder / "journal.db"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def _scribble(folder: Path) -> None:
    path = folder / "journal.db"
    content = bytearray(path.read_bytes())
    content[4096:] = os.urandom(len(content) - 4096)
    path.write_bytes(bytes(content))


def _drop(folder: Path) -> None:
    _edit(folder, "DROP TABLE settled")


def _bad_weight(folder: Path) -> None:
    _edit(folder, "UPDATE words SET weight = 7")


def _bad_type(folder: Path) -> None:
    _edit(folder, "UPDATE words SET weight = 'heavy'")


def _bad_vector(folder: Path) -> None:
    _edit(folder, "UPDATE entries SET embedding = x'0102'")


def _nan_vector(folder: Path) -> None:
    _edit(folder, "UPDATE memory SET reference = x'0000c07f'")


def _bad_state(folder: Path) -> None:
    _edit(folder, "UPDATE supervision SET state = '[1'")


def _state_of_no_text(folder: Path) -> None:
    _edit(folder, "UPDATE supervision SET state = CAST(x'7bf5f57d' AS TEXT)")


def _column_of_no_text(folder: Path) -> None:
    _replace(folder, b"stamp INTEGER PRIMARY KEY", b"stamp INTEGER PRIMARY \xf5EY")


def _column_of_another_name(folder: Path) -> None:
    _replace(folder, b"state TEXT NOT NULL", b"stbte TEXT NOT NULL")


def _replace(folder: Path, old: bytes, new: bytes) -> None:
    path = folder / "journal.db"
    content = path.read_bytes()
    assert old in content
    path.write_bytes(content.replace(old, new))


def _deep_state(folder: Path) -> None:
    _edit(folder, f"UPDATE supervision SET state = '{'[' * 100_000}'")


def _listed_state(folder: Path) -> None:
    _edit(folder, "UPDATE supervision SET state = '[1]'")


@pytest.mark.parametrize(
    ("damage", "scenes", "words", "state"),
    [
        (_overwrite, None, False, None),
        (_cut, None, False, None),
        (_scribble, None, False, None),
        (_column_of_no_text, None, False, None),
        (_drop, 1, True, 5),
        (_bad_weight, 0, False, 5),
        (_bad_type, 0, False, 5),
        (_bad_vector, 0, True, 5),
        (_nan_vector, 1, True, 5),
        (_bad_state, 1, True, 1),
        (_listed_state, 1, True, 1),
        (_deep_state, 1, True, 1),
        (_state_of_no_text, 1, True, 1),
        (_column_of_another_name, 1, True, 1),
    ],
)
def test_a_damaged_journal_is_set_aside_and_one_of_what_can_be_read_is_begun(
    tmp_path: Path,
    damage: Callable[[Path], None],
    scenes: int | None,
    words: bool,
    state: int | None,
    caplog: pytest.LogCaptureFixture,
) -> None:
    _begin(tmp_path)
    damage(tmp_path)
    content = (tmp_path / "journal.db").read_bytes()
    with caplog.at_level(logging.WARNING):
        journal = Journal(tmp_path)
    assert journal.recovered_from == tmp_path / "journal.damaged-1.db"
    assert journal.recovered_from.read_bytes() == content, "it stays as it was"
    assert f"set aside as {journal.recovered_from}: {scenes or 0} scenes recovered" in caplog.text
    memory, supervision = journal.load_memory(), journal.load_supervision()
    assert (None if memory is None else len(memory.history)) == scenes
    assert (memory is not None and dict(memory.preferences) == {"grass": 1.0}) is words
    assert (None if supervision is None else supervision["last_id"]) == state
    journal.commit(Batch(memory=_memory(9)))
    journal.close()
    again = Journal(tmp_path)
    found = again.load_memory()
    again.close()
    assert again.recovered_from is None
    assert found is not None
    assert found.clock == 9


def test_a_second_damaged_journal_does_not_replace_the_first(tmp_path: Path) -> None:
    for number in (1, 2):
        _overwrite(tmp_path)
        journal = Journal(tmp_path)
        journal.close()
        assert journal.recovered_from == tmp_path / f"journal.damaged-{number}.db"


def test_of_damaged_journals_the_newest_three_are_kept(tmp_path: Path) -> None:
    for number in range(1, 13):
        (tmp_path / "journal.db").write_bytes(b"no database %d" % number * 500)
        Journal(tmp_path).close()
        (tmp_path / f"journal.damaged-{number}.db-wal").write_bytes(b"its log")
    kept = {path.name for path in tmp_path.glob("journal.damaged*")}
    names = [f"journal.damaged-{number}.db" for number in (10, 11, 12)]
    notes = (name.replace(".db", ".txt") for name in names)
    assert kept == {*names, *(f"{name}-wal" for name in names), *notes}
    assert (tmp_path / names[-1]).read_bytes().startswith(b"no database 12")


def test_an_empty_file_is_a_damaged_journal(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "journal.db").write_bytes(b"")
    journal = Journal(tmp_path)
    journal.commit(Batch(memory=_memory()))
    journal.close()
    assert journal.recovered_from == tmp_path / "journal.damaged-1.db"
    assert "the journal was damaged (the file is empty)" in caplog.text


def test_a_long_write_ahead_log_is_taken_in_when_it_is_tidied_and_not_before(tmp_path: Path) -> None:
    journal = Journal(tmp_path)
    log = tmp_path / "journal.db-wal"
    for number in range(3):
        journal.commit(Batch(frame=(number, bytes(2 << 20))))
        assert log.stat().st_size > (number + 1) * (2 << 20)
    journal.tidy()
    assert log.stat().st_size == 0
    journal.commit(Batch(frame=(9, b"small")))
    journal.tidy()
    assert log.stat().st_size > 0
    journal.close()
    again = Journal(tmp_path)
    assert again.load_frame(9) == b"small"
    again.close()


def test_a_commit_adds_nothing_to_the_interned_texts(tmp_path: Path, interned: list[str]) -> None:
    journal = Journal(tmp_path)
    journal.tidy()  # makes the day's copy
    interned.clear()
    journal.commit(Batch(frame=(1, b"small")))
    journal.tidy()
    assert interned == []
    journal.close()


def test_a_journal_of_a_newer_companion_is_refused_and_left_alone(tmp_path: Path) -> None:
    _begin(tmp_path)
    _edit(tmp_path, f"PRAGMA user_version = {VERSION + 1}")
    content = (tmp_path / "journal.db").read_bytes()
    with pytest.raises(JournalError, match="newer companion"):
        Journal(tmp_path)
    assert (tmp_path / "journal.db").read_bytes() == content


def test_another_programs_database_is_refused_and_left_alone(tmp_path: Path) -> None:
    _edit(tmp_path, "CREATE TABLE recipes (name)", "INSERT INTO recipes VALUES ('soup')")
    with pytest.raises(JournalError, match="another program"):
        Journal(tmp_path)
    connection = sqlite3.connect(tmp_path / "journal.db")
    assert connection.execute("SELECT name FROM recipes").fetchall() == [("soup",)]
    connection.close()


def test_a_journal_that_another_companion_uses_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("companion.storage.database._WAIT", 0.05)
    journal = Journal(tmp_path)
    with pytest.raises(JournalError, match="another companion"):
        Journal(tmp_path)
    journal.commit(Batch(memory=_memory()))
    journal.close()


def test_a_folder_that_cannot_be_made_says_where_to_look(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(JournalError, match=r"check \[journal\] folder"):
        Journal(tmp_path / "file" / "journal")


def test_a_closed_journal_says_so(tmp_path: Path) -> None:
    journal = Journal(tmp_path)
    journal.close()
    journal.close()
    with pytest.raises(JournalError):
        journal.commit(Batch(memory=_memory()))


def test_a_state_that_is_no_json_is_refused_and_the_last_one_stays(tmp_path: Path) -> None:
    _begin(tmp_path)
    journal = Journal(tmp_path)
    with pytest.raises(JournalError):
        journal.commit(Batch(state=as_json({"call": object()})))
    journal.close()
    again = Journal(tmp_path)
    assert json.dumps(again.load_supervision()) == '{"last_id": 5}'
    again.close()
