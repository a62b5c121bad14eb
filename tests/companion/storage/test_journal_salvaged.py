"""A damaged page costs the scenes on it, and with the copy beside the journal none at all."""

from __future__ import annotations

import os
import random
import shutil
import sqlite3
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from anytraverse.history import Entry, History, Place
from anytraverse.memory import Memory, first_memory
from anytraverse.perception import Example
from anytraverse.preferences import Preferences, Setting
from companion.storage import Batch, Journal, TableRow
from companion.storage.batch import as_json
from companion.storage.journal_copy import told_of_damage
from companion.storage.salvage import AGE, Salvaged, best, salvage
from companion.storage.writer import Writer

SCENES = 40
WORDS = {"grass": 1.0, "dirt path": 1.0, "bush": -1.0, "tree": -1.0, "sky": -1.0}
STATE = {"last_id": SCENES, "mode": None, "call": None, "hold": None}
_PAGE = 4096


def vector(seed: int, length: int = 96) -> np.ndarray[Any, np.dtype[np.float32]]:
    return np.random.default_rng(seed).random(length).astype(np.float32)


def scene(number: int) -> Entry:
    words = {word: Setting(weight, number) for word, weight in WORDS.items()}
    words[f"thing {number}"] = Setting(-1.0, number)
    return Entry(
        embedding=vector(number),
        preferences=Preferences(words),
        order=number,
        matched=number,
        call_id=number,
        examples={f"thing {number}": (Example("m", vector(-number % 999, 64)),)} if number % 4 == 0 else {},
        place=Place(48.0 + number, 11.0, 10.0, 1.7e9),
        refused=(vector(1000 + number),) if number % 7 == 0 else (),
        surroundings=vector(2000 + number, 48),
    )


def memory_of(*numbers: int, model: str = "m") -> Memory:
    first = first_memory(model, Preferences.of(WORDS))
    entries = [scene(number) for number in numbers]
    return replace(first, history=History(entries), clock=max(numbers, default=0), reference=vector(0))


def plain(one: Entry) -> tuple[Any, ...]:
    taps = {word: [tap.vector.tobytes() for tap in kept] for word, kept in one.examples.items()}
    around = None if one.surroundings is None else one.surroundings.tobytes()
    refused = [frame.tobytes() for frame in one.refused]
    words = list(one.preferences.settings.items())
    return one.embedding.tobytes(), words, one.call_id, one.place, taps, refused, around


def orders(memory: Memory | None) -> list[int]:
    return [one.order for one in memory.history] if memory is not None else []


@pytest.fixture(scope="module")
def journal(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a journal that grew scene by scene, as on a rover, with its copy."""
    folder = tmp_path_factory.mktemp("whole")
    written = Journal(folder)
    for last in range(1, SCENES + 1):
        written.commit(Batch(memory=memory_of(*range(1, last + 1)), state=as_json(STATE)))
    record = as_json({"text": "x" * 200})
    for number in range(SCENES):
        answer = TableRow("answers", "call_id, answered_at, record", (number, 1.0, record))
        closed = TableRow("calls", "id, closed_at, outcome, record", (number, 1.0, "answered", record))
        written.commit(Batch(rows=(answer, closed)))
    written.tidy()
    written.close()
    return folder


def damaged(journal: Path, folder: Path, page: int, *, copied: bool) -> Journal:
    """Open a journal of which one page was overwritten."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    content = bytearray((journal / "journal.db").read_bytes())
    content[page * _PAGE : (page + 1) * _PAGE] = random.Random(page).randbytes(_PAGE)
    (folder / "journal.db").write_bytes(content)
    if copied:
        shutil.copy2(journal / "journal.copy.db", folder)
    return Journal(folder)


def pages_of(journal: Path) -> range:
    return range((journal / "journal.db").stat().st_size // _PAGE)


@pytest.mark.slow
def test_whichever_page_is_damaged_most_scenes_survive_and_none_is_invented(
    journal: Path, tmp_path: Path
) -> None:
    survivors = Counter[int]()
    for page in pages_of(journal):
        found = damaged(journal, tmp_path / "damaged", page, copied=False)
        assert found.recovered_from is not None, page
        memory = found.load_memory()
        survivors[len(orders(memory))] += 1
        for one in memory.history if memory is not None else []:
            assert plain(one) == plain(scene(one.order)), page
        assert found.recovered.startswith(f"{len(orders(memory))} scenes recovered"), page
        told = found.load_supervision()
        assert memory is None or (told is not None and told["last_id"] >= max(orders(memory), default=0)), (
            page
        )
        found.close()
    pages = sum(survivors.values())
    assert pages > 20
    assert sum(count for scenes, count in survivors.items() if scenes >= SCENES // 2) >= 0.8 * pages
    assert sum(scenes * count for scenes, count in survivors.items()) >= 0.75 * SCENES * pages


@pytest.mark.slow
def test_with_the_copy_all_scenes_and_words_survive_whichever_page_is_damaged(
    journal: Path, tmp_path: Path
) -> None:
    for page in pages_of(journal):
        found = damaged(journal, tmp_path / "damaged", page, copied=True)
        memory = found.load_memory()
        assert orders(memory) == list(range(1, SCENES + 1)), page
        assert memory is not None
        assert dict(memory.preferences) == WORDS, page
        assert (found.load_supervision() or {})["last_id"] == SCENES
        found.close()


def test_what_is_in_the_write_ahead_log_is_recovered_too(tmp_path: Path) -> None:
    lost = Journal(tmp_path / "lost")
    lost.commit(Batch(memory=memory_of(1, 2)))
    folder = tmp_path / "rover"
    folder.mkdir()
    for name in ("journal.db", "journal.db-wal"):
        shutil.copy(tmp_path / "lost" / name, folder)
    lost.close()
    assert (folder / "journal.db-wal").stat().st_size > 0
    connection = sqlite3.connect(folder / "journal.db", isolation_level=None)
    connection.execute("PRAGMA wal_autocheckpoint = 0")
    connection.execute("UPDATE entries SET embedding = x'01' WHERE stamp = 1")
    content = {name: (folder / name).read_bytes() for name in ("journal.db", "journal.db-wal")}
    connection.close()
    for name, before in content.items():
        (folder / name).write_bytes(before)
    assert orders(salvage(folder / "journal.db").memory) == [2]
    assert {name: (folder / name).read_bytes() for name in content} == content, "they stay as they were"


def test_calls_answers_and_the_open_calls_frame_are_recovered(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    written = Journal(tmp_path)
    row = TableRow("answers", "call_id, answered_at, record", (7, 1.0, as_json({"motion": "go"})))
    closed = TableRow(
        "calls", "id, closed_at, outcome, record", (7, 1.0, "answered", as_json({"frame_id": 3}))
    )
    state = as_json({**STATE, "call": {"frame_id": 3}})
    written.commit(Batch(memory_of(1), state, frame=(3, b"png"), rows=(row, closed)))
    written.close()
    with sqlite3.connect(tmp_path / "journal.db") as connection:
        connection.execute("UPDATE entries SET matched = 'never'")
        connection.execute("INSERT INTO answers VALUES (99, 7, 1.0, 'no JSON')")
    connection.close()
    found = Journal(tmp_path)
    assert found.recovered == "0 scenes recovered"
    assert (found.load_supervision() or {})["call"] == {"frame_id": 3}
    assert found.load_frame(3) == b"png"
    assert "frame of the open call is lost" not in caplog.text
    assert [one.id for one in found.calls()] == [7]
    assert found.answers(7) == ({"motion": "go"},)
    found.close()


def held(*numbers: int, words: bool = True, clock: int | None = None, model: str = "m") -> Salvaged:
    memory = memory_of(*numbers, model=model)
    return Salvaged(replace(memory, clock=memory.clock if clock is None else clock), words)


@pytest.mark.parametrize(
    ("found", "copied", "scenes", "of_copy"),
    [
        (held(1, 2, 3), held(1, 2), [1, 2, 3], False),
        (held(1, 2), held(2, 3), [1, 2], False),
        (held(1), held(1, 2), [1, 2], True),
        (held(1, 4, 5, clock=5), held(1, 2, 3, 6, clock=3), [1, 2, 3, 4, 5, 6], True),
        (held(1, 2, 3, words=False), held(1, 2), [1, 2, 3], True),
        (Salvaged(), held(1, 2), [1, 2], True),
        (held(1), Salvaged(), [1], False),
        (Salvaged(), Salvaged(), [], False),
        (held(1), held(1, 2, 3, model="another"), [1], False),
    ],
)
def test_the_fuller_file_counts_and_scenes_newer_than_the_copy_are_added(
    found: Salvaged,
    copied: Salvaged,
    scenes: list[int],
    of_copy: bool,
) -> None:
    left, told = best(found, copied)
    assert (orders(left.memory), told) == (scenes, of_copy)
    clock = left.memory.clock if left.memory is not None else 0
    assert clock >= max((one.memory.clock for one in (found, left) if one.memory), default=0)


def test_reading_a_file_ends_in_time_whatever_it_holds(journal: Path, tmp_path: Path) -> None:
    assert salvage(journal / "journal.db", within=-1.0).scenes == 0
    assert salvage(tmp_path / "nothing.db").memory is None
    assert not (tmp_path / "nothing.db").exists()
    (tmp_path / "rubbish.db").write_bytes(random.Random(0).randbytes(9 * _PAGE))
    assert salvage(tmp_path / "rubbish.db").memory is None


class Copied(NamedTuple):
    """A journal whose copy is looked at."""

    folder: Path
    journal: Journal

    @property
    def path(self) -> Path:
        return self.folder / "journal.copy.db"

    def scenes(self) -> list[int]:
        return orders(salvage(self.path).memory)

    def commit(self, *numbers: int) -> None:
        self.journal.commit(Batch(memory=memory_of(*numbers)))
        self.journal.tidy()

    def started_again(self, age: float = 0.0) -> Copied:
        """Start again, with a copy that is so many seconds old."""
        self.journal.close()
        made = time.time() - age
        os.utime(self.path, (made, made))
        return Copied(self.folder, Journal(self.folder))


@pytest.fixture
def copied(tmp_path: Path) -> Copied:
    one = Copied(tmp_path, Journal(tmp_path))
    one.commit(1)
    return one


def test_a_copy_is_made_when_the_last_one_is_a_day_old_or_of_another_time(copied: Copied) -> None:
    assert copied.scenes() == [1]
    copied.commit(1, 2)
    young = copied.started_again()
    young.commit(1, 2, 3)
    assert young.scenes() == [1], "not every time"
    for last, age in enumerate((AGE + 60.0, -AGE), 4):
        young = young.started_again(age)
        young.commit(1, 2, 3, last)
        assert young.scenes() == [1, 2, 3, last]
    young.journal.close()


def test_what_was_forgotten_is_in_the_copy_no_more(copied: Copied) -> None:
    old = copied.started_again(AGE + 60.0)
    old.commit(1, 2, 3)
    assert old.scenes() == [1, 2, 3]
    old.commit(1, 3)
    assert old.scenes() == [1, 3]
    old.journal.close()
    (old.folder / "journal.db").unlink()
    afresh = Copied(old.folder, Journal(old.folder))
    afresh.journal.tidy()
    assert afresh.scenes() == [], "who moves the journal away begins afresh"
    afresh.journal.close()


def test_a_disk_without_room_gets_no_copy_and_what_was_forgotten_goes_all_the_same(
    copied: Copied, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    old = copied.started_again(AGE + 60.0)
    full = shutil.disk_usage(old.folder)._replace(free=1 << 20)
    monkeypatch.setattr(shutil, "disk_usage", lambda _folder: full)
    old.commit(1, 2)
    assert old.scenes() == [1]
    assert "the journal is not copied: 1 MB are free on its disk" in caplog.text
    old.commit(2)
    assert not old.path.exists()
    old.journal.close()


def test_a_copy_that_cannot_be_written_leaves_the_old_one_and_costs_no_commit(
    copied: Copied, monkeypatch: pytest.MonkeyPatch
) -> None:
    old = copied.started_again(AGE + 60.0)

    def fails(*_: object) -> None:
        raise OSError(5, "Input/output error")

    with Writer(old.journal) as writer:
        monkeypatch.setattr(os, "fsync", fails)
        ticket = writer.queue_batch(Batch(memory=memory_of(1, 2)))
        assert writer.drain()
        assert (writer.committed, writer.errors["tidying"]) == (ticket, 1)
        assert not writer.failing
    assert old.scenes() == [1]
    assert sorted(path.name for path in old.folder.iterdir()) == ["journal.copy.db", "journal.db"]


@pytest.mark.parametrize("spoil", [lambda path: path.write_bytes(b""), lambda path: path.unlink()])
def test_the_copy_is_named_where_it_was_needed(copied: Copied, spoil: Callable[[Path], Any]) -> None:
    copied.journal.close()
    spoil(copied.path)
    os.utime(copied.folder / "journal.db")
    (copied.folder / "journal.db").write_bytes(b"no journal")
    without = Journal(copied.folder)
    assert without.recovered == "0 scenes recovered"
    without.commit(Batch(memory=memory_of(1, 2)))
    without.tidy()
    without.close()
    (copied.folder / "journal.db").write_bytes(b"no journal")
    found = Journal(copied.folder)
    found.close()
    assert found.recovered.startswith("2 scenes recovered from the copy of 20")
    assert found.recovered in told_of_damage(copied.folder)
    assert "journal.damaged-2.db" in told_of_damage(copied.folder)


def test_a_link_in_place_of_the_note_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("of somebody else")
    assert told_of_damage(tmp_path) == ""
    (tmp_path / "journal.damaged-1.txt").symlink_to(tmp_path / "secret")
    assert told_of_damage(tmp_path) == ""
