"""Lists every setting of the file with its meaning, value, default and guard: JSON values for a page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from companion.config import Config
from companion.config.checks import ValueCheck
from companion.config.guards import Guard, guard_of, only_in_shell
from companion.config.schema import OF_A_VEHICLE, SECTIONS


def all_settings(config: Config, changes: Mapping[str, object | None]) -> list[dict[str, Any]]:
    """Return one row a setting, in the file's order. Of a value only what may be shown is in it.

    hidden: the value is more than that. guarded: some values are for the shell, or a page over loopback.
    shell: all are. changed: it is one of `changes`.
    """
    return [
        _row(name, one, getattr(getattr(config, name), one.name), changes)
        for name, section in SECTIONS.items()
        for one in fields(section)
        if not one.metadata["tables"]
    ]


def _row(section: str, one: Any, value: object, changes: Mapping[str, object | None]) -> dict[str, Any]:
    check: ValueCheck = one.metadata["check"]
    key = f"{section}.{one.name}"
    plain = _plain(value)
    shown = plain if value == one.default else None if check.shown is None else _plain(check.shown(plain))
    return {
        "key": key,
        "section": section,
        "name": one.name,
        "help": one.metadata["meaning"],
        "value": shown,
        "hidden": shown != plain,
        "default": _plain(one.default),
        "form": _form(check),
        "changed": key in changes,
        "guarded": any(guard_of(key, some) is Guard.LOOPBACK for some in (plain, *_others(check))),
        "shell": only_in_shell(key, plain),
        "vehicle": section in OF_A_VEHICLE,
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
    if kind in ("number", "integer"):
        low = schema.get("minimum", schema.get("exclusiveMinimum"))
        return {"type": kind, "low": low, "high": schema.get("maximum")}
    return {"type": {"boolean": "flag", "array": "list"}.get(str(kind), "text")}


def _plain(value: object) -> object:
    return list(value) if isinstance(value, tuple) else value
