"""How either end of a TCP connection notices that the other is gone without a word."""

from __future__ import annotations

import socket

OPTIONS = {
    "TCP_NODELAY": 1,
    "TCP_USER_TIMEOUT": 10_000,
    "TCP_KEEPIDLE": 5,
    "TCP_KEEPINTVL": 2,
    "TCP_KEEPCNT": 3,
}
"""ms that what was sent may go unconfirmed, connecting included, and s for a connection that is silent."""


def watch_peer(connection: socket.socket) -> None:
    """A peer that is gone breaks the connection within 15 s, where the platform can. Before connecting."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for option, value in OPTIONS.items():
        if hasattr(socket, option):
            connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)
