"""Checks values of JSON that came from elsewhere: one that is missing or of another kind counts as none."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

LONGEST = 300
"""Characters of a text."""
LARGEST = 256 << 10
"""Bytes of a document: several times what a rover writes, and read in some 30 ms whatever it holds."""


class DocumentError(ValueError):
    """Reports a document that is none; the text says what it is instead."""


def read_object(content: bytes, what: str = "it") -> Mapping[str, Any]:
    """Read a JSON object. what: names it in an error. Raises DocumentError."""
    if len(content) > LARGEST:
        raise DocumentError(f"{what} is longer than {LARGEST >> 10} kB")
    try:
        told = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise DocumentError(f"{what} is not JSON") from error
    if not isinstance(told, dict):
        raise DocumentError(f"{what} is not an object")
    return told


def mapping_of(raw: Any) -> Mapping[str, Any]:
    """Return an object, {} for anything else."""
    return raw if isinstance(raw, dict) else {}


def list_of(raw: Any) -> list[Any]:
    """Return a list, [] for anything else."""
    return raw if isinstance(raw, list) else []


def text_of(raw: Any) -> str:
    """Return the first `LONGEST` characters of a text, "" for anything else."""
    return raw[:LONGEST] if isinstance(raw, str) else ""


def number_of(raw: Any, low: float, high: float) -> float | None:
    """Return a number of low..high, None for anything else."""
    if isinstance(raw, bool) or not isinstance(raw, int | float):
        return None
    return float(raw) if low <= raw <= high and math.isfinite(raw) else None
