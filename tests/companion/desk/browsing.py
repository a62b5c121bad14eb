"""Asks a page at the desk as the browser does that has opened its address."""

from __future__ import annotations

import http.client
import json
from collections.abc import Mapping
from contextlib import closing
from typing import Any
from urllib.parse import parse_qs, urlsplit


class Browsing:
    """Reads and posts with the token of an address. within: seconds that an answer may take."""

    def __init__(self, url: str, within: float = 40.0) -> None:
        split = urlsplit(url)
        self.address = str(split.hostname), int(split.port or 0)
        self.token = parse_qs(split.query)["token"][0]
        self.within = within

    @property
    def headers(self) -> Mapping[str, str]:
        return {"authorization": f"Bearer {self.token}"}

    def connected(self) -> closing[http.client.HTTPConnection]:
        return closing(http.client.HTTPConnection(*self.address, timeout=self.within))

    def ask(
        self, path: str, method: str = "GET", body: bytes | None = None, **headers: str
    ) -> tuple[int, bytes]:
        """Return the status and the body of an answer. headers: beside the token, with _ for -."""
        with self.connected() as connection:
            own = {**self.headers, **{name.replace("_", "-"): value for name, value in headers.items()}}
            connection.request(method, path, body, own)
            answer = connection.getresponse()
            return answer.status, answer.read()

    def post(self, path: str, content: Any, **headers: str) -> tuple[int, Any]:
        """Post JSON, or bytes as they are. Return the status and what was answered: JSON, else a text."""
        own = {"origin": f"http://{self.address[0]}:{self.address[1]}", "content_type": "application/json"}
        body = content if isinstance(content, bytes) else json.dumps(content).encode()
        status, told = self.ask(path, "POST", body, **(own | headers))
        return status, json.loads(told) if told.startswith(b"{") else told.decode()
