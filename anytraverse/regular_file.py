"""Opens files that somebody else may have put there. Another thing than a file must not be waited for."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path


def open_regular(path: str | Path, *, folder: int | None = None, follow: bool = True) -> int:
    """Open a regular file for reading, and return its descriptor. Raises OSError, for anything else, too.

    folder: directory descriptor from which a relative path counts. follow: whether the file may be a symbolic
    link.
    """
    # O_NONBLOCK: opening a named pipe would otherwise wait for its writer.
    flags = os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | (0 if follow else os.O_NOFOLLOW)
    descriptor = os.open(path, flags, dir_fd=folder)
    mode = os.fstat(descriptor).st_mode
    if not stat.S_ISREG(mode):
        os.close(descriptor)
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        raise OSError(errno.EINVAL, "no regular file", str(path))
    return descriptor


def read_regular(path: str | Path, most: int, *, follow: bool = True) -> bytes:
    """Read a regular file, its first `most` bytes of a longer one. Raises OSError, for anything else, too.

    follow: as of `open_regular`.
    """
    with os.fdopen(open_regular(path, follow=follow), "rb") as file:
        return file.read(most)
