"""What is to be kept together, all or nothing; and what is kept of calls for people to read."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from anytraverse.memory import Memory
from anytraverse.regions import Box
from companion.calls.decisions import Call
from companion.storage.database import JournalError
from companion.vehicle.position import place_figures


@dataclass(frozen=True)
class CallRecord:
    """A closed call. closed_at: seconds since 1970. outcome: as in wire.ids.Outcome, lower case.

    record: frame id, reasons, place and figures that the call was made for. answers: as recorded.
    """

    id: int
    closed_at: float
    outcome: str
    record: Mapping[str, Any]
    answers: tuple[Mapping[str, Any], ...] = ()


def _sides(box: Box) -> list[float]:
    return [round(side, 4) for side in (box.left, box.top, box.right, box.bottom)]


def record_of(call: Call) -> dict[str, Any]:
    """The figures of a call as JSON values."""
    seen = call.seen
    roi, tile = (seen.roi, seen.tile) if seen is not None else (None, None)
    return {
        "frame_id": call.frame_id,
        "reasons": sorted(reason.value for reason in call.reasons),
        "words": seen.words.format() if seen is not None else None,
        "roi_uncertainty": roi.uncertainty if roi is not None else None,
        "worst_tile": tile.uncertainty if tile is not None else None,
        "worst_tile_box": _sides(tile.box) if tile is not None else None,
        "drivable_share": roi.drivable_share if roi is not None else None,
        "similarity": seen.similarity if seen is not None else None,
        "place": place_figures(call.place),
    }


MAX_ROWS = 256
"""Answers and closed calls that may wait for the disk; beyond, the oldest go."""


@dataclass(frozen=True)
class Row:
    """One line of a table that only grows. values: as SQLite takes them, in the order of `columns`."""

    table: str
    columns: str
    values: tuple[Any, ...]

    @classmethod
    def of_call(cls, call: Call, at: float) -> Row:
        """A closed call. at: seconds since 1970. Raises JournalError for what is no JSON."""
        values = (call.id, at, call.outcome.name.lower(), as_json(record_of(call)))
        return cls("calls", "id, closed_at, outcome, record", values)

    @classmethod
    def of_answer(cls, call_id: int, record: Mapping[str, Any], at: float) -> Row:
        """What was answered to a call: JSON values. at: as for a call. Raises JournalError."""
        return cls("answers", "call_id, answered_at, record", (call_id, at, as_json(record)))


@dataclass(frozen=True)
class Batch:
    """None and () where there is nothing new. state: of the supervision, JSON. frame: its id, and the PNG."""

    memory: Memory | None = None
    state: str | None = None
    frame: tuple[int, bytes] | None = None
    rows: tuple[Row, ...] = ()

    def __bool__(self) -> bool:
        return any((self.memory, self.state, self.frame, self.rows))

    def then(self, newer: Batch) -> Batch:
        """Both as one: of memory, state and frame only the newest counts."""
        return Batch(
            newer.memory or self.memory,
            newer.state or self.state,
            newer.frame or self.frame,
            (*self.rows, *newer.rows)[-MAX_ROWS:],
        )


def as_json(values: Mapping[str, Any]) -> str:
    """Raises JournalError for what is none."""
    try:
        return json.dumps(dict(values))
    except (TypeError, ValueError) as error:
        raise JournalError(f"what cannot be written as JSON cannot be kept: {error}") from error
