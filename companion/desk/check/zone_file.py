"""Keeps measured detection zones as files, one a measurement, and reads them again: `check --zone`.

A zone says at which marks on the ground a thing was noticed, by which judgement, and in which light. All that
is read is checked: the file may come from anywhere.
"""

from __future__ import annotations

import json
import logging
import re
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from anytraverse.light import Light
from anytraverse.regular_file import read_regular
from companion.system.atomic_write import write_atomically
from companion.wire.json_values import LARGEST, number_of, read_object

log = logging.getLogger(__name__)

FOLDER = "zone"
"""Of the data folder."""
FORMAT, VERSION = "anytraverse zone", 1
MOST_FILES = 100
"""The newest are kept."""
MOST_MARKS = 400
_TEXT, _NAMES = 400, 64
_NAME = re.compile(r"[0-9]{8}T[0-9]{6}Z\.json", re.ASCII)
_TIME = "%Y%m%dT%H%M%SZ"
_FARTHEST = 1000.0

Figures = Mapping[str, float | None]


@dataclass(frozen=True, kw_only=True)
class ZoneLook:
    """What was judged at one mark, or on one walk. frames: judged ones, 1 or more.

    noticed_frames: those with something in the region of interest that stops the rover. reasons: all reasons
    that any frame had, by name. light: of the last frame, None: not measured. at: UTC, as of `utc_now`.
    """

    frames: int
    noticed_frames: int
    reasons: tuple[str, ...] = ()
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
    bearing_deg: float
    distance_m: float
    noticed: bool
    in_picture: bool = False
    elsewhere: bool = False
    ground_m: float | None = None
    ground_deg: float | None = None


@dataclass(frozen=True, kw_only=True)
class ZoneArc(ZoneLook):
    """A thing that was carried along a part of a circle about the middle of the vehicle's front.

    distance_m: the radius. from_deg, to_deg: bearings at which it began and ended.
    """

    distance_m: float
    from_deg: float
    to_deg: float


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
    words: Mapping[str, float]
    thresholds: Figures
    region: Figures
    mount: Figures
    stop: Figures
    thing: str
    distances: tuple[float, ...] = ()
    verdict: str = ""
    covers: bool | None = None
    empty: ZoneLook | None = None
    clear: bool | None = None
    marks: tuple[ZoneMark, ...] = field(default=())
    arcs: tuple[ZoneArc, ...] = field(default=())


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


def read_zone_files(folder: Path, tell: Callable[[str], None] = log.warning) -> tuple[Zone, ...]:
    """Read all zones of the data folder, oldest first. tell: is told of each file that cannot be read."""
    return _read(_paths(folder), tell)


def newest_zone(folder: Path, tell: Callable[[str], None] = log.warning) -> Zone | None:
    """Read the newest zone, None without one. tell: as of `read_zone_files`."""
    found = _read(_paths(folder)[-1:], tell)
    return found[0] if found else None


def _paths(folder: Path) -> list[Path]:
    try:
        return sorted(path for path in (folder / FOLDER).iterdir() if _NAME.fullmatch(path.name))
    except OSError:
        return []


def _read(paths: list[Path], tell: Callable[[str], None]) -> tuple[Zone, ...]:
    return tuple(zone for path in paths if (zone := _read_file(path, tell)) is not None)


def _read_file(path: Path, tell: Callable[[str], None]) -> Zone | None:
    try:
        return parsed_zone(read_regular(path, LARGEST + 1, follow=False))
    except (OSError, ZoneFileError) as error:
        why = (error.strerror or str(error)).lower() if isinstance(error, OSError) else error
        tell(f"{path} is left out: {why}")
        return None


def parsed_zone(content: bytes) -> Zone:
    """Read a zone from what `write_zone` wrote. Raises ZoneFileError."""
    try:
        told = read_object(content)
        if told.get("format") != FORMAT:
            raise ValueError("it is no file of `companion check --zone`")
        if told.get("version") != VERSION:
            version = str(told.get("version"))[:20]
            raise ValueError(f"it has version {version}, and this program reads {VERSION}")
        return _zone(told)
    except ValueError as error:
        raise ZoneFileError(str(error)[:_TEXT]) from error


def _zone(told: Mapping[str, Any]) -> Zone:
    words = _figures(told, "words", 1.0)
    if None in words.values():
        raise ValueError("a word has no weight")
    covers, clear = told.get("covers"), told.get("clear")
    if not all(one is None or isinstance(one, bool) for one in (covers, clear)):
        raise ValueError("covers or clear is not true, false or null")
    return Zone(
        at=_time(told),
        program=_text(told, "program"),
        identity=_text(told, "identity"),
        model=_text(told, "model"),
        words={word: weight for word, weight in words.items() if weight is not None},
        thresholds=_figures(told, "thresholds"),
        region=_figures(told, "region"),
        mount=_figures(told, "mount"),
        stop=_figures(told, "stop"),
        thing=_text(told, "thing"),
        distances=tuple(
            _number({"distances": one}, "distances", _FARTHEST) for one in _list(told, "distances")
        ),
        verdict=_text(told, "verdict"),
        covers=covers,
        clear=clear,
        empty=None if told.get("empty") is None else ZoneLook(**_watched(_table(told["empty"], "empty"))),
        marks=tuple(_mark(_table(one, "a mark")) for one in _list(told, "marks")),
        arcs=tuple(_arc(_table(one, "an arc")) for one in _list(told, "arcs")),
    )


def _mark(told: Mapping[str, Any]) -> ZoneMark:
    flags: dict[str, Any] = {name: told.get(name) for name in ("noticed", "in_picture", "elsewhere")}
    if not all(isinstance(one, bool) for one in flags.values()):
        raise ValueError(f"{', '.join(flags)} are not all true or false")
    return ZoneMark(
        **_watched(told),
        line=_text(told, "line"),
        bearing_deg=_number(told, "bearing_deg", 180.0),
        distance_m=_number(told, "distance_m", _FARTHEST),
        **flags,
        ground_m=number_of(told.get("ground_m"), 0.0, _FARTHEST),
        ground_deg=number_of(told.get("ground_deg"), -180.0, 180.0),
    )


def _arc(told: Mapping[str, Any]) -> ZoneArc:
    return ZoneArc(
        **_watched(told),
        distance_m=_number(told, "distance_m", _FARTHEST),
        from_deg=_number(told, "from_deg", 180.0),
        to_deg=_number(told, "to_deg", 180.0),
    )


def _watched(told: Mapping[str, Any]) -> dict[str, Any]:
    frames, noticed = (_number(told, name, 1e6) for name in ("frames", "noticed_frames"))
    if not (frames >= 1 and 0 <= noticed <= frames and frames % 1 == noticed % 1 == 0):
        raise ValueError(f"{noticed:g} of {frames:g} frames")
    light = told.get("light")
    return {
        "frames": int(frames),
        "noticed_frames": int(noticed),
        "reasons": tuple(_text({"reasons": one}, "reasons") for one in _list(told, "reasons")),
        "light": None
        if light is None
        else Light(*(_number(_table(light, "light"), name, 255.0) for name in ("mean", "darkest"))),
        "at": _time(told),
    }


def _table(value: object, what: str) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise ValueError(f"{what} is no object")
    return value


def _list(told: Mapping[str, Any], name: str) -> list[Any]:
    value = told.get(name)
    if not isinstance(value, list) or len(value) > MOST_MARKS:
        raise ValueError(f"{name} is no list of at most {MOST_MARKS}")
    return value


def _text(told: Mapping[str, Any], name: str) -> str:
    value = told.get(name)
    if not isinstance(value, str) or len(value) > _TEXT or not value.isprintable():
        raise ValueError(f"{name} is no printable text of at most {_TEXT} characters")
    return value


def _time(told: Mapping[str, Any]) -> str:
    value = _text(told, "at")
    if not _NAME.fullmatch(f"{value}.json"):
        raise ValueError("at is no time as 20261127T234500Z")
    time.strptime(value, _TIME)
    return value


def _number(told: Mapping[str, Any], name: str, most: float) -> float:
    """Return a number as float. Raises ValueError unless it is finite, and at most `most` either way."""
    value = number_of(told.get(name), -most, most)
    if value is None:
        raise ValueError(f"{name} is no number of at most {most:g}")
    return value


def _figures(told: Mapping[str, Any], name: str, most: float = 1e9) -> dict[str, float | None]:
    table = _table(told.get(name), name)
    if len(table) > _NAMES:
        raise ValueError(f"{name} has more than {_NAMES} figures")
    found: dict[str, float | None] = {}
    for key, value in table.items():
        _text({name: key}, name)
        found[key] = None if value is None else _number(table, key, most)
    return found
