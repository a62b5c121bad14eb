"""Owns several connections. What is for a rover leaves on the one on which its companion is heard."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from companion.wire.ids import COMPONENT_ID
from gcs_plugin.client.client import OperatorClient
from gcs_plugin.client.rovers import FRESH_S
from gcs_plugin.terminal.connection import OperatorConnection
from gcs_plugin.terminal.runner import Runner
from gcs_plugin.terminal.signing import OperatorSigning


class _End:
    """One connection's end of the client.

    Several connections may bring the same rover. Its messages are taken from the first connection that brings
    its companion, and from no other, so that nothing counts twice.
    """

    def __init__(self, links: Links, number: int) -> None:
        self._links = links
        self._number = number
        self.ids: tuple[int, int] | None = None
        self.heard: dict[int, float] = {}
        """When each rover's companion was heard here."""

    def receive(self, message: Any, now: float) -> None:
        system = message.get_srcSystem()
        if message.get_srcComponent() == COMPONENT_ID and message.get_type() == "HEARTBEAT":
            self.heard[system] = now
        if self._links.of(system, now) in (self._number, None):
            self._links.client.receive(message, now)

    def outgoing(self, now: float) -> list[Any]:
        return self._links.take(self._number, now)


class Links:
    """Runs the client on several connections, given in the order in which they are preferred."""

    def __init__(
        self,
        connections: Sequence[OperatorConnection],
        client: OperatorClient,
        system: int,
        component: int,
        signing: OperatorSigning | None = None,
    ) -> None:
        self.client = client
        client.ids = system, component
        self.connections = list(connections)
        self.signing = signing
        self._ends = [_End(self, number) for number in range(len(self.connections))]
        self._runners = [
            Runner(connection, end, system, component, signing)
            for connection, end in zip(self.connections, self._ends, strict=True)
        ]
        self._out: list[Any] = []

    @property
    def doubled(self) -> int:
        """How many signed frames came over more than one connection, and counted once."""
        return 0 if self.signing is None else self.signing.doubled

    def step(self, now: float) -> None:
        """Read and process what was received, then send what is due."""
        self._out = self.client.outgoing(now)
        for runner in self._runners:
            runner.step(now)

    def of(self, system: int, now: float) -> int | None:
        """Return which connection counts for a rover; None while its companion is heard on none."""
        heard = (n for n, end in enumerate(self._ends) if now - end.heard.get(system, -FRESH_S) < FRESH_S)
        return next(heard, None)

    def take(self, number: int, now: float) -> list[Any]:
        """Return what is to leave on a connection now."""
        return [message for message in self._out if self.of(message.target_system, now) == number]

    def close(self) -> None:
        """Close the connections, and store the signing timestamps."""
        for connection in self.connections:
            connection.close()
        if self.signing is not None:
            self.signing.close()
