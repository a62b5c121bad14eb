"""Two real processes: whatever happens to one of them, the other does what it should."""

from __future__ import annotations

import json
import logging
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from anytraverse.history import Entry, History
from anytraverse.memory import first_memory
from anytraverse.preferences import Preferences
from bench.processes import children
from companion.config import Config
from companion.vision.codec import encode_trusted
from companion.vision.memory_copy import MemoryCopy
from companion.vision.messages import Scenes, Start
from companion.vision.process import SupervisorChannel, _Lines, receive_start
from tests.companion.daemon.rig import picture
from tests.waiting import fill

ROOT = Path(__file__).resolve().parents[3]
PATIENCE = 20.0
GONE_WITHIN = 1.0
SCRIPT = """
import sys
from tests.companion.vision.painted import COMMAND, register
register()
from companion.cli import main
sys.exit(main(["run", "--config", sys.argv[1]], vision=COMMAND))
"""


class Companion:
    """`companion run` with painted eyes that do what `orders` says."""

    def __init__(self, folder: Path, port: int, stderr: int = subprocess.DEVNULL) -> None:
        frames = folder / "frames"
        frames.mkdir()
        for number in range(4):
            cv2.imwrite(str(frames / f"{number}.png"), picture(scene=number)[..., ::-1])
        self.orders, self.status = folder / "orders", folder / "state" / "status.json"
        config = folder / "companion.toml"
        config.write_text(
            f'[camera]\nsource = "folder:{frames}"\nloop = true\n'
            f'[perceiver]\nname = "painted:{self.orders}"\n'
            f'[web]\nlisten = ""\n[recording]\nsize = 0\n'
            f'[vehicle]\nfile = ""\n[link]\nurl = "udpout:127.0.0.1:{port}"\n'
            f'[journal]\nfolder = "{folder / "state"}"\n[words]\ngrass = 1.0\n'
        )
        self.process = subprocess.Popen(
            [sys.executable, "-c", SCRIPT, str(config)],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stderr=stderr,
        )

    def told(self) -> dict[str, Any]:
        """The status file."""
        with suppress(OSError, ValueError):
            return dict(json.loads(self.status.read_text()))
        return {}

    def vision(self) -> int | None:
        """The process id of its vision process."""
        return next(iter(children(self.process.pid)), None)

    def until(self, what: str, fits: Callable[[], bool], seconds: float = PATIENCE) -> None:
        """Wait for it."""
        deadline = time.monotonic() + seconds
        while not fits():
            assert time.monotonic() < deadline, (what, self.told())
            assert self.process.poll() is None, what
            time.sleep(0.01)


@pytest.fixture
def companion(tmp_path: Path) -> Iterator[Companion]:
    """One that sees."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ground:
        ground.bind(("127.0.0.1", 0))
        companion = Companion(tmp_path, ground.getsockname()[1])
        try:
            companion.until("it sees", lambda: companion.told().get("state") == "ok")
            yield companion
        finally:
            companion.process.kill()
            companion.process.wait()


def test_a_daemon_whose_log_nobody_reads_sees_tells_and_ends_in_good_order(tmp_path: Path) -> None:
    reader, stderr = os.pipe()
    fill(stderr)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ground:
        ground.bind(("127.0.0.1", 0))
        ground.settimeout(PATIENCE)
        companion = Companion(tmp_path, ground.getsockname()[1], stderr)
        try:
            companion.until("it sees", lambda: companion.told().get("state") == "ok")
            assert ground.recv(300)[0] == 0xFD
            companion.process.terminate()
            assert companion.process.wait(PATIENCE) == 0
        finally:
            companion.process.kill()
            companion.process.wait()
            os.close(reader)
            os.close(stderr)


def is_gone(pid: int) -> bool:
    """Whether the process has ended, reaped or not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] in ("Z", "X")
    except OSError:
        return True


def test_a_line_of_the_log_that_cannot_be_made_costs_that_line_only(
    capsys: pytest.CaptureFixture[str],
) -> None:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        port = SupervisorChannel(ours)
        handler = _Lines(port)
        for number in (1, "two", 3):
            handler.handle(logging.LogRecord("x", logging.INFO, "", 0, "%d of %s", (number, "n"), None))
        assert [line.text for line in port.lines] == ["1 of n", "3 of n"]
    assert "Arguments: ('two', 'n')" in capsys.readouterr().err


def test_a_new_vision_process_waits_until_it_has_all_remembered_scenes() -> None:
    words = Preferences.parse("grass: 1")
    scenes = [Entry(np.ones(2, np.float32), words, order, order, order) for order in range(1, 151)]
    memory = replace(first_memory("eyes", words, 200), history=History(scenes, 200), clock=150)
    copy = MemoryCopy(memory)
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
    companion: Companion, order: str
) -> None:
    vision = companion.vision()
    assert vision is not None
    companion.orders.write_text(order)
    companion.until("a fault", lambda: not order or companion.told().get("state") == "fault")
    companion.process.send_signal(signal.SIGKILL)
    companion.process.wait()
    deadline = time.monotonic() + GONE_WITHIN
    while not is_gone(vision) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert is_gone(vision)


@pytest.mark.parametrize("order", ["die", "hang", "lock", "exit"])
def test_a_vision_process_that_fails_is_started_again_and_sees(companion: Companion, order: str) -> None:
    before = companion.vision()
    companion.orders.write_text(order)
    companion.until("another process", lambda: companion.vision() not in (before, None))
    companion.orders.unlink()
    companion.until("it sees again", lambda: companion.told().get("vision", {}).get("restarts", 0) > 0)
    companion.until("it sees again", lambda: companion.told().get("state") == "ok")
    assert companion.process.poll() is None


def test_the_vision_process_steps_back_for_the_supervisor(companion: Companion) -> None:
    vision = companion.vision()
    assert vision is not None
    own = int(Path(f"/proc/{companion.process.pid}/stat").read_text().rpartition(")")[2].split()[16])
    nice = int(Path(f"/proc/{vision}/stat").read_text().rpartition(")")[2].split()[16])
    assert nice > own
    assert int(Path(f"/proc/{vision}/oom_score_adj").read_text()) > int(
        Path(f"/proc/{companion.process.pid}/oom_score_adj").read_text()
    )


def test_a_slow_vision_process_judges_less_often_and_sees_all_the_same(companion: Companion) -> None:
    companion.orders.write_text("slow")
    companion.until("fewer frames", lambda: companion.told().get("judging", {}).get("rate") == 5.0)
    before, began = companion.told()["frames"], time.monotonic()
    companion.until("two seconds", lambda: time.monotonic() - began > 2.0)
    told = companion.told()
    assert (told["state"], told["judging"]["lowered_by"]) == ("ok", "slow computer")
    assert told["frames"] - before <= 5.0 * 3.5 + 1


def test_a_signal_ends_both_in_good_order(companion: Companion) -> None:
    vision = companion.vision()
    assert vision is not None
    companion.process.terminate()
    assert companion.process.wait(PATIENCE) == 0
    assert is_gone(vision)
