"""Defines what evidence consists of: parts with figures, tables, and what is not known. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from datetime import datetime, timezone
from statistics import median
from typing import Any, NamedTuple

import numpy as np

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


class NotKnown(NamedTuple):
    """What this evidence lacks. command: what to type, or to do, to have it next time."""

    what: str
    why: str
    command: str


class EvidencePart:
    """One part: JSON values as evidence.json has them. unknown: what it lacks.

    note: how its figures were found, where that needs words.
    """

    def __init__(self, title: str) -> None:
        self.title, self.note = title, ""
        self.figures = list[dict[str, Any]]()
        self.tables = list[dict[str, Any]]()
        self.unknown = list[NotKnown]()

    def tell(self, basis: Basis, *told: tuple[str, Value | None, str]) -> None:
        """Add a figure for each name, value and unit, "" for none. A value that is None is left out."""
        for name, raw, unit in told:
            if (value := _rounded(raw)) is not None:
                self.figures.append(
                    {
                        "name": name,
                        "value": value,
                        "unit": unit,
                        "samples": basis.samples,
                        "from": utc(basis.begin),
                        "to": utc(basis.end),
                        "source": basis.source,
                    }
                )

    def tell_spread(self, basis: Basis, name: str, values: Sequence[float], unit: str) -> None:
        """Add median, 99 % and longest of values that are good when small; nothing for none."""
        if values:
            spread = {"median": median(values), "99 %": quantile(values, 0.99), "longest": max(values)}
            told = ((f"{name}, {which}", value, unit) for which, value in spread.items())
            self.tell(basis._replace(samples=len(values)), *told)

    def tabulate(self, title: str, rows: Sequence[Mapping[str, Value | None]]) -> None:
        """Add a table of the last `MOST_ROWS` rows: values by the columns' names, which have the units."""
        kept = [{name: _rounded(value) for name, value in row.items()} for row in rows[-MOST_ROWS:]]
        self.tables.append({"title": title, "rows": kept, "left_out": len(rows) - len(kept)})

    def lack(self, what: str, why: str, command: str) -> None:
        """Say what is not known: see `NotKnown`."""
        self.unknown.append(NotKnown(what, why, command))

    def document(self) -> dict[str, Any]:
        """Return it as JSON values, without what is not known."""
        return {"title": self.title, "note": self.note, "figures": self.figures, "tables": self.tables}


def quantile(values: Sequence[float], share: float) -> float:
    """Return the smallest value that is no less than this share of all values. Of none: IndexError."""
    return float(np.quantile(values, share, method="inverted_cdf"))


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
