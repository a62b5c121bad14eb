"""Relays the field's camera to the companion, and can freeze, darken, delay or unplug it."""

from __future__ import annotations

import contextlib
import threading
import time

import cv2
import numpy as np
from numpy.typing import NDArray

from companion.cameras.field import CapturedFrame, FrameError, FrameStream, FrameTimeout
from companion.sim.field.frame_server import FrameServer

_PERIOD = 1.0 / 12.0


class CameraRelay:
    """Serves the field's frames until it is closed.

    frozen: serves the last frame again and again, as if just taken. clock: draws the time into each and
    compresses it again, so that no two are equal. black: blackens each. pause: s from one frame to the next,
    where that is longer than the camera's own. taken_at: when the newest frame was taken that was passed on
    as it was, monotonic seconds.
    """

    def __init__(self, frames: str, *, plugged: bool = True) -> None:
        """frames: the address of the field's frame server. plugged: whether the companion can connect now."""
        host, _, port = frames.rpartition(":")
        self.frozen = self.clock = self.black = False
        self.pause = 0.0
        self.taken_at = 0.0
        self._stream = FrameStream(host, int(port))
        self._server: FrameServer | None = FrameServer()
        self._address = self._server.address
        if not plugged:
            self.plug(on=False)
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="camera relay", daemon=True)
        self._thread.start()

    @property
    def source(self) -> str:
        """The `source` for the companion's [camera]."""
        return "field:{}:{}".format(*self._address)

    def plug(self, *, on: bool) -> None:
        """Plugs the camera in, or pulls it: then connections to it are closed and refused."""
        if on and self._server is None:
            self._server = FrameServer(port=self._address[1])
        elif not on and self._server is not None:
            self._server.close()
            self._server = None

    def close(self) -> None:
        self._closing.set()
        self._thread.join(2.0)
        self._stream.close()
        self.plug(on=False)

    def _run(self) -> None:
        last: CapturedFrame | None = None
        number = 0
        with contextlib.suppress(FrameError):  # the field is gone
            while not self._closing.wait(self.pause):
                if self.frozen and last is not None:
                    self._closing.wait(_PERIOD)
                    frame = last._replace(captured_at=time.monotonic())
                else:
                    try:
                        frame = last = self._stream.read(_PERIOD)
                    except FrameTimeout:
                        continue
                number += 1
                self._publish(frame._replace(id=number))

    def _publish(self, frame: CapturedFrame) -> None:
        server, altered = self._server, self.frozen or self.black
        if server is None:
            return
        rgb = np.zeros_like(frame.rgb) if self.black else frame.rgb
        server.publish(frame._replace(rgb=_with_clock(rgb, frame.id) if self.clock else rgb))
        if not altered:
            self.taken_at = frame.captured_at


def _with_clock(rgb: NDArray[np.uint8], number: int) -> NDArray[np.uint8]:
    shown = rgb.copy()
    cv2.putText(shown, f"{number:09}", (8, 24), cv2.FONT_HERSHEY_SIMPLEX, 0.7, (255, 255, 255), 2)
    quality = 80 - 10 * (number % 2)
    content = cv2.imencode(".jpg", shown[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return np.asarray(cv2.imdecode(content, cv2.IMREAD_COLOR), np.uint8)[..., ::-1]
