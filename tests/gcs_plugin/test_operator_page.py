"""The operator's page says what the program does."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from gcs_plugin.terminal.commands import parse
from gcs_plugin.terminal.main import main
from gcs_plugin.terminal.script import Script
from gcs_plugin.terminal.session import HELP

PAGE = (Path(__file__).parents[2] / "docs" / "operator.md").read_text()


def test_every_line_in_the_table_of_what_can_be_typed_is_understood() -> None:
    table = PAGE.split("## What can be typed")[1].split("## In MAVProxy")[0]
    lines = [
        line for row in table.splitlines() if row.startswith("| `") for line in re.findall("`([^`]+)`", row)
    ]
    assert len(lines) > 15
    assert all(parse(line) for line in lines)


def test_the_help_names_the_same_lines() -> None:
    for line in ("go", "stay", "look", "bush: -1", "tap drum -1", "forget bush", "new episode", "7 go"):
        assert line in "\n".join(HELP)


def test_the_example_of_a_table_is_a_script() -> None:
    Script.parse(PAGE.split("```json")[1].split("```")[0])


def test_every_option_is_on_the_page(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    options = set(re.findall(r"--[a-z-]+", capsys.readouterr().out)) - {"--help"}
    assert options
    assert {option for option in options if f"`{option}" not in PAGE} == set()
