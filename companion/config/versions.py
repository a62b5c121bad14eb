"""Replaces a file whole, and keeps its last versions beside it."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from anytraverse.regular_file import open_regular

KEPT = 5
"""Versions before the current one that are kept, as FILE.1 (the newest) to FILE.5."""
_ACL = "system.posix_acl_access"


class _Rights(NamedTuple):
    """Owner and rights of a file, and its extended attributes: access control lists and labels, too."""

    status: os.stat_result
    attributes: Mapping[str, bytes]


def write_version(path: Path, before: bytes, after: bytes) -> Path:
    """Replace the content `before` of a file by `after`, and return the path of the kept version before.

    Whenever this is interrupted, the file holds the one or the other whole. Owner, group, rights and extended
    attributes (access control lists, labels) stay.
    Raises OSError, with what to do, where the file holds anything else, is a link or no regular file, is
    being written by another program, or one of these cannot be kept.
    """
    folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        _lock(folder)
        rights = _unchanged(folder, path.name, before)
        _lay(folder, f".{path.name}.new", after, rights)
        try:
            _lay(folder, f".{path.name}.old", before, rights)
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


def _unchanged(folder: int, name: str, before: bytes) -> _Rights:
    """Return the file's rights. Raises OSError where it does not hold `before`."""
    try:
        descriptor = open_regular(name, folder=folder, follow=False)
    except OSError as error:
        if error.errno != errno.ELOOP:
            raise
        raise OSError(errno.ELOOP, "it is a link: name the file itself") from error
    with os.fdopen(descriptor, "rb") as file:
        if file.read(len(before) + 1) != before:
            raise OSError(errno.EBUSY, "somebody has changed it meanwhile: look at it, and try again")
        return _Rights(os.fstat(file.fileno()), _attributes(file.fileno()))


def _attributes(descriptor: int) -> dict[str, bytes]:
    try:
        return {name: os.getxattr(descriptor, name) for name in os.listxattr(descriptor)}
    except OSError as error:
        if error.errno == errno.ENOTSUP:  # a file system without any
            return {}
        raise


def _give(descriptor: int, rights: _Rights) -> None:
    """Give a new file the rights of another. Raises OSError."""
    own, like = os.fstat(descriptor), rights.status
    if (own.st_uid, own.st_gid) != (like.st_uid, like.st_gid):
        os.fchown(descriptor, like.st_uid, like.st_gid)
    there = _attributes(descriptor)
    if _ACL in there and _ACL not in rights.attributes:  # of the folder's default
        os.removexattr(descriptor, _ACL)
    os.fchmod(descriptor, stat.S_IMODE(like.st_mode))
    for name, value in rights.attributes.items():
        if there.get(name) == value and name != _ACL:
            continue
        try:
            os.setxattr(descriptor, name, value)
        except OSError as error:
            why = f"its attribute {name} cannot be kept ({(error.strerror or '').lower()}): edit it by hand"
            raise OSError(error.errno, why) from error


def _lay(folder: int, name: str, content: bytes, like: _Rights) -> None:
    """Write a new file with the rights of another. Raises OSError; then there is none."""
    with contextlib.suppress(FileNotFoundError):  # of an earlier write that was interrupted
        os.unlink(name, dir_fd=folder)
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
    descriptor = os.open(name, flags, 0o600, dir_fd=folder)
    try:
        with os.fdopen(descriptor, "wb") as file:
            _give(descriptor, like)
            file.write(content)
            file.flush()
            os.fsync(descriptor)
    except OSError:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(name, dir_fd=folder)
        raise


def _rename(folder: int, old: str, new: str) -> None:
    os.replace(old, new, src_dir_fd=folder, dst_dir_fd=folder)
