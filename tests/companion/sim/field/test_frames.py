"""Frames over a real loopback socket."""

from __future__ import annotations

import contextlib
import math
import socket
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.cameras.field import (
    HEADER,
    MAGIC,
    CapturedFrame,
    FrameError,
    FrameStream,
    FrameTimeout,
    decode_header,
)
from companion.sim.field.frame_server import FrameServer, encode


@pytest.fixture
def server() -> Iterator[FrameServer]:
    server = FrameServer()
    yield server
    server.close()


def frame(number: int, height: int = 24, width: int = 32) -> CapturedFrame:
    picture = np.random.default_rng(number).integers(0, 256, (height, width, 3), dtype=np.uint8)
    return CapturedFrame(number, time.monotonic(), picture)


@pytest.mark.parametrize(("height", "width"), [(24, 32), (240, 320), (1, 1), (7, 641)])
def test_a_frame_arrives_as_it_was_sent(server: FrameServer, height: int, width: int) -> None:
    sent = frame(5, height, width)
    server.publish(sent)
    with FrameStream(*server.address) as stream:
        got = stream.read()
    assert (got.id, got.captured_at) == (sent.id, sent.captured_at)
    assert got.rgb.dtype == np.uint8
    assert np.array_equal(got.rgb, sent.rgb)


def test_a_slow_client_gets_the_newest_frame_and_no_queue(server: FrameServer) -> None:
    with FrameStream(*server.address) as stream:
        server.publish(frame(1))
        assert stream.read().id == 1
        for number in range(2, 60):
            server.publish(frame(number))
        assert stream.read().id == 59
        server.publish(frame(60))
        assert stream.read().id == 60


def test_no_frame_is_given_twice(server: FrameServer) -> None:
    server.publish(frame(1))
    with FrameStream(*server.address) as stream:
        stream.read()
        with pytest.raises(FrameTimeout, match="camera may be frozen"):
            stream.read(timeout=0.05)
        server.publish(frame(2))
        assert stream.read().id == 2


def test_a_client_that_never_reads_does_not_hold_up_the_others(server: FrameServer) -> None:
    with FrameStream(*server.address) as stuck, FrameStream(*server.address) as other:
        stuck._ask()
        for number in range(1, 30):
            server.publish(frame(number, 480, 640))
            assert other.read().id == number


def test_clients_are_bounded_and_a_place_is_free_again_after_one_left(server: FrameServer) -> None:
    server.publish(frame(1))
    streams = [FrameStream(*server.address) for _ in range(4)]
    assert [stream.read().id for stream in streams] == [1] * 4
    with FrameStream(*server.address) as refused, pytest.raises(FrameError):
        refused.read()
    for stream in streams:
        stream.close()
    assert read_when_there_is_a_place(server.address).id == 1


def read_when_there_is_a_place(address: tuple[str, int]) -> CapturedFrame:
    deadline = time.monotonic() + 5.0
    while time.monotonic() < deadline:
        with contextlib.suppress(FrameError), FrameStream(*address) as stream:
            return stream.read(timeout=0.5)
    pytest.fail("no place became free")


def test_a_client_that_left_while_the_camera_was_frozen_frees_its_place() -> None:
    server = FrameServer(max_clients=1)
    waiting = FrameStream(*server.address)
    with pytest.raises(FrameTimeout):
        waiting.read(timeout=0.05)
    waiting.close()
    time.sleep(0.3)  # the camera stays frozen for longer than the server looks away
    server.publish(frame(1))
    assert read_when_there_is_a_place(server.address).id == 1
    server.close()


@pytest.mark.parametrize("rubbish", [b"GET / HTTP/1.1\r\n\r\n", b"\x00" * 5000, b"\x01" * 5000])
def test_rubbish_from_a_client_harms_nobody_else(server: FrameServer, rubbish: bytes) -> None:
    server.publish(frame(1))
    with socket.create_connection(server.address) as rude, FrameStream(*server.address) as stream:
        rude.sendall(rubbish)
        assert stream.read().id == 1


def answering(reply: bytes) -> tuple[str, int]:
    """A server that says `reply` to the first client and hangs up."""
    listener = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        client, _ = listener.accept()
        with listener, client:
            client.recv(1)
            client.sendall(reply)

    threading.Thread(target=serve, daemon=True).start()
    address: tuple[str, int] = listener.getsockname()
    return address


@pytest.mark.parametrize(
    ("reply", "complaint"),
    [
        (b"HTTP/1.1 400 Bad Request\r\n\r\n", "is this the frame server's address"),
        (HEADER.pack(MAGIC, 1, 1.0, 60_000, 60_000), "refused"),
        (HEADER.pack(MAGIC, 1, 1.0, 0, 10), "refused"),
        (HEADER.pack(MAGIC, 1, math.nan, 4, 4), "capture time"),
        (HEADER.pack(MAGIC, 1, 1.0, 4, 4) + b"half", "closed"),
        (b"", "closed"),
    ],
)
def test_what_is_no_frame_is_refused_with_the_reason(reply: bytes, complaint: str) -> None:
    with FrameStream(*answering(reply)) as stream, pytest.raises(FrameError, match=complaint):
        stream.read()


def test_nobody_there_is_said_with_the_address() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    with pytest.raises(FrameError, match=f"no frame server at 127.0.0.1:{port}"):
        FrameStream("127.0.0.1", port, timeout=1.0)


def test_a_closed_server_is_noticed(server: FrameServer) -> None:
    with FrameStream(*server.address) as stream:
        server.publish(frame(1))
        stream.read()
        server.close()
        with pytest.raises(FrameError):
            stream.read(timeout=3.0)


def test_what_is_no_picture_is_not_sent() -> None:
    with pytest.raises(ValueError, match="uint8"):
        encode(CapturedFrame(1, 0.0, np.zeros((4, 4), np.uint8)))


@settings(max_examples=100, deadline=None)
@given(st.binary(min_size=HEADER.size, max_size=HEADER.size))
def test_any_header_is_either_a_frame_within_bounds_or_an_error(header: bytes) -> None:
    try:
        _, captured_at, width, height = decode_header(MAGIC + header[4:], max_pixels=100)
    except FrameError:
        return
    assert math.isfinite(captured_at)
    assert 0 < width * height <= 100
