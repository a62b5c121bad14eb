"""Which line of a TOML file a key stands on: the standard parser does not say."""

from __future__ import annotations

import re
from collections.abc import Iterator

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


def key_lines(text: str) -> dict[KeyPath, int]:
    """Path of every table and key -> its line, from 1. `text` is valid TOML.

    Keys inside inline tables and arrays count as part of the key that holds them.
    """
    lines: dict[KeyPath, int] = {}
    for table, keys, line in _statements(text):
        path = (*table, *keys)
        for depth in range(1, len(path) + 1):
            lines.setdefault(path[:depth], line)
    return lines


def _statements(text: str) -> Iterator[tuple[KeyPath, KeyPath, int]]:
    """(table, keys, line) of each header (with no keys) and each assignment."""
    table: KeyPath = ()
    parts: list[str] = []
    line, depth, in_header, in_value = 1, 0, False, False
    for match in _TOKEN.finditer(text):
        kind, token = match.lastgroup, match.group()
        if in_value:
            depth += (token in "[{") - (token in "]}") if kind == "mark" else 0
            in_value = depth > 0 or kind != "newline"
            if not in_value:
                parts = []
        elif kind == "mark" and token == "[":
            in_header = True
        elif kind == "mark" and token == "]" and in_header:
            table, parts, in_header = tuple(parts) or table, [], False
            yield table, (), line
        elif kind == "mark" and token == "=":
            yield table, tuple(parts), line
            in_value, depth = True, 0
        elif kind in {"string", "bare"}:
            parts.append(_plain(token))
        line += token.count("\n")


def _plain(key: str) -> str:
    if key[0] == "'":
        return key[1:-1]
    return _ESCAPE.sub(_unescape, key[1:-1]) if key[0] == '"' else key


def _unescape(match: re.Match[str]) -> str:
    simple: str | None = match.group(4)
    if simple is not None:
        return _SIMPLE_ESCAPES.get(simple, simple)
    return chr(int(match.group(1) or match.group(2) or match.group(3), 16))
