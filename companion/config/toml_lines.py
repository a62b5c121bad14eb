"""Finds the lines of tables, settings and comments in a TOML text: its parser reports none."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

KeyPath = tuple[str, ...]

_TOKEN = re.compile(
    r"""
      (?P<string> \"{3}(?:\\.|[^\\])*?\"{3}\"{0,2} | '{3}.*?'{3}'{0,2} | "(?:\\.|[^"\\\n])*" | '[^'\n]*' )
    | (?P<comment> \#[^\n]* )
    | (?P<newline> \n )
    | (?P<mark> [\[\]{}=.,] )
    | (?P<space> [ \t\r]+ )
    | (?P<bare> [^\s\[\]{}=.,\#"']+ | . )
    """,
    re.VERBOSE | re.DOTALL,
)
_ESCAPE = re.compile(r"\\(?:u([0-9a-fA-F]{4})|U([0-9a-fA-F]{8})|x([0-9a-fA-F]{2})|(.))", re.DOTALL)
_SIMPLE_ESCAPES = {"b": "\b", "t": "\t", "n": "\n", "f": "\f", "r": "\r", "e": "\x1b"}


class Statement(NamedTuple):
    """One header or one assignment.

    table, keys: keys of the table around it, and of the setting, () for a header. line, last: where it begins
    and ends, from 1.
    """

    table: KeyPath
    keys: KeyPath
    line: int
    last: int

    @property
    def path(self) -> KeyPath:
        """All its keys."""
        return (*self.table, *self.keys)


def key_lines(text: str) -> dict[KeyPath, int]:
    """Map the path of every table and key to its line, from 1. `text` must be valid TOML.

    Keys inside inline tables and arrays are not listed: they have the line of the key that holds them.
    """
    lines: dict[KeyPath, int] = {}
    for one in statements(text):
        for depth in range(1, len(one.path) + 1):
            lines.setdefault(one.path[:depth], one.line)
    return lines


def statements(text: str) -> Iterator[Statement]:
    """Yield each header and each assignment in order. `text` must be valid TOML."""
    table: KeyPath = ()
    parts: list[str] = []
    line, first, depth, in_header, in_value = 1, 1, 0, False, False
    for match in _TOKEN.finditer(text):
        kind, token = match.lastgroup, match.group()
        if in_value:
            depth += (token in "[{") - (token in "]}") if kind == "mark" else 0
            in_value = depth > 0 or kind != "newline"
            if not in_value:
                yield Statement(table, tuple(parts), first, line)
                parts = []
        elif kind == "mark" and token == "[":
            in_header = True
        elif kind == "mark" and token == "]" and in_header:
            table, parts, in_header = tuple(parts) or table, [], False
            yield Statement(table, (), line, line)
        elif kind == "mark" and token == "=":
            in_value, first, depth = True, line, 0
        elif kind in {"string", "bare"}:
            parts.append(_unquoted(token))
        line += token.count("\n")
    if in_value:
        yield Statement(table, tuple(parts), first, line)


def comments(text: str) -> dict[int, str]:
    """Map the line, from 1, of each comment that has a line of its own to it. `text` must be valid TOML."""
    lines, taken = text.split("\n"), set[int]()
    for one in statements(text):
        taken.update(range(one.line, one.last + 1))
    return {n: line for n, line in enumerate(lines, 1) if n not in taken and line.lstrip().startswith("#")}


def _unquoted(key: str) -> str:
    if key[0] == "'":
        return key[1:-1]
    return _ESCAPE.sub(_unescape, key[1:-1]) if key[0] == '"' else key


def _unescape(match: re.Match[str]) -> str:
    simple: str | None = match.group(4)
    if simple is not None:
        return _SIMPLE_ESCAPES.get(simple, simple)
    return chr(int(match.group(1) or match.group(2) or match.group(3), 16))
