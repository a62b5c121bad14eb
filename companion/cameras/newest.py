"""Reads a camera in a thread, opens it again whenever it fails, and holds only the newest frame."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum

from anytraverse.frame import Frame, Intrinsics, is_depth, is_image, is_intrinsics
from companion.cameras import BadFrame, Camera, CameraError, Capture, EndOfFrames, NoFrameYet
from companion.cameras.shown import plain_words

_log = logging.getLogger(__name__)

_LONGEST_REASON = 500
"""Characters of a driver's error text that are passed on."""


class CameraState(Enum):
    """Says what the camera thread is doing."""

    CONNECTING = "connecting"
    DELIVERING = "delivering"
    FAILED = "failed"
    """The thread waits before it connects again; the status says why."""
    ENDED = "ended"
    """A file has ended; no more frames will come."""


@dataclass(frozen=True)
class CameraStatus:
    """Describes the camera thread at one moment. Counts are since the start.

    reason: why the camera failed or ended, or why no good frame comes; "" again once one comes. read: good
    frames. dropped: good frames that a newer one replaced before they were taken. refused: bad frames.
    connected: how often the camera was opened. width, height: pixels of the newest good frame, 0 before the
    first. timed_by: what its capture time is from, as in `Capture`. depth: whether it has a depth map.
    intrinsics: of its lens, None where the camera does not tell.
    """

    state: CameraState = CameraState.CONNECTING
    reason: str = ""
    read: int = 0
    dropped: int = 0
    refused: int = 0
    connected: int = 0
    width: int = 0
    height: int = 0
    timed_by: str = ""
    depth: bool = False
    intrinsics: Intrinsics | None = None


@dataclass(frozen=True)
class Patience:
    """Holds the camera thread's time limits, in seconds.

    wait: time-out of one read. silence: time without a good frame after which the camera is opened again;
    opening counts instead before the first frame. first, longest: the wait before connecting again, which
    doubles from failure to failure. hung: time in one call of the camera's driver after which the thread
    counts as hung for good. late: time without a good frame after which the status gives a reason, T.
    """

    wait: float = 0.5
    silence: float = 5.0
    first: float = 0.25
    longest: float = 3.0
    hung: float = 60.0
    opening: float = 6.0
    late: float = 2.0


class NewestFrame:
    """Holds at most one frame. A newer frame replaces it, and `take` removes it."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._frame: Frame | None = None
        self._closed = False

    def put(self, frame: Frame) -> bool:
        """Store a frame; never blocks. True when it replaced one that was not taken."""
        with self._changed:
            overwritten = self._frame is not None
            self._frame = frame
            self._changed.notify()
        return overwritten

    def take(self, timeout: float) -> Frame | None:
        """Remove and return the frame; wait up to `timeout` seconds for one. None: none came, or closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._frame is not None or self._closed, timeout)
            frame, self._frame = self._frame, None
        return frame

    def close(self) -> None:
        """End every wait in `take`."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()


class CameraThread:
    """Reads a camera in a thread of its own. Frame ids rise by one, also across reconnects.

    `connect` opens the camera, as `companion.cameras.open_camera` does. After an exception of `connect` or of
    the camera the thread waits and connects again. Only EndOfFrames and `close` end the thread.
    """

    def __init__(
        self,
        connect: Callable[[], Camera],
        *,
        first_id: int = 1,
        patience: Patience | None = None,
        size: tuple[int | None, int | None] = (None, None),
    ) -> None:
        """size: width and height in pixels, None: any. A frame of another size is a bad frame."""
        self._connect = connect
        self._size = size
        self._bad = ""
        self._next_id = first_id
        self._patience = patience or Patience()
        self._newest = NewestFrame()
        self._status = CameraStatus()
        self._delivered_at: float | None = None
        self._started_at = self._turned_at = time.monotonic()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
        self._thread.start()

    @property
    def status(self) -> CameraStatus:
        """Return the newest status. Never blocks."""
        status, late = self._status, self._patience.late
        silent = time.monotonic() - (self._delivered_at or self._started_at)
        if status.reason or status.state is CameraState.ENDED or silent <= late:
            return status
        return replace(status, reason=self._why_silent(late))

    @property
    def delivered_at(self) -> float | None:
        """Return the monotonic seconds when the newest good frame came; None before the first."""
        return self._delivered_at

    @property
    def state(self) -> CameraState:
        """Return the newest status's state. Never blocks."""
        return self._status.state

    @property
    def running(self) -> bool:
        """Whether frames may still come, or a file has ended normally. False while the driver hangs."""
        hangs = time.monotonic() - self._turned_at > self._patience.hung
        return (self._thread.is_alive() and not hangs) or self._status.state is CameraState.ENDED

    def take(self, timeout: float) -> Frame | None:
        """Return the newest frame that was not taken yet; block up to `timeout` seconds for one. None: none.

        The frame's age is not checked here: look at `captured_at`.
        """
        return self._newest.take(timeout)

    def close(self, timeout: float = 2.0) -> bool:
        """Stop the thread and release the camera. False: after `timeout` s the driver still hangs."""
        self._closing.set()
        self._newest.close()
        self._thread.join(timeout)
        return not self._thread.is_alive()

    def _run(self) -> None:
        pause = self._patience.first
        while not self._closing.is_set():
            self._turned_at = time.monotonic()
            read_before = self._status.read
            self._set(state=CameraState.CONNECTING)
            try:
                self._deliver()
                return
            except EndOfFrames as end:
                _log.info("%s", end)
                self._set(state=CameraState.ENDED, reason=str(end))
                return
            except CameraError as failure:
                reason = str(failure)[:_LONGEST_REASON]
            except Exception as failure:  # a driver may raise anything, and the rover still needs its camera
                reason = (plain_words(str(failure)) or type(failure).__name__)[:_LONGEST_REASON]
            if self._status.read > read_before:
                pause = self._patience.first
            if reason != self._status.reason:
                # Logged once a reason, or a camera that is unplugged would fill the log.
                _log.warning("no camera: %s; trying again", reason)
            self._set(state=CameraState.FAILED, reason=reason)
            self._closing.wait(pause)
            pause = min(pause * 2, self._patience.longest)

    def _deliver(self) -> None:
        """Open the camera and read it until the thread is closed. Raises whatever ends the connection."""
        camera = self._connect()
        try:
            self._set(connected=self._status.connected + 1)
            last = time.monotonic()
            limit = self._patience.opening
            self._bad = ""
            warned = False
            while not self._closing.is_set():
                self._turned_at = time.monotonic()
                try:
                    capture = camera.read(self._patience.wait)
                    _check(capture, self._size)
                except NoFrameYet:
                    pass
                except BadFrame as bad:
                    self._bad = str(bad)[:_LONGEST_REASON]
                    self._set(refused=self._status.refused + 1)
                    if not warned:
                        _log.warning("frame refused: %s (further ones are only counted)", self._bad)
                        warned = True
                else:
                    last = time.monotonic()
                    limit, self._bad = self._patience.silence, ""
                    self._keep(capture)
                if time.monotonic() - last > limit:
                    raise CameraError(self._why_silent(limit))
        finally:
            camera.close()

    def _why_silent(self, seconds: float) -> str:
        return f"no good frame for {seconds:g} s: {self._bad or 'check cable, light and address'}"

    def _keep(self, capture: Capture) -> None:
        height, width, _ = capture.image.shape
        captured_at, image, timed_by, depth, intrinsics = capture
        frame = Frame(self._next_id, captured_at, image, depth, intrinsics)
        self._next_id += 1
        self._delivered_at = time.monotonic()
        if self._status.state is not CameraState.DELIVERING:
            _log.info("camera delivers %d x %d pixels", width, height)
        if self._status.width and (width, height) != (self._status.width, self._status.height):
            _log.warning(
                "the pictures have another size than before, %d x %d: look whether [mount] aspect still fits",
                width,
                height,
            )
        dropped = self._newest.put(frame)
        self._set(
            state=CameraState.DELIVERING,
            reason="",
            read=self._status.read + 1,
            dropped=self._status.dropped + dropped,
            width=width,
            height=height,
            timed_by=timed_by,
            depth=depth is not None,
            intrinsics=intrinsics,
        )

    def _set(self, **changes: object) -> None:
        self._status = replace(self._status, **changes)  # type: ignore[arg-type]


def _check(capture: Capture, size: tuple[int | None, int | None]) -> None:
    """Raise BadFrame for an image or a capture time that the algorithm must not get."""
    if not is_image(capture.image):
        raise BadFrame("not an RGB picture of 8 bits a channel: check the camera's pixel format")
    if not (capture.depth is None or is_depth(capture.depth, capture.image)):
        raise BadFrame("the depth map does not fit the picture: set [camera] depth = false")
    if not (capture.intrinsics is None or is_intrinsics(capture.intrinsics)):
        raise BadFrame("the camera tells impossible intrinsics: calibrate it, or set [camera] depth = false")
    height, width, _ = capture.image.shape
    if size[0] not in (None, width) or size[1] not in (None, height):
        raise BadFrame(f"the pictures are {width} x {height}: make [camera] width and height so")
    if not math.isfinite(capture.captured_at) or capture.captured_at > time.monotonic():
        raise BadFrame(f"captured at {capture.captured_at}, which is not in the past: check its clock")
