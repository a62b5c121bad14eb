"""Holds what somebody has changed so far and not written: always a configuration without a problem."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from contextlib import suppress
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
    ) -> list[str]:
        """Change settings as `propose` does, all or none. Returns their keys.

        waiting: changes that were refused before. Height and tilt, say, are right only together: those that
        are right with `changes` are taken along. Raises RequestError with all that is wrong with `changes`.
        """
        more = dict(list((waiting or {}).items())[-_MOST_WAITING:])
        with self._lock:
            taken = self._first_right(changes, more)
            for key in more.keys() - taken:
                with suppress(RequestError):
                    self._take({key: more[key]})
                    taken.add(key)
            return sorted(taken)

    def _first_right(
        self, changes: Mapping[str, object | None], more: Mapping[str, object | None]
    ) -> set[str]:
        """Take the changes with all others, else alone, else with one of them. Returns the keys."""
        try:
            self._take(changes if not more else {**more, **changes})
            return {*more, *changes}
        except RequestError:
            if not more:
                raise
        try:
            self._take(changes)
            return {*changes}
        except RequestError:
            for key, value in more.items():
                with suppress(RequestError):
                    self._take({key: value, **changes})
                    return {key, *changes}
            raise

    def _take(self, changes: Mapping[str, object | None]) -> None:
        together = {**self._changes, **changes}
        if len(together) > MOST:
            raise RequestError(f"{MOST} settings are changed: write them first")
        try:
            self._proposal, self._config = self._proposed(together)
        except (ConfigError, ValueError) as error:
            raise RequestError(_reasons(error)) from error
        self._changes = together

    def forget(self) -> None:
        """Drop all changes. Raises RequestError where the file has a problem by now."""
        with self._lock:
            try:
                self._proposal, self._config = self._proposed({})
            except ConfigError as error:
                raise RequestError(str(error)) from error
            self._changes = {}

    def write(self) -> None:
        """Write the changes into the file. Raises RequestError, with the file unchanged."""
        with self._lock:
            if not self._proposal.diff:
                raise RequestError("nothing is changed")
            try:
                kept = write(self.file, self._proposal)
                self._proposal, self._config = self._proposed({})
            except ConfigError as error:
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
            raise ConfigError(proposal.problems)
        return proposal, load_layer(read_layer(self.file, proposal.after.encode()))


def _reasons(error: Exception) -> str:
    """Return what is wrong without the lines of a file that nobody sees."""
    if not isinstance(error, ConfigError):
        return str(error)
    return "; ".join(f"{one.key}: {one.reason}" if one.key else one.reason for one in error.problems)
