"""Reads recordings, also those that end anywhere because their writer was killed, and repairs them.

A file may come from anybody: what is read of it at once is bounded, and what is damaged is left out.
"""

from __future__ import annotations

import fcntl
import io
import os
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import IO, Any, NamedTuple

from mcap.records import Channel, Chunk, ChunkIndex, Schema
from mcap.records import Message as Written
from mcap.summary import Summary as Index
from mcap.writer import CompressionType, Writer

from companion.observers.recording.index import chunk_at, index_of
from companion.observers.recording.records import MAGIC, Known, content_of, opened, records


class Read(NamedTuple):
    """A message that was read, with its channel and schema; schema None: it has none."""

    schema: Schema | None
    channel: Channel
    message: Written


def read(file: IO[bytes]) -> Iterator[Read]:
    """Yield all messages up to the end, or to the first byte that is no MCAP; a damaged chunk is left out.

    Raises OSError.
    """
    yield from _messages(_flat(records(file)), Known())


def _flat(found: Iterator[Any]) -> Iterator[Any]:
    """Yield records, of a chunk those in it."""
    for record in found:
        if isinstance(record, Chunk):
            yield from records(io.BytesIO(content_of(record)), magic=False)
        else:
            yield record


def _messages(found: Iterator[Any], known: Known) -> Iterator[Read]:
    for record in found:
        if isinstance(record, Written) and record.channel_id in known.channels:
            channel = known.channels[record.channel_id]
            yield Read(known.schemas.get(channel.schema_id), channel, record)
        else:
            known.take(record)


def whole(path: Path) -> bool:
    """Whether a recording was finished, so that it has its index. Raises OSError."""
    with opened(path) as file:
        file.seek(0, os.SEEK_END)
        if file.tell() < 2 * len(MAGIC):
            return False
        file.seek(-len(MAGIC), os.SEEK_END)
        return file.read() == MAGIC


def messages(
    path: Path,
    topics: Collection[str] | None = None,
    begin: int | None = None,
    end: int | None = None,
    check: Callable[[], object] = lambda: None,
) -> Iterator[Read]:
    """Yield a recording's messages, as far as it can be read, of the chunks that may have what is wanted.

    topics: their names, None: all. begin, end: ns since 1970, end not included. check: as of `index_of`.
    None for a recording that the ring has deleted meanwhile. Raises OSError.
    """
    try:
        with opened(path) as file:
            index = index_of(file, check)
            if index.chunk_indexes:
                known = Known((*index.schemas.values(), *index.channels.values()))
                found = _messages(_chunks(file, index, topics, begin, end, check), known)
            else:
                file.seek(0)
                found = read(file)
            for one in found:
                at = one.message.log_time
                right = topics is None or one.channel.topic in topics
                if right and (begin is None or at >= begin) and (end is None or at < end):
                    yield one
    except FileNotFoundError:
        return


def _chunks(
    file: IO[bytes],
    index: Index,
    topics: Collection[str] | None,
    begin: int | None,
    end: int | None,
    check: Callable[[], object],
) -> Iterator[Any]:
    """Yield what is in the chunks that may have these topics and times, in the order of the file."""
    others = set[int]()
    if topics is not None:
        others = {number for number, channel in index.channels.items() if channel.topic not in topics}

    def needed(one: ChunkIndex) -> bool:
        if begin is not None and one.message_end_time < begin:
            return False
        if end is not None and one.message_start_time >= end:
            return False
        return not one.message_index_offsets or not others.issuperset(one.message_index_offsets)

    places = {one.chunk_start_offset: one for one in index.chunk_indexes if needed(one)}
    for _, place in sorted(places.items()):
        check()
        yield from records(io.BytesIO(chunk_at(file, place)), magic=False)


class _Summary(NamedTuple):
    """What a recording holds. begin, end: ns since 1970, 0 without a message. counts: topic -> messages."""

    begin: int
    end: int
    counts: Mapping[str, int]
    finished: bool


def summary(path: Path, check: Callable[[], object] = lambda: None) -> _Summary:
    """Summarize a recording by its index. check: as of `index_of`. Raises OSError."""
    finished = whole(path)
    with opened(path) as file:
        index = index_of(file, check)
    if (told := index.statistics) is not None:
        names = {number: channel.topic for number, channel in index.channels.items()}
        counts = {names.get(number, "?"): count for number, count in told.channel_message_counts.items()}
        return _Summary(told.message_start_time, told.message_end_time, counts, finished)
    counted = Counter[str]()
    times = [0]
    for one in messages(path, check=check):
        check()
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
    with opened(path) as torn:
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
