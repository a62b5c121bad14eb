"""Shows how a configuration file changes, without its secrets."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from difflib import unified_diff
from typing import Any

from companion.cameras.shown import LEFT_OUT, is_like_a_url, shown
from companion.config.checks import checks_of
from companion.config.reading import may_be_shown
from companion.config.schema import SECTIONS, WORD_KEYS
from companion.config.toml_lines import KeyPath, statements

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

_MOST = 300
"""Characters of a line that are shown."""
_SETTING = re.compile(r"\b(\w+)\s*=\s*(.*)")
_QUOTES = "\"'`,;()[]{}<>"


def shown_diff(before: str, after: str, name: str) -> str:
    """Return the unified diff of two TOML texts, "" where they are the same.

    Of a value only that is shown which `ValueCheck.shown` makes of it, and a changed secret as "...". Of a
    comment, addresses and what looks like a setting are treated the same.
    """
    hidden = {**_hidden(before), **_hidden(after)}
    lines = _lines(before), _lines(after)
    found = unified_diff(*lines, name, f"{name}, changed", lineterm="")
    out = (line if n < 2 else line[:1] + hidden.get(line[1:], line[1:]) for n, line in enumerate(found))
    return "\n".join(line[:_MOST] for line in out)


def _lines(text: str) -> list[str]:
    """Return the lines as TOML has them: `splitlines` would end one within a comment, at U+2028."""
    lines = text.replace("\r\n", "\n").split("\n")
    return lines if lines[-1] else lines[:-1]


def _hidden(text: str) -> dict[str, str]:
    """Map each line that may not be shown as it is to what is shown of it."""
    text, lines = text.replace("\r\n", "\n"), _lines(text)
    hidden = {line: told for line in lines if (told := _told_of_comment(line)) != line}
    data = tomllib.loads(text)
    for one in statements(text):
        if not one.keys or _shows_all(one.path, value := _at(data, one.path)):
            continue
        seen = may_be_shown(one.path, value)
        whole = isinstance(seen, str) and one.line == one.last
        first = lines[one.line - 1].partition("=")[0]
        hidden[lines[one.line - 1]] = f'{first}= "{seen}"' if whole else f"{first}= {LEFT_OUT}"
        hidden.update(dict.fromkeys(lines[one.line : one.last], LEFT_OUT))
    return hidden


def _at(data: Mapping[str, Any], keys: KeyPath) -> object:
    found: Any = data
    for key in keys:
        found = found[key]
    return found


def _shows_all(keys: KeyPath, value: object) -> bool:
    """Whether all of a value may be shown. A word is for everybody."""
    if isinstance(value, Mapping):
        return all(_shows_all((*keys, key), one) for key, one in value.items())
    if keys[0] in WORD_KEYS or isinstance(value, bool | int | float):
        return True
    return value is not None and may_be_shown(keys, value) == value


def _told_of_comment(line: str) -> str:
    """Return what is shown of a line for its comment, and its addresses."""
    head, mark, tail = line.partition("#")
    if mark and (setting := _SETTING.search(tail)) and _is_text(setting[1]):
        value = setting[2].strip().strip(_QUOTES)
        seen = [may_be_shown((name, setting[1]), value) for name in SECTIONS]
        if value not in seen:
            tail = f"{tail[: setting.start(2)]}{LEFT_OUT}"
    words = re.split(r"(\s+)", head + mark + tail)
    return "".join(_told_of_word(word) for word in words)


def _told_of_word(word: str) -> str:
    core = word.strip(_QUOTES)
    if not core or not is_like_a_url(core) or LEFT_OUT in core or core.startswith(("/", "#")):
        return word
    told = shown(core)
    return word if told.rstrip("/") == core.rstrip("/") else word.replace(core, told)


def _is_text(name: str) -> bool:
    """Whether a setting of this name is a text, in some section."""
    checks = (checks_of(section).get(name) for section in SECTIONS.values())
    return any(one is not None and one.schema.get("type") == "string" for one in checks)
