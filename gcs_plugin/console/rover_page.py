"""Fetches a file from a rover's own page, where this computer has a network to it."""

from __future__ import annotations

import http.client
import threading
from collections.abc import Callable
from typing import NamedTuple
from urllib.parse import urlsplit

from companion.pages.listen import check_token

LARGEST = 64 << 20
"""Bytes of a file."""
_PATIENCE = 10.0
"""Seconds that the rover may be silent."""
_PIECE = 64 << 10


class RoverPage(NamedTuple):
    """Where a rover's page is. secure: by HTTPS."""

    host: str
    port: int
    secure: bool
    token: str

    def connection(self) -> http.client.HTTPConnection:
        """Return a connection that is not open yet."""
        kind = http.client.HTTPSConnection if self.secure else http.client.HTTPConnection
        return kind(self.host, self.port, timeout=_PATIENCE)


def read_pages(given: list[str], token: str) -> dict[int, RoverPage]:
    """Parse "1=http://rover:8191" into the pages by system id. Raises ValueError with what to write."""
    check_token(token)
    if given and not token:
        raise ValueError("--page needs --page-token-file: a rover's page takes and gives nothing without it")
    found = {}
    for one in given:
        system, _, url = one.partition("=")
        parts = urlsplit(url)
        right = system.isascii() and system.isdecimal() and 1 <= int(system[:4]) <= 255
        if not right or parts.scheme not in ("http", "https") or not parts.hostname:
            raise ValueError(f'"{one}" is no page: write it as 1=http://rover:8191')
        secure = parts.scheme == "https"
        found[int(system)] = RoverPage(parts.hostname, parts.port or (443 if secure else 80), secure, token)
    return found


class Download:
    """Fetches a file in a thread of its own.

    received: bytes so far. done: whether it has ended. problem: why it did not come, for a person; "" where
    it came.
    """

    def __init__(self, page: RoverPage, path: str, use: Callable[[bytes], None]) -> None:
        """use: takes the file in that thread, or raises ValueError with what is wrong with it."""
        self.received = 0
        self.done = self.stopped = False
        self.problem = ""
        self._use = use
        self._page = page
        self._path = path
        threading.Thread(target=self._run, name="download", daemon=True).start()

    def stop(self) -> None:
        """End it: what has come is dropped."""
        self.stopped = True

    def _run(self) -> None:
        connection = self._page.connection()
        try:
            content = self._fetched(connection)
            if not self.stopped:
                self._use(content)
        except (OSError, http.client.HTTPException) as error:
            self.problem = f"the rover's page does not answer ({error or 'it is silent'})"
        except ValueError as error:
            self.problem = str(error)
        except RuntimeError:  # the program ends: no thread takes work any more
            self.problem = "the console ended"
        finally:
            connection.close()
            self.done = True

    def _fetched(self, connection: http.client.HTTPConnection) -> bytes:
        """Return the file. Raises ValueError for another answer."""
        connection.request("GET", self._path, headers={"authorization": f"Bearer {self._page.token}"})
        answer = connection.getresponse()
        if answer.status != 200:
            why = "the token is another one" if answer.status == 401 else f"status {answer.status}"
            raise ValueError(f"the rover's page refuses it: {why}")
        found = bytearray()
        while (piece := answer.read(_PIECE)) and not self.stopped:
            found += piece
            self.received = len(found)
            if self.received > LARGEST:
                raise ValueError(f"it is larger than {LARGEST >> 20} MB")
        return bytes(found)
