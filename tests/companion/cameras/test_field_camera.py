"""The simulated field as a camera."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from companion.cameras import CameraError, NoFrameYet, SourceError, open_camera
from companion.cameras.field import CapturedFrame
from companion.cameras.newest import CameraThread, Patience
from companion.sim.field.frame_server import FrameServer
from tests.waiting import wait_for

_QUICK = Patience(wait=0.1, silence=5.0, first=0.005, longest=0.02)


@pytest.fixture
def server() -> Iterator[FrameServer]:
    server = FrameServer()
    yield server
    server.close()


def _frame(number: int, captured_at: float | None = None) -> CapturedFrame:
    now = time.monotonic() if captured_at is None else captured_at
    return CapturedFrame(number, now, np.full((6, 8, 3), number, np.uint8))


def _source(server: FrameServer) -> str:
    return f"field:127.0.0.1:{server.address[1]}"


def test_a_field_frame_keeps_its_capture_time(server: FrameServer) -> None:
    server.publish(_frame(7))
    camera = open_camera(_source(server))
    capture = camera.read(2.0)
    assert (capture.image == 7).all()
    assert 0 <= time.monotonic() - capture.captured_at < 2
    camera.close()


def test_a_field_without_a_new_frame_says_not_yet(server: FrameServer) -> None:
    camera = open_camera(_source(server))
    with pytest.raises(NoFrameYet):
        camera.read(0.02)
    server.publish(_frame(1))
    assert camera.read(2.0).image.shape == (6, 8, 3)
    camera.close()


def test_a_field_frame_from_the_future_is_refused(server: FrameServer) -> None:
    server.publish(_frame(1, time.monotonic() + 100))
    thread = CameraThread(lambda: open_camera(_source(server)), patience=_QUICK)
    wait_for(lambda: thread.status.refused)
    server.publish(_frame(2))
    frame = thread.take(5.0)
    assert frame is not None
    assert (frame.image == 2).all()
    assert thread.status.refused == 1
    assert thread.close(5.0)


def test_a_field_frame_without_a_capture_time_is_refused() -> None:
    listener = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        client, _ = listener.accept()
        client.recv(1)
        client.sendall(b"ATF1" + (1).to_bytes(4, "little") + np.float64("nan").tobytes() + b"\x08\0\x06\0")
        client.close()

    threading.Thread(target=serve, daemon=True).start()
    camera = open_camera(f"field:127.0.0.1:{listener.getsockname()[1]}")
    with pytest.raises(CameraError):
        camera.read(2.0)
    camera.close()
    listener.close()


def test_the_reader_finds_a_field_that_starts_later_on_the_same_port() -> None:
    with socket.create_server(("127.0.0.1", 0)) as reserved:
        port = reserved.getsockname()[1]
    thread = CameraThread(lambda: open_camera(f"field:127.0.0.1:{port}"), patience=_QUICK)
    assert thread.take(0.05) is None
    with socket.create_server(("127.0.0.1", port)) as late:
        late.settimeout(5.0)
        client, _ = late.accept()
        client.recv(1)
        client.sendall(_packed((1, 2)))
        frame = thread.take(5.0)
        client.close()
    assert frame is not None
    assert frame.image.shape == (1, 2, 3)
    assert thread.close(5.0)


def _packed(shape: tuple[int, int]) -> bytes:
    height, width = shape
    size = width.to_bytes(2, "little") + height.to_bytes(2, "little")
    return b"ATF1" + bytes(4) + np.float64(time.monotonic()).tobytes() + size + bytes(3 * width * height)


def test_a_frame_torn_by_a_lost_connection_is_never_delivered() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(5.0)
        source = f"field:127.0.0.1:{listener.getsockname()[1]}"
        thread = CameraThread(lambda: open_camera(source), patience=_QUICK)
        torn, _ = listener.accept()
        torn.recv(1)
        torn.sendall(_packed((6, 8))[:-1])
        torn.close()
        whole, _ = listener.accept()
        whole.recv(1)
        assert thread.status.read == 0
        whole.sendall(_packed((5, 7)))
        frame = thread.take(5.0)
        whole.close()
    assert frame is not None
    assert (frame.id, frame.image.shape) == (1, (5, 7, 3))
    assert thread.close(5.0)


@pytest.mark.parametrize(
    "place", ["5600", "127.0.0.1", "127.0.0.1:", "127.0.0.1:99999", "10.0.0.5:5600", "rover:1"]
)
def test_only_a_loopback_address_is_a_field(place: str) -> None:
    with pytest.raises(SourceError, match="write field:127"):
        open_camera(f"field:{place}")
