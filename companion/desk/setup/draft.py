"""Holds what somebody has changed so far and not written: always a configuration without a problem."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from companion.config import Config, ConfigError
from companion.config.editing import Proposal, propose, write
from companion.config.reading import load_layer, read_layer
from companion.pages.requests import RequestError

MOST = 256
"""Settings that may be changed at once."""
_MOST_WAITING = 8
"""Settings that are tried once more with a change: each costs a look at the whole file."""


class Draft:
    """Changes of one configuration file. Any thread may use it."""

    def __init__(self, file: Path) -> None:
        """Raises ConfigError where the file has a problem: it is mended first."""
        self.file = file
        self._lock = threading.Lock()
        self._changes: dict[str, object | None] = {}
        self._proposal, self._config = self._proposed({})
        self._written = ""

    @property
    def config(self) -> Config:
        """The configuration with the changes."""
        return self._config

    @property
    def changes(self) -> Mapping[str, object | None]:
        """What is changed, as `propose` takes it."""
        return dict(self._changes)

    def change(
        self, changes: Mapping[str, object | None], waiting: Mapping[str, object | None] | None = None
    ) -> tuple[list[str], dict[str, str]]:
        """Change settings as `propose` does, all or none. Returns what is taken, and what is not, and why.

        waiting: changes that were refused before. Height and tilt, say, are right only together: those that
        are right with `changes` are taken along. Raises RequestError with all that is wrong with `changes`.
        """
        more = dict(list((waiting or {}).items())[-_MOST_WAITING:])
        groups = [changes, *({key: value, **changes} for key, value in more.items())]
        if more:
            groups.insert(0, {**more, **changes})
        refusals = list[str]()
        with self._lock:
            for group in groups:
                refusals.append(self._refusal(group))
                if not refusals[-1]:
                    break
            else:
                raise RequestError(refusals[groups.index(changes)])
            rest = more.keys() - group
            refused = {key: why for key in sorted(rest) if (why := self._refusal({key: more[key]}))}
            return sorted({*more, *changes} - refused.keys()), refused

    def _refusal(self, changes: Mapping[str, object | None]) -> str:
        """Change settings, and return "", or what is wrong with them."""
        together = {**self._changes, **changes}
        if len(together) > MOST:
            return f"{MOST} settings are changed: write them first"
        try:
            self._proposal, self._config = self._proposed(together)
        except (ConfigError, ValueError) as error:
            return _reasons(error)
        self._changes, self._written = together, ""
        return ""

    def forget(self) -> None:
        """Drop all changes. Raises RequestError where the file has a problem by now."""
        with self._lock:
            try:
                self._proposal, self._config = self._proposed({})
            except ConfigError as error:
                raise RequestError(str(error)) from error
            self._changes, self._written = {}, ""

    def write(self) -> None:
        """Write the changes into the file. Raises RequestError, with the file unchanged.

        Where somebody else has changed it, they are proposed for the file as it is by now: try again.
        """
        with self._lock:
            if not self._proposal.diff:
                raise RequestError("nothing is changed")
            try:
                kept = write(self.file, self._proposal)
                self._proposal, self._config = self._proposed({})
            except ConfigError as error:
                with suppress(ConfigError):
                    self._proposal, self._config = self._proposed(self._changes)
                raise RequestError(str(error)) from error
            self._changes = {}
            self._written = f"{self.file} is written; what stood there before is {kept}"

    def document(self) -> dict[str, Any]:
        """Return what the review shows: JSON values."""
        proposal = self._proposal
        return {
            "file": str(self.file),
            "diff": proposal.diff,
            "changed": sorted(self._changes) if proposal.diff else [],
            "guarded": list(proposal.guarded),
            "written": self._written,
        }

    def _proposed(self, changes: Mapping[str, object | None]) -> tuple[Proposal, Config]:
        proposal = propose(self.file, changes)
        if proposal.problems:
            # Of the file with the changes, which nobody sees: its lines would mislead.
            raise ConfigError([replace(one, line=None) for one in proposal.problems])
        return proposal, load_layer(read_layer(self.file, proposal.after.encode()))


def _reasons(error: Exception) -> str:
    """Return what is wrong without the lines of a file that nobody sees."""
    if not isinstance(error, ConfigError):
        return str(error)
    return "; ".join(
        f"{one.key}: {one.reason}" if one.key else str(one) if one.line else one.reason
        for one in error.problems
    )
