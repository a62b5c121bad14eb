"""Packs incidents into the folder from which the ground and the page fetch them, in a process of its own."""

from __future__ import annotations

import errno
import json
import logging
import os
import resource
import shutil
import signal
import socket
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from companion.observers.recording import incident
from companion.observers.recording.recorder import missing
from companion.observers.recording.ring import LEAST_FREE
from companion.system.log_lines import end_process, log_to_stderr
from companion.wire.incidents import FOLDER, LAST_S, MOST_KEPT, SHORT, Packed, name_of, read_name

log = logging.getLogger(__name__)

LARGEST = 64 << 20
"""Bytes of a file."""
LONGEST = 96 << 10
"""Bytes of what supervisor and process say to each other."""
CANCELLED = "it was cancelled"
_LEAST = 1 << 20
"""Bytes of a file for which there must be room."""
_MOST_MEMORY = 512 << 20
_SETUP_WITHIN = 10.0


class PackingError(Exception):
    """An incident cannot be packed. The text says why."""


class PackingRequest(NamedTuple):
    """What is to be packed. folder: the companion's state. config: as `format_config` makes it.

    call: as of `Packed`. not_recorded: why nothing is recorded, "" where it is.
    """

    folder: str
    config: str
    call: int
    not_recorded: str

    def encoded(self) -> bytes:
        """Encode it. Raises ValueError when it is too long."""
        packed = json.dumps(self._asdict()).encode()
        if len(packed) > LONGEST:
            raise ValueError(f"{len(packed)} bytes, at most {LONGEST} are sent")
        return packed


def kept(folder: Path) -> list[Packed]:
    """List the incidents in the companion's state folder, the newest first. Raises OSError."""
    sizes: dict[tuple[int, int], dict[bool, int]] = {}
    home = folder / FOLDER
    if not home.is_dir():
        return []
    with os.scandir(home) as entries:
        for entry in entries:
            if (named := read_name(entry.name)) is not None and entry.is_file(follow_symlinks=False):
                number, call, short = named
                sizes.setdefault((number, call), {})[short] = entry.stat(follow_symlinks=False).st_size
    both = (Packed(*key, found[False], found[True]) for key, found in sizes.items() if len(found) == 2)
    return sorted(both, reverse=True)


def pack(asked: PackingRequest, written: Callable[[], object] = lambda: None) -> Packed:
    """Pack an incident: the whole file and the short one. Deletes the oldest once they are there.

    written: called once both are; an interruption before that leaves nothing behind.
    Limits the size of the files that this process may write from now on. Raises PackingError, OSError; then
    all that were packed before stay.
    """
    folder = Path(asked.folder)
    home = folder / FOLDER
    home.mkdir(exist_ok=True)
    before = kept(folder)
    number = 1 + max((named[0] for one in os.listdir(home) if (named := read_name(one))), default=0)
    _clear(home, {one.name for one in before})
    # The oldest has to go in any case, so that its room counts.
    free = shutil.disk_usage(home).free + sum(one.size + one.short for one in before[MOST_KEPT - 1 :])
    room = (free - LEAST_FREE) // 2  # each is copied before it is compressed
    if room < _LEAST:
        raise PackingError(f"the disk is full: {LEAST_FREE >> 20} MiB stay free")
    most = min(LARGEST, room)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, resource.RLIM_INFINITY))
    recorded = not missing()
    if asked.call < 0:
        what, calls = f"recording {-asked.call}", []
        windows = incident.of_recording(folder, -asked.call) if recorded else []
        if not windows:
            raise PackingError("it is gone, or nothing in it can be read")
    elif asked.call:
        what, calls = f"call or hold {asked.call}", [asked.call]
        windows = incident.around_call(folder, asked.call) if recorded else []
        if not windows and not (folder / "calls" / f"{asked.call}.json").is_file():
            raise PackingError("nothing of it is recorded any more, and its record is gone")
    else:
        what, calls = f"the last {LAST_S:.0f} s", []
        windows = incident.last(folder, LAST_S) if recorded else []
    name = name_of(number, asked.call)
    files = {SHORT: home / f".{name}{SHORT}.zip", "": home / f".{name}.zip"}
    try:
        for kind, path in files.items():
            incident.write_incident(path, folder, asked.config, windows, calls, what, short=kind == SHORT)
        written()
    except BaseException as error:
        _clear(home, {one.name for one in before})
        if isinstance(error, OSError) and error.errno == errno.EFBIG:
            other = "save the recording itself" if asked.call < 0 else "use `companion incident`"
            raise PackingError(f"it is larger than {most >> 20} MB: {other}") from error
        raise
    for kind, path in files.items():
        os.replace(path, home / f"{name}{kind}.zip")
    _clear(home, {name, *(one.name for one in before[: MOST_KEPT - 1])})
    note = "" if windows else f"without a recording: {asked.not_recorded or 'nothing was recorded then'}"
    whole, short = ((home / f"{name}{kind}.zip").stat().st_size for kind in ("", SHORT))
    return Packed(number, asked.call, whole, short, note)


def _clear(home: Path, names: Iterable[str]) -> None:
    """Delete all but the files of these incidents, also what a killed process has left half done."""
    stay = {f"{name}{kind}.zip" for name in names for kind in ("", SHORT)}
    for path in home.iterdir():
        if path.name not in stay and read_name(path.name.removeprefix(".")) is not None:
            path.unlink(missing_ok=True)


def main(channel: int) -> NoReturn:
    """Pack what the supervisor asks for, tell it, and end. channel: a descriptor of a socket."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the supervisor ends it
    resource.setrlimit(resource.RLIMIT_DATA, (_MOST_MEMORY, resource.RLIM_INFINITY))
    log_to_stderr(logging.WARNING)
    supervisor = socket.socket(fileno=channel)
    supervisor.settimeout(_SETUP_WITHIN)
    try:
        supervisor.send(_told(supervisor.recv(LONGEST)))
    except BaseException:
        log.critical("packing failed", exc_info=True)
        end_process(1)
    end_process(0)


def _told(asked: bytes) -> bytes:
    """Carry out what is asked for; return what became of it."""
    told: Mapping[str, Any]
    try:
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        told = pack(PackingRequest(**json.loads(asked)), _not_interrupted).document()
    except KeyboardInterrupt:
        told = {"why": CANCELLED}
    except PackingError as error:
        told = {"why": str(error)}
    except OSError as error:
        told = {"why": f"the disk: {(error.strerror or str(error)).lower()}"}
    except MemoryError:
        told = {"why": "it needs too much memory: use `companion incident`"}
    return json.dumps(told).encode()


def _not_interrupted() -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
