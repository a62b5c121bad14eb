"""Reads the section [live] of the file: where Foxglove and Lichtblick see what happens."""

from __future__ import annotations

from dataclasses import dataclass

from companion.config.checks import Section, checked, harmless, setting
from companion.pages.listen import Listen, read_listen


@dataclass(frozen=True)
class LiveSection(Section):
    """The live view: the topics of the recordings, for Foxglove and Lichtblick, while it happens."""

    listen: str = setting("", checked(read_listen, harmless), 'address:port of the live view; "": none')

    @property
    def address(self) -> Listen | None:
        """Where the live view listens; None: there is none."""
        return read_listen(self.listen)
