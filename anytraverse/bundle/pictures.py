"""Reads the frames for a bundle's check from a folder of pictures or a video, one at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from anytraverse.decoding import PictureTooLargeError, check_size
from anytraverse.errors import PerceiverError
from anytraverse.frame import Image
from anytraverse.look import PictureError, read_picture
from anytraverse.release import to_install

MOST_FRAMES = 200
SUFFIXES = (".jpg", ".jpeg", ".png")


def frames_of(path: Path, say: Callable[[str], None]) -> Iterator[Image]:
    """Yield at most `MOST_FRAMES` RGB pictures, (height, width, 3) uint8, spread evenly over `path`.

    Pictures of a folder come in the order of their names; those that cannot be read are reported to `say` and
    skipped. Raises PictureError when none can be read, PerceiverError without OpenCV.
    """
    if not path.exists():
        raise PictureError(f"{path} does not exist: give a folder of JPEG or PNG pictures, or a video")
    frames = _pictures(path, say) if path.is_dir() else _video(path)
    first = next(frames, None)
    if first is None:
        raise PictureError(f"{path} holds no picture that can be read: give JPEG or PNG pictures, or a video")
    yield first
    yield from frames


def spread(count: int, most: int = MOST_FRAMES) -> list[int]:
    """Choose at most `most` of the numbers below `count`, evenly spread, in rising order."""
    if count <= most:
        return list(range(count))
    return [int(index) for index in np.linspace(0, count - 1, most).round()]


def _pictures(folder: Path, say: Callable[[str], None]) -> Iterator[Image]:
    files = sorted(file for file in folder.iterdir() if file.suffix.lower() in SUFFIXES)
    for index in spread(len(files)):
        picture = _picture(files[index])
        if picture is None:
            say(f"{files[index].name}: not a picture that can be read, skipped")
        else:
            yield picture


def _picture(file: Path) -> Image | None:
    try:
        return read_picture(str(file))
    except (PictureError, OSError):
        return None


def _video(path: Path) -> Iterator[Image]:
    try:
        import cv2
    except ImportError:
        raise PerceiverError(f"reading videos needs OpenCV: {to_install('rover')}") from None
    video = cv2.VideoCapture(str(path))
    try:
        try:
            check_size(int(video.get(cv2.CAP_PROP_FRAME_WIDTH)), int(video.get(cv2.CAP_PROP_FRAME_HEIGHT)))
        except PictureTooLargeError as error:
            raise PictureError(f"{path}: {error}") from error
        count = int(min(video.get(cv2.CAP_PROP_FRAME_COUNT), 1e7))
        wanted = set(spread(count)) if count > 0 else set(range(MOST_FRAMES))
        for index in range(max(wanted, default=-1) + 1):
            if not video.grab():
                return
            if index in wanted:
                good, picture = video.retrieve()
                if good:
                    yield np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), dtype=np.uint8)
    finally:
        video.release()
