"""Defines a `Batch`, which the journal stores in one transaction."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from anytraverse.memory import Memory
from companion.storage.database import JournalError
from companion.wire.call_report import FIGURES_MEMBERS, CallReport

MAX_ROWS = 256
"""Answers and closed calls that may wait for the disk. Beyond that the oldest are dropped."""


@dataclass(frozen=True)
class TableRow:
    """Holds one row to append to a table. values: for SQLite, in the order of `columns`."""

    table: str
    columns: str
    values: tuple[Any, ...]

    @classmethod
    def of_call(cls, call: CallReport, at: float) -> TableRow:
        """Make the row of a closed call. at: seconds since 1970. Raises JournalError as `as_json` does."""
        values = (call.id, at, call.outcome.name.lower(), as_json(call.document(FIGURES_MEMBERS)))
        return cls("calls", "id, closed_at, outcome, record", values)

    @classmethod
    def of_answer(cls, call_id: int, record: Mapping[str, Any], at: float) -> TableRow:
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
    rows: tuple[TableRow, ...] = ()

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


def from_json(text: Any) -> dict[str, Any] | None:
    """Read a JSON object, None for anything else."""
    try:
        found = json.loads(text)
    except (ValueError, TypeError, RecursionError):
        return None
    return found if isinstance(found, dict) else None
