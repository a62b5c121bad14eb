"""Implements `companion setup`: serves the pages until somebody ends it."""

from __future__ import annotations

import getpass
import os
import signal
import socket
import time
from pathlib import Path

from companion.desk.setup.server import IDLE, SetupServer
from companion.desk.setup.session import SetupSession

_LOOK = 0.5


def run(file: str, *, port: int = 0) -> int:
    """Serve until Ctrl-C, or until the pages are idle for an hour. Returns 0.

    Raises ConfigError where the file has a problem, and OSError.
    """
    path = Path(file).expanduser().absolute()
    signal.signal(signal.SIGTERM, _interrupt)
    session = SetupSession(path)
    with SetupServer(session, port) as server:
        print(f"Open {server.url}")
        print(f"From another computer, first: ssh -L {server.port}:127.0.0.1:{server.port} {login()}")
        print(f"It changes {path} when you click Write. Ctrl-C ends it.", flush=True)
        try:
            while not server.is_idle:
                time.sleep(_LOOK)
            print(f"Nobody has used the page for {IDLE / 60:.0f} minutes: it ends.")
        except KeyboardInterrupt:
            print("It ends.")
    if left := session.draft.document()["changed"]:
        print(f"Not written: {', '.join(left)}.")
    return 0


def login() -> str:
    """Return whom ssh takes here, user@host. Behind sudo it is who typed it: few computers let root in."""
    return f"{os.environ.get('SUDO_USER') or getpass.getuser()}@{socket.gethostname()}"


def _interrupt(_number: int, _frame: object) -> None:
    raise KeyboardInterrupt
