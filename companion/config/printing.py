"""A configuration as TOML: what is in force, for a person to read."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import fields

from companion.config.checks import Section
from companion.config.schema import SECTIONS, Config

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def format_config(config: Config) -> str:
    """TOML that loads as `config`, with what each setting means. The vehicle's file is merged into it."""
    return "\n".join(_lines(config)) + "\n"


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
        if (name, field.name) == ("vehicle", "file"):
            yield f'file = ""  # merged into this from {value or "no file"}'
        elif value is None:
            yield f"# {field.name} is not set: {meaning}"
        elif field.metadata["tables"]:
            tables += [(f"{name}.{field.name}.{key}", table) for key, table in value]
        else:
            yield f"{field.name} = {toml_value(value)}  # {meaning}"
    for inner, table in tables:
        yield from _section(inner, table)


def toml_value(value: object) -> str:
    """`value` as TOML writes it."""
    match value:
        case bool():
            return str(value).lower()
        case str():
            return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
        case list() | tuple():
            return f"[{', '.join(toml_value(one) for one in value)}]"
        case _:
            return repr(value)
