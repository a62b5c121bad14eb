"""Reads the signing key, and stores timestamps of signed frames, so that none is replayed after a restart.

No frame waits for the disk: a thread writes what has changed in a turn, and syncs it every 5 s, or at once
after a jump. So a killed process loses what it used in its last moment, and a power cut some seconds more.
What the next run signs is newer all the same: after a kill by a second, which is 100,000 frames, if the clock
is not ahead by itself. After the next boot all timestamps count as 15 s newer.

A disk that hangs is a `trouble` after 10 s, when those 15 s are used up, and frames go on: a vehicle without
heartbeats is worse. Frames that are received in that time could be replayed, should the process be killed.
"""

from __future__ import annotations

import contextlib
import os
import stat
import struct
import threading
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from anytraverse.regular_file import read_regular
from companion.system.atomic_write import write_durably
from companion.wire.signing import KEY_BYTES, MAX_STREAMS, TICKS, SignedStream, SigningKey, Timestamps

_LARGEST = 256
_OTHERS = 0o077
_NOT_OURS = "the signing key {path} belongs to another user: chown it to the user who runs this program"
NAME = "signing.state"
SYNC_EVERY = 5.0
HANGS_AFTER = 10.0
"""Seconds after which a disk that does not take what is written counts as hanging."""
CLOSE_WITHIN = 1.0
RESERVE = int((SYNC_EVERY + HANGS_AFTER) * TICKS)
"""What is added to each timestamp after a boot without a clean end, for those that were not synced."""
OWN_RESERVE = TICKS
"""What is added to the newest of all after a kill, for our own that were not written."""
_MAGIC = b"ATS1"
_HEAD = struct.Struct("<4s16sQQI")
_ROW = struct.Struct("<BBBxQI")
_SIZE = _HEAD.size + MAX_STREAMS * _ROW.size
_CLOSED = bytes(16)
"""In place of the boot id, after a clean end: all timestamps are on disk."""


class SigningKeyError(ValueError):
    """A key file cannot be used; the message says what to do, and does not quote the file."""


def read_key(path: Path) -> SigningKey:
    """Read the key in `path`: 32 raw bytes or 64 hex digits. Raises SigningKeyError."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    except FileNotFoundError:
        raise SigningKeyError(f"there is no signing key {path}: make one, or take the setting out") from None
    except PermissionError:
        raise SigningKeyError(_NOT_OURS.format(path=path)) from None
    except OSError as error:
        raise SigningKeyError(f"signing key {path}: {(error.strerror or str(error)).lower()}") from None
    try:
        _check_rights(path, os.fstat(descriptor))
        return _parse(path, os.read(descriptor, _LARGEST))
    finally:
        os.close(descriptor)


def _check_rights(path: Path, status: os.stat_result) -> None:
    if not stat.S_ISREG(status.st_mode):
        raise SigningKeyError(f"signing key {path} is no file")
    if status.st_mode & _OTHERS:
        raise SigningKeyError(f"others may open the signing key {path}: chmod 600 {path}")
    if os.geteuid() != 0 and status.st_uid not in (0, os.geteuid()):
        raise SigningKeyError(_NOT_OURS.format(path=path))


def _parse(path: Path, content: bytes) -> SigningKey:
    if len(content) == KEY_BYTES:
        secret = content
    else:
        try:
            secret = bytes.fromhex(content.decode("ascii").strip())
        except ValueError:
            secret = b""
    if len(secret) != KEY_BYTES:
        raise SigningKeyError(f"the signing key {path} is neither 32 bytes nor 64 hex digits: make it again")
    if not any(secret):
        raise SigningKeyError(f"the signing key {path} is all zeros, which means no signing: make another")
    return SigningKey(secret)


@dataclass(frozen=True)
class _Saved:
    boot: bytes
    last: int
    floor: int
    rows: dict[SignedStream, int]
    whole: bool


class _Content(NamedTuple):
    """What `Timestamps` holds."""

    last: int
    floor: int
    streams: dict[SignedStream, int]


class TimestampFile:
    """Stores timestamps in `folder`/signing.state. Only its making and `close` wait for the disk.

    timestamps: those of the last run, to go on with. notice: what was wrong with the file at the start, ""
    for nothing. trouble: why it cannot be written now.
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
        self._given = self._content()
        self._synced, self._synced_at = self._given.streams, float("-inf")
        self._changed = threading.Condition()
        self._waiting: _Content | None = None
        self._waits_since: float | None = None
        """Monotonic seconds since which something is being written, or waits; None: all is written."""
        self._sync_due = self._closing = False
        write_durably(self._path, _packed(self._boot, self._given))
        self._path.chmod(0o600)
        self._descriptor = os.open(self._path, os.O_RDWR | os.O_CLOEXEC)
        self._thread = threading.Thread(target=self._run, name="signing-state", daemon=True)
        self._thread.start()

    def tick(self, now: float) -> None:
        """Have what has changed written, and synced when that is due. now: monotonic seconds."""
        content = self._content()
        changed, self._given = content != self._given, content
        # A stream that moved on by more than the reserve since the last sync could be replayed after a power
        # cut.
        jumped = any(at > self._synced.get(stream, 0) + RESERVE for stream, at in content.streams.items())
        is_old = content.streams != self._synced and now - self._synced_at >= SYNC_EVERY
        if jumped or is_old:
            self._synced, self._synced_at = content.streams, now
        with self._changed:
            if changed or jumped or is_old:
                self._waiting = content
                self._sync_due |= jumped or is_old
                self._changed.notify_all()
            if self._waiting is not None and self._waits_since is None:
                self._waits_since = now
            if self._waits_since is not None and now - self._waits_since > HANGS_AFTER:
                self.trouble = "the disk hangs"

    def close(self) -> None:
        """Mark the file as complete and sync it. Gives up after `CLOSE_WITHIN` s when the disk hangs."""
        with self._changed:
            self._waiting, self._sync_due, self._closing = self._content(), True, True
            self._changed.notify_all()
        self._thread.join(CLOSE_WITHIN)

    def _content(self) -> _Content:
        return _Content(self.timestamps.last, self.timestamps.floor, dict(self.timestamps.streams))

    def _run(self) -> None:
        while True:
            with self._changed:
                self._waits_since = None
                self._changed.notify_all()
                self._changed.wait_for(lambda: self._waiting is not None)
                content, self._waiting = self._waiting, None
                sync, self._sync_due = self._sync_due, False
                closing = self._closing
            assert content is not None
            written = self._write(_packed(self._boot, content), sync=sync)
            if closing:
                # It says that the rows are there, and so comes after them.
                if written:
                    self._write(_head(_CLOSED, content), sync=True)
                os.close(self._descriptor)
                return

    def _write(self, content: bytes, *, sync: bool) -> bool:
        try:
            os.pwrite(self._descriptor, content, 0)
            if sync:
                os.fdatasync(self._descriptor)
        except OSError as error:
            self.trouble = error.strerror or str(error)
            return False
        self.trouble = ""
        return True

    def _load(self, clock: int) -> Timestamps:
        try:
            saved = _unpack(read_regular(self._path, _SIZE + 1))
        except FileNotFoundError:
            return Timestamps()
        if saved.whole and saved.boot == _CLOSED:
            reserve = own = 0
        elif saved.whole and saved.boot == self._boot:
            reserve, own = 0, OWN_RESERVE
        else:
            reserve = own = RESERVE
        rows = {stream: at + reserve for stream, at in saved.rows.items()}
        last = max([saved.last + own, *rows.values()])
        if saved.whole:
            return Timestamps(last, saved.floor, rows)
        self.notice = f"{self._path} was damaged and is written anew: only frames newer than now are accepted"
        newest = max(last, clock)
        return Timestamps(newest, newest)


def newest_stored(folder: Path) -> int:
    """Return the newest timestamp in `folder`/signing.state; 0 where there is none. Raises OSError."""
    try:
        return _unpack(read_regular(folder / NAME, _SIZE + 1)).last
    except FileNotFoundError:
        return 0


def _packed(boot: bytes, content: _Content) -> bytes:
    rows = b"".join(_row(stream, at) for stream, at in content.streams.items())
    return (_head(boot, content) + rows).ljust(_SIZE, b"\0")


def _head(boot: bytes, content: _Content) -> bytes:
    head = _HEAD.pack(_MAGIC, boot, content.last, content.floor, 0)[:-4]
    return head + zlib.crc32(head).to_bytes(4, "little")


def _row(stream: SignedStream, timestamp: int) -> bytes:
    row = _ROW.pack(*stream, timestamp, 0)[:-4]
    return row + zlib.crc32(row).to_bytes(4, "little")


def _unpack(content: bytes) -> _Saved:
    """Read what is valid; `whole` says whether that is everything."""
    head = content[: _HEAD.size]
    is_intact = len(content) == _SIZE and head[:4] == _MAGIC and _has_valid_checksum(head)
    _, boot, last, floor, _ = _HEAD.unpack(head) if is_intact else (b"", b"", 0, 0, 0)
    rows: dict[SignedStream, int] = {}
    for at in range(_HEAD.size, len(content) - _ROW.size + 1, _ROW.size):
        row = content[at : at + _ROW.size]
        if _has_valid_checksum(row):
            system, component, link, timestamp, _ = _ROW.unpack(row)
            rows[SignedStream(system, component, link)] = timestamp
        elif any(row):
            is_intact = False
    return _Saved(boot, last, floor, rows, is_intact)


def _has_valid_checksum(record: bytes) -> bool:
    return any(record) and zlib.crc32(record[:-4]).to_bytes(4, "little") == record[-4:]


def _boot_id() -> bytes:
    with contextlib.suppress(OSError, ValueError):
        return bytes.fromhex(Path("/proc/sys/kernel/random/boot_id").read_text().strip().replace("-", ""))
    return os.urandom(16)
