"""Writes one MCAP file, of a size that is known before it is written, in chunks that are whole on disk."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from mcap.writer import CompressionType, Writer

from anytraverse.release import own_version
from companion.observers.recording.messages import RecordedMessage
from companion.observers.recording.reading import lock
from companion.observers.recording.topics import TOPICS, Topic

_CHUNK = 1 << 20
"""Bytes after which a chunk is written, whenever the next `flush` may be."""
_OF_A_MESSAGE = 64
"""Bytes of a message beside its data, with its place in the index, at most."""
_OF_A_CHUNK = 256 + 64 * len(TOPICS)
_OF_THE_FILE = 4096 + 2 * sum(len(row.schema_data) + 256 for row in TOPICS.values())
"""Bytes of head and end, at most: schemas and channels stand in both."""
SMALLEST = 4 * _OF_THE_FILE
"""Bytes that a file must be allowed to have."""


class McapFile:
    """Writes messages. Each chunk that `flush` has written is found again, whatever happens to the rest.

    unwritten: messages of the chunk in progress.
    """

    def __init__(self, path: Path, most: int) -> None:
        """Create the file. most: bytes that it may have in the end. Raises OSError."""
        self.path = path
        self.unwritten = 0
        self._most = most
        self._file = path.open("xb")
        self._channels: dict[Topic, int] = {}
        self._waiting = 0
        """Bytes, at most, of what the chunk in progress will have."""
        self._chunks = 0
        """Those that are written."""
        try:
            lock(self._file)
            self._writer = Writer(self._file, chunk_size=_CHUNK, compression=CompressionType.LZ4)
            self._writer.start(library=f"anytraverse-companion {own_version()}")
        except OSError:
            self.abandon()
            raise

    @property
    def size(self) -> int:
        """Bytes that the file would have, at most, if it were finished now."""
        ending = _OF_THE_FILE + (self._chunks + 2) * _OF_A_CHUNK
        # What cannot be compressed grows by less than a hundredth.
        return self._file.tell() + self._waiting + self._waiting // 100 + ending

    def fits(self, message: RecordedMessage) -> bool:
        """Whether the file may hold this message, too."""
        return self.size + bytes_of(message) <= self._most

    def add(self, message: RecordedMessage) -> None:
        """Add a message. Raises OSError."""
        if message.topic not in self._channels:
            self._channels[message.topic] = self._register(message.topic)
        self.unwritten += 1
        self._waiting += bytes_of(message)
        self._writer.add_message(
            self._channels[message.topic], message.at, message.data, message.at, message.sequence
        )
        if self._waiting > _CHUNK // 2:
            self.flush()

    def flush(self) -> None:
        """Write the chunk in progress. Raises OSError."""
        if self._waiting:
            self._writer.flush()
            self._waiting, self._chunks, self.unwritten = 0, self._chunks + 1, 0

    def sync(self) -> None:
        """Wait until what is written is on the disk. Raises OSError."""
        os.fdatasync(self._file.fileno())

    def rename(self, name: str) -> None:
        """Give the file another name in its folder. Raises OSError."""
        self.path = self.path.rename(self.path.with_name(name))

    def finish(self) -> None:
        """Write the index, and close the file. Raises OSError."""
        try:
            self._writer.finish()
            self._file.flush()
            self.sync()
        finally:
            self._file.close()

    def abandon(self) -> None:
        """Close the file as it is: a disk that fails takes no index either. Without a chunk it is deleted."""
        with contextlib.suppress(OSError):
            self._file.close()
        if not self._chunks:
            with contextlib.suppress(OSError):
                self.path.unlink(missing_ok=True)

    def _register(self, topic: Topic) -> int:
        row = TOPICS[topic]
        schema = self._writer.register_schema(row.schema, row.schema_encoding, row.schema_data)
        channel: int = self._writer.register_channel(row.name, row.encoding, schema)
        return channel


def bytes_of(message: RecordedMessage) -> int:
    """Return the bytes of a file that a message takes, at most."""
    return len(message.data) + _OF_A_MESSAGE
