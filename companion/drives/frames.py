"""Reads the frames of a drive, none left out, with their times: from a folder of pictures or a video."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, Protocol

import cv2
import numpy as np

from anytraverse.errors import AnyTraverseError
from anytraverse.frame import Image
from anytraverse.look import read_picture
from companion.cameras import CameraError, split_source
from companion.cameras.folder import pictures

_USUAL_RATE = 30.0
_HIGHEST_RATE = 240.0


class DriveError(Exception):
    """Reports a drive that cannot be read. The text says what to do."""


class DriveFrame(NamedTuple):
    """A frame. name: of its file, or its time in a video. at: seconds of the drive.

    image: RGB (height, width, 3) uint8; None where it is torn.
    """

    name: str
    at: float
    image: Image | None


class Drive(Protocol):
    """A drive. title: for a person. count: how many frames it has, about."""

    title: str
    count: int

    def frames(self) -> Iterator[DriveFrame]:
        """Read all frames in their order."""
        ...


def open_drive(where: str, rate: float) -> Drive:
    """Open a drive: a folder of pictures, or a video; "folder:PATH" and "video:PATH" name the kind.

    rate: frames per second of a folder, and those that are taken of a video, as a camera would deliver them.
    Raises DriveError.
    """
    path = Path(where).expanduser()
    kind = "folder" if path.is_dir() else "video"
    if not path.exists() and ":" in where:
        kind, place = split_source(where)
        path = Path(place).expanduser()
    try:
        if kind == "folder":
            return _Folder(path, rate)
        if kind == "video":
            return _Video(path, rate)
    except CameraError as error:
        raise DriveError(str(error).removesuffix(": check [camera] source")) from error
    raise DriveError(f"{where} is no drive: give a folder of pictures, or a video file")


class _Folder:
    """Pictures in name order."""

    def __init__(self, folder: Path, rate: float) -> None:
        self._pictures = pictures(folder)
        self._period = 1.0 / rate
        self.title, self.count = folder.name, len(self._pictures)

    def frames(self) -> Iterator[DriveFrame]:
        for number, path in enumerate(self._pictures, 1):
            try:
                image = read_picture(str(path))
            except (OSError, AnyTraverseError):
                image = None
            yield DriveFrame(path.name, number * self._period, image)


class _Video:
    """The frames of a video that OpenCV decodes, thinned out to a rate."""

    def __init__(self, path: Path, rate: float) -> None:
        video = self._video = cv2.VideoCapture(str(path))
        if not path.is_file() or not video.isOpened():
            raise DriveError(f"{path} is no folder, and no video that can be decoded: try to play it")
        own = float(video.get(cv2.CAP_PROP_FPS))
        self._own_rate = own if math.isfinite(own) and 0.0 < own <= _HIGHEST_RATE else _USUAL_RATE
        self._rate = min(rate, self._own_rate)
        announced = max(0.0, float(video.get(cv2.CAP_PROP_FRAME_COUNT)))
        self.title, self.count = path.name, round(announced * self._rate / self._own_rate)

    def frames(self) -> Iterator[DriveFrame]:
        number = taken = 0
        while self._video.grab():
            at = number / self._own_rate
            number += 1
            if at * self._rate < taken - 1e-6:
                continue
            taken += 1
            ok, picture = self._video.retrieve()
            image = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), np.uint8) if ok else None
            yield DriveFrame(f"{at:.2f} s", at + 1.0 / self._rate, image)
        self._video.release()
