"""The JSON schema of the configuration: it says no more and no less than the checks, setting by setting."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.cli import main
from companion.config import json_schema
from companion.config.checks import Section
from companion.config.schema import SECTIONS
from companion.config.toml_file import Layer

SHIPPED = Path(__file__).parents[3] / "config"
SETTINGS = [(name, one) for name, section in SECTIONS.items() for one in fields(section)]
VALUES = (
    st.booleans()
    | st.integers(-(10**7), 10**7)
    | st.floats(-1e7, 1e7)
    | st.text(max_size=5)
    | st.sampled_from(["off", "hold", "high", "auto", "CPU", "udpin:127.0.0.1:14550"])
    | st.lists(st.integers(0, 300) | st.just("CPU"), max_size=3)
    | st.none()
)


def _fits(document: Any) -> bool:
    return bool(jsonschema.Draft202012Validator(json_schema()).is_valid(document))


@pytest.mark.parametrize(
    "name",
    ["companion.toml", *(f"vehicles/{name}.toml" for name in ("rover", "quadruped", "small-rover", "atv"))],
)
def test_the_shipped_files_fit_the_schema_beside_them(name: str) -> None:
    path = SHIPPED / name
    assert _fits(Layer.read(path).data)
    first = path.read_text().splitlines()[0]
    assert first.startswith("#:schema ")
    assert (path.parent / first.removeprefix("#:schema ")).samefile(SHIPPED / "companion.schema.json")


@pytest.mark.parametrize(
    "wrong",
    [
        {"camera": {"rate": "fast"}},
        {"camera": {"lop": True}},
        {"lnk": {}},
        {"words": {"grass": 2}},
        {"vocabulary": [1]},
        {"aliases": {"grass": 3}},
        {"link": {"more": {"wifi": {}}}},
        {"link": {"more": {"wifi": {"url": "udpin:0.0.0.0:1", "lop": 1}}}},
    ],
)
def test_what_a_check_refuses_an_editor_marks(wrong: dict[str, Any]) -> None:
    assert not _fits(wrong)


@given(st.sampled_from(SETTINGS), VALUES)
def test_what_a_check_takes_an_editor_does_not_mark(setting: tuple[str, Any], value: Any) -> None:
    name, field = setting
    try:
        field.metadata["check"](value)
    except ValueError:
        return
    assert _fits({name: {field.name: value}})


@given(st.sampled_from([one for one in SETTINGS if one[1].type in {"float", "int", "bool"}]), VALUES)
def test_for_numbers_and_flags_it_says_the_same(setting: tuple[str, Any], value: Any) -> None:
    name, field = setting
    fits = _fits({name: {field.name: value}})
    if isinstance(value, float) and value.is_integer():
        return  # 2.0 is a whole number in JSON, and none in TOML
    try:
        field.metadata["check"](value)
    except ValueError:
        assert not fits
    else:
        assert fits


@pytest.mark.parametrize("section", SECTIONS.values())
def test_every_setting_is_described(section: type[Section]) -> None:
    told = json_schema()["properties"]
    for name in (name for name, one in SECTIONS.items() if one is section):
        assert told[name]["description"]
        assert all(one["description"] for one in told[name]["properties"].values())


def test_the_command_prints_what_is_shipped(capsys: pytest.CaptureFixture[str]) -> None:
    """After a change: python -m companion config schema > config/companion.schema.json."""
    assert main(["config", "schema"]) == 0
    assert capsys.readouterr().out == (SHIPPED / "companion.schema.json").read_text()
