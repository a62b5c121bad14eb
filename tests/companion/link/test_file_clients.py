"""pymavlink's own file transfer client, in real time over UDP and in virtual time over a bad radio."""

import random
import re
import select
import threading
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink import mavftp, mavutil
from pymavlink.dialects.v20 import development as mavlink

from companion.config.link_settings import MAIN, LinkSettings
from companion.link.link import Link
from companion.link.transport import Udp
from companion.sim.loopback_link import LoopbackLink
from companion.storage.served_files import MatchingFiles
from companion.storage.served_tree import Document, Tree
from companion.wire.ids import COMPONENT_ID
from companion.wire.parameters import build

SUCCESS, NOT_FOUND = 0, 10
CONTENT = random.Random(1).randbytes(200_000)
SIZES = (0, 1, 79, 80, 81, 160, 1_500, 64 * 80, 64 * 80 + 1, 20_000, 200_000)


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    folder = tmp_path / "logs"
    folder.mkdir()
    for size in SIZES:
        (folder / f"{size}.bin").write_bytes(CONTENT[:size])
    return folder


def tree(logs: Path) -> Tree:
    return Tree({"logs": MatchingFiles(logs), "state.json": Document(lambda: b"{}")})


def get(client: Any, path: str, copy: Path) -> int:
    client.cmd_get([path, str(copy)])
    return int(client.process_ftp_reply("Get", timeout=600).error_code)


@pytest.fixture
def port(logs: Path) -> Iterator[int]:
    """Of a link without budgets that lives in a thread."""
    settings = LinkSettings("udpin:127.0.0.1:0", asked_budget=0.0, pace=0.0)
    transport = Udp(settings.address())
    link = Link(
        settings, build([], {}, {}), time.monotonic(), openers={MAIN: lambda: transport}, tree=tree(logs)
    )
    over = threading.Event()

    def live() -> None:
        while not over.is_set():
            link.poll(time.monotonic())
            link.tick(time.monotonic())
            select.select(link.filenos(), [], [], link.wait(time.monotonic()))

    thread = threading.Thread(target=live)
    thread.start()
    yield transport.port
    over.set()
    thread.join()
    link.close()


@pytest.mark.slow
def test_pymavlinks_client_lists_and_gets_every_size_over_udp(port: int, tmp_path: Path) -> None:
    master = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=255, source_component=190)
    autopilot = mavlink.MAVLink_heartbeat_message(10, 3, 129, 10, 4, 3)
    master.write(autopilot.pack(mavlink.MAVLink(None, 1, 1)))
    client = mavftp.MAVFTP(master, 1, COMPONENT_ID)
    listed = client.cmd_list(["/logs"]).directory_listing
    assert {entry.name: entry.size_b for entry in listed} == {f"{size}.bin": size for size in SIZES}
    for size in SIZES:
        assert get(client, f"/logs/{size}.bin", tmp_path / "copy") == SUCCESS
        assert (tmp_path / "copy").read_bytes() == CONTENT[:size]
    master.close()


class Radio:
    """What the client takes for its connection: loss, copies and late frames each way, in virtual time."""

    source_system, source_component = 255, 190

    def __init__(self, stage: LoopbackLink, loss: float, seed: int = 1) -> None:
        self.mav = self
        self.stage = stage
        self._loss = loss
        self._random = random.Random(seed)
        self._seen = 0
        self._waiting: list[Any] = []

    def file_transfer_protocol_send(self, network: int, system: int, component: int, payload: bytes) -> None:
        for _ in range(self._copies()):
            message = mavlink.MAVLink_file_transfer_protocol_message(network, system, component, payload)
            self.stage.send(message, (self.source_system, self.source_component))

    def recv_match(self, *, timeout: float = 0.1, **_: Any) -> Any:
        end = self.stage.now + timeout
        while not self._waiting and self.stage.now < end:
            self.stage.run(0.01)
            frames = self.stage.frames[self._seen :]
            self._seen += len(frames)
            for frame in frames:
                if frame.message.get_type() == "FILE_TRANSFER_PROTOCOL":
                    self._waiting += [frame.message] * self._copies()
            if len(self._waiting) > 1 and self._random.random() < self._loss:
                self._waiting.reverse()
        return self._waiting.pop(0) if self._waiting else None

    def _copies(self) -> int:
        return 0 if self._random.random() < self._loss else 1 + (self._random.random() < self._loss / 2)


Connect = Callable[..., Any]


@pytest.fixture
def connect(logs: Path, monkeypatch: pytest.MonkeyPatch) -> Connect:
    def made(loss: float = 0.0, seed: int = 1) -> Any:
        stage = LoopbackLink(tree=tree(logs))
        monkeypatch.setattr(mavftp, "time", SimpleNamespace(time=lambda: 1e9 + stage.now))
        stage.run(1.0)
        return mavftp.MAVFTP(Radio(stage, loss, seed), 1, COMPONENT_ID)

    return made


@pytest.mark.parametrize(("size", "seconds"), [(1_500, 2.5), (20_000, 19.5)])
def test_a_picture_takes_two_seconds_at_the_default_budget(
    connect: Connect, tmp_path: Path, size: int, seconds: float
) -> None:
    client = connect()
    stage = client.master.stage
    began = stage.now
    assert get(client, f"/logs/{size}.bin", tmp_path / "copy") == SUCCESS
    assert (tmp_path / "copy").read_bytes() == CONTENT[:size]
    assert stage.now - began < seconds


def test_a_download_leaves_the_unsolicited_messages_alone(connect: Connect, tmp_path: Path) -> None:
    client = connect()
    get(client, "/logs/20000.bin", tmp_path / "copy")
    beats = client.master.stage.times("HEARTBEAT")
    assert max(after - before for before, after in pairwise(beats)) < 1.2


@pytest.mark.parametrize("size", [80, 239])
def test_whatever_burst_size_the_client_asks_for_the_file_is_whole(
    connect: Connect, tmp_path: Path, size: int
) -> None:
    client = connect()
    client.ftp_settings.burst_read_size = size
    for length in (239, 240, 20_000):
        (tmp_path / "logs" / "file").write_bytes(CONTENT[:length])
        assert get(client, "/logs/file", tmp_path / "copy") == SUCCESS
        assert (tmp_path / "copy").read_bytes() == CONTENT[:length]


@pytest.mark.parametrize("path", ["/nothing", "@SYS/threads.txt", "/logs/../../etc/passwd"])
def test_a_file_that_is_not_there_is_known_at_once(connect: Connect, tmp_path: Path, path: str) -> None:
    client = connect()
    assert get(client, path, tmp_path / "copy") == NOT_FOUND
    times = client.master.stage.times("FILE_TRANSFER_PROTOCOL")
    assert times[-1] - times[0] < 0.5
    assert not (tmp_path / "copy").exists()


def test_pymavlinks_client_gets_all_parameters_and_their_defaults(connect: Connect, tmp_path: Path) -> None:
    client = connect()
    client.cmd_getparams([str(tmp_path / "values"), str(tmp_path / "defaults")])
    assert client.process_ftp_reply("GetParams", timeout=60).error_code == SUCCESS
    listed = {
        parameter.name: parameter.value for parameter in build(["grass", "dry bush"], {"grass": 1.0}, {})
    }
    for file in ("values", "defaults"):
        lines = (tmp_path / file).read_text().splitlines()
        told = dict(re.split(r"[ ,\t]+", line)[:2] for line in lines if not line.startswith("#"))
        assert {name: float(value) for name, value in told.items()} == pytest.approx(listed)


@pytest.mark.slow
@pytest.mark.parametrize("loss", [0.1, 0.3])
def test_over_a_bad_radio_a_file_comes_whole_or_not_at_all(
    connect: Connect, tmp_path: Path, loss: float
) -> None:
    whole = 0
    for seed in range(8):
        client = connect(loss, seed)
        copy = tmp_path / f"copy{seed}"
        if get(client, "/logs/1500.bin", copy) == SUCCESS:
            whole += 1
            assert copy.read_bytes() == CONTENT[:1_500]
        assert client.master.stage.link.counters.lost == 0
    assert whole >= 6
