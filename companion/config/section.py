"""What every table of the file is made of."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from companion.config.checks import Check

Complaint = tuple[tuple[str, ...], str]
"""Keys that do not go together, and why."""


def setting(default: Any, check: Check, meaning: str) -> Any:
    """A field of a section."""
    return field(default=default, metadata={"check": check, "meaning": meaning})


@dataclass(frozen=True)
class Section:
    """A table of the file."""

    def complaints(self) -> Iterator[Complaint]:
        """What is wrong between settings that are fine one by one."""
        yield from ()
