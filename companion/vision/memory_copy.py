"""Keeps the supervisor's copy of the memory equal to that of the vision process, by numbered updates."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import replace

from msgspec import structs

from anytraverse.history import Entry, History
from anytraverse.memory import Memory
from companion.vision.checks import BadReportError
from companion.vision.messages import MOST_ROWS, Done, FrameJudged, MemoryUpdate, Ready, Report, Scenes

_SCENES = 64
"""Remembered scenes in one request, at most. Encoding one takes about 0.1 ms of the main loop."""


class MemoryCopy:
    """The supervisor's copy, with which a restarted process begins.

    memory: None until the first update where none was stored. revision: the number of the newest update.
    """

    def __init__(self, memory: Memory | None, most: int) -> None:
        """most: the number of scenes that a memory may have, as configured."""
        self.memory = memory
        self._most = most
        self.revision = 0
        self._unsent: deque[Entry] = deque()
        self._rows: tuple[Entry, ...] = ()
        """Rows of the next update that came before it."""

    def add(self, rows: tuple[Entry, ...]) -> None:
        """Take in rows of the next update. Raises BadReportError for more than a memory has."""
        self._rows += rows
        if len(self._rows) > self._most:
            raise BadReportError(f"{len(self._rows)} rows of one update")

    def apply(self, update: MemoryUpdate) -> None:
        """Apply an update. Raises BadReportError when it is not based on the present copy, or too large."""
        if update.base != self.revision or update.revision != self.revision + 1:
            raise BadReportError(f"memory {update.revision} on {update.base}, not on {self.revision}")
        if (limit := update.memory.history.limit) > self._most:
            raise BadReportError(f"a memory of {limit} scenes, {self._most} are configured")
        self.memory = updated(self.memory, structs.replace(update, entries=(*self._rows, *update.entries)))
        self.revision, self._rows = update.revision, ()

    def first_part(self) -> tuple[Memory | None, int]:
        """Return the copy with its first scenes only, and how many `next_scenes` returns after it."""
        self._rows = ()
        if self.memory is None:
            return None, 0
        self._unsent = deque(self.memory.history)
        history = History(self.next_scenes(), self.memory.history.limit)
        return replace(self.memory, history=history), len(self._unsent)

    def next_scenes(self) -> tuple[Entry, ...]:
        """Return up to 64 scenes that a new process must still get, () when it has all."""
        return tuple(self._unsent.popleft() for _ in range(min(_SCENES, len(self._unsent))))


def update_from(
    base: Memory | None, memory: Memory, revision: int, base_revision: int, weak: tuple[str, ...]
) -> MemoryUpdate:
    """Return the update that turns `base` into `memory`. base: None for a receiver without a memory."""
    before: Mapping[int, Entry] = {} if base is None else {entry.order: entry for entry in base.history}
    after = {entry.order: entry for entry in memory.history}
    return MemoryUpdate(
        revision=revision,
        base=base_revision,
        memory=replace(memory, history=History((), memory.history.limit)),
        entries=tuple(entry for stamp, entry in after.items() if before.get(stamp) is not entry),
        removed=tuple(stamp for stamp in before if stamp not in after),
        weak=weak,
    )


def parts(report: Report) -> Iterator[Report]:
    """Split off rows of a report's update that are more than one message carries: they go before it."""
    if isinstance(report, FrameJudged | Done | Ready) and (update := report.update) is not None:
        rows = update.entries
        while len(rows) > MOST_ROWS:
            yield Scenes(rows[:MOST_ROWS])
            rows = rows[MOST_ROWS:]
        report = structs.replace(report, update=structs.replace(update, entries=rows))
    yield report


def updated(base: Memory | None, update: MemoryUpdate) -> Memory:
    """Return the memory after `update`. Rows that did not change are the same objects as in `base`."""
    entries = {} if base is None else {entry.order: entry for entry in base.history}
    for stamp in update.removed:
        entries.pop(stamp, None)
    entries.update((entry.order, entry) for entry in update.entries)
    return replace(update.memory, history=History([*entries.values()], update.memory.history.limit))
