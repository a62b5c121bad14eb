"""What the companion in the container drives with: the simulated field on this machine, and an operator."""

from __future__ import annotations

import json
import os
import queue
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from bench.service.container import ROOT, ContainerError
from companion.sim.demo.config import write_config

SPEED = 1.5
FPS = 6.0
_ANNOUNCED_WITHIN = 30.0


class FieldProcess:
    """The simulated trail, rover and autopilot, as a process. `pause` and `go_on` stop and continue it."""

    def __init__(self) -> None:
        asked = ["-m", "companion.sim.field", "--autostart", "--speed", str(SPEED), "--fps", str(FPS)]
        self._lines = _Process([sys.executable, *asked])
        self._ports = json.loads(self._lines.wait_for(r"^\{.*\}$", _ANNOUNCED_WITHIN))

    @property
    def ground(self) -> str:
        """The url at which the operator reaches the rover's radio."""
        return str(self._ports["gcs"])

    @property
    def link(self) -> str:
        """The url of the companion's link."""
        return str(self._ports["companion"])

    def config(self, policy: str) -> str:
        """Return a companion.toml for this field, the service's state folder and a free port of the page."""
        with tempfile.TemporaryDirectory() as folder:
            camera = f"field:{self._ports['frames']}"
            path = write_config(Path(folder), camera=camera, link=self.link, policy=policy, speed=SPEED)
            text = re.sub(r"\[journal\]\nfolder = .*\n", "", path.read_text())
            return text.replace('listen = ""', 'listen = "127.0.0.1:0"')

    def pause(self) -> None:
        """Neither frames nor the autopilot's messages come."""
        self._lines.signal(signal.SIGSTOP)

    def go_on(self) -> None:
        """End `pause`."""
        self._lines.signal(signal.SIGCONT)

    def close(self) -> None:
        """End the process."""
        self.go_on()
        self._lines.close()


def answer(ground: str, words: str, within: float) -> str:
    """Type an answer into the shipped pymavlink client, and return how it was acknowledged."""
    client = _Process([sys.executable, str(ROOT / "docs" / "answer_from_python.py"), ground])
    try:
        client.wait_for(r"^\{'state'", within)  # a summary: the companion is heard
        client.type(words)
        return client.wait_for(r"^(applied|not |stale|refused|denied|busy|the companion)", within)
    finally:
        client.close()


class _Process:
    def __init__(self, command: list[str]) -> None:
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"}
        self._process = subprocess.Popen(
            command, cwd=ROOT, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self._lines: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line.rstrip("\n"))

    def wait_for(self, pattern: str, within: float) -> str:
        """Return the first line that fits."""
        until, seen = time.monotonic() + within, ""
        while time.monotonic() < until:
            try:
                seen = self._lines.get(timeout=max(0.01, until - time.monotonic()))
            except queue.Empty:
                break
            if re.search(pattern, seen):
                return seen
        raise ContainerError(
            f"{self._process.args!r} did not say {pattern} in {within:.0f} s, at last: {seen}"
        )

    def type(self, line: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(f"{line}\n")
        self._process.stdin.flush()

    def signal(self, number: int) -> None:
        if self._process.poll() is None:
            self._process.send_signal(number)

    def close(self) -> None:
        self._process.terminate()
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait(5.0)
