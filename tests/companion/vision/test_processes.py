"""Two real processes: whatever happens to one of them, the other does what it should."""

from __future__ import annotations

import logging
import os
import signal
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from anytraverse.history import Entry, History
from anytraverse.memory import first_memory
from anytraverse.preferences import Preferences
from bench.processes import children
from companion.cameras.newest import CameraStatus
from companion.config import Config
from companion.vision.codec import encode_trusted
from companion.vision.memory_copy import MemoryCopy
from companion.vision.messages import Alive, Scenes, Start
from companion.vision.process import SupervisorChannel, _Lines, _send_alive, receive_start
from tests.companion.daemon.rig import picture
from tests.companion.processes import PATIENCE, Companion
from tests.companion.vision.played import heard
from tests.waiting import fill, is_gone, wait_for

GONE_WITHIN = 1.0


def obedient(folder: Path, stderr: int = subprocess.DEVNULL) -> Companion:
    """A companion whose eyes do what the file `orders` says."""
    pictures = [picture(scene=number) for number in range(4)]
    return Companion(folder, pictures, stderr, perceiver=f'name = "painted:{folder}/orders"')


def vision_of(companion: Companion) -> int | None:
    """The process id of its vision process."""
    return next(iter(children(companion.process.pid)), None)


@pytest.fixture
def companion(tmp_path: Path) -> Iterator[Companion]:
    """One that sees."""
    with closing(obedient(tmp_path)) as companion:
        companion.until(lambda: companion.told().get("state") == "ok", "it sees")
        yield companion


@pytest.fixture
def orders(tmp_path: Path) -> Path:
    return tmp_path / "orders"


def test_a_daemon_whose_log_nobody_reads_sees_tells_and_ends_in_good_order(tmp_path: Path) -> None:
    reader, stderr = os.pipe()
    fill(stderr)
    with closing(obedient(tmp_path, stderr)) as companion:
        companion.ground.settimeout(PATIENCE)
        companion.until(lambda: companion.told().get("state") == "ok", "it sees")
        assert companion.ground.recv(300)[0] == 0xFD
        companion.process.terminate()
        assert companion.process.wait(PATIENCE) == 0
    os.close(reader)
    os.close(stderr)


def test_a_line_of_the_log_that_cannot_be_made_costs_that_line_only(
    capsys: pytest.CaptureFixture[str],
) -> None:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        port = SupervisorChannel(ours)
        handler = _Lines(port)
        for number in (1, "two", 3):
            handler.handle(logging.LogRecord("x", logging.INFO, "", 0, "%d of %s", (number, "n"), None))
        handler.handle(logging.LogRecord("x", logging.INFO, "", 0, "no /dev/\udcff", None, None))
        assert [line.text for line in port.lines] == ["1 of n", "3 of n", r"no /dev/\udcff"]
    assert "Arguments: ('two', 'n')" in capsys.readouterr().err


def test_what_a_driver_says_in_several_lines_is_believed_as_one() -> None:
    sent: list[Alive] = []
    reader = SimpleNamespace(status=CameraStatus(reason="no\ncamera\x1b"), delivered_at=None)
    _send_alive(SimpleNamespace(send=sent.append), reader)  # type: ignore[arg-type]
    assert heard(sent[0]).camera.reason == "no camera"


def test_a_new_vision_process_waits_until_it_has_all_remembered_scenes() -> None:
    words = Preferences.parse("grass: 1")
    scenes = [Entry(np.ones(2, np.float32), words, order, order, order) for order in range(1, 151)]
    memory = replace(first_memory("eyes", words, 200), history=History(scenes, 200), clock=150)
    copy = MemoryCopy(memory, memory.history.limit)
    ours, theirs = socket.socketpair()
    with ours, theirs:
        first, more = copy.first_part()
        theirs.sendall(encode_trusted(Start(Config(), first, 7, 1, more)))
        while part := copy.next_scenes():
            theirs.sendall(encode_trusted(Scenes(part)))
        start = receive_start(SupervisorChannel(ours))
    assert start.more == 0
    assert start.revision == 7
    assert start.memory is not None
    assert [entry.order for entry in start.memory.history] == list(range(1, 151))


@pytest.mark.parametrize("order", ["", "lock"], ids=["well", "hung with the lock"])
def test_when_the_supervisor_is_killed_its_vision_process_is_gone_at_once(
    companion: Companion, orders: Path, order: str
) -> None:
    vision = vision_of(companion)
    assert vision is not None
    orders.write_text(order)
    companion.until(lambda: not order or companion.told().get("state") == "fault", "a fault")
    companion.process.send_signal(signal.SIGKILL)
    companion.process.wait()
    wait_for(lambda: is_gone(vision), GONE_WITHIN)


@pytest.mark.parametrize("order", ["die", "hang", "lock", "exit"])
def test_a_vision_process_that_fails_is_started_again_and_sees(
    companion: Companion, orders: Path, order: str
) -> None:
    before = vision_of(companion)
    orders.write_text(order)
    companion.until(lambda: vision_of(companion) not in (before, None), "another process")
    orders.unlink()
    companion.until(lambda: companion.told().get("vision", {}).get("restarts", 0) > 0, "it sees again")
    companion.until(lambda: companion.told().get("state") == "ok", "it sees again")
    assert companion.process.poll() is None


def test_the_vision_process_steps_back_for_the_supervisor(companion: Companion) -> None:
    vision = vision_of(companion)
    assert vision is not None
    own = int(Path(f"/proc/{companion.process.pid}/stat").read_text().rpartition(")")[2].split()[16])
    nice = int(Path(f"/proc/{vision}/stat").read_text().rpartition(")")[2].split()[16])
    assert nice > own
    assert int(Path(f"/proc/{vision}/oom_score_adj").read_text()) > int(
        Path(f"/proc/{companion.process.pid}/oom_score_adj").read_text()
    )


def test_a_slow_vision_process_judges_less_often_and_sees_all_the_same(
    companion: Companion, orders: Path
) -> None:
    orders.write_text("slow")
    companion.until(lambda: companion.told().get("judging", {}).get("rate") == 5.0, "fewer frames")
    before, began = companion.told()["frames"], time.monotonic()
    companion.until(lambda: time.monotonic() - began > 2.0, "two seconds")
    told = companion.told()
    assert (told["state"], told["judging"]["lowered_by"]) == ("ok", "slow computer")
    assert told["frames"] - before <= 5.0 * 3.5 + 1


def test_a_signal_ends_both_in_good_order(companion: Companion) -> None:
    vision = vision_of(companion)
    assert vision is not None
    companion.process.terminate()
    assert companion.process.wait(PATIENCE) == 0
    assert is_gone(vision)
