"""Defines what evidence consists of: parts with figures, tables, and what is not known. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from statistics import median
from typing import Any, NamedTuple

from companion.vehicle.state import is_set

Value = bool | int | float | str

MOST_ROWS = 100
"""Rows of a table. More are left out, and counted."""
_DIGITS = 3
_LONGEST = 86_400.0
"""Seconds. What seems to have lasted longer is a clock that was set."""


class Basis(NamedTuple):
    """Says what a figure rests on. source: where it was read. samples: over how many; None: it was read once.

    begin, end: seconds since 1970 of the first and the last sample, None where that is not known.
    """

    source: str
    samples: int | None = None
    begin: float | None = None
    end: float | None = None


@dataclass(frozen=True)
class EvidenceFigure:
    """One figure. name: what it is, in words. unit: "" where it has none."""

    name: str
    value: Value
    basis: Basis
    unit: str = ""

    def document(self) -> dict[str, Any]:
        """Return it as JSON values."""
        basis = self.basis
        return {
            "name": self.name,
            "value": self.value,
            "unit": self.unit,
            "samples": basis.samples,
            "from": utc(basis.begin),
            "to": utc(basis.end),
            "source": basis.source,
        }


@dataclass(frozen=True)
class EvidenceTable:
    """Rows of one kind. columns: their names, with units. left_out: rows that are not in it."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Value | None, ...], ...]
    left_out: int = 0

    @classmethod
    def of(cls, title: str, columns: Sequence[str], rows: Sequence[Sequence[Value | None]]) -> EvidenceTable:
        """Make a table of the last `MOST_ROWS` rows."""
        kept = tuple(tuple(map(_rounded, row)) for row in rows[-MOST_ROWS:])
        return cls(title, tuple(columns), kept, len(rows) - len(kept))

    def document(self) -> dict[str, Any]:
        """Return it as JSON values: each row is an object by the columns' names."""
        rows = [dict(zip(self.columns, row, strict=True)) for row in self.rows]
        return {"title": self.title, "rows": rows, "left_out": self.left_out}


@dataclass(frozen=True)
class NotKnown:
    """What this evidence lacks. command: what to type, or to do, to have it next time."""

    what: str
    why: str
    command: str

    def document(self) -> dict[str, Any]:
        """Return it as JSON values."""
        return {"what": self.what, "why": self.why, "command": self.command}


@dataclass(frozen=True)
class EvidencePart:
    """One part. key: its name in JSON. note: how its figures were found, where that needs words."""

    key: str
    title: str
    figures: tuple[EvidenceFigure, ...] = ()
    tables: tuple[EvidenceTable, ...] = ()
    unknown: tuple[NotKnown, ...] = ()
    note: str = ""

    def document(self) -> dict[str, Any]:
        """Return it as JSON values."""
        return {
            "title": self.title,
            "note": self.note,
            "figures": [one.document() for one in self.figures],
            "tables": [one.document() for one in self.tables],
        }


def figures(basis: Basis, told: Iterable[tuple[str, Value | None, str]]) -> tuple[EvidenceFigure, ...]:
    """Return a figure for each name, value and unit. A value that is None is left out."""
    found = ((name, _rounded(value), unit) for name, value, unit in told)
    return tuple(EvidenceFigure(name, value, basis, unit) for name, value, unit in found if value is not None)


def spread(name: str, values: Sequence[float], unit: str, basis: Basis) -> tuple[EvidenceFigure, ...]:
    """Return median, 99 % and longest of values that are good when small; nothing for none."""
    if not values:
        return ()
    told = (("median", median(values)), ("99 %", share(values, 0.99)), ("longest", max(values)))
    return figures(basis, ((f"{name}, {which}", value, unit) for which, value in told))


def share(values: Sequence[float], least: float) -> float:
    """Return the smallest value that is no less than this share of all values. Of none: ValueError."""
    return sorted(values)[max(0, math.ceil(least * len(values)) - 1)]


def between(begin: float | None, end: float | None) -> float | None:
    """Return the seconds between two times; None where one is unknown, or the clock was set meanwhile."""
    if begin is None or end is None or not (is_set(begin) and is_set(end)):
        return None
    return end - begin if 0.0 <= end - begin <= _LONGEST else None


def utc(at: float | None) -> str | None:
    """Format seconds since 1970 in ISO 8601; None for None, and for a time that no calendar has."""
    try:
        return None if at is None else f"{datetime.fromtimestamp(at, timezone.utc):%Y-%m-%dT%H:%M:%SZ}"
    except (ValueError, OverflowError, OSError):
        return None


def _rounded(value: Value | None) -> Value | None:
    if not isinstance(value, float):
        return value
    return round(value, _DIGITS) if math.isfinite(value) else None
