"""Reads recordings, also those that end anywhere because their writer was killed, and repairs them."""

from __future__ import annotations

import contextlib
import os
import struct
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import IO, Any, NamedTuple

from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Channel, Schema
from mcap.records import Message as Written
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

_MAGIC = b"\x89MCAP0\r\n"
_LARGEST_RECORD = 64 << 20


class Read(NamedTuple):
    """A message that was read, with its channel and schema; schema None: it has none."""

    schema: Schema | None
    channel: Channel
    message: Written


def read(file: IO[bytes]) -> Iterator[Read]:
    """Yield all messages up to the end, or to the first byte that is no MCAP. Raises OSError."""
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    records = iter(StreamReader(file, validate_crcs=True, record_size_limit=_LARGEST_RECORD).records)
    while True:
        try:
            record: Any = next(records)
        except OSError:
            raise
        except Exception:  # a torn end may be anything, and the reader raises whatever it leads to
            return
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Written) and record.channel_id in channels:
            channel = channels[record.channel_id]
            yield Read(schemas.get(channel.schema_id), channel, record)


def whole(path: Path) -> bool:
    """Whether a recording was finished, so that it has its index. Raises OSError."""
    with path.open("rb") as file:
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
        with path.open("rb") as file:
            found = _by_index(file, topics, begin, end) if indexed else read(file)
            for one in found:
                at = one.message.log_time
                right = topics is None or one.channel.topic in topics
                if right and (begin is None or at >= begin) and (end is None or at < end):
                    yield one
    except FileNotFoundError:
        return


def _by_index(
    file: IO[bytes], topics: Collection[str] | None, begin: int | None, end: int | None
) -> Iterator[Read]:
    named = None if topics is None else list(topics)
    reader = make_reader(file)
    found = iter(reader.iter_messages(named, log_time_order=False, starting_at=begin, ending_before=end))
    while True:
        try:
            schema, channel, message = next(found)
        except OSError:
            raise
        except Exception:  # damaged after it was finished: the end, or what the reader raises
            return
        yield Read(schema, channel, message)


class Summary(NamedTuple):
    """What a recording holds. begin, end: ns since 1970, 0 without a message. counts: topic -> messages."""

    begin: int
    end: int
    counts: Mapping[str, int]
    finished: bool


def summary(path: Path) -> Summary:
    """Summarize a recording, of a finished one by its index. Raises OSError."""
    if finished := whole(path):
        with path.open("rb") as file, contextlib.suppress(McapError, ValueError, struct.error):
            found = make_reader(file).get_summary()
            if found is not None and (told := found.statistics) is not None:
                names = {number: channel.topic for number, channel in found.channels.items()}
                counts = {names[number]: count for number, count in told.channel_message_counts.items()}
                return Summary(told.message_start_time, told.message_end_time, counts, finished)
    counted = Counter[str]()
    times = [0]
    for one in messages(path):
        counted[one.channel.topic] += 1
        at = one.message.log_time
        times = [at, at] if times == [0] else [min(times[0], at), max(times[1], at)]
    return Summary(times[0], times[-1], counted, finished)


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


def repair(path: Path) -> int:
    """Write a torn recording anew with its index, in place, and return the number of its messages.

    The old file stays as it is until the new one is complete. Raises OSError.
    """
    partial = path.with_name(f".{path.name}.part")
    try:
        with path.open("rb") as torn, partial.open("wb") as file:
            copy = Copy(file)
            for one in read(torn):
                copy.add(one)
            copy.finish()
            file.flush()
            os.fsync(file.fileno())
        os.replace(partial, path)
    except OSError:
        partial.unlink(missing_ok=True)
        raise
    return copy.messages
