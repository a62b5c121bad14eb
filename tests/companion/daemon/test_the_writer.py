"""The one thread that writes: what goes first, what is dropped, what is survived, and how it ends."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.storage import Batch, Journal, JournalError, TableRow
from companion.storage.batch import MAX_ROWS
from companion.storage.log_file import log_to_file
from companion.storage.writer import BOUNDS, Writer

PATIENCE = 10.0


@pytest.fixture
def journal(tmp_path: Path) -> Iterator[Journal]:
    journal = Journal(tmp_path)
    yield journal
    journal.close()


@pytest.fixture
def writer(journal: Journal) -> Writer:
    return Writer(journal)


def answer(number: int) -> Batch:
    return Batch(rows=(TableRow.of_answer(number, {"number": number}, float(number)),))


def test_the_journal_goes_first_then_jobs_in_their_order(writer: Writer) -> None:
    done: list[object] = []
    writer.queue_job("record", partial(done.append, "first"))
    writer.queue_job("picture", partial(done.append, "second"))
    writer.queue_batch(Batch(state="{}"))
    assert writer.run_once()
    assert (writer.committed, done) == (1, [])
    writer.drain()
    assert done == ["first", "second"]
    assert not writer.run_once()


def test_a_journal_that_always_has_news_does_not_keep_jobs_waiting_for_ever(writer: Writer) -> None:
    done: list[int] = []
    for number in range(3):
        writer.queue_job("record", partial(done.append, number))
    for _ in range(6):
        writer.queue_batch(Batch(state="{}"))
        writer.run_once()
    assert (done, writer.committed) == ([0, 1, 2], 6)


def test_of_what_waits_the_newest_state_and_every_row_are_one_transaction(
    writer: Writer, journal: Journal
) -> None:
    for number in range(5):
        writer.queue_batch(answer(number).merged_with(Batch(state=f'{{"last_id": {number}}}')))
    assert writer.run_once()
    assert (writer.committed, journal.load_supervision()) == (5, {"last_id": 4})
    assert [journal.answers(number) for number in range(5)] == [({"number": n},) for n in range(5)]


@given(st.lists(st.tuples(st.sampled_from(sorted(BOUNDS)), st.integers()), max_size=120))
def test_of_each_kind_no_more_than_its_bound_waits_and_the_oldest_goes(
    tmp_path_factory: pytest.TempPathFactory, jobs: list[tuple[str, int]]
) -> None:
    writer = Writer(Journal(tmp_path_factory.mktemp("journal")))
    done: list[tuple[str, int]] = []
    for job in jobs:
        writer.queue_job(job[0], partial(done.append, job))
    writer.close()
    newest = {kind: [job for job in jobs if job[0] == kind][-bound:] for kind, bound in BOUNDS.items()}
    assert {kind: [job for job in done if job[0] == kind] for kind in BOUNDS} == newest
    lost = len(jobs) - len(done) - max(0, sum(kind == "status" for kind, _ in jobs) - 1)
    assert sum(writer.dropped.values()) == lost


def test_more_rows_than_there_is_room_for_count_as_failed(writer: Writer, journal: Journal) -> None:
    tickets = [writer.queue_batch(answer(number)) for number in range(MAX_ROWS + 2)]
    assert writer.failed == tickets[-2]
    writer.drain()
    assert writer.committed == tickets[-1]
    assert journal.answers(1) == ()
    assert journal.answers(MAX_ROWS + 1) == ({"number": MAX_ROWS + 1},)


@pytest.mark.parametrize("error", [JournalError("disk full"), MemoryError("none left"), KeyError("odd")])
def test_any_error_is_told_once_counted_and_tried_again(
    writer: Writer,
    journal: Journal,
    error: Exception,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    now = [1000.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    with monkeypatch.context() as patched:

        def fail(_: Batch) -> None:
            raise error

        patched.setattr(journal, "commit", fail)
        ticket = writer.queue_batch(answer(1))
        for _ in range(5):
            writer.drain()
            now[0] += 0.5
        assert (writer.failed, writer.committed, writer.failing) == (ticket, 0, True)
        assert writer.errors["journal"] == 5
        assert caplog.text.count("journal cannot be written") == 1
        assert ("Traceback" in caplog.text) == (not isinstance(error, JournalError))
    with caplog.at_level(logging.INFO):
        writer.drain()
    assert (writer.committed, writer.failing) == (ticket, False)
    assert journal.answers(1) == ({"number": 1},)
    assert "journal is written again" in caplog.text


def test_a_file_that_cannot_be_written_is_told_once_in_a_row(
    writer: Writer, caplog: pytest.LogCaptureFixture
) -> None:
    def full() -> None:
        raise OSError(28, "No space left on device")

    for job in (full, full, full, lambda: None, full):
        writer.queue_job("status", job)
        writer.drain()
    assert caplog.text.count("status cannot be written") == 2
    assert writer.errors["status"] == 4
    assert not writer.failing, "a status file need not survive"


def test_a_slow_commit_is_failing_while_it_lasts_and_some_time_after(
    writer: Writer, journal: Journal, monkeypatch: pytest.MonkeyPatch
) -> None:
    now, seen = [1000.0], list[bool]()
    monkeypatch.setattr(time, "monotonic", lambda: now[0])

    def slow(_: Batch) -> None:
        for _step in range(3):
            seen.append(writer.failing)
            now[0] += 1.5

    monkeypatch.setattr(journal, "commit", slow)
    writer.queue_batch(answer(1))
    writer.drain()
    assert seen == [False, False, True]
    assert writer.failing
    now[0] += 10.1
    assert not writer.failing


def test_a_journal_that_waits_behind_a_file_is_failing_too(
    writer: Writer, monkeypatch: pytest.MonkeyPatch
) -> None:
    now, seen = [1000.0], list[bool]()
    monkeypatch.setattr(time, "monotonic", lambda: now[0])

    def slow() -> None:
        writer.queue_batch(answer(1))
        for _step in range(3):
            seen.append(writer.failing)
            now[0] += 1.5

    writer.queue_job("status", slow)
    writer.drain()
    assert seen == [False, False, True]
    assert (writer.committed, writer.failing) == (1, False)


class Hanging(Journal):
    """Its commits wait for `released`."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.released, self.entered = threading.Event(), threading.Event()

    def commit(self, batch: Batch) -> None:
        self.entered.set()
        assert self.released.wait(PATIENCE)
        super().commit(batch)


def test_nobody_who_hands_something_over_waits_and_leaving_writes_what_waits(tmp_path: Path) -> None:
    journal = Hanging(tmp_path)
    done: list[int] = []
    with Writer(journal) as writer:
        writer.queue_batch(answer(1))
        assert journal.entered.wait(PATIENCE)
        before = time.monotonic()
        writer.queue_batch(answer(2))
        for number in range(20):
            writer.queue_job("record", partial(done.append, number))
        assert time.monotonic() - before < 1.0
        assert (done, writer.committed) == ([], 0)
        journal.released.set()
    assert done == list(range(20))
    again = Journal(tmp_path)
    assert [again.answers(number) for number in (1, 2)] == [({"number": 1},), ({"number": 2},)]
    again.close()


def test_a_disk_that_hangs_is_left_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("companion.storage.writer.SLOW", 0.1)
    journal = Hanging(tmp_path)
    writer = Writer(journal)
    before = time.monotonic()
    with writer:
        writer.queue_batch(answer(1))
        assert journal.entered.wait(PATIENCE)
        assert not writer.drain(0.1)
    assert time.monotonic() - before < 2.0
    assert "the disk fails or hangs" in caplog.text
    journal.released.set()
    writer._thread.join(PATIENCE)
    journal.close()


def test_what_waits_to_be_tried_again_is_not_yet_written(
    writer: Writer, journal: Journal, monkeypatch: pytest.MonkeyPatch
) -> None:
    commit, tries = journal.commit, list[Batch]()

    def fail_once(batch: Batch) -> None:
        tries.append(batch)
        if len(tries) == 1:
            raise JournalError("disk full")
        commit(batch)

    monkeypatch.setattr(journal, "commit", fail_once)
    with writer:
        ticket = writer.queue_batch(answer(1))
        assert writer.drain()
        assert (writer.committed, len(tries)) == (ticket, 2)


def test_a_journal_that_hangs_as_it_is_closed_is_left_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("companion.storage.writer.SLOW", 0.1)
    journal, released = Journal(tmp_path), threading.Event()
    close = journal.close
    monkeypatch.setattr(journal, "close", lambda: released.wait(PATIENCE) and close())
    before = time.monotonic()
    with Writer(journal) as writer:
        pass
    assert time.monotonic() - before < 2.0
    released.set()
    writer._thread.join(PATIENCE)


def test_log_lines_that_found_no_room_are_counted_in_the_log(
    tmp_path: Path, writer: Writer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(BOUNDS, "log", 10)
    with log_to_file(tmp_path, writer):
        for number in range(25):
            logging.getLogger("companion.test").warning("line %d", number)
        writer.drain()
        logging.getLogger("companion.test").warning("and one more")
        writer.drain()
    writer.drain()
    lines = [line.split(" ", 3)[3] for line in (tmp_path / "logs" / "companion.log").read_text().splitlines()]
    assert lines == [
        "companion.storage.log_file: 15 lines lost: slow disk",
        *(f"companion.test: line {number}" for number in range(15, 25)),
        "companion.test: and one more",
    ]
