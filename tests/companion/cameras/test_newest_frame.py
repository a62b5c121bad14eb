"""The reader thread: newest frame only, and it survives whatever a camera does."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from anytraverse.frame import Frame
from companion.cameras import BadFrame, Camera, CameraError, Capture, EndOfFrames, NoFrameYet
from companion.cameras.late_frames import CAME_LATE, LateFrames
from companion.cameras.newest import CameraState, CameraThread, NewestFrame, Patience
from tests.waiting import wait_for

_QUICK = Patience(wait=0.05, silence=5.0, first=0.001, longest=0.004)
_SOON = 5.0


def _picture() -> Capture:
    return Capture(time.monotonic(), np.zeros((4, 6, 3), np.uint8))


class _ScriptedCamera:
    """Does what the script says, one step a read; at its end it only times out."""

    def __init__(self, *script: Capture | Exception | Callable[[], Capture]) -> None:
        self._script = list(script)
        self.closed = False

    def read(self, timeout: float) -> Capture:
        if not self._script:
            time.sleep(min(timeout, 0.01))
            raise NoFrameYet("none yet")
        step = self._script.pop(0)
        if isinstance(step, Exception):
            raise step
        return step() if callable(step) else step

    def close(self) -> None:
        self.closed = True


@contextmanager
def _reading(
    connect: Callable[[], Camera],
    patience: Patience = _QUICK,
    first_id: int = 1,
    size: tuple[int | None, int | None] = (None, None),
) -> Iterator[CameraThread]:
    thread = CameraThread(connect, first_id=first_id, patience=patience, size=size)
    try:
        yield thread
    finally:
        assert thread.close(_SOON)


def test_only_the_newest_frame_is_held() -> None:
    newest = NewestFrame()
    frames = [Frame(number, 0.0, np.zeros((1, 1, 3), np.uint8)) for number in range(3)]
    assert [newest.put(frame) for frame in frames] == [False, True, True]
    assert newest.take(0) is frames[2]


def test_a_frame_is_taken_once() -> None:
    newest = NewestFrame()
    newest.put(Frame(1, 0.0, np.zeros((1, 1, 3), np.uint8)))
    assert newest.take(0) is not None
    assert newest.take(0) is None


def test_closing_wakes_who_waits_for_a_frame() -> None:
    newest = NewestFrame()
    threading.Timer(0.02, newest.close).start()
    started = time.monotonic()
    assert newest.take(_SOON) is None
    assert time.monotonic() - started < _SOON / 2


def test_frames_that_nobody_took_are_counted_as_dropped() -> None:
    camera = _ScriptedCamera(_picture, _picture, _picture)
    with _reading(lambda: camera) as thread:
        wait_for(lambda: thread.status.read == 3)
        frame = thread.take(0)
        assert frame is not None
        assert frame.id == 3
        assert thread.status.dropped == 2
        assert thread.state is CameraState.DELIVERING
    assert camera.closed


def test_a_lost_camera_is_opened_anew_and_ids_go_on_rising() -> None:
    cameras = [_ScriptedCamera(_picture, _picture, CameraError("unplugged")), _ScriptedCamera(_picture)]
    opened = iter(cameras)
    with _reading(lambda: next(opened)) as thread:
        wait_for(lambda: thread.status.read == 3)
        frame = thread.take(0)
        assert frame is not None
        assert frame.id == 3
        assert thread.status.connected == 2
    assert all(camera.closed for camera in cameras)


def test_the_time_of_the_newest_delivery_is_told() -> None:
    late = threading.Event()

    def wait_for_it() -> Capture:
        late.wait(_SOON)
        return _picture()

    with _reading(lambda: _ScriptedCamera(wait_for_it, BadFrame("torn"))) as thread:
        at_first = thread.delivered_at
        assert at_first is None
        before = time.monotonic()
        late.set()
        wait_for(lambda: thread.status.refused == 1)
        assert thread.delivered_at is not None
        assert before <= thread.delivered_at <= time.monotonic()


def test_ids_begin_where_the_caller_says() -> None:
    with _reading(lambda: _ScriptedCamera(_picture), first_id=900) as thread:
        frame = thread.take(_SOON)
        assert frame is not None
        assert frame.id == 900


@pytest.mark.parametrize("failure", [CameraError("no device"), RuntimeError("vendor's bug"), KeyError("x")])
def test_an_absent_camera_is_tried_for_ever_whatever_it_raises(failure: Exception) -> None:
    tries = 0

    def connect() -> Camera:
        nonlocal tries
        tries += 1
        if tries < 12:
            raise failure
        return _ScriptedCamera(_picture)

    with _reading(connect) as thread:
        assert thread.take(_SOON) is not None
    assert tries == 12


def test_a_failed_camera_says_why() -> None:
    def connect() -> Camera:
        raise CameraError("/dev/video7 is absent")

    with _reading(connect, Patience(first=60.0)) as thread:
        wait_for(lambda: thread.state is CameraState.FAILED)
        assert thread.status.reason == "/dev/video7 is absent"


def test_the_wait_between_tries_doubles_up_to_its_cap() -> None:
    times: list[float] = []

    def connect() -> Camera:
        times.append(time.monotonic())
        raise CameraError("absent")

    with _reading(connect, Patience(first=0.02, longest=0.08)):
        wait_for(lambda: len(times) == 6)
    waits = [later - sooner for sooner, later in pairwise(times)]
    for wait, least in zip(waits, [0.02, 0.04, 0.08, 0.08, 0.08], strict=True):
        assert wait >= least * 0.95
    assert waits[4] < 0.16 * 4


def test_the_same_failure_is_said_once(caplog: pytest.LogCaptureFixture) -> None:
    tries = 0

    def connect() -> Camera:
        nonlocal tries
        tries += 1
        raise CameraError("absent")

    with caplog.at_level(logging.WARNING), _reading(connect):
        wait_for(lambda: tries > 5)
    assert len(caplog.records) == 1


def test_bad_frames_are_counted_said_once_and_skipped(caplog: pytest.LogCaptureFixture) -> None:
    misshapen = Capture(0.0, np.zeros((4, 6), np.uint8))
    wide = Capture(0.0, np.zeros((4, 6, 3), np.uint16))
    empty = Capture(0.0, np.zeros((0, 6, 3), np.uint8))
    camera = _ScriptedCamera(BadFrame("torn"), misshapen, wide, empty, _picture)
    with caplog.at_level(logging.WARNING), _reading(lambda: camera) as thread:
        frame = thread.take(_SOON)
        assert frame is not None
        assert frame.id == 1
        assert thread.status.refused == 4
        assert thread.status.connected == 1
    assert len(caplog.records) == 1


@pytest.mark.parametrize("when", [float("nan"), float("inf"), float("-inf"), 3600.0])
def test_a_capture_time_that_is_none_or_in_the_future_is_refused(when: float) -> None:
    def wrong() -> Capture:
        return Capture(time.monotonic() + when, np.zeros((4, 6, 3), np.uint8))

    with _reading(lambda: _ScriptedCamera(wrong)) as thread:
        wait_for(lambda: thread.status.refused == 1)
        assert thread.take(0) is None


def test_a_camera_that_falls_silent_is_opened_anew() -> None:
    with _reading(lambda: _ScriptedCamera(_picture), Patience(0.005, 0.02, 0.001, 0.004)) as thread:
        wait_for(lambda: thread.status.connected >= 3)
        assert thread.status.read >= 2


def test_a_camera_of_bad_frames_alone_is_opened_anew() -> None:
    class Torn(_ScriptedCamera):
        def read(self, timeout: float) -> Capture:
            time.sleep(timeout / 10)
            raise BadFrame("torn")

    with _reading(Torn, Patience(0.005, 0.02, 0.001, 0.004, opening=0.02)) as thread:
        wait_for(lambda: thread.status.connected >= 2)


def test_a_file_that_ended_is_not_opened_anew() -> None:
    with _reading(lambda: _ScriptedCamera(_picture, EndOfFrames("played"))) as thread:
        wait_for(lambda: thread.state is CameraState.ENDED)
        assert thread.status.reason == "played"
        assert thread.take(0) is not None
        assert thread.take(0.01) is None
        assert thread.status.connected == 1


def test_closing_is_quick_while_waiting_to_try_again() -> None:
    def connect() -> Camera:
        raise CameraError("absent")

    thread = CameraThread(connect, patience=Patience(first=3600.0))
    wait_for(lambda: thread.state is CameraState.FAILED)
    assert thread.close(_SOON)


def test_a_reader_that_a_driver_keeps_for_too_long_does_not_count_as_running() -> None:
    freed = threading.Event()

    def hang() -> Capture:
        freed.wait(_SOON)
        raise NoFrameYet("freed")

    with _reading(lambda: _ScriptedCamera(hang), Patience(0.005, 5.0, 0.001, 0.004, hung=0.1)) as thread:
        assert thread.running
        wait_for(lambda: not thread.running)
        freed.set()
        wait_for(lambda: thread.running)


def test_closing_a_reader_that_hangs_keeps_its_deadline() -> None:
    freed = threading.Event()

    def hang() -> Capture:
        freed.wait(_SOON)
        raise CameraError("freed")

    thread = CameraThread(lambda: _ScriptedCamera(hang), patience=_QUICK)
    assert not thread.close(0.02)
    freed.set()
    assert thread.close(_SOON)


def test_the_status_says_after_t_that_no_frame_comes_although_the_driver_blocks() -> None:
    freed = threading.Event()

    def block() -> Capture:
        freed.wait(_SOON)
        raise NoFrameYet("freed")

    with _reading(lambda: _ScriptedCamera(_picture, block), Patience(silence=60.0, late=0.05)) as thread:
        wait_for(lambda: thread.status.reason != "")
        assert thread.status.state is CameraState.DELIVERING
        assert "no good frame for 0.05 s" in thread.status.reason
        freed.set()


def test_a_frame_of_another_size_than_configured_is_refused_and_told() -> None:
    with _reading(
        lambda: _ScriptedCamera(_picture), Patience(0.005, 5.0, 0.5, opening=0.05), size=(6, 5)
    ) as thread:
        wait_for(lambda: thread.state is CameraState.FAILED)
        assert thread.take(0) is None
        assert "6 x 4: make [camera] width and height so" in thread.status.reason


def test_the_status_says_the_size_and_what_the_time_is_from(caplog: pytest.LogCaptureFixture) -> None:
    def wide() -> Capture:
        return Capture(time.monotonic(), np.zeros((4, 8, 3), np.uint8), "sensor")

    with caplog.at_level(logging.WARNING), _reading(lambda: _ScriptedCamera(_picture, wide)) as thread:
        wait_for(lambda: thread.status.read == 2)
        assert (thread.status.width, thread.status.height, thread.status.timed_by) == (8, 4, "sensor")
    assert "another size than before, 8 x 4" in caplog.text


def test_depth_and_intrinsics_go_with_their_frame() -> None:
    depth, lens = np.full((4, 6), 2500, np.uint16), (5.0, 5.0, 3.0, 2.0)

    def deep() -> Capture:
        return Capture(time.monotonic(), np.zeros((4, 6, 3), np.uint8), "sensor", depth, lens)

    with _reading(lambda: _ScriptedCamera(deep)) as thread:
        wait_for(lambda: thread.status.read == 1)
        frame = thread.take(0)
        assert frame is not None
        assert frame.depth is depth
        assert frame.intrinsics == thread.status.intrinsics == lens
        assert thread.status.depth


@pytest.mark.parametrize(
    ("depth", "lens", "told"),
    [
        (np.zeros((4, 5), np.uint16), None, "the depth map does not fit"),
        (np.zeros((4, 6), np.float32), None, "the depth map does not fit"),
        (None, (float("nan"), 5.0, 3.0, 2.0), "impossible intrinsics"),
        (None, (0.0, 5.0, 3.0, 2.0), "impossible intrinsics"),
    ],
)
def test_depth_of_another_size_and_impossible_intrinsics_are_refused(
    depth: Any, lens: tuple[float, float, float, float] | None, told: str
) -> None:
    def wrong() -> Capture:
        return Capture(time.monotonic(), np.zeros((4, 6, 3), np.uint8), "sensor", depth, lens)

    with _reading(lambda: _ScriptedCamera(wrong), Patience(0.005, 5.0, 60.0, opening=0.05)) as thread:
        wait_for(lambda: thread.state is CameraState.FAILED)
        assert thread.take(0) is None
        assert told in thread.status.reason


def test_a_password_in_a_drivers_error_is_not_passed_on(caplog: pytest.LogCaptureFixture) -> None:
    def connect() -> Camera:
        raise RuntimeError("cannot open rtsp://me:secret@camera/1")

    with _reading(connect, Patience(first=60.0)) as thread:
        wait_for(lambda: thread.state is CameraState.FAILED)
        assert thread.status.reason == "cannot open ..."
    assert "secret" not in caplog.text


def test_a_camera_that_is_too_slow_for_t_says_so(caplog: pytest.LogCaptureFixture) -> None:
    late = LateFrames(0.01)
    late.is_late(time.monotonic())

    def slow() -> Capture:
        time.sleep(0.02)
        if late.is_late(time.monotonic()):
            raise BadFrame(CAME_LATE)
        return _picture()

    with _reading(lambda: _ScriptedCamera(*[slow] * 500), Patience(opening=0.1, first=60.0)) as thread:
        wait_for(lambda: thread.state is CameraState.FAILED)
        assert "the frames/s of the camera" in thread.status.reason
    assert len(caplog.records) == 2


def test_a_camera_that_never_delivers_gives_a_reason_after_t() -> None:
    with _reading(_ScriptedCamera, Patience(late=0.05)) as thread:
        wait_for(lambda: thread.status.reason != "")
        assert thread.status.state is CameraState.CONNECTING
        assert "no good frame for 0.05 s" in thread.status.reason
