"""Simulates a serial device between companion and autopilot that can take nothing any more."""

from __future__ import annotations

import contextlib
import os
import pty
import socket
import threading
import tty

FAR_BUFFER = 4200
"""Bytes, a little more than the far end's own buffer: no discarding reaches what is in there."""


class SerialDevice:
    """Passes bytes between a pseudo-terminal, which the companion opens, and an autopilot on UDP.

    stuck: nothing passes from the companion; the other way goes on. full: nor does its kernel take anything
    then; otherwise that keeps what the companion writes, a minute of frames. filled: bytes put before these.
    """

    def __init__(self, port: int) -> None:
        """port: where the autopilot expects the companion, of 127.0.0.1."""
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        os.set_blocking(self._slave, False)
        self.url = f"serial:{os.ttyname(self._slave)}:57600"
        self.stuck, self.full, self.filled = False, True, 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", port))
        self._socket.settimeout(0)
        self._autopilot: tuple[str, int] | None = None
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._pass, name="serial device", daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._over.set()
        self._thread.join()
        self._socket.close()
        os.close(self._slave)
        os.close(self._master)

    def _pass(self) -> None:
        while not self._over.wait(0.002):
            with contextlib.suppress(OSError):
                data, self._autopilot = self._socket.recvfrom(4096)
                os.write(self._master, data)
            with contextlib.suppress(OSError):
                if self.stuck:
                    while self.full or self.filled < FAR_BUFFER:
                        self.filled += os.write(self._slave, bytes(64))
                    continue
                self.filled = 0
                data = os.read(self._master, 4096)
                if self._autopilot is not None:
                    self._socket.sendto(data, self._autopilot)
