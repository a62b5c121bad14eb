"""What the page reads of the state folder: the newest calls, the end of the log, and no other file."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.observers.page.files import LINES, LISTED, StateFolder
from companion.storage.call_files import CallFiles
from companion.wire.ids import newest_first


@given(st.integers(0, 0xFFFF), st.lists(st.integers(1, 900), max_size=40))
def test_calls_are_listed_by_age_though_their_ids_begin_again(first: int, steps: list[int]) -> None:
    ids = [first]
    for step in steps[:40]:
        ids.append((ids[-1] + step) & 0xFFFF)
    oldest_first = list(dict.fromkeys(ids))
    assert newest_first(sorted(oldest_first)) == oldest_first[::-1]


def test_the_newest_calls_are_read_as_they_were_written(tmp_path: Path) -> None:
    (tmp_path / "calls").mkdir()
    files = CallFiles(tmp_path / "calls")
    for number in range(1, LISTED + 4):
        files.begin_record(number, {"frame_id": number, "reasons": ["unknown_object"]})
    files.add_answer(LISTED + 3, {"motion": "go"})
    (tmp_path / "calls" / "9.json").write_text("{torn")
    (tmp_path / "calls" / ".12.json.part").write_text("{}")
    found = StateFolder(str(tmp_path)).calls()
    assert [one["id"] for one in found] == [n for n in range(LISTED + 3, 3, -1) if n != 9]
    assert found[0]["answers"] == [{"motion": "go"}]


def test_a_link_out_of_the_folder_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "calls").mkdir()
    (tmp_path / "secret").write_text("secret")
    os.symlink(tmp_path / "secret", tmp_path / "calls" / "1.jpg")
    os.symlink(tmp_path / "secret", tmp_path / "calls" / "1.json")
    os.mkfifo(tmp_path / "calls" / "2.jpg")
    folder = StateFolder(str(tmp_path))
    for number in (1, 2):
        with pytest.raises(OSError, match=r"."):
            folder.picture(number)
    assert folder.calls() == []


def test_a_file_that_is_too_large_is_refused(tmp_path: Path) -> None:
    (tmp_path / "calls").mkdir()
    with (tmp_path / "calls" / "1.jpg").open("wb") as file:
        file.truncate(2 << 20)
    with pytest.raises(OSError, match="at most"):
        StateFolder(str(tmp_path)).picture(1)


def test_the_end_of_the_log_is_shown_over_its_rotation(tmp_path: Path) -> None:
    folder = StateFolder(str(tmp_path))
    assert folder.calls() == []
    assert folder.log() == ""
    logs = tmp_path / "logs"
    logs.mkdir()
    (logs / "companion.log.1").write_text("".join(f"old {n}\n" for n in range(1000)))
    (logs / "companion.log").write_text("new 1\nnew 2\n\xff")
    lines = folder.log().split("\n")
    assert len(lines) == LINES
    assert lines[-4:-1] == ["old 999", "new 1", "new 2"]
    assert json.dumps(lines)
