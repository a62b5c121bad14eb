"""Defines and takes what supervisor and recording process say to each other: datagrams (SOCK_SEQPACKET)."""

from __future__ import annotations

import contextlib
import select
import socket
import struct
import time
from collections.abc import Callable, Iterator
from typing import NamedTuple

from companion.observers.recording.topics import Topic

LARGEST = 5 << 20
"""Bytes of a message. A frame of `vision.messages.LARGEST_JPEG` fits."""
LARGEST_PART = 64 << 10
"""Bytes of a datagram: it needs no large piece of the kernel's memory."""
_HEADER = struct.Struct("<BBIQ")
_MORE, _LAST = b"+", b"."
BEAT = 0.5
"""Seconds between two reports."""


class RecordedMessage(NamedTuple):
    """One message of an MCAP file.

    at: when it was so, in ns since 1970. data: encoded as `TOPICS` says. sequence: id of the frame that it
    belongs to, 0: none. event: whether it is about a call, a hold or a fault, so that its surroundings are
    kept longest.
    """

    topic: Topic
    at: int
    data: bytes
    sequence: int = 0
    event: bool = False


def datagrams(message: RecordedMessage) -> list[bytes]:
    """Encode a message for the recording process. Raises ValueError for one that is too long."""
    if len(message.data) > LARGEST:
        raise ValueError(f"{len(message.data)} bytes, at most {LARGEST} are recorded")
    header = _HEADER.pack(message.topic, message.event, message.sequence, message.at)
    return list(_parts(header + message.data))


def _parts(packed: bytes) -> Iterator[bytes]:
    step = LARGEST_PART - 1
    for begin in range(0, len(packed), step):
        end = begin + step
        yield (_MORE if end < len(packed) else _LAST) + packed[begin:end]


def ends_message(part: bytes) -> bool:
    """Whether a datagram of ours is a message's last one."""
    return part[:1] == _LAST


class Joiner:
    """Joins datagrams to messages."""

    def __init__(self) -> None:
        self._waiting = bytearray()

    def feed(self, part: bytes) -> RecordedMessage | None:
        """Take a datagram, and return the message that it completes. Raises ValueError for other bytes."""
        mark = part[:1]
        if mark not in (_MORE, _LAST) or len(self._waiting) + len(part) > LARGEST + LARGEST_PART:
            self._waiting.clear()
            raise ValueError("no part of a message")
        self._waiting += part[1:]
        if mark == _MORE:
            return None
        packed, self._waiting = bytes(self._waiting), bytearray()
        if len(packed) < _HEADER.size:
            raise ValueError("a message without a header")
        topic, event, sequence, at = _HEADER.unpack_from(packed)
        return RecordedMessage(Topic(topic), at, packed[_HEADER.size :], sequence, bool(event))


_REPORT = struct.Struct("<IQQQ")
LONGEST_REPORT = _REPORT.size + 256


class RecordingReport(NamedTuple):
    """Tells how the recording goes: all there is in the folder, and what this process did since its start.

    files, size: recordings on disk, and their bytes. written, lost: messages. trouble: what is wrong with the
    disk, "" while all is well.
    """

    files: int = 0
    size: int = 0
    written: int = 0
    lost: int = 0
    trouble: str = ""

    def encoded(self) -> bytes:
        """Encode it for the supervisor. A long trouble is cut."""
        numbers = _REPORT.pack(self.files, self.size, self.written, self.lost)
        return numbers + self.trouble.encode()[: LONGEST_REPORT - _REPORT.size]

    @classmethod
    def decoded(cls, packed: bytes) -> RecordingReport:
        """Decode it. Raises ValueError for any other bytes."""
        if not _REPORT.size <= len(packed) <= LONGEST_REPORT:
            raise ValueError("no report")
        trouble = packed[_REPORT.size :].decode(errors="replace")
        if trouble and not trouble.isprintable():
            raise ValueError("a trouble that cannot be printed")
        files, size, written, lost = _REPORT.unpack_from(packed)
        return cls(files, size, written, lost, trouble)


def take_messages(
    descriptor: int, take: Callable[[RecordedMessage], None], report: Callable[[], bytes]
) -> None:
    """Take messages until the supervisor has closed the channel, or is gone.

    descriptor: of the channel. report: what is told twice a second. Neither may wait. Raises ValueError for
    what is no message.
    """
    joiner, reported_at = Joiner(), float("-inf")
    with (
        contextlib.suppress(ConnectionResetError, BrokenPipeError),
        socket.socket(fileno=descriptor) as channel,
    ):
        channel.settimeout(0)
        while True:
            now = time.monotonic()
            if now - reported_at >= BEAT:
                reported_at = now
                with contextlib.suppress(BlockingIOError):
                    channel.send(report())
            if not select.select([channel], [], [], BEAT)[0]:
                continue
            part = channel.recv(LARGEST_PART)
            if not part:
                return
            if (message := joiner.feed(part)) is not None:
                take(message)
