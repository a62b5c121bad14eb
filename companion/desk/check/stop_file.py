"""Stores the stops that `companion check --measure` measured, one file each time, and reads them again."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from anytraverse.regular_file import read_regular
from companion.system.atomic_write import write_atomically
from companion.vehicle.brakes import Measured
from companion.wire.json_values import DocumentError, list_of, mapping_of, number_of, read_object, text_of

FOLDER = "stops"
MOST_FILES = 20
"""Files that are read, the newest."""
_MOST_STOPS = 200
_LARGEST = 64 << 10
_FASTEST, _FARTHEST = 50.0, 1000.0


class MeasuredStops(NamedTuple):
    """The stops of one time, in one mode. at: seconds since 1970. mode: HOLD, or GUIDED which brakes."""

    at: float
    mode: str
    stops: tuple[Measured, ...]


def write_stops(folder: Path, stops: Sequence[tuple[str, Sequence[Measured]]], at: float) -> Path:
    """Store what was measured, and return the file. folder: the companion's state. at: seconds since 1970.

    stops: of each mode, by its name. Raises OSError.
    """
    path = folder / FOLDER / f"{time.strftime('%Y%m%dT%H%M%SZ', time.gmtime(at))}.json"
    told = {"at": at, "stops": {mode: [list(one) for one in each] for mode, each in stops if each}}
    write_atomically(path, json.dumps(told, indent=1).encode())
    return path


def read_stops(folder: Path) -> tuple[list[MeasuredStops], list[tuple[str, str]]]:
    """Return what is stored, oldest first, and for each file that cannot be read its name and why."""
    found, unread = list[MeasuredStops](), list[tuple[str, str]]()
    for path in sorted((folder / FOLDER).glob("*.json"))[-MOST_FILES:]:
        stops, why = _tried(path)
        found += stops
        unread += [(path.name, why)] if why else []
    return found, unread


def _tried(path: Path) -> tuple[list[MeasuredStops], str]:
    try:
        return _stops_of(path), ""
    except (OSError, DocumentError) as error:
        return [], getattr(error, "strerror", None) or str(error)


def _stops_of(path: Path) -> list[MeasuredStops]:
    told = read_object(read_regular(path, _LARGEST, follow=False), path.name)
    at = number_of(told.get("at"), 0.0, 1e11)
    if at is None:
        raise DocumentError(f"{path.name} does not say when")
    found = []
    for mode, each in mapping_of(told.get("stops")).items():
        pairs = [
            [number_of(one, 0.0, _FARTHEST) for one in list_of(pair)] for pair in list_of(each)[:_MOST_STOPS]
        ]
        stops = tuple(
            Measured(pair[0], pair[1])
            for pair in pairs
            if len(pair) == 2 and pair[0] is not None and pair[1] is not None and pair[0] <= _FASTEST
        )
        if stops:
            found.append(MeasuredStops(at, text_of(mode), stops))
    return found
