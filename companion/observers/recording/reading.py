"""Reads recordings, also those that end anywhere because their writer was killed, and repairs them.

A file may come from anybody: what is read of it at once is bounded, and what is damaged is left out.
"""

from __future__ import annotations

import fcntl
import io
import itertools
import os
import zlib
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import IO, Any, BinaryIO, NamedTuple

import lz4.frame
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, ChunkIndex, Schema
from mcap.records import Message as Written
from mcap.stream_reader import StreamReader
from mcap.summary import Summary as Index
from mcap.writer import CompressionType, Writer

from anytraverse.regular_file import open_regular

_MAGIC = b"\x89MCAP0\r\n"
_LARGEST_RECORD = 16 << 20
"""Bytes of a record, of a chunk's records together, and of all schemas and channels that are held, at most:
ours have some 6 MiB."""
_OF_A_TEXT = 100
"""Bytes of memory that a text takes beside its letters."""


class Read(NamedTuple):
    """A message that was read, with its channel and schema; schema None: it has none."""

    schema: Schema | None
    channel: Channel
    message: Written


def read(file: IO[bytes]) -> Iterator[Read]:
    """Yield all messages up to the end, or to the first byte that is no MCAP; a damaged chunk is left out.

    Raises OSError.
    """
    yield from _messages(_flat(_records(file)), {}, {})


def _flat(records: Iterator[Any]) -> Iterator[Any]:
    """Yield records, of a chunk those in it."""
    for record in records:
        if isinstance(record, Chunk):
            yield from _records(io.BytesIO(_content(record)), magic=False)
        else:
            yield record


def _messages(
    records: Iterator[Any], schemas: dict[int, Schema], channels: dict[int, Channel]
) -> Iterator[Read]:
    left = _LARGEST_RECORD
    for record in records:
        if isinstance(record, Schema):
            if record.id not in schemas and (left := left - _size(record)) > 0:
                schemas[record.id] = record
        elif isinstance(record, Channel):
            if record.id not in channels and (left := left - _size(record)) > 0:
                channels[record.id] = record
        elif isinstance(record, Written) and record.channel_id in channels:
            channel = channels[record.channel_id]
            yield Read(schemas.get(channel.schema_id), channel, record)


def _size(record: Schema | Channel) -> int:
    """Return about how many bytes of memory a record takes."""
    if isinstance(record, Schema):
        return _OF_A_TEXT + len(record.name) + len(record.encoding) + len(record.data)
    texts = (record.topic, record.message_encoding, *record.metadata, *record.metadata.values())
    return sum(_OF_A_TEXT + len(one) for one in texts)


def _records(file: IO[bytes], *, magic: bool = True) -> Iterator[Any]:
    """Yield records, chunks as they are, up to the first byte that is none. Raises OSError."""
    reader = StreamReader(file, skip_magic=not magic, emit_chunks=True, record_size_limit=_LARGEST_RECORD)
    records = iter(reader.records)
    while True:
        try:
            record = next(records)
        except OSError:
            raise
        except Exception:  # a torn end may be anything, and the reader raises whatever it leads to
            return
        yield record


def _content(chunk: Chunk) -> bytes:
    """Return a chunk's records; b"" for one that is damaged, larger than ours, or compressed otherwise.

    Its own statement of its size is believed only where it says that it is too large.
    """
    data: bytes = chunk.data
    if chunk.uncompressed_size >= _LARGEST_RECORD:
        return b""
    if chunk.compression == "lz4":
        unpacking = lz4.frame.LZ4FrameDecompressor()
        try:
            data = unpacking.decompress(chunk.data, max_length=_LARGEST_RECORD)
        except RuntimeError:
            return b""
        if not unpacking.eof:
            return b""
    elif chunk.compression == "zstd":
        data = _unpacked(chunk.data)
    elif chunk.compression:
        return b""
    right = chunk.uncompressed_crc in (0, zlib.crc32(data))
    return data if right and len(data) < _LARGEST_RECORD else b""


def _unpacked(packed: bytes) -> bytes:
    """Return what zstd packed: other programs write MCAP so."""
    import zstandard

    try:
        return (
            zstandard.ZstdDecompressor(max_window_size=_LARGEST_RECORD)
            .stream_reader(packed)
            .read(_LARGEST_RECORD)
        )
    except zstandard.ZstdError:
        return b""


def _opened(path: Path) -> BinaryIO:
    return os.fdopen(open_regular(path), "rb")


def whole(path: Path) -> bool:
    """Whether a recording was finished, so that it has its index. Raises OSError."""
    with _opened(path) as file:
        file.seek(0, os.SEEK_END)
        if file.tell() < 2 * len(_MAGIC):
            return False
        file.seek(-len(_MAGIC), os.SEEK_END)
        return file.read() == _MAGIC


def messages(
    path: Path, topics: Collection[str] | None = None, begin: int | None = None, end: int | None = None
) -> Iterator[Read]:
    """Yield a recording's messages, as far as it can be read; a finished one is read by its index.

    topics: their names, None: all. begin, end: ns since 1970, end not included. None for a recording that the
    ring has deleted meanwhile. Raises OSError.
    """
    try:
        indexed = whole(path)
        with _opened(path) as file:
            index = _index(file) if indexed else None
            if index is None or not index.chunk_indexes:
                file.seek(0)
                found = read(file)
            else:
                records = _flat(_chunks(file, index, topics, begin, end))
                found = _messages(records, dict(index.schemas), dict(index.channels))
            for one in found:
                at = one.message.log_time
                right = topics is None or one.channel.topic in topics
                if right and (begin is None or at >= begin) and (end is None or at < end):
                    yield one
    except FileNotFoundError:
        return


def _index(file: IO[bytes]) -> Index | None:
    """Return what the end of a finished recording says of it, None for a damaged one."""
    try:
        return SeekingReader(file, record_size_limit=_LARGEST_RECORD).get_summary()
    except Exception:  # it may lead anywhere, also before the file's beginning
        return None


def _chunks(
    file: IO[bytes], index: Index, topics: Collection[str] | None, begin: int | None, end: int | None
) -> Iterator[Any]:
    """Yield the chunks that may have something of these topics and times, in the order of the file."""
    others = set[int]()
    if topics is not None:
        others = {number for number, channel in index.channels.items() if channel.topic not in topics}

    def needed(one: ChunkIndex) -> bool:
        if begin is not None and one.message_end_time < begin:
            return False
        if end is not None and one.message_start_time >= end:
            return False
        return not one.message_index_offsets or not others.issuperset(one.message_index_offsets)

    size = file.seek(0, os.SEEK_END)
    for offset in sorted({one.chunk_start_offset for one in index.chunk_indexes if needed(one)}):
        file.seek(min(offset, size))
        yield from (one for one in itertools.islice(_records(file, magic=False), 1) if isinstance(one, Chunk))


class _Summary(NamedTuple):
    """What a recording holds. begin, end: ns since 1970, 0 without a message. counts: topic -> messages."""

    begin: int
    end: int
    counts: Mapping[str, int]
    finished: bool


def summary(path: Path) -> _Summary:
    """Summarize a recording, of a finished one by its index. Raises OSError."""
    if finished := whole(path):
        with _opened(path) as file:
            index = _index(file)
        if index is not None and (told := index.statistics) is not None:
            names = {number: channel.topic for number, channel in index.channels.items()}
            counts = {names.get(number, "?"): count for number, count in told.channel_message_counts.items()}
            return _Summary(told.message_start_time, told.message_end_time, counts, finished)
    counted = Counter[str]()
    times = [0]
    for one in messages(path):
        counted[one.channel.topic] += 1
        at = one.message.log_time
        times = [at, at] if times == [0] else [min(times[0], at), max(times[1], at)]
    return _Summary(times[0], times[-1], counted, finished)


class Copy:
    """Writes messages of other recordings into a new file."""

    def __init__(self, out: IO[bytes], compression: CompressionType = CompressionType.LZ4) -> None:
        self._writer = Writer(out, compression=compression)
        self._writer.start()
        self._channels: dict[str, int] = {}
        self.messages = 0

    def add(self, one: Read, at: int | None = None) -> None:
        """Add a message. at: ns since 1970 to log it at, None: as it was."""
        topic, message = one.channel.topic, one.message
        if topic not in self._channels:
            schema = 0
            if one.schema is not None:
                schema = self._writer.register_schema(one.schema.name, one.schema.encoding, one.schema.data)
            self._channels[topic] = self._writer.register_channel(
                topic, one.channel.message_encoding, schema, dict(one.channel.metadata)
            )
        logged = message.log_time if at is None else at
        number = self._channels[topic]
        self._writer.add_message(number, logged, message.data, message.publish_time, message.sequence)
        self.messages += 1

    def finish(self) -> None:
        """Write the index."""
        self._writer.finish()


def lock(file: IO[bytes]) -> None:
    """Take a recording for its writer, until it is closed. Raises BlockingIOError while another has it."""
    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def repair(path: Path) -> int:
    """Write a torn recording anew with its index, in place, and return the number of its messages.

    One of which nothing can be read stays as it is; the other one, too, until the new one is complete. Raises
    OSError, BlockingIOError while it is being written.
    """
    partial = path.with_name(f".{path.name}.part")
    with _opened(path) as torn:
        lock(torn)
        try:
            with partial.open("wb") as file:
                copy = Copy(file)
                for one in read(torn):
                    copy.add(one)
                copy.finish()
                file.flush()
                os.fsync(file.fileno())
            if copy.messages:
                os.replace(partial, path)
        finally:
            partial.unlink(missing_ok=True)
    return copy.messages
