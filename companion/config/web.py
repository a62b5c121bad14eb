"""Reads the sections [web], [live] and [alert]: where page and live view listen, and whom calls alert."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from companion.cameras.shown import address
from companion.config.checks import Conflict, Section, checked, harmless, setting
from companion.pages.listen import Listen, check_token, read_listen
from companion.system.alert import read_alert_url


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
class AlertSection(Section):
    """An address of the owner's that is told of each call."""

    url: str = setting(
        "", checked(read_alert_url), 'is told of each call by an HTTP POST, ntfy\'s for one; "": none'
    )
    link: str = setting("", checked(read_alert_url), "what a click on an alert opens, such as the page")

    @property
    def shown(self) -> str:
        """What may be shown of `url`, which may hold a token: scheme, host and port."""
        return address(self.url)


@dataclass(frozen=True)
class LiveSection(Section):
    """The live view: the topics of the recordings, for Foxglove and Lichtblick, while it happens."""

    listen: str = setting("", checked(read_listen, harmless), 'address:port of the live view; "": none')

    @property
    def address(self) -> Listen | None:
        """Where the live view listens; None: there is none."""
        return read_listen(self.listen)
