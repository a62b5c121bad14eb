"""Settings are changed in a TOML text however it is written, and its comments stay in their order."""

from __future__ import annotations

import sys
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.config.toml_edit import EditError, edited
from companion.config.toml_lines import comments

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

_VALUES = st.integers(-5, 5).map(str) | st.sampled_from(
    ["true", '"a # b"', "'c'", '"""\nx # y\n[z]\n"""', "[\n 1, # one\n 2,\n]", "{ p = 1 }", "[{a=1},{a=2}]"]
)
_KEYS = st.sampled_from(["a", "b", '"d e"', "'f.g'", "h-1"])
_LINES = st.one_of(
    st.builds(lambda key, value, end: f"{key} = {value}{end}", _KEYS, _VALUES, st.sampled_from(["", " # c"])),
    st.builds(lambda key, inner, value: f" {key}.{inner}={value}", _KEYS, _KEYS, _VALUES),
    st.sampled_from(["", "# note", "# a = 3", "# [t]", "  # [t.u]", "#[b]"]),
    st.sampled_from(["[t]", "[t.u]", "[ v ]", '["w x"]', "[[arr]]", "[t.u.y] # h"]),
)
_PATHS = st.lists(st.sampled_from(["a", "b", "t", "u", "w x", "d e", "new"]), min_size=1, max_size=3).map(
    tuple
)
_NEW: st.SearchStrategy[Any] = st.one_of(
    st.none(), st.integers(-9, 9), st.floats(-2, 2), st.booleans(), st.text(max_size=5)
)


def _is_toml(text: str) -> bool:
    try:
        tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return False
    return True


_TEXTS = st.builds(
    lambda lines, end: "\n".join(lines) + end, st.lists(_LINES, max_size=12), st.sampled_from("\n ")
)


@pytest.mark.slow
@given(_TEXTS.filter(_is_toml), _PATHS, _NEW)
@settings(max_examples=200, deadline=None)
def test_any_text_says_what_was_asked_and_keeps_its_comments(text: str, keys: Any, value: Any) -> None:
    refused, after = "", text
    try:
        after = edited(text, {keys: value})
    except EditError as error:
        refused = str(error)
    if refused:
        assert "is a table" in refused or "is no table" in refused
        return
    found: Any = tomllib.loads(after)
    for key in keys:
        found = found.get(key) if isinstance(found, dict) else None
    assert found == value
    kept = [line for line in comments(text).values() if "[" not in line]
    assert [line for line in comments(after).values() if "[" not in line] == kept


def test_a_table_is_not_replaced_by_a_value() -> None:
    with pytest.raises(EditError, match="is a table: give its settings"):
        edited("[t]\n# note\na = 1\n", {("t",): 1})
    with pytest.raises(EditError, match="is no table"):
        edited("t = 1\n", {("t", "a"): 1})
