"""Relays the field's camera to the companion, and can freeze it: the same picture, always as if new."""

from __future__ import annotations

import contextlib
import threading
import time

import cv2
import numpy as np
from numpy.typing import NDArray

from companion.cameras.frame_socket import CapturedFrame, FrameError, FrameServer, FrameStream, FrameTimeout

_PERIOD = 1.0 / 12.0


class CameraRelay:
    """Serves the field's frames until it is closed.

    frozen: serves the last frame again and again, as if just taken. clock: draws the time into each and
    compresses it again, so that no two are equal.
    """

    def __init__(self, frames: str) -> None:
        """frames: the address of the field's frame server."""
        host, _, port = frames.rpartition(":")
        self.frozen = self.clock = False
        self._stream = FrameStream(host, int(port))
        self._server = FrameServer()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="camera relay", daemon=True)
        self._thread.start()

    @property
    def source(self) -> str:
        """The `source` for the companion's [camera]."""
        return "field:{}:{}".format(*self._server.address)

    def close(self) -> None:
        self._closing.set()
        self._thread.join(2.0)
        self._stream.close()
        self._server.close()

    def _run(self) -> None:
        last: CapturedFrame | None = None
        number = 0
        with contextlib.suppress(FrameError):  # the field is gone
            while not self._closing.is_set():
                if self.frozen and last is not None:
                    self._closing.wait(_PERIOD)
                    frame = last._replace(captured_at=time.monotonic())
                else:
                    try:
                        frame = last = self._stream.read(_PERIOD)
                    except FrameTimeout:
                        continue
                number += 1
                rgb = _with_clock(frame.rgb, number) if self.clock else frame.rgb
                self._server.publish(frame._replace(id=number, rgb=rgb))


def _with_clock(rgb: NDArray[np.uint8], number: int) -> NDArray[np.uint8]:
    shown = rgb.copy()
    cv2.putText(shown, f"{number:09}", (8, 24), cv2.FONT_HERSHEY_SIMPLEX, 0.7, (255, 255, 255), 2)
    quality = 80 - 10 * (number % 2)
    content = cv2.imencode(".jpg", shown[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return np.asarray(cv2.imdecode(content, cv2.IMREAD_COLOR), np.uint8)[..., ::-1]
