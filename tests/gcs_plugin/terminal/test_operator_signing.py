"""The operator's side with a key: real frames both ways, pymavlink's own signing at the other end."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

from companion.wire.signing import MINUTE, SigningKey, ticks
from gcs_plugin.client.client import OperatorClient
from gcs_plugin.terminal.main import main
from gcs_plugin.terminal.runner import Runner
from gcs_plugin.terminal.signing import MAX_PROBLEMS, OperatorSigning, open_signing
from tests.waiting import wait_for

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

    def __init__(self, *, timestamp: int = NOW, signing: OperatorSigning | None = None) -> None:
        self.wire = Wire()
        self.client = OperatorClient()
        self.signing = signing or OperatorSigning(SigningKey(SECRET), wall=lambda: WALL)
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


def test_what_several_links_carry_counts_as_doubled_and_not_as_a_replay() -> None:
    bench = Bench()
    other = Bench(signing=bench.signing)
    for frame in [bench.heartbeat() for _ in range(3)]:
        assert bench.hear(frame) == 1
        assert other.hear(frame) == 0
    assert (bench.signing.doubled, bench.signing.problems()) == (3, [])
    bench.hear(frame)
    assert "repeats itself" in bench.signing.problems()[0], "it came twice over one link"


def test_a_replayed_frame_is_not_shown() -> None:
    bench = Bench()
    frame = bench.heartbeat()
    assert bench.hear(frame) == 1
    bench.hear(frame)
    assert "repeats itself" in bench.signing.problems()[0]


def test_our_own_frame_that_comes_back_is_no_problem() -> None:
    bench = Bench()
    bench.hear(b"")
    bench.hear(bench.wire.left[0])
    assert bench.signing.problems() == []


@pytest.fixture
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's state folder."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state"


def run_again(timestamp: int, wall: float | None = None) -> Bench:
    """An operator's program with what the one before kept. wall: what its clock says."""
    signing = open_signing(SigningKey(SECRET), 255, 190)
    if wall is not None:
        signing._wall = lambda: wall
    return Bench(timestamp=timestamp, signing=signing)


@pytest.mark.parametrize("killed", [False, True])
@pytest.mark.parametrize("lag", [0.0, 7200.0])
@pytest.mark.usefixtures("state")
def test_what_was_heard_before_a_restart_is_not_believed_again(*, killed: bool, lag: float) -> None:
    now = time.time()
    first = run_again(ticks(now))
    old = [first.heartbeat() for _ in range(3)]
    assert [first.hear(frame) for frame in old] == [1, 1, 1]
    new = first.heartbeat()
    if killed:
        kept = first.signing._kept
        assert kept is not None
        wait_for(lambda: kept.file._waiting is None and kept.file._waits_since is None)
        os.close(kept._lock)
    else:
        first.runner.close()
    second = run_again(ticks(now), wall=now - lag)
    assert [second.hear(frame) for frame in old] == [0, 0, 0]
    assert second.hear(new) == 1
    second.runner.close()


def test_two_programs_under_the_same_ids_are_told_and_both_work(state: Path) -> None:
    first, second = (run_again(ticks(time.time())) for _ in range(2))
    assert first.signing.problems() == []
    assert "another program signs as 255/190" in second.signing.problems()[0]
    for one in (first, second):
        assert one.hear(one.heartbeat()) == 1
        one.runner.close()
    (folder,) = (state / "anytraverse").iterdir()
    assert SECRET.hex() not in folder.name
    assert folder.stat().st_mode & 0o077 == 0
    assert [file.name for file in folder.iterdir()] == ["signing.state"]


def test_where_nothing_can_be_kept_it_is_said_and_the_rover_is_heard(state: Path) -> None:
    state.write_text("a file in the folder's place")
    bench = run_again(ticks(time.time()))
    assert "timestamps are not kept (Not a directory)" in bench.signing.problems()[0]
    assert bench.hear(bench.heartbeat()) == 1
    bench.runner.close()


def test_the_terminal_keeps_them_for_each_key(
    state: Path, tmp_path: Path, capsys: pytest.CaptureFixture[Any]
) -> None:
    for number in (1, 2):
        path = tmp_path / f"key{number}"
        path.touch(0o600)
        path.write_bytes(bytes([number] * 32))
        options = ["--connect", "udpin:127.0.0.1:0", "--quit-after", "0.1", "--signing-key", str(path)]
        assert main(options) == 0
    folders = sorted((state / "anytraverse").iterdir())
    assert [folder.name.split("-", 2)[2] for folder in folders] == ["255-190", "255-190"]
    assert all((folder / "signing.state").stat().st_mode & 0o077 == 0 for folder in folders)
    assert "not kept" not in capsys.readouterr().out


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
