"""Reads the sections [link] and [link.more.NAME] of the file into the settings of the link."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from companion.config.checks import (
    Conflict,
    NestedError,
    Section,
    ValueCheck,
    checked,
    checks_of,
    flag,
    harmless,
    listing,
    number,
    path,
    section_schema,
    setting,
    whole,
)
from companion.config.link_settings import LONGEST_PACE, ConnectionSettings, LinkSettings, read_url
from companion.config.toml_file import nearest


@dataclass(frozen=True)
class ConnectionSection(Section):
    """One MAVLink connection."""

    url: str = setting(
        "udpin:127.0.0.1:14550",
        checked(read_url, harmless),
        "udpin:host:port, udpout:host:port, tcp:host:port or serial:device:baud",
    )
    budget: float = setting(300.0, number(0, 1e6), "bytes/s of unsolicited traffic, 0 unlimited")
    burst: float = setting(600.0, number(300, 1e6), "bytes that may be sent at once")
    asked_budget: float = setting(1500.0, number(0, 1e6), "bytes/s of replies to requests, 0 unlimited")
    pace: float = setting(0.03, number(0, LONGEST_PACE), "least s between frames; 0.05 behind PX4")

    def conflicts(self) -> Iterator[Conflict]:
        try:
            self.settings()
        except ValueError as error:
            yield _key_of(str(error)), str(error)

    def settings(self) -> ConnectionSettings:
        """Convert to the link's own settings. Raises LinkSettingError."""
        return ConnectionSettings(self.url, self.budget, self.burst, self.asked_budget, self.pace)


def _key_of(message: str) -> tuple[str, ...]:
    """The keys that an error is about, the likeliest first: the link's errors begin with a setting's name."""
    first = message.split(maxsplit=1)[0].rstrip(":")
    return (
        (first, "url") if first.split(".")[0] in {field.name for field in fields(LinkSection)} else ("url",)
    )


Connections = tuple[tuple[str, ConnectionSection], ...]


def _connections(value: object) -> Connections:
    """Check the tables [link.more.NAME], of one connection each. Raises NestedError, ValueError."""
    if not isinstance(value, Mapping):
        raise ValueError("give each connection a name and its settings: [link.more.wifi], then url = ...")
    problems: list[Conflict] = []
    found = tuple((name, _connection(name, table, problems)) for name, table in value.items())
    if problems:
        raise NestedError(problems)
    return found


def _connection(name: str, table: object, problems: list[Conflict]) -> ConnectionSection:
    if not isinstance(table, Mapping) or "url" not in table:
        problems.append(((name,), "needs a url, like udpin:0.0.0.0:14551"))
        return ConnectionSection()
    given, before = {}, len(problems)
    for key, value in table.items():
        try:
            given[key] = _checked(key, value)
        except ValueError as error:  # noqa: PERF203
            problems.append(((name, key), str(error)))
    read = ConnectionSection(**given)
    if len(problems) == before:
        for keys, reason in read.conflicts():
            problems.append(((name, next((key for key in keys if key in table), keys[0])), reason))
    return read


def _checked(key: str, value: object) -> Any:
    checks = checks_of(ConnectionSection)
    if key not in checks:
        raise ValueError(f"is not known; {nearest(key, checks)}")
    return checks[key](value)


_MORE = {
    "type": "object",
    "maxProperties": 3,
    "additionalProperties": {**section_schema(ConnectionSection), "required": ["url"]},
}


@dataclass(frozen=True)
class LinkSection(ConnectionSection):
    """MAVLink: the first connection, and settings of all connections."""

    system_id: int = setting(1, whole(1, 254), "our system id until the autopilot's is known")
    allowed_senders: tuple[int, int] = setting(
        (245, 255), listing(whole(1, 255), 2, 2), "first and last system id that may change anything"
    )
    signing_key: str | None = setting(None, path, "file of the signing key; unset: nothing is signed")
    unsigned_autopilot: bool = setting(
        False,  # noqa: FBT003
        flag,
        "with a key: whether the autopilot's telemetry is accepted unsigned",
    )
    more: Connections = setting(  # noqa: RUF009
        (), ValueCheck(_connections, _MORE), "further connections, at most 3", tables=True
    )

    def conflicts(self) -> Iterator[Conflict]:
        if self.unsigned_autopilot and not self.signing_key:
            yield ("unsigned_autopilot",), "counts only with a signing_key: give one, or take this out"
        try:
            self.settings()
        except ValueError as error:
            yield _key_of(str(error)), str(error)

    def with_paths_in(self, folder: Path) -> LinkSection:
        """Return these settings with a relative path of the key resolved against `folder`."""
        if self.signing_key is None:
            return self
        return replace(self, signing_key=str(folder / os.path.expanduser(self.signing_key)))

    def settings(self) -> LinkSettings:
        """Convert to the link's own settings. Raises LinkSettingError."""
        return LinkSettings(
            url=self.url,
            system_id=self.system_id,
            budget=self.budget,
            burst=self.burst,
            asked_budget=self.asked_budget,
            pace=self.pace,
            allowed_senders=self.allowed_senders,
            more={name: connection.settings() for name, connection in self.more},
        )
