"""Provides the checks of single values, and the base of the tables (sections) of the file."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

from companion.cameras.shown import is_like_a_url, shown

Schema = Mapping[str, Any]
"""Part of a JSON schema (draft 2020-12), for editors."""


@dataclass(frozen=True)
class ValueCheck:
    """Checks a value of the file and converts it for the configuration. Raises ValueError for a wrong one.

    schema: the same check for editors. It may accept more than `take`, never less. shown: makes what may be
    shown and stored of a value, right or wrong, None for nothing. Without it the value is shown to nobody.
    """

    take: Callable[[object], Any]
    schema: Schema
    shown: Callable[[object], object] | None = None

    def __call__(self, value: object) -> Any:
        return self.take(value)


class NestedError(ValueError):
    """Tables inside a setting are wrong. found: for each problem, keys below the setting, and the reason."""

    def __init__(self, found: Sequence[tuple[tuple[str, ...], str]]) -> None:
        super().__init__("; ".join(f"{'.'.join(keys)} {reason}" for keys, reason in found))
        self.found = found


def harmless(value: object) -> object:
    """Return what may be shown of a number, flag, name, address or path, or of a list of them; else None."""
    match value:
        case bool() | int() | float():
            return value
        case str():
            return shown(value)
        case list() | tuple():
            found = [harmless(one) for one in value]
            return None if None in found else found
    return None


def number(low: float, high: float, *, above: bool = False, word: str | None = None) -> ValueCheck:
    """Accept a finite number from `low` to `high` as a float, or the text `word`. above: not `low` itself."""
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
    return ValueCheck(check, {"anyOf": [numbers, {"const": word}]} if word else numbers, harmless)


def whole(low: int, high: int) -> ValueCheck:
    """Accept a whole number from `low` to `high`."""

    def check(value: object) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise ValueError(f"give a whole number from {low} to {high}")
        return value

    return ValueCheck(check, {"type": "integer", "minimum": low, "maximum": high}, harmless)


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


flag = ValueCheck(_flag, {"type": "boolean"}, harmless)
"""Accepts true or false."""
text = ValueCheck(_text, {"type": "string"})
"""Accepts a printable string, which may be empty. It is not shown."""


def _path(value: object) -> str:
    written = _text(value)
    if is_like_a_url(written):
        raise ValueError("give a path on this computer")
    return written


path = ValueCheck(_path, text.schema, harmless)
"""Accepts a path, which may be empty."""


def choice(*options: str) -> ValueCheck:
    """Accept one of these texts."""

    def check(value: object) -> str:
        if not isinstance(value, str) or value not in options:
            raise ValueError(f"choose one of {', '.join(options)}")
        return value

    return ValueCheck(check, {"enum": list(options)}, harmless)


def listing(check_one: ValueCheck, least: int, most: int) -> ValueCheck:
    """Accept a list of `least` to `most` values that pass `check_one`, as a tuple."""
    count = str(least) if least == most else f"{least} to {most}"

    def check(value: object) -> tuple[Any, ...]:
        if not isinstance(value, list) or not least <= len(value) <= most:
            raise ValueError(f"give a list of {count} values")
        return tuple(check_one(one) for one in value)

    schema = {"type": "array", "items": check_one.schema, "minItems": least, "maxItems": most}
    return ValueCheck(check, schema, check_one.shown)


def checked(parse: Callable[[str], object], shown: Callable[[object], object] | None = None) -> ValueCheck:
    """Accept a text for which `parse` raises no ValueError; the text itself is stored.

    shown: as in `ValueCheck`.
    """

    def check(value: object) -> str:
        written = _text(value)
        parse(written)
        return written

    return ValueCheck(check, text.schema, shown)


Conflict = tuple[tuple[str, ...], str]
"""Keys of a section that contradict each other ("more.wifi.url" for an inner table), and the reason."""


def setting(default: Any, check: ValueCheck, meaning: str, *, tables: bool = False) -> Any:
    """Define a setting of a section. tables: its value is a tuple of (name, section) pairs."""
    return field(default=default, metadata={"check": check, "meaning": meaning, "tables": tables})


def checks_of(section: type[Section]) -> dict[str, ValueCheck]:
    """Return the checks of a section's settings."""
    return {one.name: one.metadata["check"] for one in fields(section)}


def section_schema(section: type[Section]) -> Schema:
    """Make a section's JSON schema: meaning, allowed values and default of each setting."""
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
    """Base of the sections: one table of the file."""

    def conflicts(self) -> Iterator[Conflict]:
        """Yield the problems between settings that are valid each by itself."""
        yield from ()
