"""Finds what is where in a recording without reading it whole: by its index, or the heads of its chunks."""

from __future__ import annotations

import io
import os
import struct
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import islice
from typing import IO

from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Chunk, ChunkIndex, Statistics
from mcap.records import Message as Written
from mcap.summary import Summary as Index

from companion.observers.recording.records import LARGEST_RECORD, MAGIC, Known, content_of, records

LARGEST_INDEX = 4 << 20
"""Bytes of an index that is believed, which some ten gigabytes of ours have."""
MOST_MESSAGES = 20_000
"""Messages of a chunk that are taken: ours have some hundred."""
_FOOTER = struct.Struct("<BQQQI8s")
_HEAD = struct.Struct("<BQ")
_TIMES = struct.Struct("<QQ")
_CHANNEL = struct.Struct("<HI")
_OF_AN_ENTRY = 16


def index_of(file: IO[bytes], check: Callable[[], object] = lambda: None) -> Index:
    """Return the index of a recording; of one that was cut off, or whose index is damaged, one made from the
    heads of its chunks. It has no chunk where nothing can be found.

    check: called at each step; what it raises ends this. Raises OSError.
    """
    found = _written(file)
    return found if found is not None and found.chunk_indexes else _Search(file, check).index


def chunk_at(file: IO[bytes], place: ChunkIndex) -> bytes:
    """Return the records of a chunk, b"" where none is there, or a damaged one. Raises OSError."""
    file.seek(min(place.chunk_start_offset, file.seek(0, os.SEEK_END)))
    return next(
        (content_of(one) for one in islice(records(file, magic=False), 1) if isinstance(one, Chunk)), b""
    )


def messages_in(content: bytes) -> Iterator[Written]:
    """Yield the messages in the records of a chunk."""
    found = (one for one in records(io.BytesIO(content), magic=False) if isinstance(one, Written))
    yield from islice(found, MOST_MESSAGES)


def _written(file: IO[bytes]) -> Index | None:
    """Return what the end of a finished recording says of it, None for another or a damaged one."""
    size = file.seek(0, os.SEEK_END)
    if size < _FOOTER.size:
        return None
    file.seek(size - _FOOTER.size)
    opcode, _, begin, _, _, magic = _FOOTER.unpack(file.read(_FOOTER.size))
    if magic != MAGIC or opcode != Opcode.FOOTER or not size - LARGEST_INDEX <= begin < size:
        return None
    file.seek(0)
    try:
        found = SeekingReader(file, record_size_limit=LARGEST_RECORD).get_summary()
    except Exception:  # it may lead anywhere, also before the file's beginning
        return None
    return found if found is not None and found.statistics is not None else None


class _Search:
    """Goes from record to record, and reads only the chunks that say what a channel is."""

    def __init__(self, file: IO[bytes], check: Callable[[], object]) -> None:
        self.index = Index()
        self._known = Known()
        self.index.schemas, self.index.channels = self._known.schemas, self._known.channels
        self._file = file
        self._learnt: ChunkIndex | None = None
        """The chunk that was read last: each is read once, whatever it tells."""
        self._counts = Counter[int]()
        """Messages by channel, of all chunks but the last."""
        self._newest = Counter[int]()
        size = file.seek(0, os.SEEK_END)
        file.seek(0)
        at = len(MAGIC) if file.read(len(MAGIC)) == MAGIC else size
        while at + _HEAD.size <= size:
            check()
            file.seek(at)
            opcode, length = _HEAD.unpack(file.read(_HEAD.size))
            end = at + _HEAD.size + length
            if end > size or opcode == Opcode.DATA_END or not self._take(opcode, at, end):
                break
            at = end
        if self.index.chunk_indexes:
            self._count_last()
            self._sum_up()

    def _take(self, opcode: int, at: int, end: int) -> bool:
        """Take a record. False where there is none."""
        chunks = self.index.chunk_indexes
        if opcode == Opcode.CHUNK and end - at > _HEAD.size + _TIMES.size:
            self._counts += self._newest
            self._newest = Counter()
            begins, ends = _TIMES.unpack(self._file.read(_TIMES.size))
            chunks.append(
                ChunkIndex(
                    chunk_length=end - at,
                    chunk_start_offset=at,
                    compression="",
                    compressed_size=0,
                    message_end_time=ends,
                    message_index_length=0,
                    message_index_offsets={},
                    message_start_time=begins,
                    uncompressed_size=0,
                )
            )
        elif opcode == Opcode.MESSAGE_INDEX and chunks and end - at >= _HEAD.size + _CHANNEL.size:
            channel, size = _CHANNEL.unpack(self._file.read(_CHANNEL.size))
            if size:
                chunks[-1].message_index_offsets[channel] = at
                self._newest[channel] = size // _OF_AN_ENTRY
                if channel not in self.index.channels and self._learnt is not chunks[-1]:
                    self._learn(chunks[-1])
        return bool(opcode)

    def _learn(self, place: ChunkIndex) -> bytes:
        """Take the schemas and channels that a chunk tells, and return its content."""
        self._learnt = place
        content = chunk_at(self._file, place)
        for one in islice(records(io.BytesIO(content), magic=False), MOST_MESSAGES):
            self._known.take(one)
        return content

    def _count_last(self) -> None:
        """Count the last chunk itself: what tells of it may be cut off."""
        last = self.index.chunk_indexes[-1]
        found = Counter(one.channel_id for one in messages_in(self._learn(last)))
        last.message_index_offsets = dict.fromkeys(found, 0)
        self._counts += found

    def _sum_up(self) -> None:
        index = self.index
        index.statistics = Statistics(
            attachment_count=0,
            channel_count=len(index.channels),
            channel_message_counts=dict(self._counts),
            chunk_count=len(index.chunk_indexes),
            message_count=self._counts.total(),
            message_end_time=max(one.message_end_time for one in index.chunk_indexes),
            message_start_time=min(one.message_start_time for one in index.chunk_indexes),
            metadata_count=0,
            schema_count=len(index.schemas),
        )
