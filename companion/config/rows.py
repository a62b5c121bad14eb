"""Lists every setting of the file with its meaning, value, default and guard: JSON values for a page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from companion.config import Config
from companion.config.checks import ValueCheck
from companion.config.guards import Guard, guard_of, guards_words, only_in_shell
from companion.config.schema import OF_A_VEHICLE, SECTIONS, WORD_KEYS
from companion.wire.parameters import OBSTACLE

_WORD_FORMS: Mapping[str, Mapping[str, str]] = {
    "vocabulary": {"type": "lines", "example": "dry grass"},
    "words": {"type": "table", "of": "number", "example": "dry grass: 0.5"},
    "aliases": {"type": "table", "of": "text", "example": "dry grass: DRYGR"},
}


def all_settings(config: Config, changes: Mapping[str, object | None]) -> list[dict[str, Any]]:
    """Return one row a setting, in the file's order. Of a value only what may be shown is in it.

    hidden: the value is more than that. guarded: some values are for the shell, or a page over loopback.
    shell: all are. changed: it is one of `changes`. typed: the key as it is set in the shell.
    """
    return [
        *(_of_words(key, meaning, config, changes) for key, meaning in WORD_KEYS.items()),
        *(
            _row(name, one, getattr(getattr(config, name), one.name), changes)
            for name, section in SECTIONS.items()
            for one in fields(section)
        ),
    ]


def _of_words(key: str, meaning: str, config: Config, changes: Mapping[str, object | None]) -> dict[str, Any]:
    """Return the row of words: each is a line, with what it has."""
    guarded, value = guards_words(config.perceiver.name), _plain(getattr(config, key))
    if key == "vocabulary":
        meaning = f"{meaning}, beside those in use"
        added = (*config.words, *(OBSTACLE[:1] if config.video.listen else ()))
        value = [word for word in config.vocabulary if word not in added]
    return {
        "key": key,
        "section": "words",
        "name": key,
        "help": meaning,
        "value": value,
        "hidden": False,
        "default": _plain(getattr(Config(), key)),
        "form": _WORD_FORMS[key],
        "changed": any(one.partition(".")[0] == key for one in changes),
        "guarded": guarded,
        "shell": guarded,
        "typed": key if key == "vocabulary" else f"{key}.WORD",
        "vehicle": True,
    }


def _row(section: str, one: Any, value: object, changes: Mapping[str, object | None]) -> dict[str, Any]:
    check: ValueCheck = one.metadata["check"]
    key = f"{section}.{one.name}"
    plain, default = _plain(value), _plain(one.default)
    shown = plain if value == one.default else None if check.shown is None else _plain(check.shown(plain))
    if one.metadata["tables"]:
        plain, shown, default = _flat(value), _flat(value, show=True), {}
    return {
        "key": key,
        "section": section,
        "name": one.name,
        "help": one.metadata["meaning"],
        "value": shown,
        "hidden": shown != plain,
        "default": default,
        "form": _form(check),
        "changed": any(one == key or one.startswith(f"{key}.") for one in changes),
        "guarded": any(guard_of(key, some) is Guard.LOOPBACK for some in (plain, *_others(check))),
        "shell": only_in_shell(key, plain),
        "typed": f"{key}.NAME.url" if one.metadata["tables"] else key,
        "vehicle": section in OF_A_VEHICLE,
    }


def _flat(connections: Any, *, show: bool = False) -> dict[str, object]:
    """Return tables in one, as `propose` takes them: "NAME.url" -> its value, or what is shown of it."""
    return {
        f"{name}.{one.name}": one.metadata["check"].shown(value) if show else value
        for name, table in connections
        for one in fields(table)
        if (value := getattr(table, one.name)) != one.default or one.name == "url"
    }


def _others(check: ValueCheck) -> list[object]:
    """Return values that stand for what else could be set: of some settings not all values are guarded."""
    return list(check.schema.get("enum", ())) or ([""] if check.schema.get("type") == "string" else [])


def _form(check: ValueCheck) -> dict[str, Any]:
    """Return how the value is entered: the parts of its JSON schema that an input needs."""
    schema = dict(check.schema)
    if "anyOf" in schema:
        return {"type": "text"}
    if "enum" in schema:
        return {"type": "choice", "options": list(schema["enum"])}
    kind = schema.get("type")
    if kind == "object":
        return {"type": "table", "of": "any", "example": "wifi.url: udpin:0.0.0.0:14551"}
    if kind in ("number", "integer"):
        low = schema.get("minimum", schema.get("exclusiveMinimum"))
        return {"type": kind, "low": low, "high": schema.get("maximum")}
    return {"type": {"boolean": "flag", "array": "list"}.get(str(kind), "text")}


def _plain(value: object) -> object:
    return list(value) if isinstance(value, tuple) else dict(value) if isinstance(value, Mapping) else value
