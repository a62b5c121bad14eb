"""Real ground stations in processes of their own, against a rover in others. `make interop` runs it.

Nothing is collected without INTEROP, the folder of the environment that holds them.
"""

from __future__ import annotations

import json
import math
import os
import queue
import select
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from companion.desk.check.here import read_status
from companion.sim.demo.child import LoggedProcess
from companion.sim.demo.config import write_config
from companion.sim.demo.pace import SPEED
from companion.sim.field.control import FieldControl
from tests.waiting import wait_for

CHECKOUT = Path(__file__).parents[2]
"""Whose module and samples are tried, whatever is installed in the environment."""
ENVIRONMENT = Path(os.environ.get("INTEROP", "")).absolute()
collect_ignore_glob = [] if "INTEROP" in os.environ else ["test_*"]
PATIENCE = 30.0
"""Seconds until something that should come is given up."""
MAX_LINES = 5000


class Stage:
    """The field and the daemon as processes. The field's ground port serves whoever spoke last."""

    def __init__(self, out: Path, more_config: str = "") -> None:
        self.out = out
        self._children: list[LoggedProcess] = []
        field = self._start("field", ["companion.sim.field", "--seed", "1", "--speed", str(SPEED)])
        ports = json.loads(field.first_line(PATIENCE))
        host, _, port = ports["control"].rpartition(":")
        self.control = FieldControl(host, int(port))
        self.ground: str = ports["gcs"]
        camera = f"field:{ports['frames']}"
        config = write_config(out, camera=camera, link=ports["companion"], policy="hold", speed=SPEED)
        with config.open("a", encoding="utf-8") as file:
            file.write(more_config)
        self.daemon = self._start("daemon", ["companion", "run", str(config)])

    def _start(self, name: str, arguments: list[str]) -> LoggedProcess:
        self._children.append(LoggedProcess(name, arguments, self.out / f"{name}.log"))
        return self._children[-1]

    def wait_until_ok(self) -> None:
        """Until the daemon has judged its first frame and knows that it may hold."""
        state, unseen = self.out / "state", partial(self.daemon.error, "saw nothing that it knows")
        wait_for(lambda: read_status(state)[1].get("state") == "ok", PATIENCE, unseen)

    def close(self) -> None:
        for child in reversed(self._children):
            child.stop()
        self.control.close()


class Program:
    """A ground station that is typed to and read line by line."""

    def __init__(self, *command: str, folder: Path) -> None:
        self.said: list[str] = []
        self._read_to = 0
        self._lines: queue.Queue[str] = queue.Queue(MAX_LINES)
        self._process = subprocess.Popen(
            [str(ENVIRONMENT / "bin" / "python"), "-u", *command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            bufsize=1,
            cwd=folder,
            env={"PATH": os.environ["PATH"], "HOME": str(folder), "PYTHONPATH": str(CHECKOUT)},
        )
        threading.Thread(target=self._read, daemon=True).start()

    def type(self, *lines: str) -> None:
        assert self._process.stdin is not None
        for line in lines:
            self._process.stdin.write(line + "\n")
            self._process.stdin.flush()

    def wait_for(self, part: str) -> str:
        """The next line that holds `part`; what came before it counts as read."""
        line = self._next(part, PATIENCE)
        assert line is not None, f'"{part}" never came; the last lines were:\n' + "\n".join(self.said[-25:])
        return line

    def ask(self, line: str, part: str) -> str:
        """Type a line, and the answer that holds `part`."""
        self._forget()
        self.type(line)
        return self.wait_for(part)

    def ask_until(self, line: str, part: str, every: float = 1.0) -> None:
        """The same, typed again every so many seconds."""
        for _ in range(math.ceil(PATIENCE / every)):
            self._forget()
            self.type(line)
            if self._next(part, every) is not None:
                return
        raise AssertionError(f'"{line}" never gave "{part}":\n' + "\n".join(self.said[-25:]))

    def close(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            self._process.wait(10.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait(10.0)

    def _next(self, part: str, patience: float) -> str | None:
        deadline = time.monotonic() + patience
        while time.monotonic() < deadline:
            self._take()
            while self._read_to < len(self.said):
                self._read_to += 1
                if part in self.said[self._read_to - 1]:
                    return self.said[self._read_to - 1]
            time.sleep(0.02)
        return None

    def _forget(self) -> None:
        self._take()
        self._read_to = len(self.said)

    def _take(self) -> None:
        while not self._lines.empty():
            self.said.append(self._lines.get_nowait())

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line.rstrip("\n"), timeout=PATIENCE)


class Radio:
    """A UDP port of 127.0.0.1 behind which a rover speaks twice a second to whoever spoke last."""

    def __init__(self, rover: Any) -> None:
        self._rover = rover
        self._over = threading.Event()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.05)
        self.address = f"udpout:127.0.0.1:{self._socket.getsockname()[1]}"
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._over.set()
        self._thread.join(5.0)
        self._socket.close()

    def _run(self) -> None:
        peer: Any = None
        next_at = 0.0
        while not self._over.is_set():
            frames: list[bytes] = []
            try:
                heard, peer = self._socket.recvfrom(4096)
                frames += self._rover.hear(heard)
            except OSError:
                pass
            if time.monotonic() >= next_at:
                next_at = time.monotonic() + 0.5
                frames += self._rover.speak()
            for frame in frames:
                if peer is not None:
                    self._socket.sendto(frame, peer)


class LossyLink:
    """A UDP port of 127.0.0.1 that passes datagrams to a rover's port and back, and loses some of them."""

    def __init__(self, rover: str) -> None:
        """rover: "udpout:HOST:PORT". Each datagram is one frame."""
        host, port = rover.rsplit(":", 2)[1:]
        self._near, self._far = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        self._near.bind(("127.0.0.1", 0))
        self._far.connect((host, int(port)))
        self.port = int(self._near.getsockname()[1])
        self.loses: Callable[[bytes], bool] = lambda _: False
        self.lost = 0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._over.set()
        self._thread.join(5.0)
        self._near.close()
        self._far.close()

    def _run(self) -> None:
        peer: Any = None
        while not self._over.is_set():
            for ready in select.select([self._near, self._far], [], [], 0.05)[0]:
                try:
                    frame, sender = ready.recvfrom(65536)
                except OSError:
                    continue
                peer = sender if ready is self._near else peer
                if self.loses(frame):
                    self.lost += 1
                elif ready is self._near:
                    self._far.send(frame)
                elif peer is not None:
                    self._near.sendto(frame, peer)


@pytest.fixture(scope="module")
def more_config() -> str:
    """What a module wants in the daemon's configuration besides."""
    return ""


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory, more_config: str) -> Iterator[Stage]:
    """A rover that stands at the start of its trail."""
    made = Stage(tmp_path_factory.mktemp("stage"), more_config)
    yield made
    made.close()


@pytest.fixture(scope="module")
def start(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., Program]]:
    """Starts a Python program of the environment; all end with the module."""
    running: list[Program] = []

    def started(*command: str) -> Program:
        running.append(Program(*command, folder=tmp_path_factory.mktemp("program")))
        return running[-1]

    yield started
    for program in running:
        program.close()


@pytest.fixture(scope="module")
def mavproxy(start: Callable[..., Program]) -> Callable[..., Program]:
    """Starts MAVProxy on these links."""

    def started(*links: str, options: tuple[str, ...] = ()) -> Program:
        masters = [word for link in links for word in ("--master", link)]
        return start(str(ENVIRONMENT / "bin" / "mavproxy.py"), "--no-state", *masters, *options)

    return started


@pytest.fixture(scope="module")
def lossy(stage: Stage) -> Iterator[LossyLink]:
    """A link to the rover that loses what a test tells it to."""
    stage.wait_until_ok()
    made = LossyLink(stage.ground)
    yield made
    made.close()


@pytest.fixture
def radio() -> Iterator[Callable[[Any], Radio]]:
    """Puts a rover behind a port."""
    made: list[Radio] = []

    def opened(rover: Any) -> Radio:
        made.append(Radio(rover))
        return made[-1]

    yield opened
    for one in made:
        one.close()
