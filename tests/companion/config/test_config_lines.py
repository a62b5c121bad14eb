"""Where the keys of a TOML file stand."""

from __future__ import annotations

import json
import re
import string
import sys
from collections.abc import Iterator, Mapping
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from companion.config.toml_lines import KeyPath, key_lines

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

_ODD = '''
# a comment with [brackets] and key = "value"
top = 1
[table]   # [not.this]
plain = "a # b = ["
'quoted key' = [1,
  2, # ] not the end
  "]"]
"esc\\u0041pe\\"d" = """
fake = 1
[fake]
"""
a . b."c.d" = 3
inline = { x = 1, y = { z = 2 } }
raw = \'\'\'
other = 2\'\'\'
after = 1979-05-27T07:32:00Z
[other . "sub table"]
last = -1.5e3
[[many]]
name = "one"
'''
_INSIDE = {("table", "inline", *rest) for rest in [("x",), ("y",), ("y", "z")]}
"""Keys of inline tables: they count as part of the key that holds them."""


def _paths(data: Mapping[str, Any], above: KeyPath = ()) -> Iterator[KeyPath]:
    for key, value in data.items():
        yield (*above, key)
        if isinstance(value, Mapping):
            yield from _paths(value, (*above, key))


def test_odd_files_are_read_like_the_parser_reads_them() -> None:
    lines = key_lines(_ODD)
    assert lines == {
        ("top",): 3,
        ("table",): 4,
        ("table", "plain"): 5,
        ("table", "quoted key"): 6,
        ("table", 'escApe"d'): 9,
        ("table", "a"): 13,
        ("table", "a", "b"): 13,
        ("table", "a", "b", "c.d"): 13,
        ("table", "inline"): 14,
        ("table", "raw"): 15,
        ("table", "after"): 17,
        ("other",): 18,
        ("other", "sub table"): 18,
        ("other", "sub table", "last"): 19,
        ("many",): 20,
        ("many", "name"): 21,
    }
    assert set(_paths(tomllib.loads(_ODD))) <= set(lines) | _INSIDE


_KEYS = st.text(string.ascii_letters + string.digits + "_- .#='\"[]\\\té", min_size=1, max_size=8)
_TEXTS = st.text(string.printable.replace("\r", "").replace("\x0b", "").replace("\x0c", ""), max_size=20)
_VALUES = st.one_of(st.integers(-9, 9), st.booleans(), _TEXTS, st.lists(_TEXTS, max_size=3))


def _written(key: str) -> str:
    if re.fullmatch("[A-Za-z0-9_-]+", key):
        return key
    literal = "'" not in key and "\t" not in key
    return f"'{key}'" if literal else json.dumps(key, ensure_ascii=False)


def _value(value: object, style: str) -> str:
    """A value in one of TOML's ways: on one line, or over several."""
    if isinstance(value, str) and style == "long":
        lines = (json.dumps(line, ensure_ascii=False)[1:-1] for line in value.split("\n"))
        return '"""\n' + "\n".join(lines) + '"""'
    if isinstance(value, list) and style == "long":
        return "[ # ]\n" + "".join(f"  {_value(one, style)},\n" for one in value) + "]"
    return json.dumps(value, ensure_ascii=False)


@settings(max_examples=60)
@given(
    st.dictionaries(_KEYS, st.dictionaries(_KEYS, _VALUES, max_size=4), max_size=4),
    st.sampled_from(["short", "long"]),
)
def test_every_key_is_found_on_the_line_where_it_is_written(
    data: dict[str, dict[str, object]], style: str
) -> None:
    text = ""
    expected: dict[KeyPath, int] = {}
    for name, table in data.items():
        expected[name,] = text.count("\n") + 1
        text += f"[{_written(name)}]\n"
        for key, value in table.items():
            expected[name, key] = text.count("\n") + 1
            text += f"{_written(key)} = {_value(value, style)} # = [\n"
    assert tomllib.loads(text) == data
    assert key_lines(text) == expected
