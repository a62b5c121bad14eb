"""Whoever sees the live view, and whatever happens to its process: viewers see all, and nobody waits."""

from __future__ import annotations

import contextlib
import logging
import os
import resource
import signal
import socket
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("foxglove")
pytest.importorskip("google.protobuf")
pytest.importorskip("websockets")

from companion.config import Config
from companion.config.web import LiveSection
from companion.observers.live import live as live_module
from companion.observers.live.live import Live, LiveChild
from companion.observers.recording.topics import TOPICS
from companion.system.side_process import missing_packages
from tests.companion.observers.live.viewer import Seen, Viewer
from tests.companion.observers.recording.made import LIMITS, frame, status, words
from tests.companion.observers.supervisor import Supervisor

PATIENT = LIMITS._replace(silent_for=10.0)
SLOWEST_TURN = 0.25
"""Seconds. A turn starts a process at most, on a loaded computer."""
SAYS = "import socket, sys, time; s = socket.socket(fileno=int(sys.argv[3])); {}; time.sleep(30)"


class Stage(Supervisor):
    """Runs a `Live` and its process, and viewers beside it."""

    def __init__(self, listen: str = "127.0.0.1:0", **more: Any) -> None:
        self.live = Live(replace(Config(), live=LiveSection(listen)), **{"restarts": PATIENT, **more})
        self.service, self._viewers = self.live, list[Viewer]()

    def viewer(self, topics: set[str] | None = None) -> Viewer:
        found = Viewer(self.live.figures()["url"], topics)
        self._viewers.append(found)
        self.until(lambda: self.live.figures()["clients"] == len(self._viewers))
        return found

    def close(self) -> None:
        for viewer in self._viewers:
            viewer.close()
        super().close()


@pytest.fixture
def stage() -> Iterator[Stage]:
    one = Stage().ready()
    yield one
    one.close()


def numbers(found: Sequence[Seen]) -> list[int]:
    """Of statuses."""
    return [one.content["number"] for one in found if one.topic == "/status"]


def memory(pid: int) -> float:
    """MB of the process."""
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    return next(int(line.split()[1]) / 1e3 for line in lines if line.startswith("Pss:"))


def test_a_viewer_finds_the_topics_of_a_recording_and_decodes_them_by_what_is_advertised(
    stage: Stage,
) -> None:
    viewer = stage.viewer()
    advertised = {
        topic: (one["schemaName"], one["encoding"], one["schemaEncoding"])
        for topic, one in viewer.channels.items()
    }
    assert advertised == {
        row.name: (row.schema, row.encoding, row.schema_encoding) for row in TOPICS.values()
    }
    assert viewer.server["capabilities"] == [], "a viewer sets nothing"
    stage.turn([frame(7, 1.0, 300_000), status(8, 2.0)])
    shown, told = viewer.read(5.0, 2)
    assert (shown.topic, shown.content.format, len(shown.content.data)) == ("/camera", "jpeg", 300_000)
    assert shown.at == shown.content.timestamp.seconds * 10**9 + shown.content.timestamp.nanos
    assert (told.topic, told.content) == ("/status", {"state": "ok", "number": 8})


def test_a_new_viewer_sees_what_holds_and_no_old_picture(stage: Stage) -> None:
    stage.turn([words(0.5), frame(1), words(0.7)])
    stage.until(lambda: not stage.live._waiting)
    time.sleep(0.1)
    (held,) = stage.viewer().read(0.3)
    assert (held.topic, held.content["words"]) == ("/words", {"grass": 0.7})


def test_only_what_a_viewer_wants_is_sent(stage: Stage) -> None:
    viewer = stage.viewer({"/status"})
    stage.turn([frame(1), status(1), frame(2), status(2)])
    assert numbers(viewer.read(5.0, 2)) == [1, 2]


@pytest.mark.parametrize("deed", [signal.SIGKILL, signal.SIGSTOP])
def test_a_process_that_dies_or_hangs_is_started_again_on_its_port_and_nobody_waits(
    deed: signal.Signals,
) -> None:
    stage = Stage(restarts=LIMITS).ready()
    stage.viewer()
    first, url = stage.pid(), stage.live.figures()["url"]
    os.kill(first, deed)
    stage._viewers.clear()
    for number in range(100):
        stage.turn([frame(number, 0.0, 200_000)])
    stage.until(lambda: stage.pid() not in (0, first) and stage.live.figures()["url"])
    assert stage.live.figures()["url"] == url
    assert stage.slowest < SLOWEST_TURN
    viewer = stage.viewer({"/status"})
    stage.turn([status(5)])
    assert numbers(viewer.read(5.0, 1)) == [5]
    stage.close()


def test_a_viewer_that_reads_nothing_delays_nobody_and_takes_bounded_memory(stage: Stage) -> None:
    silent = socket.create_connection(("127.0.0.1", stage.live._listen.port))  # type: ignore[union-attr]
    silent.sendall(
        b"GET / HTTP/1.1\r\nHost: rover\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
        b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
        b"Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
    )
    assert b"101 Switching" in silent.recv(200)
    wants = b'{"op":"subscribe","subscriptions":[{"id":1,"channelId":1}]}'
    silent.sendall(bytes([0x81, 0x80 | len(wants), 0, 0, 0, 0]) + wants)
    stage.until(lambda: stage.live.figures()["clients"] == 1)
    viewer = Viewer(stage.live.figures()["url"])
    stage.until(lambda: stage.live.figures()["clients"] == 2)
    found, before = list[Seen](), memory(stage.pid())
    for number in range(200):
        stage.turn([frame(number, 0.0, 400_000), status(number)])
        found += viewer.read(5.0, 2)
    viewer.close()
    silent.close()
    assert numbers(found) == list(range(200))
    assert stage.slowest < SLOWEST_TURN
    figures = stage.live.figures()
    assert (figures["lost"], figures["restarts"]) == (0, 0)
    assert memory(stage.pid()) - before < 64, "80 MB were sent"


RUBBISH = (
    b"\x00" * 5000,
    b"GET / HTTP/1.1\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: rover\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
    b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n",
    b"A" * 100_000,
)
SAID = (
    "{",
    "[]",
    '"text"',
    '{"op":"subscribe"}',
    '{"op":"subscribe","subscriptions":[{"id":1,"channelId":99999}]}',
    '{"op":"unsubscribe","subscriptionIds":[-1]}',
    '{"op":"advertise","channels":[{"id":1,"topic":"/a","encoding":"json","schemaName":""}]}',
    '{"op":"setParameters","parameters":[{"name":"a","value":1}]}',
    "[" * 20_000,
    b"",
    b"\x01",
    b"\x01" + bytes(100),
    b"\x02" + bytes(3),
    bytes(1 << 20),
)


def test_what_viewers_say_is_of_no_effect(stage: Stage, capfd: pytest.CaptureFixture[str]) -> None:
    port = stage.live._listen.port  # type: ignore[union-attr]
    for rubbish in RUBBISH:
        with socket.create_connection(("127.0.0.1", port)) as other:
            other.sendall(rubbish)
            stage.turn([status(0)])
    for said in SAID:
        speaker = Viewer(stage.live.figures()["url"], set())
        speaker.send(said)
        stage.turn([status(0)])
        speaker.close()
    viewer = stage.viewer({"/status"})
    stage.turn([status(9)])
    assert numbers(viewer.read(5.0, 1)) == [9]
    assert (stage.live.figures()["restarts"], stage.live.figures()["trouble"]) == (0, "")
    assert capfd.readouterr().err == "", "nobody fills the log"


def test_twenty_viewers_see_the_same(stage: Stage) -> None:
    viewers = [Viewer(stage.live.figures()["url"]) for _ in range(20)]
    stage.until(lambda: stage.live.figures()["clients"] == 20)
    for number in range(10):
        stage.turn([frame(number, 0.0, 80_000), status(number)])
    for viewer in viewers:
        found = viewer.read(5.0, 20)
        assert numbers(found) == list(range(10))
        assert len(found) == 20
    assert stage.slowest < SLOWEST_TURN
    for viewer in viewers:
        viewer.close()
    stage.until(lambda: stage.live.figures()["clients"] == 0)


def test_a_server_that_listens_no_more_is_started_again(stage: Stage) -> None:
    first = stage.pid()
    resource.prlimit(first, resource.RLIMIT_NOFILE, (16, 16))
    assert stage.live._listen is not None
    address, many = ("127.0.0.1", stage.live._listen.port), list[socket.socket]()
    with contextlib.suppress(ConnectionError):  # it may be over before the last one
        for _ in range(20):
            many.append(socket.create_connection(address))
    stage.until(lambda: stage.pid() not in (0, first) and stage.live.figures()["url"])
    for one in many:
        one.close()
    viewer = stage.viewer({"/status"})
    stage.turn([status(9)])
    assert numbers(viewer.read(5.0, 1)) == [9]


def test_a_port_that_another_program_has_is_told_and_taken_once_it_is_free() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        stage = Stage(f"127.0.0.1:{port}")
        stage.until(lambda: stage.live.figures()["trouble"] != "starting")
        said = f"cannot be started on ws://127.0.0.1:{port}/ (address already in use)"
        assert stage.live.figures()["trouble"] == said
        assert stage.live.figures()["url"] == ""
    stage.ready()
    assert stage.live.figures()["trouble"] == ""
    stage.close()


@pytest.mark.parametrize(
    "said", ["s.send(b'x')", "s.send(bytes(4))", "s.send(b'\\1\\0\\0\\0')", "s.send(bytes(9))"]
)
def test_a_process_that_says_nonsense_is_killed(said: str, caplog: pytest.LogCaptureFixture) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    command = (sys.executable, "-c", SAYS.format(said))
    stage = Stage(f"127.0.0.1:{port}", launch=lambda listen: LiveChild(listen, command))
    stage.until(lambda: stage.live.figures()["restarts"] >= 1)
    stage.close()
    assert "the live view sent nonsense; it is started again in 0 s" in caplog.text


def test_without_the_package_it_is_said_once_how_to_install_it(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(live_module, "missing", lambda: missing_packages({"nowhere": "foxglove-sdk"}, "live"))
    stage = Stage()
    for _ in range(5):
        stage.turn([status(1)])
    assert (stage.pid(), stage.live.listener) == (0, 0)
    (record,) = caplog.records
    assert 'pip install "anytraverse-companion[live]"' in record.getMessage()
    assert stage.live.figures()["trouble"].startswith("foxglove-sdk not installed")


def test_it_is_off_until_somebody_configures_it(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    stage = Stage(Config().live.listen)
    stage.turn([status(1)])
    assert (stage.pid(), stage.live.listener, caplog.records) == (0, 0, [])
    expected = {"url": "", "clients": 0, "trouble": "switched off by [live] listen", "restarts": 0, "lost": 0}
    assert stage.live.figures() == expected
