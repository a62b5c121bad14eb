"""`companion check` with a key: it signs what it asks, and believes only an autopilot that signs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.config import Config
from companion.config.radio import LinkSection
from companion.desk.check.autopilot import ask, judged
from companion.desk.check.interview import Interview
from companion.link.connection import Connection
from companion.link.signing import Signing, open_signing
from companion.sim.loopback_link import MemoryTransport, pair
from companion.wire.signing import ticks

SECRET = bytes(range(32))
WALL = 1_790_000_000.0


@pytest.fixture
def signing(tmp_path: Path) -> Signing:
    key = tmp_path / "key"
    key.touch(0o600)
    key.write_bytes(SECRET)
    return open_signing(key, tmp_path, wall=lambda: WALL)


class Autopilot:
    """Answers every question with 1. It signs as pymavlink does; without a `key` it does not, nor checks."""

    def __init__(self, far: MemoryTransport, key: bytes | None) -> None:
        self._far = far
        self._mav = mavlink.MAVLink(None, 1, 1)
        self._mav.signing.secret_key = key
        self._mav.signing.sign_outgoing = key is not None
        self._mav.signing.timestamp = ticks(WALL)
        self.refused = 0

    def turn(self) -> None:
        self._send(mavlink.MAVLink_heartbeat_message(10, 3, 0x81, 10, 4, 3))
        while frame := self._far.read():
            try:
                message = self._mav.decode(bytearray(frame))
            except mavlink.MAVError:
                self.refused += 1
                continue
            if message.get_type() == "PARAM_REQUEST_READ":
                self._send(mavlink.MAVLink_param_value_message(message.param_id.encode(), 1.0, 9, 1, 0))

    def _send(self, message: Any) -> None:
        self._far.write(message.pack(self._mav))


def talked(
    signing: Signing, key: bytes | None, *, refuse_unsigned: bool = True
) -> tuple[Interview, Autopilot]:
    near, far = pair()
    interview = Interview(
        Connection(lambda: near, 0.0), lambda _: ["A", "B"], 1, 0.0, signing, refuse_unsigned
    )
    autopilot = Autopilot(far, key)
    for step in range(200):
        autopilot.turn()
        if interview.turn(step / 10):
            break
    return interview, autopilot


def test_an_autopilot_with_the_key_answers(signing: Signing) -> None:
    interview, autopilot = talked(signing, SECRET)
    assert interview.values == {"A": 1.0, "B": 1.0}
    assert autopilot.refused == 0


@pytest.mark.parametrize(("key", "said"), [(None, "is not signed"), (b"x" * 32, "with another key")])
def test_an_autopilot_without_the_key_is_told_as_such(signing: Signing, key: bytes | None, said: str) -> None:
    interview, _ = talked(signing, key)
    assert interview.autopilot is None
    assert said in judged(Config(), "udpin:0.0.0.0:14550", interview).findings[0].text


def test_an_exempted_autopilot_is_heard_without_it(signing: Signing) -> None:
    interview, _ = talked(signing, None, refuse_unsigned=False)
    assert interview.values == {"A": 1.0, "B": 1.0}


def test_a_key_that_cannot_be_used_is_a_finding(tmp_path: Path) -> None:
    config = replace(Config(), link=LinkSection(signing_key=str(tmp_path / "none")))
    assert "there is no signing key" in ask(config, "udpin:127.0.0.1:0").findings[0].text
