"""Changes settings in a TOML text, and keeps everything else: comments, order, and how values are written.

tomlkit replaces a value where it stands. A setting that is new goes below the comment that describes it: the
shipped file has every setting as "# name = default", below a headline that may be a comment, too.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Mapping, MutableMapping
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from companion.config.toml_lines import KeyPath, Statement, comments, statements

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

_HEADLINE = re.compile(r"#\s*\[+\s*([\w.-]+)\s*\]+\s*\Z")
_SETTING = re.compile(r'#\s*("?)([\w -]+)\1\s*=')
_FREE = frozenset({"words", "aliases"})
"""Tables in which any key may stand: what comments show there is an example."""


class EditError(ValueError):
    """The text cannot be changed by program; the message says what to do."""


def edited(text: str, changes: Mapping[KeyPath, object]) -> str:
    """Return `text`, valid TOML with "\\n", with each value set, or removed where it is None.

    Where the last word or alias is removed, an empty table stays.
    Raises EditError for a value that is none of TOML, or where the result would say anything else than asked.
    """
    wanted = tomllib.loads(text)
    try:
        for keys in (keys for keys, value in changes.items() if value is None):
            text = _removed(text, keys, wanted)
        given = {keys: _plain(value) for keys, value in changes.items() if value is not None}
        there = {keys: value for keys, value in given.items() if _has(wanted, keys)}
        for keys, value in given.items():
            _put(wanted, keys, value)
        text = _replaced(text, there)
        for keys, value in given.items():
            text = text if keys in there else _inserted(text, keys, value)
        for name in {keys[0] for keys, value in changes.items() if value is None and len(keys) > 1} & _FREE:
            if not wanted.get(name):  # without it, those of another file would come into force
                wanted[name] = {}
                text = text if name in tomllib.loads(text) else _on_top(text, f"{name} = {{}}")
        right = _filled(tomllib.loads(text)) == _filled(wanted)
    except (TOMLKitError, tomllib.TOMLDecodeError, KeyError, TypeError) as error:
        raise EditError(f"{_names(changes)}: edit the file by hand: {error}") from error
    if not right:
        raise EditError(f"{_names(changes)}: edit the file by hand")
    return text


def _names(changes: Mapping[KeyPath, object]) -> str:
    return ", ".join(".".join(keys) for keys in changes)


def _plain(value: object) -> object:
    match value:
        case float() if not math.isfinite(value):
            raise EditError("give a finite number")
        case bool() | int() | float() | str():
            return value
        case list() | tuple():
            return [_plain(one) for one in value]
    raise EditError("give a text, a number, true or false, or a list of them")


def _filled(data: Mapping[str, Any]) -> dict[str, Any]:
    """Leave out empty tables: a removed setting may leave its headline, or not. Without words is a choice."""
    inner = {key: _filled(one) if isinstance(one, Mapping) else one for key, one in data.items()}
    return {key: one for key, one in inner.items() if one != {} or key in _FREE}


def _has(data: object, keys: KeyPath) -> bool:
    for key in keys:
        if not isinstance(data, Mapping) or key not in data:
            return False
        data = data[key]
    return True


def _put(data: MutableMapping[str, Any], keys: KeyPath, value: object) -> None:
    for key in keys[:-1]:
        data = data.setdefault(key, {})
        if not isinstance(data, MutableMapping):
            raise EditError(f"{key} is no table: edit the file by hand")
    old = data.get(keys[-1])
    if isinstance(old, Mapping) or (isinstance(old, list) and any(isinstance(one, Mapping) for one in old)):
        raise EditError(f"{'.'.join(keys)} is a table: give its settings")
    data[keys[-1]] = value


def _replaced(text: str, values: Mapping[KeyPath, object]) -> str:
    if not values:
        return text
    document = tomlkit.parse(text)
    for keys, value in values.items():
        table: Any = document
        for key in keys[:-1]:
            table = table[key]
        table[keys[-1]] = value
    return tomlkit.dumps(document)


def _removed(text: str, keys: KeyPath, wanted: dict[str, Any]) -> str:
    """Take out the lines of a setting or table, and it out of `wanted`."""
    if not _has(wanted, keys):
        return text
    table: Any = wanted
    for key in keys[:-1]:
        table = table[key]
    del table[keys[-1]]
    doomed = {
        n for one in statements(text) if one.path[: len(keys)] == keys for n in range(one.line, one.last + 1)
    }
    if not doomed:  # it stands in an inline table
        document = tomlkit.parse(text)
        inner: Any = document
        for key in keys[:-1]:
            inner = inner[key]
        del inner[keys[-1]]
        return tomlkit.dumps(document)
    return "\n".join(line for n, line in enumerate(text.split("\n"), 1) if n not in doomed)


def _inserted(text: str, keys: KeyPath, value: object) -> str:
    """Write a new setting where a person would: see above."""
    table, lines = keys[:-1], text.split("\n")
    of_table = [one for one in statements(text) if one.path[: len(table)] == table]
    if any(one.keys and one.path == table for one in of_table):  # an inline table
        return _replaced(text, {keys: value})
    if not table:
        return _on_top(text, _assignment(keys, value))
    own = [one for one in of_table if one.table == table]
    dotted = [one for one in of_table if one.keys and len(one.table) < len(table)]
    if own:
        lines.insert(_place(text, own, keys[-1]), _assignment(keys[-1:], value))
    elif dotted:
        last = dotted[-1]
        lines.insert(last.last, _assignment(keys[len(last.table) :], value))
    elif (line := _commented_headline(text, table)) is not None:
        lines[line - 1] = f"[{_name(table)}]"
        return _inserted("\n".join(lines), keys, value)
    else:
        while lines and not lines[-1].strip():
            lines.pop()
        lines += [*([""] if lines else []), f"[{_name(table)}]", _assignment(keys[-1:], value), ""]
    return "\n".join(lines)


def _place(text: str, own: list[Statement], key: str) -> int:
    """Return the index of the line that a new setting of a table becomes.

    That is below the comment that shows its default, else below the table's last setting.
    """
    first, last = own[0].line, own[-1].last
    if own[0].table[0] in _FREE:
        return last
    following = (one.line for one in statements(text) if one.line > last)
    end = next(following, text.count("\n") + 2)
    for line, comment in comments(text).items():
        if not first < line < end:
            continue
        if _HEADLINE.match(comment.strip()):
            break
        found = _SETTING.match(comment.strip())
        if found and found[2].strip() == key:
            return line
    return last


def _commented_headline(text: str, table: KeyPath) -> int | None:
    """Return the line of "# [table]" where only comments stand between it and the next headline."""
    found = list(statements(text))
    for line, comment in comments(text).items():
        name = _HEADLINE.match(comment.strip())
        if name and name[1] == ".".join(table):
            after = next((one for one in found if one.line > line), None)
            if after is None or not after.keys:
                return line
    return None


def _on_top(text: str, line: str) -> str:
    """Write a setting above all tables: below the others there, else below the file's first comment."""
    lines = text.split("\n")
    headers = (one.line for one in statements(text) if not one.keys)
    before = next(headers, len(lines) + 1)
    others = [one.last for one in statements(text) if one.line < before]
    if others:
        lines.insert(others[-1], line)
        return "\n".join(lines)
    first = next((n for n, one in enumerate(lines) if not one.startswith("#")), len(lines))
    follows = "".join(lines[first : first + 1]).strip()
    lines[first:first] = [line, ""] if follows else ["", line] if first else [line]
    return "\n".join(lines)


def _name(keys: KeyPath) -> str:
    return ".".join(tomlkit.key(key).as_string() for key in keys)


def _assignment(keys: KeyPath, value: object) -> str:
    return f"{_name(keys)} = {tomlkit.item(value).as_string()}"
