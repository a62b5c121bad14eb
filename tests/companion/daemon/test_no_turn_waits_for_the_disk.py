"""A whole daemon on a signed link, whose main loop is watched: it touches no disk, whatever it is asked."""

from __future__ import annotations

import os
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from anytraverse.operations import SetWord
from companion import run
from companion.config import load_config
from companion.daemon.daemon import Daemon
from companion.daemon.startup import load
from companion.daemon.trial_call import REQUEST
from companion.vision.messages import Ready
from companion.wire.answers import Answer
from companion.wire.ids import TUNNEL_ACKNOWLEDGEMENT, TUNNEL_ANSWER, Motion
from tests.companion.daemon.rig import picture
from tests.companion.processes import painted_config
from tests.companion.vision import painted

PATIENCE = 30.0
_EVENTS = ("open", "os.", "shutil.", "sqlite3.", "subprocess.", "tempfile.", "glob.", "import")
"""Beginnings of the audit events of what may wait for a disk."""
_NOT_AUDITED = ("stat", "lstat", "write", "pwrite", "fsync", "fdatasync", "statvfs", "access")
_NO_DISK = ("/proc/", "/sys/", "/dev/", "/run/systemd/")
"""Beginnings of paths in memory."""


class Watch:
    """Notes what a thread does that may wait for a disk."""

    def __init__(self) -> None:
        self.touched: list[str] = []
        self._thread = 0

    def begin(self) -> None:
        """Watch this thread."""
        self._thread = threading.get_ident()

    def end(self) -> None:
        """Watch no more."""
        self._thread = 0

    def note(self, event: str, arguments: tuple[Any, ...]) -> None:
        """Note an event, if it is one of these, in the watched thread."""
        if threading.get_ident() == self._thread and event.startswith(_EVENTS):
            what = str(arguments[0]) if arguments else ""
            if not what.startswith(_NO_DISK):
                self.touched.append(f"{event} {what}")


_watch = Watch()


@pytest.fixture
def watch(monkeypatch: pytest.MonkeyPatch) -> Iterator[Watch]:
    """Watches the turns while the perceiver loads, in which processes are started, and those after that."""
    sys.addaudithook(_watch.note)
    for name in _NOT_AUDITED:
        real: Callable[..., Any] = getattr(os, name)

        def noted(*given: Any, _real: Callable[..., Any] = real, _name: str = name, **named: Any) -> Any:
            _watch.note(f"os.{_name}", given)
            return _real(*given, **named)

        monkeypatch.setattr(os, name, noted)
    turn = Daemon.turn

    def loads(*given: Any) -> Ready | None:
        _watch.begin()
        ready = load(*given)
        _watch.end()
        return ready

    def turns(daemon: Daemon) -> None:
        _watch.begin()
        turn(daemon)

    monkeypatch.setattr("companion.run.load", loads)
    monkeypatch.setattr(Daemon, "turn", turns)
    yield _watch
    _watch.end()


class Ground(threading.Thread):
    """The autopilot and an operator, in a thread of their own: they sign, and ask for this and that."""

    def __init__(self, radio: socket.socket, secret: bytes, state: Path) -> None:
        super().__init__(daemon=True)
        self._radio, self._state = radio, state
        self._ends = [mavlink.MAVLink(None, *ids) for ids in ((1, 1), (255, 190))]
        for end in self._ends:
            end.signing.secret_key, end.signing.sign_outgoing = secret, True
            end.signing.timestamp = int((time.time() - 1_420_070_400) * 100_000)
        self._ear = mavlink.MAVLink(None)
        self._ear.robust_parsing = True
        self.heard: list[Any] = []
        self.done = False
        """Whether all that was asked for was answered."""
        self.ended = threading.Event()

    def run(self) -> None:
        autopilot, operator = self._ends
        self._radio.settimeout(0.05)
        address, beat_at, asked = None, 0.0, 0
        while not self.ended.is_set():
            with suppress(TimeoutError):
                data, address = self._radio.recvfrom(4096)
                self.heard += self._ear.parse_buffer(bytearray(data)) or []
            if address is None or time.monotonic() < beat_at:
                continue
            beat_at = time.monotonic() + 0.25
            beat = mavlink.MAVLink_heartbeat_message(10, 3, 0x81, 10, 4, 3)
            self._radio.sendto(bytes(beat.pack(autopilot)), address)
            if not (self._state / "status.json").exists():
                continue
            answer = Answer(0, Motion.NONE, (SetWord("gravel", 1.0),), 7).pack()
            padded = list(answer.ljust(128, b"\0"))
            self._radio.sendto(
                bytes(
                    mavlink.MAVLink_tunnel_message(1, 191, TUNNEL_ANSWER, len(answer), padded).pack(operator)
                ),
                address,
            )
            listed = mavlink.MAVLink_param_request_list_message(1, 191)
            self._radio.sendto(bytes(listed.pack(operator)), address)
            if not asked:
                asked = 1
                (self._state / REQUEST).touch()
            kinds = {one.get_type() for one in self.heard}
            acknowledged = any(
                one.get_type() == "TUNNEL" and one.payload_type == TUNNEL_ACKNOWLEDGEMENT
                for one in self.heard
            )
            tried = any(one.get_type() == "STATUSTEXT" and "TEST" in one.text for one in self.heard)
            self.done = acknowledged and tried and "PARAM_VALUE" in kinds


@pytest.mark.slow
def test_no_turn_touches_the_disk(tmp_path: Path, radio: socket.socket, watch: Watch) -> None:
    key, secret = tmp_path / "signing.key", bytes(range(100, 132))
    key.touch(0o600)
    key.write_bytes(secret)
    web, link = 'listen = "127.0.0.1:0"', 'signing_key = "signing.key"'
    lines = {"web": web, "link": link, "recorded": "1000", "more": "rock = -1.0"}
    path = painted_config(tmp_path, radio.getsockname()[1], [picture()] * 5, **lines)
    painted.register()
    ground = Ground(radio, secret, tmp_path / "state")
    ground.start()
    deadline = time.monotonic() + PATIENCE

    def stop() -> bool:
        if ground.done or time.monotonic() > deadline:
            watch.end()
        return ground.done or time.monotonic() > deadline

    try:
        assert run.main(load_config(str(path)), stop, vision=painted.COMMAND) == 0
    finally:
        ground.ended.set()
        ground.join()
    assert ground.done
    assert watch.touched == []
