"""Files that are there whole or not at all, whatever happens while they are written."""

from __future__ import annotations

import os
from pathlib import Path


def write_durably(path: Path, content: bytes) -> None:
    """Replace `path` by `content`; on disk when this returns. Raises OSError, with the old file in place."""
    _replace(path, content, at_once=True)
    sync_folder(path.parent)


def write_whole(path: Path, content: bytes) -> None:
    """The same, but after a power cut either may be there; its folder is made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    _replace(path, content, at_once=False)


def sync_folder(folder: Path) -> None:
    """Put the names in `folder` on disk. Raises OSError."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _replace(path: Path, content: bytes, *, at_once: bool) -> None:
    torn = path.with_name(f".{path.name}.part")
    try:
        with torn.open("wb") as file:
            file.write(content)
            file.flush()
            if at_once:
                os.fsync(file.fileno())
        os.replace(torn, path)
    except OSError:
        torn.unlink(missing_ok=True)
        raise
