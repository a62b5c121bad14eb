"""The rover's only wire: the autopilot at its end, and all that the companion and the operator say on it."""

from __future__ import annotations

import contextlib
import socket
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.sim.demo.rehearsal import free_port
from companion.wire.ids import AUTOPILOT_COMPONENT_ID
from companion.wire.signing import SigningKey, is_signed, timestamp_of
from gcs_plugin.terminal.signing import OperatorSigning

HOST = "127.0.0.1"
AUTO, HOLD = 10, 4
SYSTEM = 1
_MODE_COMMAND = 176


class Wire:
    """The rover's only wire, with the autopilot at its end; the `OperatorConnection`, too.

    mode, modes: the autopilot's, and all that it was commanded with the monotonic time. It routes: what one
    companion says reaches every other.
    """

    name = "wire"
    trouble = ""

    def __init__(self, key: SigningKey | None = None, *, listens: bool = False) -> None:
        """key: with which the autopilot signs. listens: the companion listens, and does not speak first."""
        self._listener = (HOST, free_port()) if listens else None
        self.mode, self.modes = AUTO, list[tuple[float, int]]()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((HOST, 0))
        self._socket.settimeout(0)
        self._rovers: dict[Any, None] = {}
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._encoder = mavlink.MAVLink(None, SYSTEM, AUTOPILOT_COMPONENT_ID)
        self._signing = None if key is None else OperatorSigning(key)
        self._beats_at = 0.0
        self.reboots = False
        """Whether the autopilot says nothing."""
        self._heard = b""
        self.messages: dict[str, Any] = {}
        """The companion's newest message of each type."""
        self.senders: dict[Any, set[int]] = {}
        """Address from which something came -> the components in whose name."""
        self.stamps: list[int] = []
        """The signing timestamps of the companion's frames, in order."""
        self.recording, self.recorded = False, list[bytes]()
        """Whether to record what is sent to the companion, and what was."""
        self.forget_rovers()

    @property
    def url(self) -> str:
        """The link's url for the companion."""
        if self._listener is not None:
            return f"udpin:{HOST}:{self._listener[1]}"
        return f"udpout:{HOST}:{self._socket.getsockname()[1]}"

    @property
    def companion(self) -> tuple[str, int]:
        """Where the companion listens. Only with `listens`."""
        assert self._listener is not None
        return self._listener

    def step(self, now: float) -> None:
        """Carry what came in, and let the autopilot say what is due."""
        with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
            while True:
                data, address = self._socket.recvfrom(4096)
                self._rovers[address] = None
                self._heard += data
                for other in self._rovers.keys() - {address}:
                    self._socket.sendto(data, other)
                for message in self._parser.parse_buffer(data) or []:
                    self._take(message, address, now)
        if now >= self._beats_at and not self.reboots:
            self._beats_at = now + 1.0
            self._beat()

    def forget_rovers(self) -> None:
        """Forget from where a companion was heard, since another one follows."""
        self._rovers = {} if self._listener is None else {self._listener: None}
        self.senders.clear()
        self.messages.clear()

    def read(self) -> bytes:
        """Return what has reached the operator."""
        heard, self._heard = self._heard, b""
        return heard

    def write(self, frame: bytes) -> None:
        """Send to every companion that was heard."""
        if self.recording:
            self.recorded.append(frame)
        for address in self._rovers:
            with contextlib.suppress(OSError):
                self._socket.sendto(frame, address)

    def fileno(self) -> int | None:
        """There is none to wait for."""
        return None

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def send(self, message: Any) -> None:
        """Send a message of the autopilot."""
        frame = bytes(message.pack(self._encoder))
        if self._signing is not None:
            frame = self._signing.sign(frame, message)
        self._encoder.seq = (self._encoder.seq + 1) % 256
        self.write(frame)

    def _take(self, message: Any, address: Any, now: float) -> None:
        if message.get_type() == "BAD_DATA":
            return
        self.senders.setdefault(address, set()).add(message.get_srcComponent())
        frame = bytes(message.get_msgbuf())
        if is_signed(frame):
            self.stamps.append(timestamp_of(frame))
        self.messages[message.get_type()] = message
        if message.get_type() != "COMMAND_LONG" or message.target_component != AUTOPILOT_COMPONENT_ID:
            return
        if message.command == _MODE_COMMAND:
            self.mode = int(message.param2)
            self.modes.append((now, self.mode))
            self._beat()
        self.send(mavlink.MAVLink_command_ack_message(message.command, mavlink.MAV_RESULT_ACCEPTED))

    def _beat(self) -> None:
        flags = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        kinds = mavlink.MAV_TYPE_GROUND_ROVER, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
        self.send(mavlink.MAVLink_heartbeat_message(*kinds, flags, self.mode, 4, 3))
