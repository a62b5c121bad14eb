"""Runs `companion record` and `companion incident`: lists and repairs recordings, and packs one to send."""

from __future__ import annotations

import json
import re
import time
from pathlib import Path
from typing import Any

from companion.config import format_config, load_config, state_folder
from companion.observers.recording import incident
from companion.observers.recording.foxglove import NS
from companion.observers.recording.recorder import missing
from companion.observers.recording.ring import FOLDER, recordings

_CALL = re.compile(r"[CHch]?([0-9]{1,5})", re.ASCII)
_SECONDS = re.compile(r"([0-9]{1,6})\s*(s|m|min|h)?", re.ASCII)
_UNITS = {None: 1, "s": 1, "m": 60, "min": 60, "h": 3600}
HEAD = f"{'recording':<20}  {'begins':<19}  {'s':>4}  {'MB':>6}  {'frames':>6}  what"


class RecordError(Exception):
    """The command cannot be carried out. The text says what to do."""


def show_list(file: str, *, as_json: bool = False) -> int:
    """Print one line for each recording. Raises RecordError, ConfigError, OSError."""
    folder = _state(file)
    found = [folder / FOLDER / one.name for one in recordings(folder / FOLDER)]
    if found:
        _need_packages()
    rows = [_row(path) for path in found]
    if as_json:
        print(json.dumps({"folder": str(folder / FOLDER), "recordings": rows}))
        return 0
    print(f"{len(rows)} recordings, {sum(row['bytes'] for row in rows) / 1e6:.1f} MB, in {folder / FOLDER}")
    if rows:
        print(HEAD)
    for row in rows:
        begins = ""
        if row["begins"] is not None:
            begins = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(row["begins"]))
        what = ", ".join(row["events"]) + ("" if row["finished"] else " (being written, or torn)")
        print(
            f"{row['file']:<20}  {begins:<19}  {row['seconds']:>4.0f}  {row['bytes'] / 1e6:>6.1f}  "
            f"{row['frames']:>6}  {what.strip()}"
        )
    return 0


def repair(path: str) -> int:
    """Write a torn recording anew with its index. Raises RecordError, OSError."""
    _need_packages()
    from companion.observers.recording import reading

    torn = Path(path)
    if not torn.is_file():
        raise RecordError(f"{path}: there is no such file: `companion record list` names them")
    if reading.whole(torn):
        print(f"{path}: is whole, left as it is")
        return 0
    try:
        count = reading.repair(torn)
    except BlockingIOError:
        raise RecordError(f"{path}: is being written: repair a copy of it") from None
    if not count:
        raise RecordError(f"{path}: no message in it can be read, left as it is")
    print(f"{path}: {count} messages are whole, and have an index again")
    return 0


def pack(file: str, call: str | None, last: str | None, out: str | None) -> int:
    """Write one file about a call, or about the last seconds. Raises RecordError, ConfigError, OSError."""
    if (call is None) == (last is None):
        raise RecordError("name a call (C7) or a time (--last 60s)")
    folder = _state(file)
    recorded = not missing()
    if call is not None:
        named = _CALL.fullmatch(call)
        if named is None:
            raise RecordError(f"{call} is no call: give C7, H7 or 7")
        number = int(named[1])
        name, what, calls = f"C{number}", f"call or hold {number}", [number]
        windows = incident.around_call(folder, number) if recorded else []
        there = bool(windows) or (folder / "calls" / f"{number}.json").is_file()
        if not there:
            raise RecordError(
                f"nothing of {number} is left in {folder}: `companion record list` says what is recorded"
            )
    else:
        seconds = _seconds(last or "")
        name, what, calls = f"last-{seconds:.0f}s", f"the last {seconds:.0f} s", []
        windows = incident.last(folder, seconds) if recorded else []
    path = Path(out or f"incident-{name}.zip")
    try:
        packed = incident.write_incident(path, folder, format_config(load_config(file)), windows, calls, what)
    except FileExistsError:
        raise RecordError(f"{path}: is there already: name another one with --out") from None
    print(f"{path}: {packed.messages} messages, {path.stat().st_size / 1e6:.1f} MB")
    if not windows:
        why = missing() or "nothing was recorded then"
        print(f"  without a recording: {why}")
    for line in packed.left_out:
        print(f"  left out: {line}")
    print("  pictures, positions and the log are in it: look through it before you give it to others")
    return 0


def _state(file: str) -> Path:
    return state_folder(load_config(file))


def _need_packages() -> None:
    if why := missing():
        raise RecordError(why)


def _seconds(text: str) -> float:
    found = _SECONDS.fullmatch(text)
    if found is None or int(found[1]) == 0:
        raise RecordError(f'"{text}" is no time: give 60s, 5m or 1h')
    return float(int(found[1]) * _UNITS[found[2]])


def _row(path: Path) -> dict[str, Any]:
    from companion.observers.recording.listing import listed

    found = listed(path)
    return {
        "file": path.name,
        "bytes": path.stat().st_size,
        "begins": found.begin / NS if found.begin else None,
        "seconds": round((found.end - found.begin) / NS, 1),
        "frames": found.frames,
        "finished": found.finished,
        "events": list(dict.fromkeys(one.text for one in found.happened)),
    }
