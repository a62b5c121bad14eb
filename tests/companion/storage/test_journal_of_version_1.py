"""A journal that an older companion wrote: its scenes come back, and new ones get what it did not know."""

from __future__ import annotations

import sqlite3
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anytraverse.history import Entry, History, Place
from anytraverse.memory import first_memory
from anytraverse.preferences import Preferences, Setting
from companion.storage import Batch, Journal, JournalError
from companion.storage.batch import as_json

WORDS = Preferences.parse("grass: 1")
OLD = Place(47.0, 8.0, 90.0, 1_790_000_000.0)
NEW = Place(47.1, 8.1, 91.0, 1_790_000_001.0, (1.0, -2.0, 91.0))


def entry(order: int, place: Place) -> Entry:
    embedding = np.zeros(4, np.float32)
    embedding[order % 4] = 1.0
    return Entry(embedding, WORDS, order, order, call_id=order, place=place)


def made_old(folder: Path) -> None:
    """As version 1 had it."""
    with sqlite3.connect(folder / "journal.db") as connection:
        for column in ("roll", "pitch", "yaw", "surroundings"):
            connection.execute(f"ALTER TABLE entries DROP COLUMN {column}")
        for table in ("frame", "refused", "adoption"):
            connection.execute(f"DROP TABLE {table}")
        connection.execute("PRAGMA user_version = 1")
    connection.close()


def make_old_journal(folder: Path) -> None:
    """A journal of version 1 that remembers one scene."""
    memory = replace(first_memory("m", WORDS), history=History([entry(1, OLD)]), clock=5)
    journal = Journal(folder)
    journal.commit(Batch(memory=memory))
    journal.close()
    made_old(folder)


def test_an_older_journal_comes_back_and_takes_attitudes_from_then_on(tmp_path: Path) -> None:
    make_old_journal(tmp_path)
    journal = Journal(tmp_path)
    assert journal.recovered_from is None
    found = journal.load_memory()
    assert found is not None
    assert [one.place for one in found.history] == [OLD]
    journal.commit(Batch(memory=replace(found, history=found.history.added(entry(2, NEW)))))
    journal.close()
    for _ in range(2):
        journal = Journal(tmp_path)
        found = journal.load_memory()
        assert found is not None
        assert [one.place for one in found.history] == [OLD, NEW]
        journal.close()


def test_the_call_of_a_journal_of_version_2_gets_the_picture_beside_it_until_another_is_kept(
    tmp_path: Path,
) -> None:
    journal = Journal(tmp_path)
    journal.commit(Batch(state=as_json({"call": {"frame_id": 41}})))
    journal.close()
    with sqlite3.connect(tmp_path / "journal.db") as connection:
        for table in ("frame", "refused", "adoption"):
            connection.execute(f"DROP TABLE {table}")
        connection.execute("ALTER TABLE entries DROP COLUMN surroundings")
        connection.execute("PRAGMA user_version = 2")
    connection.close()
    (tmp_path / "call.png").write_bytes(b"a picture")
    for _ in range(2):
        journal = Journal(tmp_path)
        assert journal.recovered_from is None
        assert (journal.load_frame(41), journal.load_frame(42)) == (b"a picture", None)
        journal.commit(Batch(state=as_json({"call": {"frame_id": 42}})))
        journal.close()
    journal = Journal(tmp_path)
    journal.commit(Batch(frame=(42, b"another")))
    assert (journal.load_frame(41), journal.load_frame(42)) == (None, b"another")
    assert not (tmp_path / "call.png").exists()
    journal.close()


def test_an_older_journal_is_copied_before_it_is_upgraded_and_the_copy_opens(tmp_path: Path) -> None:
    make_old_journal(tmp_path)
    Journal(tmp_path).close()
    backup = tmp_path / "journal.version-1.db"
    with sqlite3.connect(f"file:{backup}?mode=ro", uri=True) as connection:
        assert connection.execute("PRAGMA user_version").fetchone() == (1,)
        columns = [name for name, *_ in connection.execute("SELECT * FROM entries").description]
        assert "heading" in columns
        assert "roll" not in columns
    connection.close()
    written = backup.read_bytes()
    Journal(tmp_path).close()
    assert backup.read_bytes() == written, "an upgraded journal is not copied again"
    restored = tmp_path / "restored"
    restored.mkdir()
    (restored / "journal.db").write_bytes(written)
    journal = Journal(restored)
    found = journal.load_memory()
    journal.close()
    assert found is not None
    assert [one.place for one in found.history] == [OLD]


def test_a_journal_of_which_no_copy_can_be_made_is_not_upgraded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Journal(tmp_path).close()
    made_old(tmp_path)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr("companion.storage.database.os.replace", full)
        with pytest.raises(JournalError, match=r"no copy of it can be made .* make room on the disk"):
            Journal(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["journal.db"]
    with sqlite3.connect(tmp_path / "journal.db") as connection:
        assert connection.execute("PRAGMA user_version").fetchone() == (1,)
    connection.close()
    Journal(tmp_path).close()


def test_the_words_that_a_journal_of_version_4_knows_count_as_given(tmp_path: Path) -> None:
    words = Preferences({"grass": Setting(-0.5, 1), "water": Setting(-1, 1)})
    scenes = [replace(entry(1, OLD), preferences=words), replace(entry(2, OLD), preferences=Preferences())]
    newer = replace(entry(3, NEW), preferences=Preferences({"water": Setting(0.5, 3)}))
    memory = replace(
        first_memory("m", Preferences.of({"mud": 0.2})), preferences=WORDS, history=History([*scenes, newer])
    )
    journal = Journal(tmp_path)
    journal.commit(Batch(memory=memory))
    journal.close()
    with sqlite3.connect(tmp_path / "journal.db") as connection:
        connection.execute("ALTER TABLE entries DROP COLUMN surroundings")
        connection.execute("PRAGMA user_version = 4")
    connection.close()
    for _ in range(2):
        journal = Journal(tmp_path)
        found = journal.load_memory()
        journal.close()
        assert found is not None
        assert found.preferences == WORDS
        assert list(found.given.items()) == [("water", 0.5), ("mud", 0.2)]


def test_a_journal_of_version_3_opens_and_takes_refused_frames_from_then_on(tmp_path: Path) -> None:
    memory = replace(first_memory("m", WORDS), history=History([entry(1, OLD)]), clock=5)
    journal = Journal(tmp_path)
    journal.commit(Batch(memory=memory))
    journal.close()
    with sqlite3.connect(tmp_path / "journal.db") as connection:
        for table in ("refused", "adoption"):
            connection.execute(f"DROP TABLE {table}")
        connection.execute("ALTER TABLE entries DROP COLUMN surroundings")
        connection.execute("PRAGMA user_version = 3")
    connection.close()
    journal = Journal(tmp_path)
    assert journal.recovered_from is None
    found = journal.load_memory()
    assert found is not None
    assert found.adoption is None
    assert found.history[0].refused == ()
    journal.commit(
        Batch(memory=replace(found, history=found.history.refusing({1}, found.history[0].embedding)))
    )
    journal.close()
    journal = Journal(tmp_path)
    found = journal.load_memory()
    assert found is not None
    assert [len(one.refused) for one in found.history] == [1]
    journal.close()
