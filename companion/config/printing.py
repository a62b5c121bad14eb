"""Formats the configuration in force as TOML, and its JSON schema for editors."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import Any

from companion.config.checks import Section, ValueCheck, harmless, number, section_schema, text
from companion.config.reading import WORDS_OFFERED
from companion.config.schema import SECTIONS, WORD_KEYS, Config

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def format_config(config: Config) -> str:
    """Format what may be shown of `config` as TOML, with each setting's meaning, to be printed and recorded.

    The vehicle's file is merged into it. Of the values, only what `ValueCheck.shown` makes of them is in it.
    """
    return "\n".join(_lines(config)) + "\n"


def json_schema() -> dict[str, Any]:
    """Make the JSON schema (draft 2020-12) of the configuration files.

    Editors that support schemas for TOML complete and check by it. Only `load_config` checks rules between
    settings or between words.
    """
    properties: dict[str, Any] = {name: section_schema(section) for name, section in SECTIONS.items()}
    properties["vocabulary"] = {"description": WORD_KEYS["vocabulary"], **WORDS_OFFERED.schema}
    properties["words"] = _word_table(WORD_KEYS["words"], number(-1, 1))
    properties["aliases"] = _word_table(WORD_KEYS["aliases"], text)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "AnyTraverse companion",
        "type": "object",
        "properties": properties,
        "additionalProperties": False,
    }


def _word_table(meaning: str, value: ValueCheck) -> dict[str, Any]:
    return {"description": meaning, "type": "object", "additionalProperties": value.schema}


def _lines(config: Config) -> Iterator[str]:
    yield f"vocabulary = {toml_value(list(config.vocabulary))}"
    tables: dict[str, Mapping[str, object]] = {"words": config.words, "aliases": config.aliases}
    for name, table in tables.items():
        yield f"\n[{name}]"
        for word, value in table.items():
            yield f"{word if _BARE.fullmatch(word) else toml_value(word)} = {toml_value(value)}"
    for name in SECTIONS:
        yield from _section(name, getattr(config, name))


def _section(name: str, section: Section) -> Iterator[str]:
    yield f"\n[{name}]"
    tables: list[tuple[str, Section]] = []
    for field in fields(section):
        value = getattr(section, field.name)
        meaning = field.metadata["meaning"]
        shown = field.metadata["check"].shown
        if (name, field.name) == ("vehicle", "file"):
            yield f'file = ""  # merged into this from {harmless(value) or "no file"}'
        elif value is None:
            yield f"# {field.name} is not set: {meaning}"
        elif field.metadata["tables"]:
            tables += [(f"{name}.{field.name}.{key}", table) for key, table in value]
        elif value == field.default:
            yield f"{field.name} = {toml_value(value)}  # {meaning}"
        elif shown is None:
            yield f"# {field.name} is set, and not shown: {meaning}"
        else:
            yield f"{field.name} = {toml_value(shown(value))}  # {meaning}"
    for inner, table in tables:
        yield from _section(inner, table)


def toml_value(value: object) -> str:
    """Format a value in TOML."""
    match value:
        case bool():
            return str(value).lower()
        case str():
            return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
        case list() | tuple():
            return f"[{', '.join(toml_value(one) for one in value)}]"
        case _:
            return repr(value)
