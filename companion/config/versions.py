"""Replaces a file whole, and keeps its last versions beside it."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import stat
from pathlib import Path

from anytraverse.regular_file import open_regular

KEPT = 5
"""Versions before the current one that are kept, as FILE.1 (the newest) to FILE.5."""


def write_version(path: Path, before: bytes, after: bytes) -> Path:
    """Replace the content `before` of a file by `after`, and return the path of the kept version before.

    Whenever this is interrupted, the file holds the one or the other whole. Owner, group and rights stay.
    Raises OSError, with what to do, where the file holds anything else, is a link or no regular file, is
    being written by another program, or its owner cannot be kept.
    """
    folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        _lock(folder)
        status = _unchanged(folder, path.name, before)
        _lay(folder, f".{path.name}.new", after, status)
        try:
            _lay(folder, f".{path.name}.old", before, status)
            for n in range(KEPT - 1, 0, -1):
                with contextlib.suppress(FileNotFoundError):
                    _rename(folder, f"{path.name}.{n}", f"{path.name}.{n + 1}")
            _rename(folder, f".{path.name}.old", f"{path.name}.1")
            _unchanged(folder, path.name, before)
            _rename(folder, f".{path.name}.new", path.name)
        except OSError:
            for name in ("new", "old"):
                with contextlib.suppress(FileNotFoundError):
                    os.unlink(f".{path.name}.{name}", dir_fd=folder)
            raise
        os.fsync(folder)
    finally:
        os.close(folder)
    return path.with_name(f"{path.name}.1")


def _lock(folder: int) -> None:
    try:
        fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise OSError(errno.EAGAIN, "another program is writing it: try again") from error


def _unchanged(folder: int, name: str, before: bytes) -> os.stat_result:
    """Return the file's owner and rights. Raises OSError where it does not hold `before`."""
    try:
        descriptor = open_regular(name, folder=folder, follow=False)
    except OSError as error:
        if error.errno != errno.ELOOP:
            raise
        raise OSError(errno.ELOOP, "it is a link: name the file itself") from error
    with os.fdopen(descriptor, "rb") as file:
        if file.read(len(before) + 1) != before:
            raise OSError(errno.EBUSY, "somebody has changed it meanwhile: look at it, and try again")
        return os.fstat(file.fileno())


def _lay(folder: int, name: str, content: bytes, like: os.stat_result) -> None:
    """Write a new file with the owner and the rights of another. Raises OSError; then there is none."""
    with contextlib.suppress(FileNotFoundError):  # of an earlier write that was interrupted
        os.unlink(name, dir_fd=folder)
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
    descriptor = os.open(name, flags, 0o600, dir_fd=folder)
    try:
        with os.fdopen(descriptor, "wb") as file:
            own = os.fstat(descriptor)
            if (own.st_uid, own.st_gid) != (like.st_uid, like.st_gid):
                os.fchown(descriptor, like.st_uid, like.st_gid)
            os.fchmod(descriptor, stat.S_IMODE(like.st_mode))
            file.write(content)
            file.flush()
            os.fsync(descriptor)
    except OSError:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(name, dir_fd=folder)
        raise


def _rename(folder: int, old: str, new: str) -> None:
    os.replace(old, new, src_dir_fd=folder, dst_dir_fd=folder)
