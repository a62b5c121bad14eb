"""Network cameras, with real servers: MJPEG over HTTP everywhere, RTSP where its server is installed."""

from __future__ import annotations

import contextlib
import logging
import socket
import threading
import time
from collections.abc import Callable, Iterator
from functools import cache, partial

import numpy as np
import pytest

from bench.cameras.servers import CameraServer, rtsp_missing, serving
from bench.cameras.stamps import age
from companion.cameras import (
    BadFrame,
    CameraError,
    CameraOptions,
    Capture,
    NoFrameYet,
    SourceError,
    open_camera,
)
from companion.cameras.newest import CameraState, CameraThread, Patience
from tests.waiting import wait_for

_OPTIONS = CameraOptions(latency=0.0, freshness=1.0)
_LOGIN = {"USER_NAME": "rover", "PASSWORD": "top-secret"}
_SOON = 15.0
_FRESH = 0.5

_missing = cache(rtsp_missing)


@pytest.fixture(params=["http", "rtsp"])
def scheme(request: pytest.FixtureRequest) -> str:
    if request.param == "rtsp" and _missing():
        pytest.skip(_missing())
    return str(request.param)


def _script(scheme: str) -> str:
    return {"http": "mjpeg_server", "rtsp": "rtsp_server"}[scheme]


def _url(scheme: str, server: CameraServer, login: str = "") -> str:
    return f"{scheme}://{login}127.0.0.1:{server.port}/trail"


def _age(image: np.ndarray, at: float) -> float:
    height, width, _ = image.shape
    return age(np.ascontiguousarray(image[..., 0]).tobytes(), width, height, at)


def _next(read: Callable[[float], Capture]) -> Capture:
    deadline = time.monotonic() + _SOON
    while time.monotonic() < deadline:
        with contextlib.suppress(NoFrameYet, BadFrame):
            return read(0.5)
    raise AssertionError("no picture came in time")


@contextlib.contextmanager
def _thread(source: str) -> Iterator[CameraThread]:
    thread = CameraThread(
        partial(open_camera, source, _OPTIONS), patience=Patience(first=0.1, longest=0.5, late=1.0)
    )
    try:
        yield thread
    finally:
        assert thread.close(_SOON)


def test_pictures_come_new_with_what_their_time_is_from(scheme: str) -> None:
    with serving(_script(scheme)) as server:
        camera = open_camera(_url(scheme, server), _OPTIONS)
        try:
            for _ in range(10):
                capture = _next(camera.read)
                assert capture.image.shape == (480, 640, 3)
                assert -0.02 < _age(capture.image, capture.captured_at) < _FRESH
            assert capture.timed_by == ("stream" if scheme == "rtsp" else "arrival")
        finally:
            camera.close()


def test_what_waited_while_nobody_read_is_dropped(scheme: str) -> None:
    with serving(_script(scheme)) as server:
        camera = open_camera(_url(scheme, server), _OPTIONS)
        try:
            for _ in range(15):
                _next(camera.read)
            time.sleep(1.4)
            for _ in range(5):
                capture = _next(camera.read)
                assert _age(capture.image, capture.captured_at) < _FRESH
                assert _age(capture.image, time.monotonic()) < 1.0
        finally:
            camera.close()


def test_pictures_that_wait_since_this_computer_reads_slowly_do_not_count_as_new(scheme: str) -> None:
    with serving(_script(scheme), "640", "480", "30") as server:
        camera = open_camera(_url(scheme, server), _OPTIONS)
        try:
            until = time.monotonic() + 5.0
            while time.monotonic() < until:
                with contextlib.suppress(NoFrameYet, BadFrame):
                    capture = camera.read(0.5)
                    assert _age(capture.image, capture.captured_at) < _FRESH
                time.sleep(0.1)
        finally:
            camera.close()


def test_a_killed_server_is_noticed_and_comes_back(scheme: str) -> None:
    with serving(_script(scheme)) as server, _thread(_url(scheme, server)) as thread:
        assert thread.take(_SOON) is not None
        for _ in range(2):
            server.kill()
            wait_for(lambda: thread.state is CameraState.FAILED)
            assert f"{scheme}://127.0.0.1:{server.port}" in thread.status.reason
            while thread.take(0) is not None:
                pass
            server.start()
            frame = thread.take(_SOON)
            assert frame is not None
            assert _age(frame.image, time.monotonic()) < 1.0
            assert thread.status.reason == ""


def test_a_frozen_server_is_noticed_within_t_and_never_shows_an_old_picture(scheme: str) -> None:
    with serving(_script(scheme)) as server, _thread(_url(scheme, server)) as thread:
        assert thread.take(_SOON) is not None
        server.freeze()
        frozen_at = time.monotonic()
        wait_for(lambda: thread.status.reason != "")
        assert 0.5 < time.monotonic() - frozen_at < 2.5
        while thread.take(0) is not None:
            pass
        time.sleep(0.5)
        server.thaw()
        for _ in range(5):
            frame = thread.take(_SOON)
            assert frame is not None
            assert _age(frame.image, time.monotonic()) < 1.0


@pytest.mark.parametrize("login", ["", "rover:wrong-secret@"])
def test_a_wrong_password_is_told_and_never_shown(
    scheme: str, login: str, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    with serving(_script(scheme), env=_LOGIN) as server:
        with caplog.at_level(logging.DEBUG), _thread(_url(scheme, server, login)) as thread:
            wait_for(lambda: thread.state is CameraState.FAILED)
            reason = thread.status.reason
        assert "user or password (401)" in reason
        assert "secret" not in caplog.text + reason + "".join(capfd.readouterr())


def test_the_right_password_opens_the_stream(scheme: str) -> None:
    with serving(_script(scheme), env=_LOGIN) as server:
        camera = open_camera(_url(scheme, server, "rover:top-secret@"), _OPTIONS)
        try:
            assert _next(camera.read).image.any()
        finally:
            camera.close()


def test_a_wrong_path_is_told(scheme: str) -> None:
    with serving(_script(scheme)) as server, pytest.raises(CameraError, match=r"no such stream \(404\)"):
        open_camera(f"{_url(scheme, server)}/wrong", _OPTIONS)


@pytest.mark.parametrize("kind", ["rtsp", "http", "https"])
def test_a_port_where_nothing_listens_is_told(kind: str) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        with pytest.raises(CameraError, match=f"nothing listens at {kind}://127.0.0.1:{port}"):
            open_camera(f"{kind}://me:secret@127.0.0.1:{port}/x", _OPTIONS)


@pytest.mark.parametrize("kind", ["rtsp", "http"])
def test_a_server_that_says_nothing_costs_a_bounded_time(kind: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as mute:
        began = time.monotonic()
        with pytest.raises(CameraError, match="does not answer"):
            open_camera(f"{kind}://127.0.0.1:{mute.getsockname()[1]}/x", _OPTIONS)
        assert time.monotonic() - began < 8.0


@pytest.mark.parametrize("length", ["Content-Length: 2147483647\r\n", ""])
def test_a_picture_without_end_is_not_collected_in_memory(length: str) -> None:
    taken = 0

    def pour(server: socket.socket) -> None:
        nonlocal taken
        with contextlib.suppress(OSError), server.accept()[0] as reader:
            reader.recv(4096)
            head = "HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=frame\r\n\r\n"
            reader.sendall(f"{head}--frame\r\nContent-Type: image/jpeg\r\n{length}\r\n".encode())
            while taken < 2 << 30:
                reader.sendall(bytes(1 << 20))
                taken += 1 << 20

    with socket.create_server(("127.0.0.1", 0)) as server:
        pouring = threading.Thread(target=pour, args=(server,))
        pouring.start()
        with contextlib.suppress(CameraError):
            open_camera(f"http://127.0.0.1:{server.getsockname()[1]}/x", _OPTIONS).close()
    pouring.join(_SOON)
    assert taken < 300 << 20


@pytest.mark.parametrize(
    "source", ["rtsp:camera", "http:///x", "rtsp://:554/x", "rtsp://a:b@host:99999/x", "http://host:x/"]
)
def test_what_is_no_address_is_refused_without_its_password(source: str) -> None:
    with pytest.raises(SourceError, match="is no address") as refused:
        open_camera(source, _OPTIONS)
    assert "a:b" not in str(refused.value)
