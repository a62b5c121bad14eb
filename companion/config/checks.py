"""Checks of single values, and what every table of the file is made of."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

Check = Callable[[object], Any]


class NestedError(ValueError):
    """What is wrong in tables inside a setting: the keys below it that lead there, and why."""

    def __init__(self, found: Sequence[tuple[tuple[str, ...], str]]) -> None:
        super().__init__("; ".join(f"{'.'.join(keys)} {reason}" for keys, reason in found))
        self.found = found


def number(low: float, high: float, *, above: bool = False, word: str | None = None) -> Check:
    """A finite number from `low` (or above it) to `high`, as a float; `word` is let through as it is."""
    least = f"above {low:g} and up" if above else f"from {low:g}"
    other = f', or "{word}"' if word else ""

    def check(value: object) -> float | str:
        if word is not None and value == word:
            return word
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise ValueError(f"give a number {least} to {high:g}{other}")
        if not low <= value <= high or (above and value == low):
            raise ValueError(f"give a number {least} to {high:g}{other}")
        return float(value)

    return check


def whole(low: int, high: int) -> Check:
    """A whole number from `low` to `high`."""

    def check(value: object) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise ValueError(f"give a whole number from {low} to {high}")
        return value

    return check


def flag(value: object) -> bool:
    """true or false."""
    if not isinstance(value, bool):
        raise ValueError("give true or false, without quotes")
    return value


def text(value: object) -> str:
    """A printable string; it may be empty."""
    if not isinstance(value, str):
        raise ValueError('give a text in quotes, "like this"')
    if not value.isprintable():
        raise ValueError("the text holds characters that cannot be printed: leave them out")
    return value


def choice(*options: str) -> Check:
    """One of these texts."""

    def check(value: object) -> str:
        if not isinstance(value, str) or value not in options:
            raise ValueError(f"choose one of {', '.join(options)}")
        return value

    return check


def listing(check_one: Check, least: int, most: int) -> Check:
    """A list of `least` to `most` values, each of which passes; as a tuple."""
    count = str(least) if least == most else f"{least} to {most}"

    def check(value: object) -> tuple[Any, ...]:
        if not isinstance(value, list) or not least <= len(value) <= most:
            raise ValueError(f"give a list of {count} values")
        return tuple(check_one(one) for one in value)

    return check


def checked(parse: Callable[[str], object]) -> Check:
    """A text that `parse` takes without a ValueError; kept as it was written."""

    def check(value: object) -> str:
        written = text(value)
        parse(written)
        return written

    return check


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
