"""One of the autopilot's two ports as a loopback UDP socket."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Callable
from typing import Any

from companion.sim.field.router import Parser

MAX_DATAGRAM = 4096
MAX_DATAGRAMS_A_READ = 64


class UdpPort:
    """Bound to an ephemeral port of 127.0.0.1. Its peer is whoever was last heard to speak MAVLink; until
    then nothing is sent. `bytes_in` and `bytes_out` count whole datagrams."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.0)
        self.parser = Parser()
        self.bytes_in = 0
        self.bytes_out = 0
        self._peer: tuple[str, int] | None = None

    @property
    def number(self) -> int:
        return int(self.socket.getsockname()[1])

    def read(self, overhear: Callable[[bytes], None] | None = None) -> list[Any]:
        """The MAVLink frames that wait, a bounded number, so that the caller gets on; rubbish is left out.
        `overhear` gets every datagram as it came."""
        frames = []
        with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
            for _ in range(MAX_DATAGRAMS_A_READ):
                datagram, sender = self.socket.recvfrom(MAX_DATAGRAM)
                self.bytes_in += len(datagram)
                if overhear is not None:
                    overhear(datagram)
                heard = self.parser.frames(datagram)
                if heard:
                    self._peer = sender
                frames += heard
        return frames

    def send(self, frame: bytes) -> bool:
        """True when the frame left; False when there is no peer, or it is gone or slow (as by radio)."""
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
