"""Makes a proposal of a changed file for the supervisor: both ends of the process that does it.

The checks read files and import what judges words, which would stall the supervisor's main loop.
"""

from __future__ import annotations

import hashlib
import json
import select
import socket
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import msgspec

from companion.config import Config, load_config
from companion.config.request import Value
from companion.system.side_process import SideChild

COMMAND = (sys.executable, "-m", "companion.daemon.settings.proposing_process")
LONGEST = 128 << 10
"""Bytes of what either end says."""
_LONGEST_DIFF = 64 << 10
"""Bytes as JSON, in which it goes to the page."""
_MOST_PROBLEMS, _LONGEST_PROBLEM = 20, 500
_ASKED_WITHIN = 10.0


class Asked(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is to be proposed. file: its path. changes: as of `propose`.

    in_force: of the word tables that are changed as a whole, what the companion that runs has of each.
    """

    file: str
    changes: dict[str, Value]
    in_force: dict[str, Value] = {}


class Proposed(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A proposal that may be shown. sha256: of the file before. Else: of `Proposal`, cut to what is shown."""

    sha256: str = ""
    diff: str = ""
    problems: list[str] = []
    guarded: list[str] = []


class ProposingChild(SideChild):
    """Runs `python -m companion.daemon.settings.proposing_process`."""

    def __init__(self, command: Sequence[str] = COMMAND) -> None:
        """Start the process. Raises OSError."""
        super().__init__(command, buffer=2 * LONGEST, longest=LONGEST)


def proposed(
    file: Path, changes: Mapping[str, Value], in_force: Mapping[str, Value] | None = None
) -> Proposed:
    """Propose the changes of the file. What cannot be proposed is said as a problem. in_force: of `Asked`."""
    from companion.config.editing import propose
    from companion.config.toml_file import ConfigError

    try:
        # Who changes a table has seen the one in force: written over a newer one, it would take words away.
        if in_force and (newer := _newer(load_config(file), in_force)):
            why = "changed in the file since the companion was started: start it again first"
            return Proposed(problems=[f"{', '.join(newer)}: {why}"])
        found = propose(file, changes)
        sha256 = hashlib.sha256(found.before.encode()).hexdigest()
    except ConfigError as error:
        return Proposed(problems=_shown(error.problems))
    except ValueError as error:
        return Proposed(problems=_shown([error]))
    if len(json.dumps(found.diff)) > _LONGEST_DIFF:
        return Proposed(problems=["the change is too long to be shown here: make it in the shell"])
    return Proposed(sha256, found.diff, _shown(found.problems), list(found.guarded))


def _newer(config: Config, in_force: Mapping[str, Value]) -> list[str]:
    there = table_words(config, in_force)
    return [key for key, value in in_force.items() if there[key] != value]


def table_words(config: Config, keys: Iterable[str]) -> dict[str, Value]:
    """Return of the keys that are whole tables of words what the configuration has: `Asked.in_force`."""
    tables: dict[str, Value] = {
        "words": dict(config.words),
        "vocabulary": list(config.vocabulary),
        "aliases": dict(config.aliases),
    }
    return {key: tables[key] for key in keys if key in tables}


def _shown(problems: Sequence[object]) -> list[str]:
    texts = [str(one)[:_LONGEST_PROBLEM] for one in problems[:_MOST_PROBLEMS]]
    more = len(problems) - len(texts)
    texts = [text.encode(errors="replace").decode() for text in texts]
    return [*texts, f"and {more} more"] if more else texts


def main(channel: int) -> None:
    """Answer the one request that comes. channel: the descriptor of a socket. What it raises ends it."""
    with socket.socket(fileno=channel) as supervisor:
        if not select.select([supervisor], [], [], _ASKED_WITHIN)[0]:
            raise TimeoutError("the supervisor says nothing")
        asked = msgspec.json.decode(supervisor.recv(LONGEST), type=Asked)
        supervisor.settimeout(_ASKED_WITHIN)
        supervisor.send(msgspec.json.encode(proposed(Path(asked.file), asked.changes, asked.in_force)))
