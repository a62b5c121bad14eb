"""Reads cameras of the kernel, such as USB cameras: `v4l2:/dev/v4l/by-id/...` or `v4l2:0`."""

from __future__ import annotations

import math
import os
import time

import cv2
import numpy as np

from companion.cameras import BadFrame, CameraError, CameraOptions, Capture, NoFrameYet
from companion.cameras.late_frames import CAME_LATE, LateFrames
from companion.cameras.pixel_formats import MJPEG, PIXEL_FORMATS
from companion.cameras.v4l2_devices import DeviceError, in_use, query

_MANUAL = 1
_EXPOSURE_UNIT = 1e-4
_OLDEST = 10.0
"""Seconds of age up to which a time stamp is believed to be of the monotonic clock."""
_AHEAD = 0.05
"""Seconds by which the kernel's estimate of the capture time may be too late."""


class V4l2Device:
    """Reads one device. `read` blocks for up to T, rounded up to whole seconds, whatever `timeout` says."""

    def __init__(self, place: str, options: CameraOptions) -> None:
        self._path = f"/dev/video{place}" if place.isdecimal() else os.path.expanduser(place)
        self._latency = options.latency
        self._timeout = max(1, math.ceil(options.freshness))
        self._late = LateFrames(options.freshness)
        # CAP_PROP_READ_TIMEOUT_MSEC would make the open fail. OpenCV reads this once, before the first wait.
        os.environ["OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT"] = str(self._timeout)
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
        try:
            query(self._path)
        except DeviceError as error:
            raise CameraError(str(error)) from error
        self._video = cv2.VideoCapture(self._path, cv2.CAP_V4L2)
        try:
            self._set(options)
        except CameraError:
            self.close()
            raise

    def read(self, timeout: float) -> Capture:  # noqa: ARG002
        began = time.monotonic()
        grabbed = self._video.grab()
        now = time.monotonic()
        if not grabbed and now - began < 0.9 * self._timeout:
            raise CameraError(f"{self._path} is gone, or failed: check its cable and its supply")
        if not grabbed:
            raise NoFrameYet(f"{self._path} sent no picture in {self._timeout} s: read again")
        stamp = self._video.get(cv2.CAP_PROP_POS_MSEC) / 1e3
        from_sensor = now - _OLDEST < stamp < now + _AHEAD
        if self._late.is_late(now) and not from_sensor:
            raise BadFrame(CAME_LATE)
        ok, picture = self._video.retrieve()
        if not ok or picture is None or picture.size == 0:
            raise BadFrame(f"a picture of {self._path} cannot be decoded: try another pixel_format or cable")
        colour = cv2.COLOR_GRAY2RGB if picture.ndim == 2 else cv2.COLOR_BGR2RGB
        image = np.asarray(cv2.cvtColor(picture, colour), np.uint8)
        if from_sensor:
            return Capture(min(stamp, now), image, "sensor")
        return Capture(now - self._latency, image, "arrival")

    def close(self) -> None:
        self._video.release()

    def _set(self, options: CameraOptions) -> None:
        """Ask for the configured format. Raises CameraError when the camera is busy or gives another one."""
        video = self._video
        if not video.isOpened():
            raise CameraError(in_use(self._path))
        if options.pixel_format is not None:
            name = "MJPG" if options.pixel_format == MJPEG else PIXEL_FORMATS[options.pixel_format].fourcc
            video.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*name))
            given = int(video.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little").decode("latin-1")
            if given != name:
                raise CameraError(f"{self._path} gives {given}, not {name}: choose another pixel_format")
        if options.width is not None and options.height is not None:
            video.set(cv2.CAP_PROP_FRAME_WIDTH, options.width)
            video.set(cv2.CAP_PROP_FRAME_HEIGHT, options.height)
            width = int(video.get(cv2.CAP_PROP_FRAME_WIDTH))
            height = int(video.get(cv2.CAP_PROP_FRAME_HEIGHT))
            if (width, height) != (options.width, options.height):
                asked = f"{options.width} x {options.height}"
                raise CameraError(f"{self._path} gives {width} x {height}, not {asked}: choose that")
        if options.fps is not None:
            video.set(cv2.CAP_PROP_FPS, options.fps)
        if options.exposure is not None:
            video.set(cv2.CAP_PROP_AUTO_EXPOSURE, _MANUAL)
            if not video.set(cv2.CAP_PROP_EXPOSURE, round(options.exposure / _EXPOSURE_UNIT)):
                raise CameraError(f"{self._path} has no exposure time to set: leave [camera] exposure out")
