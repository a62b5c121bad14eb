"""Looks up the address of a link without waiting for a name server that does not answer."""

from __future__ import annotations

import errno
import socket
import threading
import time
from typing import Any

PATIENCE_S = 10.0
"""How long the first address is waited for."""
SILENT_S = 2.0
"""After this time without an answer a name server is said to be silent."""

Address = tuple[int, Any]
"""Family of the socket, and what it connects to."""


class Name:
    """The address of a host and port. A name is looked up in a thread, of which there is one at most."""

    def __init__(self, host: str, port: int) -> None:
        self.host = host
        self._port = port
        self._looking: _Lookup | None = None

    def first(self) -> Address:
        """Wait for the address, `PATIENCE_S` at most. Raises OSError and ValueError for what is no name."""
        self._looking = self._looking or _Lookup(self.host, self._port)
        self._looking.ended.wait(PATIENCE_S)
        return self.now()

    def now(self) -> Address:
        """Return the address without waiting: of a number at once, of a name once it is looked up anew.

        Raises BlockingIOError while it is not known; OSError and ValueError for what is no name.
        """
        if self._looking is None:
            try:
                return _address(self.host, self._port, socket.AI_NUMERICHOST)
            except socket.gaierror:
                self._looking = _Lookup(self.host, self._port)
        looking = self._looking
        if not looking.ended.is_set():
            silent = time.monotonic() - looking.began >= SILENT_S
            text = f"no name server says who {self.host} is" if silent else ""
            raise BlockingIOError(errno.EAGAIN, text)
        self._looking = None
        if isinstance(looking.found, tuple):
            return looking.found
        raise looking.found


class _Lookup:
    """One lookup. found: the address or what went wrong, once `ended` is set."""

    def __init__(self, host: str, port: int) -> None:
        self.began = time.monotonic()
        self.ended = threading.Event()
        self.found: Address | OSError | ValueError = OSError("it was not looked up")
        threading.Thread(target=self._run, args=(host, port), name="lookup", daemon=True).start()

    def _run(self, host: str, port: int) -> None:
        try:
            self.found = _address(host, port)
        except (OSError, ValueError) as error:
            self.found = error
        self.ended.set()


def _address(host: str, port: int, flags: int = 0) -> Address:
    found = socket.getaddrinfo(host, port, flags=flags)[0]
    return int(found[0]), found[4]
