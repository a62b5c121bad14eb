"""Where a page listens, and what a token looks like."""

from __future__ import annotations

import hashlib
import ipaddress
import re
import socket
from typing import NamedTuple

_TOKEN = re.compile(r"[A-Za-z0-9._~-]{16,128}", re.ASCII)


class Listen(NamedTuple):
    """Where the page listens. port 0: any free one."""

    host: str
    port: int

    @property
    def loopback(self) -> bool:
        """Whether only programs on this computer reach it."""
        return ipaddress.ip_address(self.host).is_loopback

    def bind(self) -> socket.socket:
        """Take the port, without listening yet. Raises OSError when another program has it."""
        taken = socket.socket(socket.AF_INET6 if ":" in self.host else socket.AF_INET)
        try:
            taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            taken.bind((self.host, self.port))
        except OSError:
            taken.close()
            raise
        return taken

    def url(self, scheme: str = "http") -> str:
        """Return the address as a browser wants it."""
        return f"{scheme}://{f'[{self.host}]' if ':' in self.host else self.host}:{self.port}/"


def listen_here(port: int, token: str) -> tuple[socket.socket, str]:
    """Listen on this computer alone; port 0: any free one.

    Returns the listening socket, and the page's address with the token. Raises OSError.
    """
    listener = Listen("127.0.0.1", port).bind()
    listener.listen(64)  # before the address is told: who comes early waits
    return listener, f"{Listen(*listener.getsockname()[:2]).url()}?token={token}"


def read_listen(text: str) -> Listen | None:
    """Parse "host:port", None for "". Names are not looked up, but localhost. Raises ValueError."""
    if not text:
        return None
    host, _, port = text.rpartition(":")
    try:
        address = ipaddress.ip_address("127.0.0.1" if host == "localhost" else host.strip("[]"))
    except ValueError:
        raise ValueError('give "127.0.0.1:8191", another numeric address and port, or "" for none') from None
    if not (port.isdecimal() and port.isascii() and int(port) <= 65535):
        raise ValueError("the port is not in 0..65535")
    return Listen(str(address), int(port))


def check_token(text: str) -> None:
    """Accept a token, or "" for none. Raises ValueError."""
    if text and not _TOKEN.fullmatch(text):
        raise ValueError("give 16 to 128 of A-Z, a-z, 0-9 and . _ ~ - (`openssl rand -hex 16` makes one)")


def hashed(token: str) -> str:
    """Return what is known of a token where it is checked: nobody who breaks in there learns the token."""
    return hashlib.sha256(token.encode(errors="replace")).hexdigest() if token else ""
