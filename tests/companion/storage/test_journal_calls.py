"""The open call, its frame, and the record of closed ones."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from companion.storage import Batch, Journal, JournalError, TableRow
from companion.storage import journal as journal_module
from companion.storage.batch import as_json
from companion.wire.call_report import CallReport
from companion.wire.ids import Outcome, Reasons


@pytest.fixture
def journal(tmp_path: Path) -> Iterator[Journal]:
    journal = Journal(tmp_path)
    yield journal
    journal.close()


def _call(number: int, outcome: Outcome = Outcome.ANSWERED) -> CallReport:
    return CallReport(number, outcome=outcome, reasons=Reasons.UNKNOWN_OBJECT, frame_id=40 + number)


def test_the_state_of_the_calls_comes_back(journal: Journal, tmp_path: Path) -> None:
    state = {"last_id": 7, "mode": None, "call": {"id": 7, "reasons": ["unknown_object"]}, "hold": None}
    journal.commit(Batch(state=as_json({"last_id": 6})))
    journal.commit(Batch(state=as_json(state)))
    journal.close()
    again = Journal(tmp_path)
    assert again.load_supervision() == state
    again.close()


def test_the_callers_later_changes_of_the_state_are_not_kept(journal: Journal) -> None:
    state = {"call": {"id": 1}}
    journal.commit(Batch(state=as_json(state)))
    state["call"]["id"] = 2
    assert journal.load_supervision() == {"call": {"id": 1}}


def test_the_frame_of_the_open_call_comes_back_byte_by_byte(journal: Journal, tmp_path: Path) -> None:
    journal.commit(Batch(frame=(6, b"the one before")))
    journal.commit(Batch(frame=(7, b"a picture")))
    assert journal.load_frame(7) == b"a picture"
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".db", ".db-wal"]


def test_frame_state_memory_and_rows_are_kept_together_or_not_at_all(tmp_path: Path) -> None:
    Journal(tmp_path).close()
    journal = Journal(tmp_path, largest=(tmp_path / "journal.db").stat().st_size + 40_000)
    row = TableRow.of_answer(1, {"motion": "go"}, 5.0)
    journal.commit(Batch(state='{"call": 1}', frame=(1, b"one"), rows=(row,)))
    with pytest.raises(JournalError, match="make room"):
        journal.commit(Batch(state='{"call": 2}', frame=(2, bytes(200_000)), rows=(row,)))
    journal.close()
    again = Journal(tmp_path)
    assert (again.load_supervision(), again.load_frame(1)) == ({"call": 1}, b"one")
    assert again.answers(1) == ({"motion": "go"},)
    again.close()


def test_closed_calls_are_listed_newest_first_with_their_answers(journal: Journal) -> None:
    journal.commit(Batch(rows=(TableRow.of_answer(1, {"motion": "go", "operations": ["drum: -1"]}, 1.8e9),)))
    journal.commit(Batch(rows=(TableRow.of_call(_call(1), 1.8e9),)))
    journal.commit(Batch(rows=(TableRow.of_call(_call(2, Outcome.PASSED), 1.8e9),)))
    newest, oldest = journal.calls()
    assert (newest.id, newest.outcome, newest.answers) == (2, Outcome.PASSED, ())
    assert (oldest.id, oldest.outcome) == (1, Outcome.ANSWERED)
    assert journal.answers(1) == ({"motion": "go", "operations": ["drum: -1"]},)
    assert [(one.motion, one.operations) for one in oldest.answers] == [("go", ("drum: -1",))]
    assert oldest.reasons == Reasons.UNKNOWN_OBJECT
    assert oldest.frame_id == 41
    assert oldest.closed == 1.8e9
    assert [call.id for call in journal.calls(1)] == [2]


def test_old_calls_and_answers_go(journal: Journal, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(journal_module, "MAX_CALLS", 3)
    for number in range(1, 7):
        journal.commit(Batch(rows=(TableRow.of_call(_call(number), 1.8e9),)))
        journal.commit(Batch(rows=(TableRow.of_answer(number, {}, 1.8e9),)))
    assert [call.id for call in journal.calls()] == [6, 5, 4]
