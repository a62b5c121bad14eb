"""Runs the recording process: one thread takes what the supervisor sends, another one writes it."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from pathlib import Path
from typing import NoReturn

from companion.observers.recording.messages import BEAT, RecordedMessage, RecordingReport, take_messages
from companion.observers.recording.ring_writer import RingWriter
from companion.system.child_process import settle_in
from companion.system.log_lines import end_process

log = logging.getLogger(__name__)

_MOST_MEMORY = 256 << 20
MOST_WAITING = 16 << 20
"""Bytes of messages that wait for the disk. Beyond that they are lost, and counted."""
_OF_A_MESSAGE = 512
"""Bytes of memory that one takes beside its data, at most."""
HANGS_AFTER = 5.0
"""Seconds in one call of the disk after which it counts as hanging."""
_LEAVES_WITHIN = 1.5
"""Seconds that the disk has to finish the last recording; the supervisor waits a little longer."""


class Writing(threading.Thread):
    """Writes messages in a thread of its own, since a disk may hang."""

    def __init__(self, ring: RingWriter) -> None:
        super().__init__(name="disk", daemon=True)
        self._ring = ring
        self._waiting: deque[RecordedMessage] = deque()
        self._bytes = 0
        self._changed = threading.Condition()
        self._ending = False
        self._at_disk_since: float | None = None
        self._lost = 0

    def put(self, message: RecordedMessage) -> None:
        """Queue a message, or lose it where too much waits."""
        with self._changed:
            size = len(message.data) + _OF_A_MESSAGE
            if self._bytes + size > MOST_WAITING:
                self._lost += 1
                return
            self._bytes += size
            self._waiting.append(message)
            self._changed.notify()

    def report(self, now: float) -> RecordingReport:
        """Say how it goes. Waits for no disk."""
        found, since = self._ring.report, self._at_disk_since
        hangs = since is not None and now - since > HANGS_AFTER
        trouble = "the disk does not answer" if hangs else found.trouble
        return found._replace(lost=found.lost + self._lost, trouble=trouble)

    def finish(self) -> None:
        """Finish the recording in progress, and end, within `_LEAVES_WITHIN` seconds."""
        with self._changed:
            self._ending = True
            self._changed.notify()
        self.join(_LEAVES_WITHIN)

    def run(self) -> None:
        """Write until `finish`."""
        try:
            self._at_disk_since = time.monotonic()
            self._ring.begin(time.monotonic())
            while (message := self._next()) is not None or not self._ending:
                self._at_disk_since = time.monotonic()
                if message is not None:
                    self._ring.write(message, time.monotonic())
                self._ring.tick(time.monotonic())
            self._ring.finish(time.monotonic())
        except BaseException:
            log.critical("the recorder failed", exc_info=True)
            end_process(1)  # the supervisor starts another one

    def _next(self) -> RecordedMessage | None:
        """Wait for a message, half a second at most."""
        with self._changed:
            self._at_disk_since = None
            if not self._waiting and not self._ending:
                self._changed.wait(BEAT)
            if not self._waiting:
                return None
            message = self._waiting.popleft()
            self._bytes -= len(message.data) + _OF_A_MESSAGE
            return message


def main(descriptor: int, folder: str, most: int) -> NoReturn:
    """Record until the supervisor is gone. descriptor: of the channel. most: bytes of all recordings."""
    settle_in(_MOST_MEMORY)
    writing = Writing(RingWriter(Path(folder), most))
    writing.start()
    code = 0
    try:
        take_messages(descriptor, writing.put, lambda: writing.report(time.monotonic()).encoded())
    except BaseException:
        log.critical("the recorder failed", exc_info=True)
        code = 1
    writing.finish()
    end_process(code)
