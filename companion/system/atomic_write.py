"""Writes files atomically: a reader finds the old content or the new one, never a part of it."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path


def write_durably(path: Path, content: bytes) -> None:
    """Replace the content of `path`, and return once it is on disk.

    Raises OSError; the old file is then unchanged.
    """
    _replace(path, content, sync=True)
    sync_folder(path.parent)


def write_atomically(path: Path, content: bytes, *, sync: bool = True) -> None:
    """Replace the content of `path`, and create its folder.

    After a power cut the file holds the old content or the new one. sync: False does not wait for the disk;
    then a power cut may leave an empty or a torn file. Raises OSError.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    _replace(path, content, sync=sync)


def sync_folder(folder: Path) -> None:
    """Write the directory entries of `folder` to disk, so that a rename in it survives a power cut.

    Raises OSError.
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _replace(path: Path, content: bytes, *, sync: bool) -> None:
    # In the same folder, since os.replace is atomic only within one file system.
    # Named by text, since a Path interns the name, each second anew: as of `Computer`.
    partial = os.path.join(path.parent, f".{path.name}.part")
    try:
        with open(partial, "wb") as file:
            file.write(content)
            file.flush()
            if sync:
                os.fsync(file.fileno())
        os.replace(partial, path)
    except OSError:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(partial)
        raise
