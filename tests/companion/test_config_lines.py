"""Where the keys of a TOML file stand."""

from __future__ import annotations

import string

import tomlkit
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.config.lines import key_lines

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
    tomlkit.parse(_ODD)


_KEYS = st.text(string.ascii_letters + string.digits + "_- .#='\"[]é", min_size=1, max_size=8)
_TEXTS = st.text(string.printable.replace("\r", "").replace("\x0b", "").replace("\x0c", ""), max_size=20)
_VALUES = st.one_of(st.integers(-9, 9), st.booleans(), _TEXTS, st.lists(_TEXTS, max_size=3))


@settings(max_examples=60, deadline=None)
@given(st.dictionaries(_KEYS, st.dictionaries(_KEYS, _VALUES, max_size=4), max_size=4))
def test_every_key_is_found_on_the_line_where_it_is_written(data: dict[str, dict[str, object]]) -> None:
    text = tomlkit.dumps(data)
    lines = key_lines(text)
    assert set(lines) == {(name,) for name in data} | {(name, key) for name in data for key in data[name]}
    rows = text.split("\n")
    for path, line in lines.items():
        name = tomlkit.key(path[-1]).as_string()
        assert rows[line - 1].lstrip("[").startswith(name)
