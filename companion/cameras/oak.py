"""Reads a Luxonis OAK by DepthAI 3, colour and, if wanted, depth: `oak:`, or `oak:ID` for one of several."""

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

from anytraverse.frame import Intrinsics  # noqa: E402
from companion.cameras import BadFrame, CameraError, CameraOptions, Capture, NoFrameYet  # noqa: E402
from companion.cameras.late_frames import CAME_LATE  # noqa: E402
from companion.cameras.shown import shown  # noqa: E402

_USUAL_SIZE = (640, 480)
_STEREO_SIZE, _USUAL_FPS = (640, 400), 30.0
_COLOUR, _DEPTH = "colour", "depth"
_WAITING = 1
"""Pictures that may wait: a newer one replaces the older."""


class OakStream:
    """Delivers the pictures of an output of a DepthAI pipeline, with the time that DepthAI gives them.

    With an output of depth maps, too, each picture waits for the map of its time.
    """

    def __init__(self, pipeline: Any, output: Any, options: CameraOptions, depth: Any = None) -> None:
        """Start the pipeline. Raises CameraError."""
        self._pipeline, self._freshness = pipeline, options.freshness
        self._state = ""
        self._has_depth = depth is not None
        if self._has_depth:
            both = pipeline.create(depthai.node.Sync)
            both.setRunOnHost(True)
            both.setSyncThreshold(timedelta(seconds=0.5 / (options.fps or _USUAL_FPS)))
            output.link(both.inputs[_COLOUR])
            depth.link(both.inputs[_DEPTH])
            output = both.out
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
        depth = np.array(message[_DEPTH].getFrame()) if self._has_depth else None
        message = message[_COLOUR] if self._has_depth else message
        now = time.monotonic()
        captured_at = min(message.getTimestamp().total_seconds(), now)
        if now - captured_at > self._freshness:
            raise BadFrame(CAME_LATE)
        image = np.asarray(cv2.cvtColor(message.getCvFrame(), cv2.COLOR_BGR2RGB), np.uint8)
        return Capture(captured_at, image, "sensor", depth, _intrinsics(message))

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
            output = camera.requestOutput(
                size, depthai.ImgFrame.Type.BGR888p, fps=options.fps, enableUndistortion=options.depth
            )
            depth = self._depth(pipeline, output, options) if options.depth else None
            super().__init__(pipeline, output, options, depth)
        except RuntimeError as error:
            self._device.close()
            raise CameraError(f"the OAK gives no such picture ({error}): choose another size") from error
        except CameraError:
            self._device.close()
            raise

    def _depth(self, pipeline: Any, colour: Any, options: CameraOptions) -> Any:
        """Return an output of depth maps, in mm at each pixel of `colour`. Raises CameraError."""
        sides = depthai.CameraBoardSocket.CAM_B, depthai.CameraBoardSocket.CAM_C
        if not {*sides} <= {*self._device.getConnectedCameras()}:
            raise CameraError("this OAK has no stereo cameras: set [camera] depth = false")
        stereo = pipeline.create(depthai.node.StereoDepth)
        for socket, view in zip(sides, (stereo.left, stereo.right), strict=True):
            one = pipeline.create(depthai.node.Camera).build(socket)
            one.requestOutput(_STEREO_SIZE, fps=options.fps).link(view)
        if self._device.getPlatform() is not depthai.Platform.RVC4:
            colour.link(stereo.inputAlignTo)
            return stereo.depth
        align = pipeline.create(depthai.node.ImageAlign)
        stereo.depth.link(align.input)
        colour.link(align.inputAlignTo)
        return align.outputAligned

    def close(self) -> None:
        super().close()
        self._device.close()


def oak_ids() -> list[str]:
    """Return the ids of the devices that are there. Takes half a second."""
    return [info.getDeviceId() for info in depthai.Device.getAllAvailableDevices()]


def _intrinsics(message: Any) -> Intrinsics | None:
    """Return what the picture itself says of its lens, at its size; None where it says nothing."""
    transformation = message.getTransformation()
    if not transformation.isValid():
        return None
    (fx, _, cx), (_, fy, cy), _ = transformation.getIntrinsicMatrix()
    return None if (fx, fy) == (1.0, 1.0) else (fx, fy, cx, cy)


def _chosen(place: str) -> Any:
    found = depthai.Device.getAllAvailableDevices()
    chosen = [info for info in found if place in ("", info.getDeviceId(), info.name)]
    if len(chosen) == 1:
        return chosen[0]
    ids = ", ".join(info.getDeviceId() for info in found)
    if chosen:
        raise CameraError(f"there are several OAKs: write oak:ID with one of {ids}")
    if found:
        raise CameraError(f"{shown(f'oak:{place}')} is not there: write oak:ID with one of {ids}")
    raise CameraError("no OAK is there: check its cable, its supply and the udev rule (docs/cameras.md)")
