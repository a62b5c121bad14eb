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
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise OSError(errno.EINVAL, "no regular file", str(path))
    return descriptor
