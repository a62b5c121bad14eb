"""Puts answered scenes into words, for a person and for a program, and finds their pictures."""

from __future__ import annotations

import time
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

from anytraverse.history import Entry
from anytraverse.regular_file import read_regular
from companion.desk.memory.scene_file import MAX_PICTURE
from companion.storage.call_files import SCENES, scene_name
from companion.system.atomic_write import write_atomically
from companion.wire.json_values import place_document

HEAD = (
    f"{'scene':>5}  {'call':<6}  {'answered':<16}  {'place':<20}  "
    f"{'picture':<7}  {'refused':>7}  {'surroundings':<12}  words"
)


def row(folder: Path, entry: Entry) -> str:
    """Return a scene as a line below `HEAD`. folder: the state folder."""
    picture = "yes" if picture_of(folder, entry) is not None else "no"
    words = "; ".join(
        f"{word}: {weight:g}{' (tapped)' if word in entry.examples else ''}"
        for word, weight in entry.preferences.items()
    )
    columns = f"{entry.order:>5}  {call_text(entry):<6}  {time_text(entry):<16}  {place_text(entry):<20}"
    around = "no" if entry.surroundings is None else "yes"
    return f"{columns}  {picture:<7}  {len(entry.refused):>7}  {around:<12}  {words}"


def call_text(entry: Entry) -> str:
    """Return the call that was answered, as "C7"; "none" for the first scene and imported ones."""
    return f"C{entry.call_id}" if entry.call_id else "none"


def time_text(entry: Entry) -> str:
    """Return when it was answered, local time; "unknown" on a rover that had no clock."""
    if entry.place.time is None:
        return "unknown"
    return time.strftime("%Y-%m-%d %H:%M", time.localtime(entry.place.time))


def place_text(entry: Entry) -> str:
    """Return latitude and longitude, degrees; "unknown" without them."""
    place = entry.place
    if place.latitude is None or place.longitude is None:
        return "unknown"
    return f"{place.latitude:.5f}, {place.longitude:.5f}"


def figures(folder: Path, entry: Entry) -> dict[str, Any]:
    """Return a scene as JSON values. folder: the state folder."""
    picture = picture_of(folder, entry)
    return {
        "scene": entry.order,
        "call": entry.call_id or None,
        "place": place_document(entry.place),
        "words": dict(entry.preferences),
        "tapped": {word: len(taps) for word, taps in entry.examples.items()},
        "refused": len(entry.refused),
        "surroundings": entry.surroundings is not None,
        "picture": None if picture is None else str(picture),
    }


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
