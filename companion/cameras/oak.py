"""Reads the colour camera of a Luxonis OAK by DepthAI 3: `oak:`, or `oak:ID` for one of several."""

from __future__ import annotations

import os
import time
from datetime import timedelta
from typing import Any

for _name, _value in {
    "DEPTHAI_TELEMETRY": "0",
    "DEPTHAI_DISABLE_CRASHDUMP_COLLECTION": "1",
    "DEPTHAI_ZOO_INTERNET_CHECK": "0",
    "DEPTHAI_INSTALL_SIGNAL_HANDLER": "0",
    "DEPTHAI_LEVEL": "error",
}.items():
    os.environ.setdefault(_name, _value)  # read at import, which else asks the network
import cv2  # noqa: E402
import depthai  # noqa: E402
import numpy as np  # noqa: E402

from companion.cameras import (  # noqa: E402
    BadFrame,
    CameraError,
    CameraOptions,
    Capture,
    NoFrameYet,
)
from companion.cameras.late_frames import CAME_LATE  # noqa: E402

_USUAL_SIZE = (640, 480)
_WAITING = 1
"""Pictures that may wait: a newer one replaces the older."""


class OakStream:
    """Delivers the pictures of an output of a DepthAI pipeline, with the time that DepthAI gives them."""

    def __init__(self, pipeline: Any, output: Any, options: CameraOptions) -> None:
        """Start the pipeline. Raises CameraError."""
        self._pipeline, self._freshness = pipeline, options.freshness
        self._state = ""
        self._queue = output.createOutputQueue(maxSize=_WAITING, blocking=False)
        try:
            pipeline.setDeviceStateCallback(self._note_state)
            pipeline.setStopOnDeviceLoss(True)  # else the queue only falls silent
            pipeline.start()
        except RuntimeError as error:
            raise CameraError(f"the OAK does not start ({error}): unplug it and plug it in again") from error

    def read(self, timeout: float) -> Capture:
        try:
            message = self._queue.get(timedelta(seconds=timeout))
        except (RuntimeError, depthai.MessageQueue.QueueException) as error:
            state = f" (its state: {self._state})" if self._state else ""
            raise CameraError(f"the OAK is gone{state}: check its cable and its supply") from error
        if message is None:
            raise NoFrameYet(f"the OAK sent no picture in {timeout:g} s: read again")
        now = time.monotonic()
        captured_at = min(message.getTimestamp().total_seconds(), now)
        if now - captured_at > self._freshness:
            raise BadFrame(CAME_LATE)
        image = np.asarray(cv2.cvtColor(message.getCvFrame(), cv2.COLOR_BGR2RGB), np.uint8)
        return Capture(captured_at, image, "sensor")

    def close(self) -> None:
        self._pipeline.stop()

    def _note_state(self, _: Any, state: Any) -> None:
        self._state = str(getattr(state, "name", state)).lower()


class OakCamera(OakStream):
    """Boots the device, which takes some seconds, and reads its colour camera."""

    def __init__(self, place: str, options: CameraOptions) -> None:
        # Without a device the constructor of Device waits for 11 s: the list costs half a second.
        info = _chosen(place)
        try:
            self._device = depthai.Device(info)
        except RuntimeError as error:
            raise CameraError(
                f"the OAK {info.getDeviceId()} cannot be opened ({error}): end other programs that use it"
            ) from error
        try:
            self._device.setMaxReconnectionAttempts(0)  # the camera's thread opens it again
            pipeline = depthai.Pipeline(self._device)
            size = (options.width, options.height) if options.width and options.height else _USUAL_SIZE
            camera = pipeline.create(depthai.node.Camera).build(depthai.CameraBoardSocket.CAM_A)
            output = camera.requestOutput(size, depthai.ImgFrame.Type.BGR888p, fps=options.fps)
            super().__init__(pipeline, output, options)
        except RuntimeError as error:
            self._device.close()
            raise CameraError(f"the OAK gives no such picture ({error}): choose another size") from error
        except CameraError:
            self._device.close()
            raise

    def close(self) -> None:
        super().close()
        self._device.close()


def oak_ids() -> list[str]:
    """Return the ids of the devices that are there. Takes half a second."""
    return [info.getDeviceId() for info in depthai.Device.getAllAvailableDevices()]


def _chosen(place: str) -> Any:
    found = depthai.Device.getAllAvailableDevices()
    chosen = [info for info in found if place in ("", info.getDeviceId(), info.name)]
    if len(chosen) == 1:
        return chosen[0]
    ids = ", ".join(info.getDeviceId() for info in found)
    if chosen:
        raise CameraError(f"there are several OAKs: write oak:ID with one of {ids}")
    if found:
        raise CameraError(f"there is no OAK {place}: write oak:ID with one of {ids}")
    raise CameraError("no OAK is there: check its cable, its supply and the udev rule (docs/cameras.md)")
