"""Packs all parameters into one small file, in the format of ArduPilot's `@PARAM/param.pck`. Little-endian.

Source: libraries/AP_Filesystem of ArduPilot, README.md and AP_Filesystem_Param.cpp. ArduPilot pads with
zeros, so that no value crosses a block. We do not: our file does not change while it is read.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from urllib.parse import parse_qsl

from companion.wire.parameters import Parameter

MAGIC = 0x671B
MAGIC_WITH_DEFAULTS = 0x671C
_HEAD = struct.Struct("<HHH")
_FLOAT = 4
_HAS_DEFAULT = 1 << 4
_MOST_IN_COMMON = 15
_LAST = 0xFFFE
_DIGITS = 6
"""Decimal places of a value; values that differ only behind them are equal."""


@dataclass(frozen=True)
class ListOptions:
    """A client's options: `count` parameters (0: all) from index `start` on.

    with_defaults: whether to add the configured values.
    """

    start: int = 0
    count: int = 0
    with_defaults: bool = False

    @classmethod
    def read(cls, query: str) -> ListOptions:
        """Parse `start=5&count=10&withdefaults=1`, any of them; others are ignored. Raises ValueError."""
        options = dict(parse_qsl(query, keep_blank_values=True))
        start, count = (_number(options.get(name, "0"), _LAST) for name in ("start", "count"))
        return cls(start, count, bool(_number(options.get("withdefaults", "0"), 1)))


def pack(parameters: Sequence[Parameter], options: ListOptions, configured: Mapping[str, float]) -> bytes:
    """Pack the file. configured: name -> configured value, packed where it differs from the value in force.

    Raises ValueError when there are no parameters from `options.start` on.
    """
    chosen = parameters[options.start :][: options.count or None]
    if options.start and not chosen:
        raise ValueError(f"there are {len(parameters)} parameters, none from {options.start} on")
    magic = MAGIC_WITH_DEFAULTS if options.with_defaults else MAGIC
    packed, before = _HEAD.pack(magic, len(chosen), len(parameters)), ""
    for one in chosen:
        default = configured.get(one.name) if options.with_defaults else None
        packed += _row(one, before, default)
        before = one.name
    return packed


def _row(parameter: Parameter, before: str, default: float | None) -> bytes:
    name, values = parameter.name, struct.pack("<f", parameter.value)
    common = min(_in_common(before, name), len(name) - 1, _MOST_IN_COMMON)
    rest = name[common:].encode()
    kind = _FLOAT
    if default is not None and round(default, _DIGITS) != round(parameter.value, _DIGITS):
        kind |= _HAS_DEFAULT
        values += struct.pack("<f", default)
    return bytes([kind, (len(rest) - 1) << 4 | common]) + rest + values


def _in_common(one: str, other: str) -> int:
    same = [a == b for a, b in zip(one, other, strict=False)]
    return same.index(False) if False in same else len(same)


def _number(text: str, most: int) -> int:
    if not text.isascii() or not text.isdigit() or int(text) > most:
        raise ValueError(f'"{text}" is not a number up to {most}')
    return int(text)
