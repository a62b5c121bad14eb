"""Says what to write instead of a line that is no TOML, for the mistakes that are made most."""

from __future__ import annotations

import re

_LINE = re.compile(r"""\s*(?P<key>[\w."' -]*?)\s*(?P<mark>[=:])\s*(?P<value>.*?)\s*(?:\#.*)?\Z""")
_COMMA = re.compile(r"([+-]?\d+),(\d+)")
_THOUSANDS = re.compile(r"[+-]?\d{1,3}(?:,\d{3})+\.\d+")
_BARE_POINT = re.compile(r"([+-]?)(\d*)\.(\d*)")
_ZEROS = re.compile(r"([+-]?)0+(\d+(?:\.\d+)?)")
_UNIT = re.compile(r"([+-]?\d+(?:\.\d+)?)\s*[^\W\d_]{0,4}[°%/]?\S{0,4}")
_CURLY = re.compile("[“”„«»‘’‚]")
_TRUE, _FALSE = frozenset({"true", "yes", "on"}), frozenset({"false", "no", "off"})
_NOTHING = frozenset({"none", "null", "nil", ""})
_LONGEST, _LONGEST_LINE = 40, 300


def mistake(line: str) -> tuple[str, str]:
    """Return the setting of a line that is no TOML, and what to write instead; "" for what is not known.

    A value is repeated only where it is a number: another may be a secret.
    """
    found = _LINE.fullmatch(line) if len(line) <= _LONGEST_LINE else None
    if found is None or len(found["key"]) > _LONGEST:
        return "", ""
    key, value = found["key"], found["value"]
    if " " in key and not key.endswith(("'", '"')):
        return key, f'a name with a space in it stands in quotes: "{key}" = ...'
    if not key:
        return "", ""
    if found["mark"] == ":":
        return key, f"write = in place of : after {key}"
    return key, _instead(key, value)


def _instead(key: str, value: str) -> str:
    if value.lower() in _TRUE | _FALSE:
        return (
            f"write {key} = {'true' if value.lower() in _TRUE else 'false'}, in small letters, without quotes"
        )
    if value.lower() in _NOTHING:
        return "it has no value: write one, or take the line out, so that it is unset"
    if _CURLY.search(value):
        return f'text stands in straight quotes: {key} = "..."'
    if number := _number(value):
        return f"write {key} = {number}"
    if value[0] in "\"'":
        if value.count(value[0]) == 1:
            return f"the closing {value[0]} of the text is missing"
        if "\\" in value and value[0] == '"':
            return f"a \\ in a text stands in single quotes: {key} = '...'"
        return ""
    if value[0].isalpha() or value[0] in "/~.":
        return f'text stands in quotes: {key} = "..."'
    return ""


def _number(value: str) -> str:
    """Return how TOML writes a number, "" for what is none."""
    if found := _COMMA.fullmatch(value):
        return f"{found[1]}.{found[2]}, with a decimal point"
    if _THOUSANDS.fullmatch(value):
        return f"{value.replace(',', '')}, without a comma"
    if (found := _BARE_POINT.fullmatch(value)) and (found[2] or found[3]):
        return f"{found[1]}{found[2] or '0'}.{found[3] or '0'}"
    if found := _ZEROS.fullmatch(value):
        return f"{found[1]}{found[2]}"
    if found := _UNIT.fullmatch(value):
        return f"{found[1]}, the number alone, without a unit"
    return ""
