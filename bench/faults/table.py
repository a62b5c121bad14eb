"""The fault table: all rows, in the order of a reader. docs/faults.md shows it."""

from __future__ import annotations

from bench.faults import (
    braking,
    by_hand,
    cameras,
    disk,
    driving,
    endurance,
    inputs,
    proven,
    recorder,
    starting,
    vision,
)
from bench.faults.row import Row

ROWS: tuple[Row, ...] = (
    *cameras.ROWS,
    *vision.ROWS,
    *driving.ROWS,
    *by_hand.ROWS,
    *braking.ROWS,
    *inputs.ROWS,
    *disk.ROWS,
    *recorder.ROWS,
    *starting.ROWS,
    *endurance.ROWS,
    *proven.ROWS,
)


def chosen(parts: list[str]) -> list[Row]:
    """Returns the rows whose fault has one of these parts in its name; all for none. Raises ValueError."""
    for part in parts:
        if not any(part.casefold() in row.fault.casefold() for row in ROWS):
            raise ValueError(f"no row has {part!r} in its name: {'; '.join(row.fault for row in ROWS)}")
    return [
        row for row in ROWS if not parts or any(part.casefold() in row.fault.casefold() for part in parts)
    ]
