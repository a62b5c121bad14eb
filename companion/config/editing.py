"""Changes the configuration file by program: proposes a text, and writes it whole."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from companion.config.guards import Guard, guard_of
from companion.config.toml_file import Problem

__all__ = ["Guard", "Proposal", "guard_of", "propose", "write"]


@dataclass(frozen=True)
class Proposal:
    """A changed text of the configuration file.

    before, after: the file's texts; they may hold secrets. diff: unified, with secrets left out, "" where
    nothing changes. problems: what `companion config check` would say of the text after. guarded: the keys
    of which `guard_of` says LOOPBACK, for the value before or after.
    """

    before: str = field(repr=False)
    after: str = field(repr=False)
    diff: str
    problems: tuple[Problem, ...]
    guarded: tuple[str, ...]


def propose(path: Path, changes: Mapping[str, object | None]) -> Proposal:
    """Propose the text of the file `path` with `changes`, keeping its comments and its order.

    changes: "section.key" -> a value of a TOML type, None: the key is removed. "words.WORD" and
    "aliases.WORD" are entries of these tables, "words" and "aliases" the whole tables, "vocabulary" the whole
    list. Raises ConfigError for a file that cannot be read.
    """
    raise NotImplementedError


def write(path: Path, proposal: Proposal) -> Path:
    """Write the text after into the file, and return the path of the kept version before, `path`.1.

    Raises ConfigError where the proposal has problems, the file is no longer the one before, or it cannot be
    written; the file is then unchanged.
    """
    raise NotImplementedError
