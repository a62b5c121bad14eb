"""Files that are replaced whole."""

from __future__ import annotations

import resource
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from companion.system.atomic_write import write_atomically, write_durably

ROOM = 64 * 1024
Write = Callable[[Path, bytes], None]
WAYS = pytest.mark.parametrize("write", [write_durably, write_atomically])


@pytest.fixture
def _little_room() -> Iterator[None]:
    """No file can grow beyond ROOM bytes, as on a disk that is full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@WAYS
def test_a_file_is_replaced_and_nothing_else_is_left(tmp_path: Path, write: Write) -> None:
    path = tmp_path / "file"
    write(path, b"old")
    write(path, b"new")
    assert path.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [path]


@WAYS
def test_writing_adds_nothing_to_the_interned_texts(
    tmp_path: Path, write: Write, interned: list[str]
) -> None:
    path = tmp_path / "file"
    interned.clear()
    write(path, b"new")
    assert interned == []


@WAYS
@pytest.mark.usefixtures("_little_room")
def test_a_file_that_finds_no_room_leaves_the_old_one_and_gives_its_room_back(
    tmp_path: Path, write: Write
) -> None:
    path = tmp_path / "file"
    write(path, b"old")
    with pytest.raises(OSError, match="too large"):
        write(path, bytes(2 * ROOM))
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]
