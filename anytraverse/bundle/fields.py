"""Reads JSON objects field by field; errors name the field, what was found and what was expected."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Iterator, Mapping
from typing import Any

from anytraverse.errors import BundleError


def parse_object(data: bytes, where: str) -> Fields:
    """Parse the JSON object in `data`; `where` names it in error messages. Raises BundleError."""
    try:
        value = json.loads(data.decode("utf-8"), parse_constant=_refuse, parse_float=_finite)
        json.dumps(value, ensure_ascii=False).encode("utf-8")  # raises for half a surrogate pair
    except (ValueError, RecursionError) as error:
        raise BundleError(f"{where} is torn, it is not JSON ({error}): copy the bundle again") from None
    return Fields(value, where)


class Fields:
    """Reads a JSON object. Every method takes a field's name and raises BundleError for an unfit value."""

    def __init__(self, value: object, where: str) -> None:
        if not isinstance(value, dict):
            raise BundleError(f"{where} is {_short(value)}, expected an object: export the bundle again")
        self._values: dict[str, Any] = value
        self.where = where

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def only(self, names: Collection[str]) -> None:
        """Raise BundleError for a field that is not in `names`: nothing would read it."""
        unknown = [name for name in self._values if name not in names]
        if unknown:
            raise self.unfit(_short(unknown[0]), "only " + ", ".join(names), "an unknown field")

    def any(self, name: str) -> Any:
        """Return the value, of any type."""
        if name not in self._values:
            raise self.unfit(name, "a value", "missing")
        return self._values[name]

    def object(self, name: str) -> Fields:
        """Return an object."""
        return Fields(self.any(name), f"{self.where}: {name}")

    def mapping(self, name: str) -> Mapping[str, Any]:
        """Return an object with its values unchecked."""
        return dict(self.object(name)._values)

    def text(self, name: str, *, empty: bool = False) -> str:
        """Return one printable line of at most 500 characters."""
        value = self.any(name)
        if not isinstance(value, str) or not value.isprintable() or len(value) > 500 or not (value or empty):
            raise self.unfit(name, "one line of text", _short(value))
        return value

    def texts(self, name: str) -> tuple[str, ...]:
        """Return a list of texts, each checked as by `text`."""
        values = self.any(name)
        if not isinstance(values, list):
            raise self.unfit(name, "a list", _short(values))
        items = Fields({str(index): value for index, value in enumerate(values)}, f"{self.where}: {name}")
        return tuple(items.text(index) for index in items)

    def choice(self, name: str, choices: Collection[str]) -> str:
        """Return a text that is one of `choices`."""
        value = self.any(name)
        if not isinstance(value, str) or value not in choices:
            raise self.unfit(name, "one of " + ", ".join(choices), _short(value))
        return value

    def whole(self, name: str, low: int, high: int) -> int:
        """Return a whole number from `low` to `high`."""
        value = self.any(name)
        # bool is a subclass of int
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise self.unfit(name, f"a whole number from {low} to {high}", _short(value))
        return value

    def number(self, name: str, low: float, high: float) -> float:
        """Return a finite number from `low` to `high`."""
        value = self.any(name)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:
            raise self.unfit(name, f"a number from {low:g} to {high:g}", _short(value))
        return float(value)

    def flag(self, name: str) -> bool:
        """Return true or false."""
        value = self.any(name)
        if not isinstance(value, bool):
            raise self.unfit(name, "true or false", _short(value))
        return value

    def unfit(self, name: str, expected: str, came: str) -> BundleError:
        """Make the error for a field with an unfit value."""
        return BundleError(f"{self.where}: {name} is {came}, expected {expected}: export the bundle again")


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"the number {text[:20]} is too large")
    return value


def _refuse(text: str) -> float:
    raise ValueError(f"{text} is no number")


def _short(value: object) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."
