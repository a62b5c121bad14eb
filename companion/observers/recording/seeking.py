"""Finds what was so at a moment of a recording, in the few chunks around it."""

from __future__ import annotations

from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Callable
from typing import IO

from mcap.records import ChunkIndex
from mcap.records import Message as Written
from mcap.summary import Summary as Index

from companion.observers.recording.index import chunk_at, messages_in

_AROUND = 2
"""Chunks before a moment and after it in which what belongs to it is: one has two seconds, or half a MiB."""
_BACK = 4
"""Chunks with a topic that are read back to find the newest message."""
_MOST_KEPT = 32 << 20
"""Bytes of chunks that are kept."""


class Seeker:
    """Reads messages of one recording. Each chunk is read once, as long as `_MOST_KEPT` lasts."""

    def __init__(self, file: IO[bytes], index: Index, check: Callable[[], object] = lambda: None) -> None:
        """check: called at each step; what it raises ends this."""
        self._file = file
        self._index = index
        self._check = check
        self._places: dict[str, list[ChunkIndex]] = {}
        self._read = OrderedDict[int, tuple[int, list[Written]]]()

    def around(self, topic: str, at: int) -> list[Written]:
        """Return the messages of a topic in the chunks around a moment, in the order of their times.

        at: ns since 1970, here and below. Raises OSError.
        """
        places, place = self._found(topic, at)
        near = places[max(0, place - _AROUND) : place + _AROUND + 1]
        return sorted((one for chunk in near for one in self._of(chunk, topic)), key=lambda one: one.log_time)

    def last(self, topic: str, at: int) -> Written | None:
        """Return the newest message of a topic that is not later than a moment, None without one."""
        places, place = self._found(topic, at)
        best: Written | None = None
        for chunk in reversed(places[max(0, place - _BACK) : place + 1]):
            if best is not None and chunk.message_end_time < best.log_time:
                break
            told = (one for one in self._of(chunk, topic) if one.log_time <= at)
            best = max((*told, *([best] if best else ())), key=lambda one: one.log_time, default=None)
        return best

    def _found(self, topic: str, at: int) -> tuple[list[ChunkIndex], int]:
        """Return the chunks that have a topic, the earliest first, and the place of the last one begun."""
        if topic not in self._places:
            numbers = self._numbers(topic)
            self._places[topic] = sorted(
                (one for one in self._index.chunk_indexes if numbers & one.message_index_offsets.keys()),
                key=lambda one: one.message_start_time,
            )
        places = self._places[topic]
        return places, max(0, bisect_right(places, at, key=lambda one: one.message_start_time) - 1)

    def _numbers(self, topic: str) -> set[int]:
        return {number for number, channel in self._index.channels.items() if channel.topic == topic}

    def _of(self, place: ChunkIndex, topic: str) -> list[Written]:
        numbers = self._numbers(topic)
        return [one for one in self._chunk(place) if one.channel_id in numbers]

    def _chunk(self, place: ChunkIndex) -> list[Written]:
        at = place.chunk_start_offset
        if at not in self._read:
            self._check()
            content = chunk_at(self._file, place)
            found = []
            for one in messages_in(content):
                self._check()
                found.append(one)
            self._read[at] = len(content), found
            while len(self._read) > 1 and sum(size for size, _ in self._read.values()) > _MOST_KEPT:
                self._read.popitem(last=False)
        return self._read[at][1]
