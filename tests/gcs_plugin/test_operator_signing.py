"""The operator's side with a key: real frames both ways, pymavlink's own signing at the other end."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from companion.wire.signing import MINUTE, SigningKey, ticks
from gcs_plugin.client import OperatorClient
from gcs_plugin.runner import Runner
from gcs_plugin.signing import MAX_PROBLEMS, Signing
from gcs_plugin.terminal import main

SECRET = bytes(range(32))
WALL = 1_790_000_000.0
NOW = ticks(WALL)


class Wire:
    """A connection in memory."""

    name = "memory"
    trouble = ""

    def __init__(self) -> None:
        self.coming: list[bytes] = []
        self.left: list[bytes] = []

    def fileno(self) -> int | None:
        return None

    def read(self) -> bytes:
        waiting, self.coming = b"".join(self.coming), []
        return waiting

    def write(self, frame: bytes) -> None:
        self.left.append(frame)

    def close(self) -> None:
        pass


class Bench:
    """A runner with a key, and a rover that signs with pymavlink."""

    def __init__(self, *, timestamp: int = NOW) -> None:
        self.wire = Wire()
        self.client = OperatorClient()
        self.signing = Signing(SigningKey(SECRET), wall=lambda: WALL)
        self.runner = Runner(self.wire, self.client, signing=self.signing)
        self.rover = mavlink.MAVLink(None, 1, 191)
        self.rover.signing.secret_key = SECRET
        self.rover.signing.sign_outgoing = True
        self.rover.signing.timestamp = timestamp

    def hear(self, frame: bytes) -> int:
        """How many rovers are known after it."""
        self.wire.coming.append(frame)
        self.runner.step(0.0)
        return len(self.client.rovers)

    def heartbeat(self) -> bytes:
        return bytes(mavlink.MAVLink_heartbeat_message(18, 8, 0, 1, 4, 3).pack(self.rover))


def test_a_signed_rover_is_heard_and_what_it_is_told_is_signed() -> None:
    bench = Bench()
    assert bench.hear(bench.heartbeat()) == 1
    assert bench.signing.problems() == []
    assert bench.rover.decode(bytearray(bench.wire.left[0])).get_type() == "HEARTBEAT"


@pytest.mark.parametrize(
    ("what", "said"),
    [
        ("unsigned", "1/191 says is not signed"),
        ("key", "another key"),
        ("old", "old time"),
        ("far", "a year"),
    ],
)
def test_what_is_not_believed_is_not_shown_and_said_once(what: str, said: str) -> None:
    bench = Bench(timestamp={"old": NOW - 2 * MINUTE, "far": NOW + 400 * 24 * 60 * MINUTE}.get(what, NOW))
    bench.rover.signing.sign_outgoing = what != "unsigned"
    bench.rover.signing.secret_key = SECRET if what != "key" else bytes(32 * [5])
    assert [bench.hear(bench.heartbeat()) for _ in range(3)] == [0, 0, 0]
    (problem,) = bench.signing.problems()
    assert said in problem
    assert bench.signing.problems() == []


def test_a_replayed_frame_is_not_shown() -> None:
    bench = Bench()
    frame = bench.heartbeat()
    assert bench.hear(frame) == 1
    bench.hear(frame)
    assert "repeats itself" in bench.signing.problems()[0]


def test_a_swarm_of_strangers_is_not_a_swarm_of_problems() -> None:
    bench = Bench()
    for system in range(1, 200):
        stranger = mavlink.MAVLink(None, system, 1)
        bench.hear(bytes(mavlink.MAVLink_heartbeat_message(10, 3, 0, 0, 4, 3).pack(stranger)))
    assert len(bench.signing.problems()) == MAX_PROBLEMS


def test_a_radio_cannot_sign_and_is_no_problem() -> None:
    bench = Bench()
    bench.hear(
        bytes(mavlink.MAVLink_radio_status_message(9, 9, 9, 9, 9, 9, 9).pack(mavlink.MAVLink(None, 51, 68)))
    )
    assert bench.signing.problems() == []


def test_a_key_that_others_may_read_ends_the_terminal_with_what_to_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[Any]
) -> None:
    path = tmp_path / "key"
    path.write_bytes(SECRET)
    path.chmod(0o644)
    assert main(["--connect", "udpin:127.0.0.1:0", "--signing-key", str(path)]) == 2
    assert f"chmod 600 {path}" in capsys.readouterr().err
