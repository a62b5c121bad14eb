"""Defines a `Batch`, which the journal stores in one transaction, and the records of calls for people."""

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
    """Describes a closed call, as it is read back from the journal.

    closed_at: seconds since 1970. outcome: a name of wire.ids.Outcome in lower case. record: as of
    `record_of`. answers: those recorded for it.
    """

    id: int
    closed_at: float
    outcome: str
    record: Mapping[str, Any]
    answers: tuple[Mapping[str, Any], ...] = ()


def _sides(box: Box) -> list[float]:
    return [round(side, 4) for side in (box.left, box.top, box.right, box.bottom)]


def record_of(call: Call) -> dict[str, Any]:
    """Return a call's frame id, reasons, figures and place as JSON values."""
    seen = call.seen
    roi, tile = (seen.roi, seen.tile) if seen is not None else (None, None)
    return {
        "frame_id": call.frame_id,
        "reasons": sorted(reason.value for reason in call.reasons),
        "words": seen.words.format() if seen is not None else None,
        "roi_uncertainty": roi.uncertainty if roi is not None else None,
        "worst_tile": tile.uncertainty if tile is not None else None,
        "worst_tile_box": _sides(tile.shown) if tile is not None else None,
        "drivable_share": roi.drivable_share if roi is not None else None,
        "similarity": seen.similarity if seen is not None else None,
        "place": place_figures(call.place),
    }


MAX_ROWS = 256
"""Answers and closed calls that may wait for the disk. Beyond that the oldest are dropped."""


@dataclass(frozen=True)
class Row:
    """Holds one row to append to a table. values: for SQLite, in the order of `columns`."""

    table: str
    columns: str
    values: tuple[Any, ...]

    @classmethod
    def of_call(cls, call: Call, at: float) -> Row:
        """Make the row of a closed call. at: seconds since 1970. Raises JournalError as `as_json` does."""
        values = (call.id, at, call.outcome.name.lower(), as_json(record_of(call)))
        return cls("calls", "id, closed_at, outcome, record", values)

    @classmethod
    def of_answer(cls, call_id: int, record: Mapping[str, Any], at: float) -> Row:
        """Make the row of an answer. record: JSON values. at: seconds since 1970. Raises JournalError."""
        return cls("answers", "call_id, answered_at, record", (call_id, at, as_json(record)))


@dataclass(frozen=True)
class Batch:
    """Holds what the journal stores in one transaction. None and () where nothing is new.

    state: of calls, holds and settings, as JSON. frame: id and PNG of the open call's frame.
    """

    memory: Memory | None = None
    state: str | None = None
    frame: tuple[int, bytes] | None = None
    rows: tuple[Row, ...] = ()

    def __bool__(self) -> bool:
        return any((self.memory, self.state, self.frame, self.rows))

    def merged_with(self, newer: Batch) -> Batch:
        """Merge with a newer batch: the newer memory, state and frame replace the older, rows are joined."""
        return Batch(
            newer.memory or self.memory,
            newer.state or self.state,
            newer.frame or self.frame,
            (*self.rows, *newer.rows)[-MAX_ROWS:],
        )


def as_json(values: Mapping[str, Any]) -> str:
    """Encode values as JSON. Raises JournalError for values that JSON cannot express."""
    try:
        return json.dumps(dict(values))
    except (TypeError, ValueError) as error:
        raise JournalError(f"a record cannot be stored, since it is not JSON: {error}") from error
