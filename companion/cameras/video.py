"""Plays a video file at its own rate or a given one: `video:PATH`. A folder is played at the same pace."""

from __future__ import annotations

import math
import os
import time
from pathlib import Path

import cv2

from anytraverse.decoding import PictureTooLargeError, check_size
from companion.cameras import BadFrame, CameraError, CameraOptions, Capture, EndOfFrames, NoFrameYet

_USUAL_RATE = 30.0
_HIGHEST_RATE = 240.0


class VideoFile:
    """Delivers the frames of a video that OpenCV can decode. `captured_at` is when a frame was due."""

    def __init__(self, place: str, options: CameraOptions) -> None:
        self._path = Path(os.path.expanduser(place)).absolute()
        self._loop = options.loop
        self._video = open_video(self._path)
        self._read_in_lap = 0
        self._pace = PlaybackPace(options.playback or own_rate(self._video))

    def read(self, timeout: float) -> Capture:
        now = self._pace.wait(timeout)
        if not self._video.grab():
            self._start_again()
        self._read_in_lap += 1
        ok, picture = self._video.retrieve()
        if not ok:
            raise BadFrame(f"frame {self._read_in_lap} of {self._path} cannot be decoded")
        return Capture(now, cv2.cvtColor(picture, cv2.COLOR_BGR2RGB))  # type: ignore[arg-type]

    def close(self) -> None:
        self._video.release()

    def _start_again(self) -> None:
        """Start again at the file's end, or raise EndOfFrames."""
        if not self._loop:
            announced = int(self._video.get(cv2.CAP_PROP_FRAME_COUNT))
            torn = f" of {announced} announced" if announced > self._read_in_lap else ""
            raise EndOfFrames(f"{self._path} ended after {self._read_in_lap} frames{torn}")
        self._video.release()
        # The file is opened again, because OpenCV cannot seek to the start of every container.
        self._video = open_video(self._path)
        self._read_in_lap = 0
        if not self._video.grab():
            raise CameraError(f"{self._path} holds no frame: choose another video")


def open_video(path: Path) -> cv2.VideoCapture:
    """Open a video file. Raises CameraError for one that is not there, cannot be decoded, or is too large."""
    if not path.is_file():
        raise CameraError(f"there is no video {path}: check [camera] source")
    video = cv2.VideoCapture(str(path))
    if not video.isOpened():
        raise CameraError(f"{path} is no video that can be decoded: try to play it, or convert it")
    try:
        check_size(int(video.get(cv2.CAP_PROP_FRAME_WIDTH)), int(video.get(cv2.CAP_PROP_FRAME_HEIGHT)))
    except PictureTooLargeError as error:
        video.release()
        raise CameraError(f"{path}: {error}") from error
    return video


def own_rate(video: cv2.VideoCapture) -> float:
    """Return the frames per second that a video states, 30 where that is none."""
    rate = float(video.get(cv2.CAP_PROP_FPS))
    return rate if math.isfinite(rate) and 0.0 < rate <= _HIGHEST_RATE else _USUAL_RATE


class PlaybackPace:
    """Lets a reader through `rate` times a second. It never speeds up to make up for lost time."""

    def __init__(self, rate: float) -> None:
        self._period = 1.0 / rate
        self._due = time.monotonic()

    def wait(self, timeout: float) -> float:
        """Wait until the next frame is due, and return time.monotonic() then.

        Raises NoFrameYet when it is not due within `timeout` seconds.
        """
        left = self._due - time.monotonic()
        if left > 0:
            time.sleep(min(left, timeout))
        if left > timeout:
            raise NoFrameYet(f"the next picture is due in {left - timeout:.1f} s: read again")
        now = time.monotonic()
        fell_behind = now - self._due >= self._period
        self._due = self._period + (now if fell_behind else self._due)
        return now
