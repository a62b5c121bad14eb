"""Has systemd start processes as users of their own, and end them: we may not.

Each process has a socket: systemd starts the process when we connect to it. And each has a file in our
runtime directory: when we make the file, systemd kills what it started at the socket, then removes the file.
"""

from __future__ import annotations

import json
import os
import select
import socket
import sys
import time
from collections.abc import Sequence
from pathlib import Path

SOCKETS = "ANYTRAVERSE_SOCKETS"
"""The environment variable that names the folder of the sockets. It is not set where there are none."""
_WITHIN = 5.0
"""Seconds that systemd has to take a connection, and to kill what was started before."""
_STEP = 0.02
_LONGEST, _MOST_DESCRIPTORS = 8192, 8
_FIRST_DESCRIPTOR = 3
"""Of those that systemd gives, see sd_listen_fds(3)."""


class SocketUnit:
    """Starts and kills the process of one socket unit. `run` and `wait` block: they are for a thread."""

    def __init__(self, name: str, sockets: Path, runtime: Path) -> None:
        """name: of the unit, between "companion-" and ".socket". runtime: our runtime directory."""
        self._name = name
        self._path = sockets / name
        self._doomed = runtime / f"kill-{name}"
        self._connection: socket.socket | None = None

    @classmethod
    def of(cls, name: str) -> SocketUnit | None:
        """Return the unit of this name, None where systemd has none for us."""
        sockets, runtime = os.environ.get(SOCKETS), os.environ.get("RUNTIME_DIRECTORY")
        return cls(name, Path(sockets), Path(runtime)) if name and sockets and runtime else None

    def run(self, arguments: Sequence[str], descriptors: Sequence[int]) -> None:
        """Kill what was started before, and have the process started with these. Raises OSError."""
        self.kill()
        until = time.monotonic() + _WITHIN
        while self._doomed.exists():
            if time.monotonic() > until:
                unit = f"anytraverse-kill@{self._name}.path"
                raise OSError(f"systemd does not end the one before: systemctl status {unit}")
            time.sleep(_STEP)
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            connection.settimeout(_WITHIN)
            connection.connect(os.fspath(self._path))
            socket.send_fds(connection, [json.dumps(list(arguments)).encode()], descriptors)
        except OSError:
            connection.close()
            raise
        self._connection = connection

    def wait(self) -> str:
        """Wait until the process has ended, and say so. systemd holds the other end, too, while it runs."""
        assert self._connection is not None
        with self._connection as connection:
            hanging_up = select.poll()  # what the process writes there is not read
            hanging_up.register(connection, 0)
            hanging_up.poll()
        return "its unit ended"

    def kill(self) -> None:
        """Have the process killed, and all that it has started. Raises OSError."""
        self._doomed.touch()


def arguments() -> list[str]:
    """Return what this process was started with: its command line, or what came to systemd's socket.

    Descriptors that came with it are at the end, followed by the process id of the parent, 0: systemd.
    Raises OSError, or ValueError for anything else than a list of words.
    """
    if os.environ.get("LISTEN_PID") != str(os.getpid()):
        return sys.argv[1:]
    with socket.socket(fileno=os.dup(_FIRST_DESCRIPTOR)) as connection:
        connection.settimeout(_WITHIN)
        packed, descriptors, _, _ = socket.recv_fds(connection, _LONGEST, _MOST_DESCRIPTORS)
    given = json.loads(packed)
    return [*map(str, given), *map(str, descriptors), "0"]
