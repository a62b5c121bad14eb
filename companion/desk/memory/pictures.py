"""Finds the pictures of answered scenes: files of calls, and those that were imported with a scene."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from anytraverse.history import Entry
from anytraverse.regular_file import read_regular
from companion.desk.memory.scene_file import MAX_PICTURE
from companion.storage.call_files import SCENES, scene_name
from companion.system.atomic_write import write_atomically


def picture_of(folder: Path, entry: Entry) -> Path | None:
    """Return the best picture of a scene in the state folder, None without one."""
    paths = [_imported(folder, entry)]
    if entry.call_id:
        paths += [folder / "calls" / f"{entry.call_id}{size}.jpg" for size in ("-large", "")]
    return next((path for path in paths if path.is_file()), None)


def read_picture(folder: Path, entry: Entry) -> bytes:
    """Return a scene's picture, b"" without one. Raises OSError."""
    path = picture_of(folder, entry)
    if path is None:
        return b""
    return read_regular(path, MAX_PICTURE + 1)


def store_picture(folder: Path, entry: Entry, picture: bytes) -> bool:
    """Store the picture of an imported scene. False when it cannot be written."""
    try:
        write_atomically(_imported(folder, entry), picture)
    except OSError:
        return False
    return True


def delete_unused(folder: Path, entries: Iterable[Entry]) -> None:
    """Delete imported pictures of which no scene is left."""
    used = {_imported(folder, entry) for entry in entries}
    for path in (folder / SCENES).glob("*.jpg"):
        if path not in used:
            with suppress(OSError):
                path.unlink()


def _imported(folder: Path, entry: Entry) -> Path:
    return folder / SCENES / scene_name(entry)
