"""Plays a folder of pictures in name order, at a fixed rate: `folder:PATH`."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from anytraverse.decoding import MAX_BYTES, PictureTooLargeError, decode
from anytraverse.regular_file import read_regular
from companion.cameras import BadFrame, CameraError, CameraOptions, Capture, EndOfFrames
from companion.cameras.video import PlaybackPace

_PHOTOS = {".jpg", ".jpeg"}
SUFFIXES = _PHOTOS | {".png", ".bmp", ".webp", ".tif", ".tiff"}
_USUAL_RATE = 10.0


def pictures(folder: Path) -> list[Path]:
    """List the frames of a folder in name order.

    Leaves out hidden files, and each png that has a jpg of the same stem: data sets store labels that way.
    Raises CameraError when the folder cannot be read or holds no picture.
    """
    try:
        names = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
    except OSError as error:
        raise CameraError(
            f"folder {folder} cannot be read ({error.strerror}): check [camera] source"
        ) from error
    found = [path for path in names if path.suffix.lower() in SUFFIXES]
    photos = {path.stem for path in found if path.suffix.lower() in _PHOTOS}
    frames = [path for path in found if path.suffix.lower() != ".png" or path.stem not in photos]
    if not frames:
        raise CameraError(f"folder {folder} holds no picture: jpg, png, bmp, webp and tiff are read")
    return frames


class PictureFolder:
    """Delivers pictures at `rate`, by default 10 a second. `captured_at` is the time when a picture was due.

    With `loop`, the folder is listed again at the start of each lap.
    """

    def __init__(self, place: str, options: CameraOptions) -> None:
        self._folder = Path(os.path.expanduser(place)).absolute()
        self._loop = options.loop
        self._pace = PlaybackPace(options.playback or _USUAL_RATE)
        self._frames: Iterator[Path] = iter(pictures(self._folder))

    def read(self, timeout: float) -> Capture:
        now = self._pace.wait(timeout)
        path = next(self._frames, None)
        if path is None:
            if not self._loop:
                raise EndOfFrames(f"the last picture of {self._folder} was read")
            self._frames = iter(pictures(self._folder))
            path = next(self._frames)
        try:
            picture = decode(read_regular(path, MAX_BYTES + 1))
        except OSError as error:
            raise BadFrame(f"{path} cannot be read ({error}): mend or remove it") from error
        except PictureTooLargeError as error:
            raise BadFrame(f"{path}: {error}") from error
        if picture is None:
            raise BadFrame(f"{path} is torn or no picture: mend or remove it")
        return Capture(now, np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), np.uint8))

    def close(self) -> None:
        """Do nothing: no file stays open between two reads."""
