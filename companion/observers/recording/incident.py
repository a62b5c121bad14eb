"""Puts what was recorded around a call, and what belongs to it, into one zip to send to somebody."""

from __future__ import annotations

import json
import os
import platform
import shutil
import tempfile
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from itertools import islice
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, NamedTuple

from anytraverse.regular_file import open_regular
from anytraverse.release import own_version
from companion.observers.recording.contents import read_json
from companion.observers.recording.foxglove import NS
from companion.observers.recording.ring import FOLDER, RecordingFile, recordings
from companion.observers.recording.shortened import FRAME_WIDTH, FRAMES, Shortened, Window
from companion.observers.recording.topics import TOPICS, Topic
from companion.storage.log_file import FOLDER as LOGS
from companion.storage.log_file import NAME as LOG
from companion.wire.ids import newest_first
from companion.wire.incidents import MOST_MEMBERS

if TYPE_CHECKING:
    from companion.observers.recording.reading import Read

BEFORE, AFTER = 30.0, 30.0
"""Seconds that are taken before and after each thing that happened to a call or hold."""
_PACKAGES = ("numpy", "onnxruntime", "opencv-python-headless", "pymavlink", "mcap")
_LARGEST = 4 << 20
"""Bytes of a file beside the recording, at most."""
_LARGEST_SHORT = 24 << 10
"""The same in a short file."""
_STANDING = frozenset(row.name for row in TOPICS.values() if row.standing)
_ABOUT = {TOPICS[Topic.DECISIONS].name: "id", TOPICS[Topic.ACKNOWLEDGEMENTS].name: "target"}
"""Topics that tell what happened to a call or hold -> the key with its id."""

README = """What a rover's AnyTraverse companion recorded around {what}.

recording.mcap   where anything was recorded: frames, maps, assessments, calls, answers, vehicle, log
                 Open it in Foxglove or Lichtblick (layout: foxglove/anytraverse.json of `companion init`)
config.toml      the configuration; of the camera's source and of addresses, what is no secret
status.json      what the companion said of itself last
calls/           records and pictures of the calls
logs/            its log
versions.json    what was installed

Position, pictures and log are in it. Look through it before you give it to others.
"""
README_SHORT = f"""
This is the short file: of the recording it has {FRAMES} frames at most, {FRAME_WIDTH} pixels wide, no maps,
and one assessment a second; of the log its end.
"""


class Incident(NamedTuple):
    """What the zip holds. messages: of the recording. calls: whose files are in it. left_out: what is not."""

    messages: int
    calls: tuple[int, ...]
    left_out: tuple[str, ...]


def around_call(folder: Path, number: int) -> list[Window]:
    """Find when something happened to a call or hold. folder: the companion's state. Raises OSError."""
    found = []
    for path in _paths(folder, event=True):
        for name, at, said in _told(path):
            if said.get(_ABOUT[name]) == number:
                found.append((at - round(BEFORE * NS), at + round(AFTER * NS)))
    return _merged(found)


def of_recording(folder: Path, number: int) -> list[Window]:
    """Return all of the recording of a number; nothing where it is gone. Raises OSError."""
    from companion.observers.recording.reading import summary

    for one in recordings(folder / FOLDER):
        if one.number == number and (found := summary(folder / FOLDER / one.name)).begin:
            return [(found.begin, found.end + 1)]
    return []


def last(folder: Path, seconds: float) -> list[Window]:
    """Return the last `seconds` of what is recorded. Raises OSError."""
    from companion.observers.recording.reading import messages

    for path in reversed(_paths(folder)):
        newest = max((one.message.log_time for one in messages(path)), default=0)
        if newest:
            return [(newest - round(seconds * NS), newest + 1)]
    return []


def write_incident(
    out: Path,
    folder: Path,
    config: str,
    windows: Sequence[Window],
    calls: Sequence[int],
    what: str,
    *,
    short: bool = False,
) -> Incident:
    """Write the zip. It works beside a companion that runs, and with recordings that end anywhere.

    folder: the companion's state. config: as `format_config` makes it. windows: what is taken of the
    recordings. calls: whose files are taken, beside those of the windows. what: for the reader.
    short: whether it is for a radio, see `README_SHORT`.
    Raises OSError, FileExistsError where `out` is there already.
    """
    try:
        with out.open("xb") as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as packed:
            return _write(packed, out.parent, folder, config, windows, calls, what, short=short)
    except FileExistsError:
        raise
    except BaseException:
        out.unlink(missing_ok=True)
        raise


def _write(
    packed: zipfile.ZipFile,
    scratch: Path,
    folder: Path,
    config: str,
    windows: Sequence[Window],
    calls: Sequence[int],
    what: str,
    *,
    short: bool,
) -> Incident:
    count, told = 0, set(calls)
    if windows:
        with tempfile.TemporaryFile(dir=scratch) as copied:
            count = _copy(folder, windows, copied, told, short=short)
            copied.seek(0)
            with packed.open("recording.mcap", "w", force_zip64=True) as member:
                shutil.copyfileobj(copied, member)
    packed.writestr("README.txt", README.format(what=what) + (README_SHORT if short else ""))
    packed.writestr("config.toml", config)
    packed.writestr("versions.json", json.dumps(versions(), indent=1))
    most = _LARGEST_SHORT if short else _LARGEST
    pictured = (list(calls) or sorted(told)[-1:]) if short else sorted(told)
    ranked = list(dict.fromkeys([*calls, *newest_first(list(told))]))
    room = MOST_MEMBERS - len(packed.namelist())
    beside = islice(_beside(folder, ranked, pictured, short=short), room)
    left_out = [left for path in beside if (left := _added(packed, folder, path, most))]
    return Incident(count, tuple(sorted(told)), tuple(left_out))


def _added(packed: zipfile.ZipFile, folder: Path, path: Path, most: int) -> str:
    """Add a file, of one longer than `most` bytes its end. Return why it is left out, "" where it is not."""
    try:
        content = _read(path, most)
    except OSError as error:
        return f"{path}: {(error.strerror or str(error)).lower()}"
    packed.writestr(str(path.relative_to(folder)), content)
    return ""


def versions() -> dict[str, str]:
    """Return what is installed on this computer."""
    found = {"companion": own_version(), "python": platform.python_version(), "computer": platform.platform()}
    return found | {name: told for name in _PACKAGES if (told := _version(name))}


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def _copy(
    folder: Path, windows: Sequence[Window], out: IO[bytes], calls: set[int], *, short: bool = False
) -> int:
    """Copy the messages of the windows, and before each what held at its beginning. Adds ids to `calls`."""
    from mcap.writer import CompressionType

    from companion.observers.recording.reading import Copy, messages, summary

    # The zip compresses a short one better as a whole.
    copy = Copy(out, CompressionType.NONE if short else CompressionType.LZ4)
    shortened = Shortened(_paths(folder), windows) if short else None
    begin, end = windows[0][0], windows[-1][1]
    standing: dict[str, Read] = {}
    begun = set[int]()
    for path in _paths(folder):
        if summary(path).end < begin:  # each tells at its own begin what holds
            continue
        for one in messages(path, end=end):
            topic, at = one.channel.topic, one.message.log_time
            if topic in _STANDING:
                standing[topic] = one
            inside = next((n for n, (first, after) in enumerate(windows) if first <= at < after), None)
            if at < begin or inside is None:
                continue
            if inside not in begun:
                begun.add(inside)
                for earlier in standing.values():
                    if earlier is not one:
                        copy.add(earlier, at)
            if (kept := one if shortened is None else shortened.take(one)) is not None:
                copy.add(kept)
            if topic in _ABOUT:
                number = read_json(one.message.data).get(_ABOUT[topic])
                calls |= {number} if isinstance(number, int) and number else set()
    copy.finish()
    return copy.messages


def _told(path: Path) -> Iterator[tuple[str, int, Mapping[str, Any]]]:
    from companion.observers.recording.reading import messages

    for one in messages(path, _ABOUT):
        yield one.channel.topic, one.message.log_time, read_json(one.message.data)


def _merged(found: Sequence[Window]) -> list[Window]:
    """Join windows that overlap."""
    merged: list[Window] = []
    for begin, end in sorted(found):
        if merged and begin <= merged[-1][1]:
            merged[-1] = merged[-1][0], max(end, merged[-1][1])
        else:
            merged.append((begin, end))
    return merged


def _paths(folder: Path, *, event: bool = False) -> list[Path]:
    """List the recordings, oldest first. event: only those with an event."""
    found: list[RecordingFile] = recordings(folder / FOLDER)
    return [folder / FOLDER / one.name for one in found if one.event or not event]


def _beside(folder: Path, calls: Sequence[int], pictured: Sequence[int], *, short: bool) -> Iterator[Path]:
    """Yield the files to add that are there: records of the calls, pictures of those `pictured`."""
    names = ["status.json", *([] if short else [f"{LOGS}/{LOG}.1"]), f"{LOGS}/{LOG}"]
    pictures = (".jpg", "-raw.jpg") if short else (".jpg", "-large.jpg", "-raw.jpg")
    for number in calls:
        names += [f"calls/{number}{rest}" for rest in (".json", *(pictures if number in pictured else ()))]
    for name in names:
        if (folder / name).is_file():
            yield folder / name


def _read(path: Path, most: int) -> bytes:
    with os.fdopen(open_regular(path), "rb") as file:
        size = os.fstat(file.fileno()).st_size
        file.seek(max(0, size - most))
        return file.read(most)
