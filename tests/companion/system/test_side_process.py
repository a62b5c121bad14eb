"""A process that the daemon can do without is heard to its last word."""

from __future__ import annotations

import sys

from companion.system.side_process import SideChild

PATIENCE = 30.0
LAST_WORDS = """
import socket, sys
with socket.socket(fileno=int(sys.argv[1])) as daemon:
    assert daemon.recv(64, socket.MSG_PEEK) == b"go"
    for number in range(10):
        daemon.send(b"%d" % number)
"""


def test_what_it_said_is_heard_where_it_ends_without_reading_what_it_was_told() -> None:
    child = SideChild((sys.executable, "-c", LAST_WORDS), buffer=1 << 16, longest=64)
    try:
        assert child.send(b"go")
        assert child.ends_within(PATIENCE)
        assert child.ended() == "exit code 0"
        assert child.receive() == [b"%d" % number for number in range(8)]
        assert child.receive() == [b"8", b"9"]
        assert child.receive() == []
    finally:
        child.close()
