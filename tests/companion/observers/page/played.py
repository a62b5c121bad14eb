"""A supervisor that tells a real web process what a test wants it to, and asks it as a browser does."""

from __future__ import annotations

import http.client
import json
import socket
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlsplit

from companion.config import Config
from companion.config.schema import JournalSection
from companion.config.web import WebSection
from companion.observers.page.page import Page
from companion.observers.recording.messages import RecordedMessage
from companion.system.watchdog import Restarts
from tests.companion.observers.supervisor import Supervisor

LIMITS = Restarts(silent_for=2.5, loading=20.0, first=0.2, longest=0.4)
TOKEN = "0123456789abcdef-TOKEN"
JPEG = b"\xff\xd8 a picture \xff\xd9"


class Answer(NamedTuple):
    """What the page answered."""

    status: int
    headers: Mapping[str, str]
    body: bytes


class Browser:
    """Asks the page at `url` as a browser does that sends these headers each time."""

    headers: Mapping[str, str] = {}

    @property
    def url(self) -> str:
        raise NotImplementedError

    @property
    def address(self) -> tuple[str, int]:
        url = urlsplit(self.url)
        return url.hostname or "", url.port or 0

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
            connection.request(method, path, body, headers={**self.headers, **(headers or {})})
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


class Stage(Supervisor, Browser):
    """Runs a `Page` and its process."""

    def __init__(
        self,
        folder: Path,
        listen: str = "127.0.0.1:0",
        token: str = "",
        *,
        config: Config | None = None,
        **page: Any,
    ) -> None:
        self.folder = folder
        config = replace(
            config or Config(), web=WebSection(listen, token), journal=JournalSection(folder=str(folder))
        )
        self.service = self.page = Page(config, **{"restarts": LIMITS, **page})
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
        self.frames, self.from_above = 0, b""

    @property
    def url(self) -> str:
        return self.page.url

    def work(self, now: float, _messages: Sequence[RecordedMessage]) -> None:
        self.page.tell(now, lambda: self.news)
        if self.page.wanted():
            self.frames += 1
            self.page.show(self.frames, now - 0.05, JPEG, self.from_above)

    def ready(self) -> Stage:
        """Turn until the page answers with news."""
        self.until(lambda: self.up() and self.get("/healthz").status == 200)
        return self

    def up(self) -> bool:
        """Whether the process has said that it listens."""
        return bool(self.page.url) and not self.page.trouble and self.pid() > 0
