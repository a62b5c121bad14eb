"""What every table of the file is made of."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from companion.config.checks import Check

Complaint = tuple[tuple[str, ...], str]
"""Keys that do not go together, with dots inside the section's own tables, and why."""


def setting(default: Any, check: Check, meaning: str, *, tables: bool = False) -> Any:
    """A field of a section. tables: its value is pairs of a name and the section below it."""
    return field(default=default, metadata={"check": check, "meaning": meaning, "tables": tables})


@dataclass(frozen=True)
class Section:
    """A table of the file."""

    def complaints(self) -> Iterator[Complaint]:
        """What is wrong between settings that are fine one by one."""
        yield from ()
