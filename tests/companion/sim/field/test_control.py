"""The onlooker's channel: lines in, lines out, and clients that misbehave."""

from __future__ import annotations

import contextlib
import json
import selectors
import socket
import threading
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.sim.field.control import (
    MAX_ANSWER,
    MAX_CLIENTS,
    ControlServer,
    FieldControl,
    FieldError,
    answer,
)

BIG = "x" * 200_000


def handle(request: dict[str, Any]) -> dict[str, Any]:
    if request["do"] == "fail":
        raise FieldError("send something better")
    return {"ok": True, "echo": BIG if request["do"] == "big" else request["do"]}


@pytest.fixture
def address() -> Iterator[tuple[str, int]]:
    selector = selectors.DefaultSelector()
    server = ControlServer(selector, handle)
    stopping = threading.Event()

    def serve() -> None:
        while not stopping.is_set():
            for key, events in selector.select(0.02):
                key.data(events)

    loop = threading.Thread(target=serve)
    loop.start()
    yield server.address
    stopping.set()
    loop.join()
    server.close()


def test_a_request_is_answered(address: tuple[str, int]) -> None:
    with FieldControl(*address) as control:
        assert control.ask("hello")["echo"] == "hello"


def test_a_refusal_says_what_to_do_and_the_channel_stays_open(address: tuple[str, int]) -> None:
    with FieldControl(*address) as control:
        with pytest.raises(FieldError, match="send something better"):
            control.ask("fail")
        assert control.ask("hello")["ok"]


def test_a_long_answer_comes_whole(address: tuple[str, int]) -> None:
    with FieldControl(*address) as control:
        assert control.ask("big")["echo"] == BIG


def test_several_requests_in_one_packet_and_one_in_several_are_answered_in_order(
    address: tuple[str, int],
) -> None:
    with socket.create_connection(address, timeout=5.0) as raw, raw.makefile("rb") as answers:
        raw.sendall(b'{"do": "a"}\n{"do": "b"}\n{"do"')
        assert [json.loads(answers.readline())["echo"] for _ in range(2)] == ["a", "b"]
        raw.sendall(b': "c"}\n')
        assert json.loads(answers.readline())["echo"] == "c"


@pytest.mark.parametrize(
    "line", [b"rubbish", b"\xff\xfe", b"[]", b"7", b"{}", b'{"do": 3}', b"[" * 3000, b""]
)
def test_rubbish_is_answered_with_what_to_send_instead(address: tuple[str, int], line: bytes) -> None:
    with socket.create_connection(address, timeout=5.0) as raw, raw.makefile("rb") as answers:
        raw.sendall(line + b"\n")
        assert '{"do": "status"}' in json.loads(answers.readline())["error"]
        raw.sendall(b'{"do": "a"}\n')
        assert json.loads(answers.readline())["ok"]


def hangs_up(raw: socket.socket) -> bool:
    raw.settimeout(5.0)
    with contextlib.suppress(ConnectionError):
        while raw.recv(65_536):
            pass
    return True


def test_a_line_without_an_end_costs_the_client_its_connection(address: tuple[str, int]) -> None:
    with socket.create_connection(address) as raw, FieldControl(*address) as other:
        raw.sendall(b"x" * 20_000)
        assert hangs_up(raw)
        assert other.ask("hello")["ok"]


def test_a_client_that_does_not_read_is_dropped(address: tuple[str, int]) -> None:
    with socket.create_connection(address) as raw, FieldControl(*address) as other:
        raw.settimeout(5.0)
        with contextlib.suppress(ConnectionError):
            for _ in range(200 * MAX_ANSWER // len(BIG)):
                raw.sendall(b'{"do": "big"}\n')
                other.ask("hello")
            pytest.fail("it may leave everything unread")
        assert other.ask("hello")["ok"]


def test_clients_are_bounded(address: tuple[str, int]) -> None:
    controls = [FieldControl(*address) for _ in range(MAX_CLIENTS)]
    assert all(control.ask("a")["ok"] for control in controls)
    with FieldControl(*address) as refused, pytest.raises(FieldError, match="connect again"):
        refused.ask("a")
    for control in controls:
        control.close()


def test_nobody_there_is_said_with_the_address() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    with pytest.raises(FieldError, match=f"no field at 127.0.0.1:{port}"):
        FieldControl("127.0.0.1", port, timeout=1.0)


@settings(max_examples=100, deadline=None)
@given(st.binary(max_size=200))
def test_any_line_gets_one_line_of_json(line: bytes) -> None:
    reply = answer(line.replace(b"\n", b""), handle)
    assert reply.endswith(b"\n")
    assert {"ok", "error"} & set(json.loads(reply))
