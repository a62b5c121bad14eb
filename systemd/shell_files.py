"""Writes the manual pages of the programs, and what completes them in bash and zsh: shell_files.py FOLDER

FOLDER becomes what a `share` folder holds: man/man1, bash-completion/completions, zsh/site-functions. Needs
argparse-manpage and shtab, which no program needs when it runs.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import shtab
from argparse_manpage.manpage import Manpage

from anytraverse.cli import parser as anytraverse
from companion.cli import parser as companion
from gcs_plugin.console.main import parser as console
from gcs_plugin.terminal.main import parser as operator

_FILES = ("FILE", "PICTURE", "RECORDING", "DRIVE", "PNG")
_FOLDERS = ("FOLDER", "DIR")


def write(folder: Path) -> None:
    """Write all files below `folder`. Raises OSError."""
    os.environ["COLUMNS"] = "1000"  # a usage is one line, which man breaks
    for name in ("XDG_CACHE_HOME", "XDG_STATE_HOME"):
        os.environ.pop(name, None)
    for parser in (companion(), anytraverse(), console(), operator()):
        program = parser.prog
        _tell_files(parser)
        for name, text in (
            (f"man/man1/{program}.1", manual(parser)),
            (f"bash-completion/completions/{program}", shtab.complete(parser, shell="bash")),
            (f"zsh/site-functions/_{program}", shtab.complete(parser, shell="zsh")),
        ):
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            # A default in the writer's home is one in the reader's.
            path.write_text(text.replace(f"{Path.home()}/", "~/"), encoding="utf-8")


def manual(parser: argparse.ArgumentParser) -> str:
    """Return the parser's manual page, in the language of man."""
    what = (parser.description or "").partition(":")[0].rstrip(".")
    said = {"description": what[:1].lower() + what[1:], "manual_section": "1", "manual_title": "AnyTraverse"}
    return f"{Manpage(parser, said)}\n"


def _tell_files(parser: argparse.ArgumentParser) -> None:
    for action in _actions(parser):
        words = str(action.metavar).split(".")[0] if action.nargs != 0 else ""
        if words in _FILES:
            action.complete = shtab.FILE  # type: ignore[attr-defined]
        elif words in _FOLDERS:
            action.complete = shtab.DIRECTORY  # type: ignore[attr-defined]


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                yield from _actions(below)
        else:
            yield action


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(f"shell_files.py: type: python {sys.argv[0]} FOLDER")
    write(Path(sys.argv[1]))
