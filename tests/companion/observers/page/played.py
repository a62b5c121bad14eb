"""A supervisor that tells a real web process what a test wants it to, and asks it as a browser does."""

from __future__ import annotations

import http.client
import json
import socket
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from companion.config import Config
from companion.config.schema import JournalSection
from companion.config.web import WebSection
from companion.observers.page.page import Page
from companion.system.watchdog import Restarts

PATIENCE = 20.0
LIMITS = Restarts(silent_for=2.5, loading=20.0, first=0.2, longest=0.4)
TOKEN = "0123456789abcdef-TOKEN"
JPEG = b"\xff\xd8 a picture \xff\xd9"


class Answer(NamedTuple):
    """What the page answered."""

    status: int
    headers: Mapping[str, str]
    body: bytes


class Stage:
    """Runs a `Page` and its process. `turn` is one turn of the main loop."""

    def __init__(self, folder: Path, listen: str = "127.0.0.1:0", token: str = "", **page: Any) -> None:
        self.folder = folder
        config = replace(Config(), web=WebSection(listen, token), journal=JournalSection(folder=str(folder)))
        self.page = Page(config, **{"restarts": LIMITS, **page})
        self.news: dict[str, Any] = {
            "told": "",
            "status": {"state": "ok", "frames": 7, "policy": "hold", "computer": {"memory_free": 512}},
            "state": {"state": "ok", "words": {"grass": 1.0}, "given": {}},
            "check": {
                "ok": True,
                "age": 2.0,
                "checks": [{"check": "disk", "verdict": "warn", "text": "make room"}],
            },
        }
        self.frames = 0

    def turn(self) -> None:
        self.page.tell(time.monotonic(), lambda: self.news)
        if self.page.wanted():
            self.frames += 1
            self.page.show(self.frames, time.monotonic() - 0.05, JPEG)
        time.sleep(0.01)

    def until(self, fits: Callable[[], bool], seconds: float = PATIENCE) -> None:
        """Turn until it is so."""
        deadline = time.monotonic() + seconds
        while not fits():
            assert time.monotonic() < deadline, self.page.figures()
            self.turn()

    def ready(self) -> Stage:
        """Turn until the page answers with news."""
        self.until(lambda: self.up() and self.get("/healthz").status == 200)
        return self

    def up(self) -> bool:
        """Whether the process has said that it listens."""
        return bool(self.page.url) and not self.page.trouble and self.pid() > 0

    def pid(self) -> int:
        """The process id, 0 without a process."""
        child = self.page.child
        return (child.pid or 0) if child is not None else 0

    @property
    def address(self) -> tuple[str, int]:
        host, _, port = self.page.url.removeprefix("http://").strip("/").rpartition(":")
        return host, int(port)

    def post(self, path: str, content: Any, headers: Mapping[str, str] | None = None) -> Answer:
        """Post JSON as the page does that has the token."""
        host, port = self.address
        own = {"authorization": f"Bearer {TOKEN}", "origin": f"http://{host}:{port}"}
        own |= {"content-type": "application/json", **(headers or {})}
        return self.get(path, "POST", own, json.dumps(content).encode())

    def get(
        self,
        path: str,
        method: str = "GET",
        headers: Mapping[str, str] | None = None,
        body: bytes | None = None,
    ) -> Answer:
        connection = http.client.HTTPConnection(*self.address, timeout=5.0)
        try:
            connection.request(method, path, body, headers=dict(headers or {}))
            response = connection.getresponse()
            return Answer(response.status, {k.lower(): v for k, v in response.getheaders()}, response.read())
        except OSError:
            return Answer(0, {}, b"")
        finally:
            connection.close()

    def raw(self, request: bytes) -> bytes:
        """Send these bytes, and return what came until the other end closed, or for half a second."""
        with socket.create_connection(self.address, timeout=0.5) as connection:
            found = b""
            try:
                connection.sendall(request)
                while data := connection.recv(65536):
                    found += data
            except OSError:
                pass
            return found

    def close(self) -> None:
        self.page.close()
