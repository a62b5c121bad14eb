"""Runs a client on a link of its own, with our heartbeat, and reads lines from standard input."""

from __future__ import annotations

import os
import select
import stat
from typing import Any, Protocol, TextIO

from pymavlink.dialects.v20 import common as mavlink

from gcs_plugin.terminal.connection import OperatorConnection
from gcs_plugin.terminal.signing import OperatorSigning

MAX_WAITING = 65536


class Keyboard:
    """Reads lines from a terminal, a pipe or a file.

    ended: whether it is at its end; never for /dev/null, so that a program in the background keeps running.
    """

    def __init__(self, descriptor: int | None) -> None:
        self.ended = False
        self._descriptor = descriptor
        self._waiting = b""

    @classmethod
    def of(cls, stream: TextIO | None) -> Keyboard:
        """Use the stream's descriptor, unless it is /dev/null or the like, where nobody can type."""
        try:
            descriptor = -1 if stream is None else stream.fileno()
            mode = os.fstat(descriptor).st_mode
        except (OSError, ValueError):
            return cls(None)
        return cls(None if stat.S_ISCHR(mode) and not os.isatty(descriptor) else descriptor)

    def descriptors(self) -> list[int]:
        """Return the file descriptors to wait on."""
        return [] if self._descriptor is None or self.ended else [self._descriptor]

    def lines(self) -> list[str]:
        """Return the complete lines received; at the end of the input also an unfinished one."""
        if not self.descriptors() or not select.select(self.descriptors(), [], [], 0)[0]:
            return []
        assert self._descriptor is not None
        try:
            read = os.read(self._descriptor, 4096)
        except OSError:
            read = b""
        self.ended = not read
        *complete, self._waiting = (self._waiting + read).split(b"\n")
        if self.ended or len(self._waiting) > MAX_WAITING:
            complete.append(self._waiting)
            self._waiting = b""
        return [line.decode(errors="replace") for line in complete]


HEARTBEAT_S = 1.0
MAX_BUFFER = 65536


class Client(Protocol):
    """What runs on a connection: `OperatorClient`, or one that passes on to it."""

    ids: tuple[int, int] | None

    def receive(self, message: Any, now: float) -> None:
        """Take a decoded message."""

    def outgoing(self, now: float) -> list[Any]:
        """Return the messages to send now."""


class Runner:
    """Owns the connection. Call `step` often; `wait` sleeps until there is something to read.

    system, component: our ids; a ground station has 255/190 by convention. Our heartbeat is sent from the
    first step on, since an autopilot sends nothing to a peer that is silent.
    """

    def __init__(
        self,
        connection: OperatorConnection,
        client: Client,
        system: int = 255,
        component: int = 190,
        signing: OperatorSigning | None = None,
    ) -> None:
        self.client = client
        client.ids = system, component
        self._signing = signing
        self._connection = connection
        self._mavlink = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self._mavlink.robust_parsing = True
        self._heartbeat_at = float("-inf")

    def step(self, now: float) -> None:
        """Read and process what was received, then send what is due."""
        for message in self._mavlink.parse_buffer(self._connection.read()) or []:
            if self._signing is None or self._accepts(self._signing, message):
                self.client.receive(message, now)
        self._forget_parsed()
        if now - self._heartbeat_at >= HEARTBEAT_S:
            self._heartbeat_at = now
            self._send(
                mavlink.MAVLink_heartbeat_message(
                    mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
                )
            )
        for message in self.client.outgoing(now):
            self._send(message)
        if self._signing is not None:
            self._signing.tick(now)

    def wait(self, timeout: float, *others: int) -> None:
        """Wait until the link or one of `others` (file descriptors) can be read; timeout: seconds."""
        own = self._connection.fileno()
        select.select([*others, *([] if own is None else [own])], [], [], timeout)

    def close(self) -> None:
        """Close the connection, and store the signing timestamps."""
        self._connection.close()
        if self._signing is not None:
            self._signing.close()

    def _send(self, message: mavlink.MAVLink_message) -> None:
        frame = bytes(message.pack(self._mavlink))
        if self._signing is not None:
            frame = self._signing.sign(frame, message)
        self._mavlink.seq = (self._mavlink.seq + 1) % 256
        self._connection.write(frame)

    def _accepts(self, signing: OperatorSigning, message: mavlink.MAVLink_message) -> bool:
        return message.get_msgId() >= 0 and signing.accepts(message, self)

    def _forget_parsed(self) -> None:
        """Drop parsed bytes: pymavlink empties its buffer only when a stream pauses between frames."""
        if self._mavlink.buf_index > MAX_BUFFER:
            self._mavlink.buf = self._mavlink.buf[self._mavlink.buf_index :]
            self._mavlink.buf_index = 0
