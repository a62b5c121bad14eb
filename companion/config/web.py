"""Reads the sections [web] and [live]: where the page and the live view listen, and who may see them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from companion.config.checks import Conflict, Section, checked, harmless, setting
from companion.pages.listen import Listen, check_token, read_listen


@dataclass(frozen=True)
class WebSection(Section):
    """The page that shows a browser what the companion does."""

    listen: str = setting(
        "127.0.0.1:8191", checked(read_listen, harmless), 'address:port of the page; "": no page'
    )
    token: str = setting("", checked(check_token), "whoever knows it sees the page and may answer on it")

    def conflicts(self) -> Iterator[Conflict]:
        listen = self.address
        if listen is not None and not listen.loopback and not self.token:
            reason = "other computers reach this address: set token, too (`openssl rand -hex 16` makes one)"
            yield ("listen", "token"), reason

    @property
    def address(self) -> Listen | None:
        """Where the page listens; None: there is none."""
        return read_listen(self.listen)


@dataclass(frozen=True)
class LiveSection(Section):
    """The live view: the topics of the recordings, for Foxglove and Lichtblick, while it happens."""

    listen: str = setting("", checked(read_listen, harmless), 'address:port of the live view; "": none')

    @property
    def address(self) -> Listen | None:
        """Where the live view listens; None: there is none."""
        return read_listen(self.listen)
