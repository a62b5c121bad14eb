"""A camera between the field's and the companion, which can freeze: the same picture, always as if new."""

from __future__ import annotations

import contextlib
import threading
import time

from companion.field.frames import CapturedFrame, FrameError, FrameServer, FrameStream, FrameTimeout

_PERIOD = 1.0 / 12.0


class Lens:
    """Serves the field's frames until closed. frozen: the last of them again and again, as if just taken."""

    def __init__(self, frames: str) -> None:
        """frames: the address of the field's frame server."""
        host, _, port = frames.rpartition(":")
        self.frozen = False
        self._stream = FrameStream(host, int(port))
        self._server = FrameServer()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="lens", daemon=True)
        self._thread.start()

    @property
    def source(self) -> str:
        """For the companion's [camera]."""
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
                self._server.publish(frame._replace(id=number))
