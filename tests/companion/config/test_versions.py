"""A file is replaced whole, whatever interrupts it, and its last versions stay beside it."""

from __future__ import annotations

import errno
import fcntl
import os
import stat
import struct
import sys
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

from companion.config import versions
from companion.config.versions import KEPT, write_version

OLD, NEW = b"old = 1\n" * 50, b"new = 2\n" * 80


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "companion.toml"
    path.write_bytes(OLD)
    path.chmod(0o640)
    return path


def _killed_at(file: Path, step: int) -> bool:
    """Write in a process that is killed before the n-th step. Returns whether it came to its end."""
    child = os.fork()
    if child:
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    left = step

    def count(frame: FrameType, event: str, _: Any) -> Any:
        nonlocal left
        if frame.f_code.co_filename != versions.__file__:
            return None
        left -= event == "line"
        if left < 0:
            os._exit(9)
        return count

    code = 1
    try:
        sys.settrace(count)
        write_version(file, OLD, NEW)
        code = 0
    finally:
        os._exit(code)


@pytest.mark.slow
def test_a_write_that_is_killed_anywhere_leaves_the_old_or_the_new_file_whole(file: Path) -> None:
    seen = set()
    for step in range(1000):
        file.write_bytes(OLD)
        for number in range(1, KEPT + 1):
            file.with_name(f"companion.toml.{number}").write_bytes(b"%d" % number)
        ended = _killed_at(file, step)
        content = file.read_bytes()
        assert content in (OLD, NEW), step
        seen.add(content)
        for number in range(1, KEPT + 1):
            kept = file.with_name(f"companion.toml.{number}")
            assert not kept.exists() or kept.read_bytes() in (OLD, b"1", b"2", b"3", b"4", b"5")
        if ended:
            break
        write_version(file, content, b"next")  # what was left behind is in nobody's way
        assert file.read_bytes() == b"next"
    assert ended
    assert step > 50
    assert seen == {OLD, NEW}
    assert sorted(one.name for one in file.parent.iterdir()) == [
        "companion.toml",
        *(f"companion.toml.{number}" for number in range(1, KEPT + 1)),
    ]


def test_the_last_five_versions_stay_the_newest_first_with_the_same_rights(file: Path) -> None:
    for number in range(8):
        before = file.read_bytes()
        assert write_version(file, before, b"%d" % number) == file.with_name("companion.toml.1")
    kept = [file.with_name(f"companion.toml.{number}") for number in range(1, KEPT + 1)]
    assert [one.read_bytes() for one in kept] == [b"6", b"5", b"4", b"3", b"2"]
    assert {stat.S_IMODE(one.stat().st_mode) for one in (file, *kept)} == {0o640}
    assert len(list(file.parent.iterdir())) == 1 + KEPT


def test_a_file_that_somebody_changed_meanwhile_stays_as_it_is(file: Path) -> None:
    file.write_bytes(OLD + b"# mine")
    with pytest.raises(OSError, match="somebody has changed it meanwhile"):
        write_version(file, OLD, NEW)
    assert file.read_bytes() == OLD + b"# mine"
    assert list(file.parent.iterdir()) == [file]


def test_only_a_regular_file_is_written(tmp_path: Path, file: Path) -> None:
    link = tmp_path / "link.toml"
    link.symlink_to(file)
    with pytest.raises(OSError, match="it is a link"):
        write_version(link, OLD, NEW)
    pipe = tmp_path / "pipe.toml"
    os.mkfifo(pipe)
    with pytest.raises(OSError, match="no regular file"):
        write_version(pipe, OLD, NEW)
    with pytest.raises(FileNotFoundError):
        write_version(tmp_path / "none.toml", OLD, NEW)
    assert file.read_bytes() == OLD


def test_what_lies_at_the_names_of_its_own_files_is_not_followed(tmp_path: Path, file: Path) -> None:
    other = tmp_path / "other"
    other.write_bytes(b"untouched")
    for name in (".companion.toml.new", ".companion.toml.old", "companion.toml.1", "companion.toml.2"):
        (tmp_path / name).symlink_to(other)
    write_version(file, OLD, NEW)
    assert other.read_bytes() == b"untouched"
    assert (file.read_bytes(), file.with_name("companion.toml.1").read_bytes()) == (NEW, OLD)
    assert not file.is_symlink()


def test_two_programs_do_not_write_at_once(file: Path) -> None:
    folder = os.open(file.parent, os.O_RDONLY)
    try:
        fcntl.flock(folder, fcntl.LOCK_EX)
        with pytest.raises(OSError, match="another program is writing it"):
            write_version(file, OLD, NEW)
    finally:
        os.close(folder)
    write_version(file, OLD, NEW)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may give a file to another user")
def test_owner_and_group_stay(file: Path) -> None:
    os.chown(file, 12345, 23456)
    write_version(file, OLD, NEW)
    for one in (file, file.with_name("companion.toml.1")):
        status = one.stat()
        assert (status.st_uid, status.st_gid, stat.S_IMODE(status.st_mode)) == (12345, 23456, 0o640)


def test_a_full_disk_leaves_the_old_file_and_nothing_else(file: Path) -> None:
    limit = len(NEW) // 2  # bytes that a file may have in the child
    child = os.fork()
    if not child:
        import resource
        import signal

        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
        code = 1
        try:
            write_version(file, OLD, NEW)
        except OSError as error:
            code = 0 if error.errno == errno.EFBIG else 2
        finally:
            os._exit(code)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    assert file.read_bytes() == OLD
    assert list(file.parent.iterdir()) == [file]


def _list(*, named: int) -> bytes:
    """An access control list that lets one user more read, with a mask: as `setfacl` writes it."""
    none = 0xFFFFFFFF
    entries = ((1, 6, none), (2, 4, named), (4, 0, none), (0x10, 4, none), (0x20, 0, none))
    return struct.pack("<I", 2) + b"".join(struct.pack("<HHI", *one) for one in entries)


def test_access_control_lists_and_other_attributes_stay(file: Path) -> None:
    kept = {"user.mark": b"1", "system.posix_acl_access": _list(named=65534)}
    try:
        for name, value in kept.items():
            os.setxattr(file, name, value)
    except OSError:
        pytest.skip("this file system has no such attributes")
    mode = file.stat().st_mode
    older = write_version(file, OLD, NEW)
    for path in (file, older):
        assert {name: os.getxattr(path, name) for name in kept} == kept
        assert path.stat().st_mode == mode


def test_a_file_whose_attributes_cannot_be_kept_is_not_written(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(versions, "_attributes", lambda _: {"user.mark": os.urandom(8)})
    monkeypatch.setattr(os, "setxattr", refuse)
    with pytest.raises(OSError, match=r"attribute user\.mark cannot be kept"):
        write_version(file, OLD, NEW)
    assert file.read_bytes() == OLD
    assert list(file.parent.iterdir()) == [file]
