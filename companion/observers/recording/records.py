"""Reads the records of MCAP files that may come from anybody: what is read at once is bounded."""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import IO, Any, BinaryIO

import lz4.frame
from mcap.records import Channel, Chunk, Schema
from mcap.stream_reader import StreamReader

from anytraverse.regular_file import open_regular

MAGIC = b"\x89MCAP0\r\n"
LARGEST_RECORD = 16 << 20
"""Bytes of a record, of a chunk's records together, and of all schemas and channels that are held, at most:
ours have some 6 MiB."""

_OF_A_TEXT = 100
"""Bytes of memory that a text takes beside its letters."""


def opened(path: Path) -> BinaryIO:
    """Open a file. Raises OSError, for anything else than a regular one, too."""
    return os.fdopen(open_regular(path), "rb")


def records(file: IO[bytes], *, magic: bool = True) -> Iterator[Any]:
    """Yield records, chunks as they are, up to the first byte that is none. Raises OSError."""
    reader = StreamReader(file, skip_magic=not magic, emit_chunks=True, record_size_limit=LARGEST_RECORD)
    found = iter(reader.records)
    while True:
        try:
            record = next(found)
        except OSError:
            raise
        except Exception:  # a torn end may be anything, and the reader raises whatever it leads to
            return
        yield record


def content_of(chunk: Chunk) -> bytes:
    """Return a chunk's records; b"" for one that is damaged, larger than ours, or compressed otherwise.

    Its own statement of its size is believed only where it says that it is too large.
    """
    data: bytes = chunk.data
    if chunk.uncompressed_size >= LARGEST_RECORD:
        return b""
    if chunk.compression == "lz4":
        unpacking = lz4.frame.LZ4FrameDecompressor()
        try:
            data = unpacking.decompress(chunk.data, max_length=LARGEST_RECORD)
        except RuntimeError:
            return b""
        if not unpacking.eof:
            return b""
    elif chunk.compression == "zstd":
        data = _unpacked(chunk.data)
    elif chunk.compression:
        return b""
    right = chunk.uncompressed_crc in (0, zlib.crc32(data))
    return data if right and len(data) < LARGEST_RECORD else b""


def _unpacked(packed: bytes) -> bytes:
    """Return what zstd packed: other programs write MCAP so."""
    import zstandard

    try:
        return (
            zstandard.ZstdDecompressor(max_window_size=LARGEST_RECORD)
            .stream_reader(packed)
            .read(LARGEST_RECORD)
        )
    except zstandard.ZstdError:
        return b""


class Known:
    """Keeps the schemas and channels of a recording, by id, as far as `LARGEST_RECORD` goes."""

    def __init__(self, known: Iterable[Schema | Channel] = ()) -> None:
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self._left = LARGEST_RECORD
        for one in known:
            self.take(one)

    def take(self, record: Any) -> None:
        """Keep a record that is a schema or a channel, the first one of its id."""
        if isinstance(record, Schema) and record.id not in self.schemas:
            if self._has_room(record.name, record.encoding, record.data):
                self.schemas[record.id] = record
        elif isinstance(record, Channel) and record.id not in self.channels:
            more = record.metadata
            if self._has_room(record.topic, record.message_encoding, *more, *more.values()):
                self.channels[record.id] = record

    def _has_room(self, *texts: str | bytes) -> bool:
        self._left -= sum(_OF_A_TEXT + len(one) for one in texts)
        return self._left > 0
