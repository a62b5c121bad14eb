"""Every command that a page tells to type is one that the program understands."""

from __future__ import annotations

import re
import shlex
from argparse import ArgumentParser
from collections.abc import Callable
from pathlib import Path

import pytest

from anytraverse.cli import parser as anytraverse
from companion.cli import parser as companion
from gcs_plugin.console.main import parser as console
from gcs_plugin.terminal.main import parser as operator

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
PARSERS: dict[str, Callable[[], ArgumentParser]] = {
    "anytraverse": anytraverse,
    "companion": companion,
    "anytraverse-console": console,
    "anytraverse-operator": operator,
}


def typed(page: Path) -> list[list[str]]:
    """The commands in a page's blocks, in words: without sudo, folders, comments and what follows a pipe."""
    lines, inside, shell = [], False, False
    for line in page.read_text(encoding="utf-8").replace("\\\n", " ").splitlines():
        if line.startswith("```"):
            inside = not inside
            shell = inside and line.strip("` ") in ("", "sh")
        elif shell and (words := _words(line.removeprefix("$ "))):
            lines.append([words[0].rpartition("/")[2], *words[1:]])
    return lines


def _words(line: str) -> list[str]:
    try:
        words = shlex.split(line, comments=True)
    except ValueError:  # part of a quoted text of several lines
        return []
    while words and (words[0] == "sudo" or "=" in words[0]):
        words = words[1:]
    return words[: next((place for place, word in enumerate(words) if word in "|;&&>"), len(words))]


def is_understood(parser: ArgumentParser, words: list[str]) -> bool:
    try:
        parser.parse_args(words)
    except SystemExit as ended:
        return ended.code == 0
    return True


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_in_a_page_is_understood(page: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, *words in typed(page):
        if name in PARSERS:
            assert is_understood(PARSERS[name](), words), (name, words, capsys.readouterr().err)


def test_every_make_target_in_a_page_is_one() -> None:
    targets = set(
        re.findall(r"^([a-z-]+):.*##", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    )
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        named = re.findall(r"`(?:sudo )?make ([a-z-]+)(?: [A-Z][^`]*)?`", text)
        named += [words[1] for words in typed(page) if words[0] == "make" and len(words) > 1]
        assert set(named) <= targets, page.name


def test_commands_are_found_in_pages() -> None:
    names = [words[0] for page in PAGES for words in typed(page)]
    assert all(
        names.count(name) >= least for name, least in (("companion", 20), ("anytraverse", 10), ("make", 5))
    )
