"""Keeps measured detection zones as files, one a measurement, and reads them again: `check --zone`.

A zone says at which marks on the ground a thing was noticed, by which judgement, and in which light. All that
is read is checked: the file may come from anywhere.
"""

from __future__ import annotations

import json
import re
import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict, astuple, dataclass
from pathlib import Path
from typing import Annotated

from msgspec import Meta, ValidationError, convert

from anytraverse.light import Light
from anytraverse.regular_file import read_regular
from companion.system.atomic_write import write_atomically
from companion.wire.json_values import LARGEST, read_object

FOLDER = "zone"
"""Of the data folder."""
FORMAT, VERSION = "anytraverse zone", 1
MOST_FILES = 100
"""The newest are kept."""
MOST_MARKS = 400
_TEXT = 400
_NAME = re.compile(r"[0-9]{8}T[0-9]{6}Z\.json", re.ASCII)
_TIME = "%Y%m%dT%H%M%SZ"
_BRIGHTEST = 255.0

_Figure = Annotated[float, Meta(ge=-1e9, le=1e9)]
_Figures = Annotated[Mapping[str, _Figure | None], Meta(max_length=64)]
_Metres = Annotated[float, Meta(ge=0.0, le=1000.0)]
_Bearing = Annotated[float, Meta(ge=-180.0, le=180.0)]
_Weight = Annotated[float, Meta(ge=-1.0, le=1.0)]
_Many = Meta(max_length=MOST_MARKS)


@dataclass(frozen=True, kw_only=True)
class ZoneLook:
    """What was judged at one mark, or on one walk. frames: judged ones, 1 or more.

    noticed_frames: those with something in the region of interest that stops the rover. reasons: all reasons
    that any frame had, by name. light: of the last frame, None: not measured. at: UTC, as of `utc_now`.
    """

    frames: Annotated[int, Meta(ge=1, le=1_000_000)]
    noticed_frames: Annotated[int, Meta(ge=0)]
    reasons: Annotated[tuple[str, ...], _Many]
    light: Light | None = None
    at: str

    @property
    def share(self) -> float:
        """Share of the frames in which something was noticed, 0 to 1."""
        return self.noticed_frames / self.frames


@dataclass(frozen=True, kw_only=True)
class ZoneMark(ZoneLook):
    """A thing that stood on a mark.

    line: names the line. bearing_deg: the line's, clockwise from the nose. distance_m: along it, from the
    middle of the vehicle's front, by tape. noticed: whether the daemon's rule would have stopped the rover,
    without a pause, and the picture shows a thing that may stand on the mark. in_picture: whether it shows
    one at all, in the region or not. elsewhere: whether that stands somewhere else. ground_m, ground_deg: its
    distance and bearing by picture and [mount], None: not known.
    """

    line: str
    bearing_deg: _Bearing
    distance_m: _Metres
    noticed: bool
    in_picture: bool
    elsewhere: bool
    ground_m: _Figure | None = None  # no _Metres: below the horizon a row of the picture covers kilometres
    ground_deg: _Bearing | None = None


@dataclass(frozen=True, kw_only=True)
class ZoneArc(ZoneLook):
    """A thing that was carried along a part of a circle about the middle of the vehicle's front.

    distance_m: the radius. from_deg, to_deg: bearings at which it began and ended.
    """

    distance_m: _Metres
    from_deg: _Bearing
    to_deg: _Bearing


@dataclass(frozen=True, kw_only=True)
class Zone:
    """One measurement.

    at: UTC when it began. program, identity: as of `release`. model: the perceiver's id. words: word ->
    weight. thresholds: votes, window, and those of `Thresholds`; None: not judged. region: left, top, right,
    bottom in fractions of the picture; near, far, width and tile in m, None: not known. mount: as in
    [mount], and view. stop: speed in m/s and needs, the metres in which the rover stops, None: not known.
    thing: what was carried, by whoever measured. distances: of the marks of each line, as planned: those that
    `marks` lacks were not measured. verdict: what that means for the stop, in words. covers: whether the
    thing is noticed in time all across the rover's way, None: not known. empty: the same view without it.
    clear: whether that would not stop the rover after the last mark either, None: it was not looked at again.
    """

    at: str
    program: str
    identity: str
    model: str
    words: Annotated[Mapping[str, _Weight], Meta(max_length=64)]
    thresholds: _Figures
    region: _Figures
    mount: _Figures
    stop: _Figures
    thing: str
    distances: Annotated[tuple[_Metres, ...], _Many]
    verdict: str
    covers: bool | None = None
    empty: ZoneLook | None = None
    clear: bool | None = None
    marks: Annotated[tuple[ZoneMark, ...], _Many]
    arcs: Annotated[tuple[ZoneArc, ...], _Many]


class ZoneFileError(Exception):
    """A file is none of a zone. The text says why."""


def utc_now() -> str:
    """Return the time as it names a file: 20261127T234500Z."""
    return time.strftime(_TIME, time.gmtime())


def write_zone(folder: Path, zone: Zone) -> Path:
    """Write a zone into the data folder, in place of one with the same time, and return its path.

    The oldest beyond `MOST_FILES` are deleted. Raises OSError, and ZoneFileError for what could not be read.
    """
    content = json.dumps({"format": FORMAT, "version": VERSION, **asdict(zone)}, indent=1).encode()
    parsed_zone(content)
    path = folder / FOLDER / f"{zone.at}.json"
    write_atomically(path, content + b"\n")
    for old in _paths(folder)[:-MOST_FILES]:
        if old != path:  # without a clock it is none of the newest
            old.unlink(missing_ok=True)
    return path


def read_zone_files(folder: Path, most: int = MOST_FILES) -> tuple[list[Zone], list[str]]:
    """Read the newest zones of the data folder, oldest first, and say why each other file is left out."""
    found = [_read(path) for path in _paths(folder)[-most:]]
    return [one for one in found if isinstance(one, Zone)], [one for one in found if isinstance(one, str)]


def _paths(folder: Path) -> list[Path]:
    try:
        return sorted(path for path in (folder / FOLDER).iterdir() if _NAME.fullmatch(path.name))
    except OSError:
        return []


def _read(path: Path) -> Zone | str:
    """Read a file, and return the zone, or why it is left out."""
    try:
        return parsed_zone(read_regular(path, LARGEST + 1, follow=False))
    except (OSError, ZoneFileError) as error:
        why = (error.strerror or str(error)).lower() if isinstance(error, OSError) else error
        return f"{path} is left out: {why}"


def parsed_zone(content: bytes) -> Zone:
    """Read a zone from what `write_zone` wrote. Raises ZoneFileError."""
    try:
        told = read_object(content)
        if told.get("format") != FORMAT:
            raise ValueError("it is no file of `companion check --zone`")
        if told.get("version") != VERSION:
            version = ascii(told.get("version"))[:20]
            raise ValueError(f"it has version {version}, and this program reads {VERSION}")
        zone = convert(told, Zone)
        _check(zone)
    except (ValueError, ValidationError) as error:
        raise ZoneFileError(str(error)[:_TEXT]) from error
    return zone


def _check(zone: Zone) -> None:
    """Refuse what the types do not. Raises ValueError."""
    looks = [*zone.marks, *zone.arcs, *([] if zone.empty is None else [zone.empty])]
    for at in (zone.at, *(look.at for look in looks)):
        if not _NAME.fullmatch(f"{at}.json"):
            raise ValueError("at is no time as 20261127T234500Z")
        time.strptime(at, _TIME)
    for look in looks:
        if look.noticed_frames > look.frames:
            raise ValueError(f"{look.noticed_frames} of {look.frames} frames")
        if look.light is not None and not all(0.0 <= one <= _BRIGHTEST for one in astuple(look.light)):
            raise ValueError(f"light is not 0 to {_BRIGHTEST:g}")
    if not all(len(text) <= _TEXT and text.isprintable() for text in _texts(asdict(zone))):
        raise ValueError(f"a text is not printable, or longer than {_TEXT} characters")


def _texts(value: object) -> Iterator[str]:
    """Yield all texts in a value of JSON, the names in its objects, too."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        for pair in value.items():
            yield from _texts(pair)
    elif isinstance(value, tuple | list):
        for one in value:
            yield from _texts(one)
