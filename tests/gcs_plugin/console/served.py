"""The console as its user starts it, rovers that talk to it by UDP, and a browser's requests."""

from __future__ import annotations

import http.client
import json
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

from tests.waiting import wait_for

MISSING = [name for name in ("starlette", "uvicorn") if find_spec(name) is None]
PATIENCE = 20.0
TUNNEL = 385
LINK = ("--connect", "udpin:127.0.0.1:0")


class Served:
    """Runs the console. `rovers` speak once a second while `turn` is called."""

    def __init__(self, *options: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "gcs_plugin.console", "--no-browser", *LINK, *options],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        ready, _, _ = select.select([self.process.stdout], [], [], PATIENCE)
        assert ready, "the console says nothing"
        self.url = self.process.stdout.readline().split()[-1]
        link = self.process.stdout.readline().split()[3].rstrip(",.")
        self.address = "127.0.0.1", int(self.url.rsplit(":", 1)[1].strip("/"))
        self._air = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._air.settimeout(0)
        self._air.connect(("127.0.0.1", int(link.rsplit(":", 1)[1])))
        self.rovers: list[Any] = []
        self._speak_at = 0.0

    def turn(self) -> None:
        """Let the rovers speak and hear."""
        if time.monotonic() >= self._speak_at:
            self._speak_at = time.monotonic() + 1.0
            for rover in self.rovers:
                self.say(*rover.speak())
        try:
            while True:
                data = self._air.recv(4096)
                for rover in self.rovers:
                    if _may_be_for(rover.system, data):
                        self.say(*rover.hear(data))
        except (BlockingIOError, ConnectionRefusedError):
            time.sleep(0.01)

    def say(self, *frames: bytes) -> None:
        """Send frames to the console."""
        for frame in frames:
            self._air.send(frame)

    def until(self, fits: Callable[[], bool], seconds: float = PATIENCE) -> None:
        """Turn until it is so."""
        wait_for(fits, seconds, turn=self.turn)

    def news(self) -> dict[str, Any]:
        """Return the newest state as a page that opens now gets it."""
        connection = http.client.HTTPConnection(*self.address, timeout=5.0)
        connection.request("GET", "/events")
        response = connection.getresponse()
        kind = ""
        try:
            while True:
                line = response.readline().decode()
                if line.startswith("event:"):
                    kind = line.split()[1]
                elif line.startswith("data:") and kind == "news":
                    found: dict[str, Any] = json.loads(line[5:])
                    return found
        finally:
            connection.close()

    def ask(
        self, path: str, method: str = "GET", body: Any = None, **headers: str
    ) -> tuple[int, dict[str, str], bytes]:
        """Ask as a client does that sets these headers, written with _ for -."""
        connection = http.client.HTTPConnection(*self.address, timeout=5.0)
        content = body if isinstance(body, bytes) or body is None else json.dumps(body).encode()
        try:
            connection.request(method, path, content, {k.replace("_", "-"): v for k, v in headers.items()})
            response = connection.getresponse()
            told = {name.lower(): value for name, value in response.getheaders()}
            return response.status, told, response.read()
        finally:
            connection.close()

    def post(self, kind: str, body: Any, **headers: str) -> tuple[int, bytes]:
        """Post as the page does."""
        own = {"Content_Type": "application/json", "Origin": self.url.rstrip("/")}
        status, _, told = self.ask(f"/{kind}", "POST", body, **(own | headers))
        return status, told

    def close(self, by: signal.Signals = signal.SIGTERM) -> None:
        """End the console, which says nothing more."""
        self._air.close()
        self.process.send_signal(by)
        try:
            _, errors = self.process.communicate(timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise
        assert (self.process.returncode, errors) == (0, ""), (self.process.returncode, errors)


def _may_be_for(system: int, frame: bytes) -> bool:
    """Whether a MAVLink 2 frame is not an answer (TUNNEL) to another rover."""
    return int.from_bytes(frame[7:10], "little") != TUNNEL or frame[12] == system
