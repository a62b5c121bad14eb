"""Writes messages into recordings of a minute each, within the ring's size. Time is an input."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator
from pathlib import Path

from companion.observers.recording.mcap_file import SMALLEST, McapFile, bytes_of
from companion.observers.recording.messages import RecordedMessage, RecordingReport
from companion.observers.recording.reading import repair, whole
from companion.observers.recording.ring import (
    LEAST_FREE,
    PARTIAL,
    free_number,
    make_room,
    name_of,
    recordings,
)
from companion.observers.recording.topics import TOPICS, Topic

LONGEST = 60.0
"""Seconds of a recording."""
_FILES = 8
"""Recordings that a ring holds, at least."""
FLUSHED_EVERY = 2.0
"""Seconds after which a chunk is written: what kill -9 loses, at most."""
SYNCED_EVERY = 10.0
"""Seconds after which what is written is on the disk: what a power cut loses, at most."""
_TRIED_AGAIN = 5.0
_JUMP = 60 * 1_000_000_000
"""Nanoseconds between two messages from which the clock was set: then a new recording begins."""


class RingWriter:
    """Writes messages. An error of the disk ends the recording in progress; it is tried again after 5 s.

    report: how it goes. Another thread may read it while this one waits for the disk.
    """

    def __init__(self, folder: Path, most: int) -> None:
        """most: bytes of all recordings together."""
        self._folder = folder
        self._most = most
        self._longest = max(SMALLEST, most // _FILES)
        self._file: McapFile | None = None
        self._empty = 0
        """Bytes with which that recording began."""
        self._number = self._given = 0
        self._event = False
        self._began = self._flushed = self._synced = 0.0
        self._newest = 0
        self._standing: dict[Topic, RecordedMessage] = {}
        self._retry_at = float("-inf")
        self._written = self._lost = 0
        self._files = self._size = 0
        """Of the finished recordings."""
        self._trouble = ""
        self.report = RecordingReport()

    def begin(self, now: float) -> None:
        """Make the folder, and repair what a process that was killed has left. now: monotonic seconds."""
        with self._survived(now):
            self._folder.mkdir(parents=True, exist_ok=True)
            for torn in self._folder.iterdir():
                if PARTIAL.fullmatch(torn.name):
                    with contextlib.suppress(OSError):
                        torn.unlink()
            make_room(self._folder, self._most)
            for one in recordings(self._folder):
                self._repair(self._folder / one.name, one.size)
            self._look()

    def _repair(self, path: Path, size: int) -> None:
        """Give a recording its index where it lacks one. One that cannot be read must not stop the others."""
        with contextlib.suppress(OSError):
            if not size:
                path.unlink()
            elif size <= self._longest and not whole(path) and self._lacking() + self._longest <= 0:
                make_room(self._folder, self._most - self._longest)
                repair(path)

    def write(self, message: RecordedMessage, now: float) -> None:
        """Write a message, or lose it where the disk takes none."""
        before = self._written
        if now >= self._retry_at:
            self._try(message, now)
        if self._written == before:
            self._lost += 1
            self._tell()
        if TOPICS[message.topic].standing:
            self._standing[message.topic] = message

    def _try(self, message: RecordedMessage, now: float) -> None:
        with self._survived(now):
            file = self._file_for(message, now)
            if file.fits(message):
                file.add(message)
                self._written += 1
            if message.event and not self._event:
                self._event = True
                file.rename(name_of(self._number, event=True))

    def tick(self, now: float) -> None:
        """Write and sync what is due."""
        if self._file is None:
            return
        with self._survived(now):
            if now - self._flushed >= FLUSHED_EVERY:
                self._flushed = now
                self._file.flush()
                self._trouble = ""
            if now - self._synced >= SYNCED_EVERY:
                self._synced = now
                self._file.sync()
                if self._lacking() > 0:
                    self._finish()

    def finish(self, now: float) -> None:
        """Finish the recording in progress."""
        with self._survived(now):
            self._finish()

    def _file_for(self, message: RecordedMessage, now: float) -> McapFile:
        """Return the recording for a message: a new one after a minute, or where the message does not fit."""
        jumped = abs(message.at - self._newest) > _JUMP
        self._newest = message.at
        over = jumped or now - self._began >= LONGEST
        full = self._file is not None and not self._file.fits(message)
        # One that fits no recording must not end this one.
        if over or (full and self._empty + bytes_of(message) <= self._longest):
            self._finish()
        return self._file or self._start(message.at, now)

    def _start(self, at: int, now: float) -> McapFile:
        """Start a recording with what holds at `at`. Raises OSError, also where the disk is nearly full."""
        self._folder.mkdir(parents=True, exist_ok=True)  # somebody may have deleted it
        self._look()
        make_room(self._folder, min(self._most - self._longest, self._size - self._lacking()))
        self._look()
        if self._lacking() > 0:
            raise OSError(f"less than {LEAST_FREE >> 20} MiB are free on its disk")
        self._number, self._event = free_number(self._folder, self._number + 1), False
        self._given = self._number
        path = self._folder / name_of(self._number, event=False)
        self._file = file = McapFile(path, self._longest)
        self._began = self._flushed = self._synced = now
        for standing in self._standing.values():
            file.add(standing._replace(at=at))
        self._empty = file.size
        return file

    def _finish(self) -> None:
        file, self._file = self._file, None
        if file is not None:
            file.finish()
            self._trouble = ""
            self._look()

    def _look(self) -> None:
        found = recordings(self._folder)
        self._files, self._size = len(found), sum(one.size for one in found)
        # The number of one that was deleted is not given again: an old list would delete the new one by it.
        self._number = max([self._given, *(one.number for one in found)])

    def _lacking(self) -> int:
        """Return how many bytes fewer are free on the disk than must be; 0 or less: enough are."""
        return LEAST_FREE - shutil.disk_usage(self._folder).free

    @contextlib.contextmanager
    def _survived(self, now: float) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            self._trouble = error.strerror.lower() if error.strerror else str(error)
            self._retry_at = now + _TRIED_AGAIN
            file, self._file = self._file, None
            if file is not None:
                gone = min(file.unwritten, self._written)
                self._written, self._lost = self._written - gone, self._lost + gone
                file.abandon()
        self._tell()

    def _tell(self) -> None:
        file = self._file
        files, size = (self._files, self._size) if file is None else (self._files + 1, self._size + file.size)
        self.report = RecordingReport(files, size, self._written, self._lost, self._trouble)
