"""Makes the same calls over real sockets in real time; a relay between the two ends is the bad radio."""

from __future__ import annotations

import contextlib
import socket
import time
from pathlib import Path
from typing import Any

from bench.link.drive import DriveOutcome, drive
from bench.link.lossy import StreamingAutopilot, is_for_autopilot
from bench.link.operator import Operator
from bench.link.radio_model import LinkConditions, RadioModel
from bench.link.rover import Rover
from companion.config.link_settings import Address
from companion.link.transport import opener
from gcs_plugin.terminal.connection import open_connection

WEATHER = LinkConditions(loss=0.3, twice=0.1, shuffled=0.1, stall_every=8.0)
HOST = "127.0.0.1"


class Relay:
    """Plays autopilot and radio between the rover's socket and the operator's at `port`."""

    def __init__(self, weather: LinkConditions, seed: str, port: int) -> None:
        self._rover, self._ground = _socket(), _socket()
        self._operator = (HOST, port)
        self._near: Any = None
        self._up, self._down = RadioModel(weather, f"up {seed}"), RadioModel(weather, f"down {seed}")
        self._autopilot = StreamingAutopilot()

    @property
    def port(self) -> int:
        """The port to which the rover sends."""
        return int(self._rover.getsockname()[1])

    def carry(self, now: float) -> None:
        """Carries what has come in on either side."""
        for frame, near in _received(self._rover):
            self._near = near
            if not is_for_autopilot(frame):
                self._up.put(frame, now)
        for frame, _ in _received(self._ground):
            self._down.put(frame, now)
        for frame in self._up.take(now):
            self._ground.sendto(frame, self._operator)
        if self._near is not None:
            for frame in (*self._down.take(now), *self._autopilot.says(now)):
                self._rover.sendto(frame, self._near)

    def close(self) -> None:
        """Closes the sockets."""
        self._rover.close()
        self._ground.close()


def run(weather: LinkConditions, calls: int, folder: Path, seed: str = "1") -> DriveOutcome:
    """Makes `calls` calls, a few seconds each."""
    connection = open_connection(f"udpin:{HOST}:0")
    relay = Relay(weather, seed, int(connection.name.rpartition(":")[2]))
    rover = Rover(folder, opener(Address("udpout", HOST, relay.port)))
    operator = Operator(connection, seed, lambda: rover.shows)

    def step() -> None:
        relay.carry(time.monotonic())
        rover.turn()
        relay.carry(time.monotonic())
        operator.step(time.monotonic())

    try:
        return drive(rover, operator, calls, step)
    finally:
        rover.close()
        operator.close()
        relay.close()


def _socket() -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind((HOST, 0))
    made.settimeout(0)
    return made


def _received(from_: socket.socket) -> list[tuple[bytes, Any]]:
    received = []
    with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
        while True:
            received.append(from_.recvfrom(4096))
    return received
