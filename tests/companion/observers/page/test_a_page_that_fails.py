"""Whatever happens to the web process: the supervisor does not wait for it, and the page returns."""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import socket
import sys
import time
from contextlib import closing
from pathlib import Path

import pytest

from companion.observers.page import page as page_module
from companion.observers.page.messages import PageMessageKind
from companion.observers.page.news import FRESH
from companion.observers.page.page import WebChild, missing
from companion.system.datagrams import LARGEST, Datagram
from companion.system.side_process import missing_packages
from companion.system.watchdog import Restarts
from companion.tasks import PAGE
from tests.companion.observers.page.played import LIMITS, Stage

pytestmark = pytest.mark.skipif(bool(missing()), reason="the extra web is not installed")
SLOWEST_TURN = 0.25
"""Seconds. A turn starts a process at most, on a loaded computer."""
SAYS = "import socket, sys, time; s = socket.socket(fileno=int(sys.argv[1])); {}; time.sleep(30)"


@pytest.mark.parametrize("deed", [signal.SIGKILL, signal.SIGSTOP, signal.SIGSEGV])
def test_a_process_that_dies_or_hangs_is_started_again_on_the_same_port(
    tmp_path: Path, deed: signal.Signals
) -> None:
    with closing(Stage(tmp_path)) as stage:
        first, url = stage.ready().pid(), stage.page.url
        os.kill(first, deed)
        stage.slowest = 0.0
        stage.until(lambda: stage.pid() not in (0, first) and stage.up())
        assert stage.slowest < SLOWEST_TURN
        assert stage.ready().page.url == url
        assert stage.page.figures() == {"url": url, "trouble": "", "restarts": 1}
        with pytest.raises(ProcessLookupError):
            os.kill(first, 0)


def test_a_stopped_process_takes_nothing_and_nobody_waits_for_it(tmp_path: Path) -> None:
    with closing(Stage(tmp_path, restarts=Restarts(60.0, 60.0, 1.0, 1.0))) as stage:
        os.kill(stage.ready().pid(), signal.SIGSTOP)
        stage.news["told"] = "x" * 100_000
        began = time.monotonic()
        for _ in range(200):
            stage.page._told_at = float("-inf")
            stage.page.tell(time.monotonic(), lambda: stage.news)
            stage.page.show(1, began, b"y" * 100_000)
        assert time.monotonic() - began < 1.0
        os.kill(stage.pid(), signal.SIGCONT)
        stage.ready()


def test_what_waited_for_a_stopped_process_is_old_when_it_goes_on(tmp_path: Path) -> None:
    with closing(Stage(tmp_path, restarts=Restarts(60.0, 60.0, 1.0, 1.0))) as stage:
        os.kill(stage.ready().pid(), signal.SIGSTOP)
        stage.page._told_at = float("-inf")
        stage.turn()
        time.sleep(FRESH + 0.1)
        os.kill(stage.pid(), signal.SIGCONT)
        assert stage.get("/healthz").status == 503
        stage.ready()


@pytest.mark.parametrize(
    "said", ["s.send(b'x')", "s.send(b'aa')", "s.send(b'w' * 70000)", "s.send(bytes(1))"]
)
def test_a_process_that_says_nonsense_is_killed(
    tmp_path: Path, said: str, caplog: pytest.LogCaptureFixture
) -> None:
    command = (sys.executable, "-c", SAYS.format(said))
    with closing(Stage(tmp_path, launch=lambda listener: WebChild(listener, command))) as stage:
        stage.until(lambda: stage.page.figures()["restarts"] >= 1)
        assert "the page sent nonsense; it is started again in 0 s" in caplog.text


def test_a_process_that_says_too_much_is_taken_a_little_at_a_time(tmp_path: Path) -> None:
    talks = "[s.send(b'w') for _ in range(10**6)]"
    stage = Stage(
        tmp_path, launch=lambda listener: WebChild(listener, (sys.executable, "-c", SAYS.format(talks)))
    )
    try:
        stage.until(stage.up)
        wanted, until = 0, time.monotonic() + 1.7
        while time.monotonic() < until:
            began = time.monotonic()
            stage.page.tell(began, lambda: stage.news)
            assert time.monotonic() - began < SLOWEST_TURN
            wanted += stage.page.wanted()
        assert 1 <= wanted <= 3
    finally:
        stage.close()


def test_a_process_that_was_killed_and_has_not_ended_yet_does_not_keep_the_port(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    held: list[int] = []

    def launch(listener: socket.socket) -> WebChild:
        held.append(os.dup(listener.fileno()))  # as a process keeps it that waits for the disk
        return WebChild(listener)

    stage = Stage(tmp_path, launch=launch)
    try:
        first, url = stage.ready().pid(), stage.page.url
        os.kill(first, signal.SIGKILL)
        stage.until(lambda: stage.pid() not in (0, first))
        assert stage.ready().page.figures() == {"url": url, "trouble": "", "restarts": 1}
        assert "in use" not in caplog.text
    finally:
        stage.close()
        for descriptor in held:
            os.close(descriptor)


def test_a_busy_port_is_said_once_and_tried_again_until_it_is_free(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    with socket.create_server(("127.0.0.1", 0)) as other:
        stage = Stage(tmp_path, listen=f"127.0.0.1:{other.getsockname()[1]}")
        stage.until(lambda: stage.page.figures()["restarts"] >= 4)
        assert stage.page.trouble.endswith("(address already in use)")
        assert stage.page.url == ""
    try:
        stage.ready()
        said = [record for record in caplog.records if "address already in use" in record.getMessage()]
        assert len(said) == 1
    finally:
        stage.close()


def test_a_port_that_is_busy_for_two_days_is_tried_once_a_minute(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        stage = Stage(tmp_path, listen=f"127.0.0.1:{other.getsockname()[1]}", restarts=PAGE)
        now = time.monotonic()
        for _ in range(2 * 24 * 60):
            now += 60.0
            stage.page.tell(now, lambda: stage.news)
            stage.page.tell(now + 0.02, lambda: stage.news)
    assert stage.page.figures()["restarts"] == pytest.approx(2 * 24 * 60, abs=10)
    assert "the page failed" not in caplog.text


def test_without_the_extra_it_is_said_once_how_to_install_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(page_module, "missing", lambda: missing_packages({"nowhere": "uvicorn"}, "web"))
    stage = Stage(tmp_path)
    for _ in range(5):
        stage.turn()
    assert stage.pid() == 0
    (record,) = caplog.records
    assert 'pip install "anytraverse-companion[web]"' in record.getMessage()
    assert stage.page.figures()["trouble"].startswith("uvicorn not installed")


def test_an_empty_address_means_no_process(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    stage = Stage(tmp_path, listen="")
    for _ in range(5):
        stage.turn()
    assert stage.pid() == 0
    assert caplog.records == []
    assert stage.page.figures() == {"url": "", "trouble": "switched off by [web] listen", "restarts": 0}


def test_news_that_cannot_be_made_are_logged_and_survived(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with closing(Stage(tmp_path)) as stage:
        stage.ready()
        stage.news["status"]["frames"] = float("nan")
        stage.until(lambda: stage.get("/healthz").status == 503)
        assert "the page failed" in caplog.text
        stage.news["status"]["frames"] = 8
        stage.ready()
        assert stage.page.figures()["restarts"] == 0


def test_too_many_connections_and_streams_are_refused_and_forgotten(tmp_path: Path) -> None:
    from companion.pages.access import MOST_CONNECTIONS, MOST_STRANGERS
    from companion.pages.site import MOST_STREAMS

    with closing(Stage(tmp_path, restarts=LIMITS._replace(silent_for=20.0))) as stage:
        stage.ready()
        with contextlib.ExitStack() as held:
            idle = [
                held.enter_context(socket.create_connection(stage.address, timeout=5.0)) for _ in range(200)
            ]
            stage.until(lambda: sum(_ended(one) for one in idle) == 200 - MOST_STRANGERS)
            assert stage.get("/healthz").status == 200, "nobody is locked out by them"
        with contextlib.ExitStack() as held:
            known = [_let_in(stage, held) for _ in range(MOST_CONNECTIONS)]
            assert not any(_ended(one) for one in known)
            refused = held.enter_context(socket.create_connection(stage.address, timeout=5.0))
            stage.until(lambda: _ended(refused))
            assert not any(_ended(one) for one in known)
        stage.until(lambda: stage.get("/healthz").status == 200)
        with contextlib.ExitStack() as held:
            streams = [_let_in(stage, held) for _ in range(MOST_STREAMS + 2)]
            heads = []
            for one in streams:
                one.sendall(b"GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n")
                heads.append(one.recv(12))
                time.sleep(0.05)
            assert heads == [b"HTTP/1.1 200"] * MOST_STREAMS + [b"HTTP/1.1 503"] * 2
            assert stage.get("/healthz").status == 200
        stage.until(lambda: _first_bytes(stage, b"/events") == b"HTTP/1.1 200")
        with contextlib.ExitStack() as held:
            together = [_let_in(stage, held) for _ in range(40)]
            for one in together:
                one.sendall(b"GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n")
            time.sleep(0.5)
            assert sum(b"event: news" in one.recv(1 << 16) for one in together) <= MOST_STREAMS


def _let_in(stage: Stage, held: contextlib.ExitStack) -> socket.socket:
    """A connection with a request behind it that was answered."""
    stage.turn()  # without news /healthz is not well
    one = held.enter_context(socket.create_connection(stage.address, timeout=5.0))
    one.sendall(b"HEAD /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n")
    assert one.recv(1 << 16).startswith(b"HTTP/1.1 200")
    return one


def test_a_watcher_that_reads_nothing_is_ended_and_delays_nobody(tmp_path: Path) -> None:
    stage = Stage(tmp_path, launch=lambda listener: WebChild(listener, (sys.executable, "-c", HASTY)))
    stage.news["told"] = "x" * 150_000
    try:
        stage.ready()
        with socket.socket() as slow:
            slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            slow.settimeout(10.0)
            slow.connect(stage.address)
            slow.sendall(b"GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n")
            idle = socket.create_connection(stage.address, timeout=10.0)
            until = time.monotonic() + 1.8
            stage.until(lambda: time.monotonic() > until)
            assert stage.get("/healthz").status == 200
            frames = stage.frames
            assert _ended(idle), "it made no request"
            idle.close()
            until = time.monotonic() + 1.5
            stage.until(lambda: time.monotonic() > until)
            assert stage.frames == frames, "nobody counts as watching"
    finally:
        stage.close()


HASTY = """
import sys
from companion.pages import access
access._IDLE = access._STALLED = 0.6
from companion.observers.page.server import main
from companion.system.side_process import missing_packages
main(*map(int, sys.argv[1:3]))
"""


def _ended(connection: socket.socket) -> bool:
    connection.settimeout(0.0)
    try:
        return connection.recv(1) == b""
    except BlockingIOError:
        return False
    except OSError:
        return True


def _first_bytes(stage: Stage, path: bytes) -> bytes:
    with socket.create_connection(stage.address, timeout=5.0) as connection:
        connection.sendall(b"GET " + path + b" HTTP/1.1\r\nHost: localhost\r\n\r\n")
        return connection.recv(12)


def test_a_picture_that_is_too_large_is_said_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING)
    with closing(Stage(tmp_path)) as stage:
        stage.ready()
        for _ in range(3):
            stage.page.show(1, time.monotonic(), bytes(LARGEST))
        (record,) = caplog.records
        assert "the page shows no picture" in record.getMessage()
        assert stage.get("/healthz").status == 200


def test_the_longest_message_gets_through(tmp_path: Path) -> None:
    with closing(Stage(tmp_path)) as stage:
        stage.ready()
        stage.news["status"]["filler"] = ""
        stage.news["at"] = "in place of the time"
        stage.news["status"]["filler"] = "x" * (
            LARGEST - len(Datagram(PageMessageKind.NEWS, stage.news).encoded())
        )
        stage.until(lambda: stage.get("/status.json").body.count(b"x") > LARGEST // 2)
