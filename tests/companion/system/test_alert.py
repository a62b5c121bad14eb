"""Alerts to a URL of the owner's, against servers that take, refuse, redirect, hang and drip."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

import pytest

from companion.system.alert import MOST, WAITING, Alert, AlertSender, read_alert_url
from tests.waiting import wait_for

ALERT = Alert(
    "A rover calls: C7", "C7 unknown 91% in yellow frame, over 25% calls\nat 47.00010 8.00000", "http://r/"
)
SHOWN = "http://127.0.0.1"


class Server:
    """Takes one connection after the other, and does with each what the test says."""

    def __init__(self, *answers: Callable[[socket.socket], None]) -> None:
        self._answers = list(answers)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._open: list[socket.socket] = []
        self.url = f"http://127.0.0.1:{self._listener.getsockname()[1]}/topic?auth=SECRET"
        self.requests: list[bytes] = []
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        with suppress(OSError):
            while True:
                taken = self._listener.accept()[0]
                self._open.append(taken)
                head = b""
                while b"\r\n\r\n" not in head:
                    head += taken.recv(4096)
                length = int(head.lower().partition(b"content-length: ")[2].split(b"\r\n")[0])
                while len(head.partition(b"\r\n\r\n")[2]) < length:
                    head += taken.recv(4096)
                self.requests.append(head)
                (self._answers.pop(0) if len(self._answers) > 1 else self._answers[0])(taken)

    def close(self) -> None:
        self._listener.close()
        for one in self._open:
            one.close()


def says(line: bytes) -> Callable[[socket.socket], None]:
    def answer(taken: socket.socket) -> None:
        taken.sendall(line + b"\r\nContent-Length: 0\r\n\r\n")
        taken.close()

    return answer


def hangs(_taken: socket.socket) -> None:
    """Say nothing, and stay connected."""


def drips(taken: socket.socket) -> None:
    """Say a byte now and then, for ever."""

    def drip() -> None:
        with suppress(OSError):
            while True:
                taken.sendall(b"H")
                time.sleep(0.02)

    threading.Thread(target=drip, daemon=True).start()


OK, BUSY, GONE, MOVED = (
    says(b"HTTP/1.1 " + one) for one in (b"200 OK", b"503 Busy", b"404 No", b"302 Found\r\nLocation: /else")
)


@pytest.fixture
def made() -> Iterator[Callable[..., tuple[Server, AlertSender]]]:
    every: list[Any] = []

    def make(*answers: Callable[[socket.socket], None], again: tuple[float, ...] = (0.0, 0.0)) -> Any:
        server = Server(*answers)
        sender = AlertSender(server.url, SHOWN, again=again, patience=0.3)
        every.extend((sender, server))
        return server, sender

    yield make
    for one in every:
        one.close()


Make = Callable[..., tuple[Server, AlertSender]]


def counted(sender: AlertSender, name: str, number: int) -> None:
    wait_for(lambda: sender.figures()[name] == number, 10.0)


def test_an_alert_is_posted_once_as_plain_text_with_a_title_and_a_link(made: Make) -> None:
    server, sender = made(OK)
    sender.send(ALERT)
    counted(sender, "sent", 1)
    (request,) = server.requests
    head, _, body = request.partition(b"\r\n\r\n")
    assert head.startswith(b"POST /topic?auth=SECRET HTTP/1.1\r\n")
    assert b"\r\nTitle: A rover calls: C7\r\n" in head + b"\r\n"
    assert b"\r\nClick: http://r/\r\n" in head + b"\r\n"
    assert body.decode() == ALERT.text
    assert sender.figures() == {
        "to": SHOWN, "sent": 1, "failed": 0, "dropped": 0, "waiting": 0, "trouble": "",
    }  # fmt: skip


def test_one_that_failed_is_tried_again_and_no_more_often_than_is_allowed(made: Make) -> None:
    server, sender = made(BUSY, OK)
    sender.send(ALERT)
    counted(sender, "sent", 1)
    assert len(server.requests) == 2
    server, sender = made(BUSY)
    sender.send(ALERT)
    counted(sender, "failed", 1)
    assert len(server.requests) == 3
    assert sender.figures()["trouble"] == "answered 503"


@pytest.mark.parametrize(("answer", "told"), [(MOVED, "answered 302"), (GONE, "answered 404")])
def test_a_redirect_is_not_followed_and_a_refusal_is_not_repeated(made: Make, answer: Any, told: str) -> None:
    server, sender = made(answer)
    sender.send(ALERT)
    counted(sender, "failed", 1)
    assert len(server.requests) == 1
    assert sender.figures()["trouble"] == told


@pytest.mark.parametrize("answer", [hangs, drips, says(b"SSH-2.0")])
def test_a_server_that_hangs_drips_or_speaks_otherwise_ends_in_time_and_delays_nobody(
    made: Make, answer: Any
) -> None:
    _, sender = made(answer, again=())
    begun = time.monotonic()
    sender.send(ALERT)
    assert time.monotonic() - begun < 0.2, "who sends does not wait"
    counted(sender, "failed", 1)
    assert sender.figures()["trouble"].startswith("no answer (")


def test_what_waits_and_what_is_taken_in_five_minutes_is_bounded(made: Make) -> None:
    _, sender = made(hangs)
    for _ in range(3 * WAITING):
        sender.send(ALERT)
    told = sender.figures()
    assert told["dropped"] == 3 * WAITING - MOST
    assert told["waiting"] <= WAITING


def test_nothing_of_the_path_is_told_or_logged(made: Make, caplog: pytest.LogCaptureFixture) -> None:
    _, sender = made(GONE)
    sender.send(ALERT)
    counted(sender, "failed", 1)
    wait_for(lambda: bool(caplog.text), 5.0)
    assert "was not taken: answered 404" in caplog.text
    assert "SECRET" not in caplog.text + str(sender.figures())
    assert "topic" not in caplog.text + str(sender.figures())


def test_where_nobody_listens_it_fails_and_says_so() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    sender = AlertSender(f"http://127.0.0.1:{port}/", SHOWN, again=(), patience=0.3)
    sender.send(ALERT)
    counted(sender, "failed", 1)
    sender.close()


def test_without_a_url_nothing_is_sent_and_no_thread_runs() -> None:
    before = threading.active_count()
    sender = AlertSender("", "")
    sender.send(ALERT)
    assert sender.figures()["to"] == ""
    assert threading.active_count() == before


def test_a_title_with_a_line_break_is_one_header(made: Make) -> None:
    server, sender = made(OK)
    sender.send(Alert("C7\r\nX-Evil: 1 é", "text"))
    counted(sender, "sent", 1)
    assert b"X-Evil: 1 ?\r\n" in server.requests[0]
    assert b"\r\nX-Evil" not in server.requests[0]


@pytest.mark.parametrize(
    "url",
    ["ftp://a/b", "http://?auth=S", "http:///x", "http://a b/", "https://u:p@h/",
     "http://a:99999/", "h" * 600, "ntfy.sh/x", "http://a/\r\nX: 1", "http://[::1/"],
)  # fmt: skip
def test_what_is_no_address_is_refused_without_repeating_it(url: str) -> None:
    with pytest.raises(ValueError, match=r"https://|auth=") as refused:
        read_alert_url(url)
    assert url not in str(refused.value)


@pytest.mark.parametrize(
    ("url", "to"),
    [
        ("http://[2001:db8::5]/t", ("2001:db8::5", 80)),
        ("https://[2001:db8::5]/t", ("2001:db8::5", 443)),
        ("http://[::1]:8080/t", ("::1", 8080)),
    ],
)
def test_an_ipv6_address_is_connected_to_as_it_was_written(
    monkeypatch: pytest.MonkeyPatch, url: str, to: tuple[str, int]
) -> None:
    asked: list[tuple[str, int]] = []

    def refuse(address: tuple[str, int], *_: Any, **__: Any) -> socket.socket:
        asked.append(address)
        raise ConnectionRefusedError

    monkeypatch.setattr(socket, "create_connection", refuse)
    sender = AlertSender(url, "http://host", again=())
    sender.send(ALERT)
    wait_for(lambda: sender.figures()["failed"] == 1)
    sender.close()
    assert asked == [to]
