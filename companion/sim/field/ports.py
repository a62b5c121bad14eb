"""Makes one of the autopilot's two ports a loopback UDP socket."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Callable
from typing import Any

from companion.sim.field.router import DatagramParser

MAX_DATAGRAM = 4096
MAX_DATAGRAMS_A_READ = 64


class UdpPort:
    """A UDP socket on a port of 127.0.0.1, 0: a free one, with one peer: the last address that sent MAVLink.

    Before that nothing is sent. `bytes_in` and `bytes_out` count whole datagrams.
    """

    def __init__(self, port: int = 0) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", port))
        self.socket.settimeout(0.0)
        self.parser = DatagramParser()
        self.bytes_in = 0
        self.bytes_out = 0
        self._peer: tuple[str, int] | None = None

    @property
    def number(self) -> int:
        return int(self.socket.getsockname()[1])

    def read(self, pass_to_script: Callable[[bytes], None] | None = None) -> list[Any]:
        """Reads the MAVLink frames that wait, at most 64 datagrams at a time so that it returns soon.

        What is no MAVLink is left out. `pass_to_script` gets every datagram as it came.
        """
        frames = []
        with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
            for _ in range(MAX_DATAGRAMS_A_READ):
                datagram, sender = self.socket.recvfrom(MAX_DATAGRAM)
                self.bytes_in += len(datagram)
                if pass_to_script is not None:
                    pass_to_script(datagram)
                parsed = self.parser.frames(datagram)
                if parsed:
                    self._peer = sender
                frames += parsed
        return frames

    def send(self, frame: bytes) -> bool:
        """Sends a frame. Returns False when it is lost: there is no peer, or it is gone or slow."""
        if self._peer is None:
            return False
        try:
            self.socket.sendto(frame, self._peer)
        except OSError:
            return False
        self.bytes_out += len(frame)
        return True

    def close(self) -> None:
        self.socket.close()
