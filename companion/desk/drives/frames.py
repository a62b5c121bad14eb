"""Opens a drive: a folder of pictures, a video, or a recording."""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import AnyTraverseError
from anytraverse.frame import Image
from anytraverse.look import read_picture
from companion.cameras import CameraError, split_source
from companion.cameras.folder import pictures
from companion.cameras.shown import shown
from companion.cameras.video import open_video, own_rate
from companion.desk.drives.drive import Drive, DriveError, DriveFrame, printable
from companion.desk.drives.recorded import RecordedDrive


def open_drive(where: str, rate: float) -> Drive:
    """Open a drive: a folder of pictures, a video, or a recording (a file or a folder of files *.mcap).

    "folder:PATH" and "video:PATH" name the kind.

    rate: frames per second of a folder, and those that are taken of a video, as a camera would deliver them.
    Raises DriveError.
    """
    kind, path = located(where)
    if is_recording(path):
        return RecordedDrive(path)
    try:
        if kind == "folder":
            return _Folder(path, rate)
        if kind == "video":
            return _Video(path, rate)
    except CameraError as error:
        raise DriveError(str(error).removesuffix(": check [camera] source")) from error
    raise DriveError(f"{shown(where)} is no drive: give a folder of pictures, a video file, or a recording")


def located(where: str) -> tuple[str, Path]:
    """Return the kind of a drive, "folder" or "video" or as it is named, and its absolute path.

    Raises DriveError.
    """
    path = Path(where).expanduser()
    kind = "folder" if path.is_dir() else "video"
    if not path.exists() and ":" in where:
        try:
            kind, place = split_source(where)
        except CameraError as error:
            raise DriveError(str(error)) from error
        path = Path(place).expanduser()
    return kind, Path(os.path.abspath(path))


def is_recording(path: Path) -> bool:
    """Whether this is a companion's recording: a file *.mcap, or a folder with some."""
    return path.suffix == ".mcap" or (path.is_dir() and any(path.glob("*.mcap")))


class _Folder:
    """Pictures in name order."""

    def __init__(self, folder: Path, rate: float) -> None:
        self._pictures = pictures(folder)
        self._period = 1.0 / rate
        self.title, self.count = printable(folder.name), len(self._pictures)

    def frames(self) -> Iterator[DriveFrame]:
        for number, path in enumerate(self._pictures, 1):
            yield DriveFrame(printable(path.name), number * self._period, partial(_read, path))


class _Video:
    """The frames of a video that OpenCV decodes, thinned out to a rate."""

    def __init__(self, path: Path, rate: float) -> None:
        if not path.is_file():
            raise DriveError(f"{path} is no folder, and no video: give one that is there")
        video = self._video = open_video(path)
        self._own_rate = own_rate(video)
        self._rate = min(rate, self._own_rate)
        announced = max(0.0, float(video.get(cv2.CAP_PROP_FRAME_COUNT)))
        self.title, self.count = printable(path.name), round(announced * self._rate / self._own_rate)

    def frames(self) -> Iterator[DriveFrame]:
        number = taken = 0
        while self._video.grab():
            at = number / self._own_rate
            number += 1
            if at * self._rate < taken - 1e-6:
                continue
            taken += 1
            ok, picture = self._video.retrieve()
            decode = partial(_rgb, picture if ok else None)
            yield DriveFrame(f"{at:.2f} s", at + 1.0 / self._rate, decode)
        self._video.release()


def _rgb(picture: NDArray[Any] | None) -> Image | None:
    return None if picture is None else np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), np.uint8)


def _read(path: Path) -> Image | None:
    try:
        return read_picture(str(path))
    except (OSError, AnyTraverseError):
        return None
