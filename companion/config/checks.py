"""Checks of single values, and what every table of the file is made of."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

Schema = Mapping[str, Any]
"""Part of a JSON schema (draft 2020-12), for editors."""


@dataclass(frozen=True)
class Check:
    """Takes a value of the file and gives it as the configuration has it; ValueError for a wrong one.

    schema: what an editor may say of it beforehand, where no more is right than `take` takes.
    """

    take: Callable[[object], Any]
    schema: Schema

    def __call__(self, value: object) -> Any:
        return self.take(value)


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

    numbers = {"type": "number", "exclusiveMinimum" if above else "minimum": low, "maximum": high}
    return Check(check, {"anyOf": [numbers, {"const": word}]} if word else numbers)


def whole(low: int, high: int) -> Check:
    """A whole number from `low` to `high`."""

    def check(value: object) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise ValueError(f"give a whole number from {low} to {high}")
        return value

    return Check(check, {"type": "integer", "minimum": low, "maximum": high})


def _flag(value: object) -> bool:
    if not isinstance(value, bool):
        raise ValueError("give true or false, without quotes")
    return value


def _text(value: object) -> str:
    if not isinstance(value, str):
        raise ValueError('give a text in quotes, "like this"')
    if not value.isprintable():
        raise ValueError("the text holds characters that cannot be printed: leave them out")
    return value


flag = Check(_flag, {"type": "boolean"})
"""true or false."""
text = Check(_text, {"type": "string"})
"""A printable string; it may be empty."""


def choice(*options: str) -> Check:
    """One of these texts."""

    def check(value: object) -> str:
        if not isinstance(value, str) or value not in options:
            raise ValueError(f"choose one of {', '.join(options)}")
        return value

    return Check(check, {"enum": list(options)})


def listing(check_one: Check, least: int, most: int) -> Check:
    """A list of `least` to `most` values, each of which passes; as a tuple."""
    count = str(least) if least == most else f"{least} to {most}"

    def check(value: object) -> tuple[Any, ...]:
        if not isinstance(value, list) or not least <= len(value) <= most:
            raise ValueError(f"give a list of {count} values")
        return tuple(check_one(one) for one in value)

    return Check(check, {"type": "array", "items": check_one.schema, "minItems": least, "maxItems": most})


def checked(parse: Callable[[str], object]) -> Check:
    """A text that `parse` takes without a ValueError; kept as it was written."""

    def check(value: object) -> str:
        written = _text(value)
        parse(written)
        return written

    return Check(check, text.schema)


Complaint = tuple[tuple[str, ...], str]
"""Keys that do not go together, with dots inside the section's own tables, and why."""


def setting(default: Any, check: Check, meaning: str, *, tables: bool = False) -> Any:
    """A field of a section. tables: its value is pairs of a name and the section below it."""
    return field(default=default, metadata={"check": check, "meaning": meaning, "tables": tables})


def section_schema(section: type[Section]) -> Schema:
    """A table as JSON schema: what each setting means, may be, and is where the file does not say."""
    properties = {}
    for one in fields(section):
        default = {} if one.default is None or one.metadata["tables"] else {"default": one.default}
        properties[one.name] = {
            "description": one.metadata["meaning"],
            **default,
            **one.metadata["check"].schema,
        }
    meaning = (section.__doc__ or "").partition("\n\n")[0]
    return {"type": "object", "description": meaning, "properties": properties, "additionalProperties": False}


@dataclass(frozen=True)
class Section:
    """A table of the file."""

    def complaints(self) -> Iterator[Complaint]:
        """What is wrong between settings that are fine one by one."""
        yield from ()
