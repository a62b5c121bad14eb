"""Stores the timestamps of signed frames, so that frames from before a restart are refused as replays.

Each timestamp is written to the file before its frame counts, so a killed process loses none. The file is
synced to disk every 5 s, so a power cut may lose some. After the next boot, all count as 15 s newer.
"""

from __future__ import annotations

import contextlib
import os
import struct
import threading
import zlib
from dataclasses import dataclass
from pathlib import Path

from companion.system.atomic_write import write_durably
from companion.wire.signing import MAX_STREAMS, TICKS, Stream, Timestamps

NAME = "signing.state"
SYNC_EVERY = 5.0
CLOSE_WITHIN = 1.0
RESERVE = 15 * TICKS
"""What is added to each timestamp after a boot without a clean end, for those that were not synced."""
_MAGIC = b"ATS1"
_HEAD = struct.Struct("<4s16sQQI")
_ROW = struct.Struct("<BBBxQI")
_SIZE = _HEAD.size + MAX_STREAMS * _ROW.size
_CLOSED = bytes(16)
"""In place of the boot id, after a clean end: all timestamps are on disk."""


@dataclass(frozen=True)
class _Saved:
    boot: bytes
    last: int
    floor: int
    rows: dict[Stream, int]
    whole: bool


class TimestampFile:
    """Stores timestamps in `folder`/signing.state.

    notice: what was wrong with the file at the start, "" for nothing. trouble: why it cannot be written now.
    """

    def __init__(self, folder: Path, boot: bytes | None = None, *, clock: int = 0) -> None:
        """boot: 16 bytes, others after each boot of the computer. clock: the time as a timestamp, 0 unknown.

        Raises OSError.
        """
        self._path = folder / NAME
        self._boot = _boot_id() if boot is None else boot
        self.notice = ""
        self.trouble = ""
        self.timestamps = self._load(clock)
        self._slots: dict[Stream, int] = {}
        self._on_disk: dict[Stream, int] = {}
        self._urgent = False
        self._changed = False
        self._synced_at = float("-inf")
        self._syncing: threading.Thread | None = None
        self._rewrite()
        self._descriptor = os.open(self._path, os.O_RDWR | os.O_CLOEXEC)

    def keep(self, stream: Stream) -> None:
        """Write a stream's newest timestamp, and the newest of all, before its frame counts or is sent."""
        if stream not in self._slots:
            self._slots = {known: at for known, at in self._slots.items() if known in self.timestamps.streams}
            free = set(range(MAX_STREAMS)) - set(self._slots.values())
            self._slots[stream] = min(free)
        timestamp = self.timestamps.streams[stream]
        # A stream that moved on by more than the reserve since the last sync could be replayed after a power
        # cut.
        self._urgent |= timestamp > self._on_disk.get(stream, 0) + RESERVE
        self._write(0, self._head(self._boot))
        self._write(_HEAD.size + self._slots[stream] * _ROW.size, _row(stream, timestamp))

    def tick(self, now: float) -> None:
        """Sync the file to disk, in a thread, when that is due."""
        if self._syncing is not None and self._syncing.is_alive():
            return
        if self._urgent or (self._changed and now - self._synced_at >= SYNC_EVERY):
            self._urgent = self._changed = False
            self._synced_at = now
            self._on_disk = dict(self.timestamps.streams)
            self._syncing = threading.Thread(target=self._sync, name="signing-state", daemon=True)
            self._syncing.start()

    def close(self) -> None:
        """Mark the file as complete and sync it. Gives up after `CLOSE_WITHIN` s when the disk hangs."""
        last = threading.Thread(target=self._finish, name="signing-state", daemon=True)
        last.start()
        last.join(CLOSE_WITHIN)

    def _finish(self) -> None:
        if self._syncing is not None:
            self._syncing.join()
        self._write(0, self._head(_CLOSED))
        self._sync()
        os.close(self._descriptor)

    def _write(self, at: int, content: bytes) -> None:
        self._changed = True
        try:
            os.pwrite(self._descriptor, content, at)
            self.trouble = ""
        except OSError as error:
            self.trouble = error.strerror or str(error)

    def _sync(self) -> None:
        try:
            os.fdatasync(self._descriptor)
        except OSError as error:
            self.trouble = error.strerror or str(error)

    def _head(self, boot: bytes) -> bytes:
        head = _HEAD.pack(_MAGIC, boot, self.timestamps.last, self.timestamps.floor, 0)[:-4]
        return head + zlib.crc32(head).to_bytes(4, "little")

    def _rewrite(self) -> None:
        self._slots = {stream: at for at, stream in enumerate(self.timestamps.streams)}
        self._on_disk = dict(self.timestamps.streams)
        rows = b"".join(_row(stream, at) for stream, at in self.timestamps.streams.items())
        write_durably(self._path, (self._head(self._boot) + rows).ljust(_SIZE, b"\0"))
        self._path.chmod(0o600)

    def _load(self, clock: int) -> Timestamps:
        try:
            with self._path.open("rb") as file:
                saved = _unpack(file.read(_SIZE + 1))
        except FileNotFoundError:
            return Timestamps()
        exact = saved.boot in (self._boot, _CLOSED)
        reserve = 0 if exact and saved.whole else RESERVE
        rows = {stream: at + reserve for stream, at in saved.rows.items()}
        last = max([saved.last + reserve, *rows.values()])
        if saved.whole:
            return Timestamps(last, saved.floor, dict(sorted(rows.items(), key=lambda row: row[1])))
        self.notice = f"{self._path} was damaged and is written anew: only frames newer than now are accepted"
        newest = max(last, clock)
        return Timestamps(newest, newest)


def _row(stream: Stream, timestamp: int) -> bytes:
    row = _ROW.pack(*stream, timestamp, 0)[:-4]
    return row + zlib.crc32(row).to_bytes(4, "little")


def _unpack(content: bytes) -> _Saved:
    """Read what is valid; `whole` says whether that is everything."""
    head = content[: _HEAD.size]
    is_intact = len(content) == _SIZE and head[:4] == _MAGIC and _has_valid_checksum(head)
    _, boot, last, floor, _ = _HEAD.unpack(head) if is_intact else (b"", b"", 0, 0, 0)
    rows: dict[Stream, int] = {}
    for at in range(_HEAD.size, len(content) - _ROW.size + 1, _ROW.size):
        row = content[at : at + _ROW.size]
        if _has_valid_checksum(row):
            system, component, link, timestamp, _ = _ROW.unpack(row)
            rows[Stream(system, component, link)] = timestamp
        elif any(row):
            is_intact = False
    return _Saved(boot, last, floor, rows, is_intact)


def _has_valid_checksum(record: bytes) -> bool:
    return any(record) and zlib.crc32(record[:-4]).to_bytes(4, "little") == record[-4:]


def _boot_id() -> bytes:
    with contextlib.suppress(OSError, ValueError):
        return bytes.fromhex(Path("/proc/sys/kernel/random/boot_id").read_text().strip().replace("-", ""))
    return os.urandom(16)
