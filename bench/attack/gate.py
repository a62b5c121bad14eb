"""Attacks the rover's page without its token, while somebody who has it watches."""

from __future__ import annotations

import contextlib
import http.client
import socket
import threading
import time
from pathlib import Path
from urllib.parse import urlsplit

from bench.attack.outcome import AttackOutcome, watched
from bench.faults.standing import Standing

TOKEN = "0123456789abcdef-TOKEN"
_KNOWN = {"Authorization": f"Bearer {TOKEN}"}
_PATHS = ("/", "/state.json", "/log.txt", "/calls/1.jpg", "/../../etc/passwd", "/calls/..%2f..%2fjournal.db")
_WAITED_TOO_LONG = 5.0
SECONDS, QUICK = 30.0, 8.0


def gate(folder: Path, *, quick: bool) -> AttackOutcome:
    """Ask with huge cookies and headers, wrong tokens and rubbish, and hold idle connections."""
    outcome = AttackOutcome()
    with Standing(folder, web=f'listen = "127.0.0.1:0"\ntoken = "{TOKEN}"') as rover:
        rover.start()
        rover.wait("the page", lambda: bool(rover.status().get("web", {}).get("url")), 30.0)
        there = urlsplit(rover.status()["web"]["url"])
        address, over = (str(there.hostname), there.port or 0), threading.Event()
        deeds = (_cookies, _headers, _tokens, _rubbish, _idle)
        owner = Owner(address, over, "/healthz", 1.0, **_KNOWN)
        threads = [threading.Thread(target=_repeat, args=(deed, address, over, outcome)) for deed in deeds]
        for thread in (*threads, owner):
            thread.start()
        watched(rover, outcome, lambda: True, QUICK if quick else SECONDS)
        over.set()
        for thread in (*threads, owner):
            thread.join(20.0)
        restarts = rover.status().get("web", {}).get("restarts")
    outcome.figures = {"longest_until_shown_s": round(owner.longest, 2), "page_restarts": restarts}
    if owner.longest > _WAITED_TOO_LONG or restarts:
        outcome.reached.append("the page's owner was locked out")
    return outcome


class Owner(threading.Thread):
    """Looks at a page again and again. longest: s until it was shown, at worst."""

    def __init__(
        self, address: tuple[str, int], over: threading.Event, path: str, every: float, **headers: str
    ) -> None:
        super().__init__()
        self._address, self._over = address, over
        self._path, self._every, self._headers = path, every, headers
        self.longest = 0.0

    def run(self) -> None:
        since = time.monotonic()
        while not self._over.is_set():
            with contextlib.suppress(OSError, http.client.HTTPException):
                if _status(self._address, self._path, self._headers, "127.0.0.2") < 400:
                    self.longest, since = max(self.longest, time.monotonic() - since), time.monotonic()
            self._over.wait(self._every)
        self.longest = max(self.longest, time.monotonic() - since)


def _repeat(deed: object, address: tuple[str, int], over: threading.Event, outcome: AttackOutcome) -> None:
    assert callable(deed)
    while not over.is_set():
        with contextlib.suppress(OSError, http.client.HTTPException):
            outcome.reached += deed(address)
        over.wait(0.02)


def _cookies(address: tuple[str, int]) -> list[str]:
    return _let_in(address, "/", {"Cookie": 'a="' + 30_000 * '\\"'})


def _headers(address: tuple[str, int]) -> list[str]:
    with socket.create_connection(address, timeout=5.0) as connection:
        connection.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n" + b"x: y\r\n" * 20_000)
        connection.recv(100)
    return []


def _tokens(address: tuple[str, int]) -> list[str]:
    found = list[str]()
    for path in _PATHS:
        found += _let_in(address, path, {})
        found += _let_in(address, path, {"Authorization": f"Bearer {TOKEN[:-1]}"})
        found += _let_in(address, path + "?token=" + TOKEN.lower(), {"Host": "evil.example"})
    return found


def _rubbish(address: tuple[str, int]) -> list[str]:
    with socket.create_connection(address, timeout=5.0) as connection:
        connection.sendall(bytes(range(256)) * 200 + b"\r\n\r\n")
        connection.recv(100)
    return []


def _idle(address: tuple[str, int]) -> list[str]:
    with contextlib.ExitStack() as held:
        for _ in range(100):
            held.enter_context(socket.create_connection(address, timeout=5.0))
        time.sleep(1.0)
    return []


def _let_in(address: tuple[str, int], path: str, headers: dict[str, str]) -> list[str]:
    """Return what was reached without the token."""
    return [f"{path} of the page"] if _status(address, path, headers) < 400 else []


def _status(address: tuple[str, int], path: str, headers: dict[str, str], source: str = "127.0.0.1") -> int:
    connection = http.client.HTTPConnection(*address, timeout=5.0, source_address=(source, 0))
    try:
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        answer.read(1 << 20)
        return answer.status
    finally:
        connection.close()
