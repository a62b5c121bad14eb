"""Decodes picture files after checking the size in their header: a small file can hold a huge picture."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from anytraverse.picture_size import picture_size

MAX_PIXELS = 50_000_000
"""Width times height; decoded in colour this takes 150 MB."""
MAX_BYTES = 200_000_000
"""The largest file that is decoded."""


class PictureTooLargeError(ValueError):
    """Reports a picture of more than MAX_PIXELS, or a file of more than MAX_BYTES."""


def decode(content: bytes, flags: int | None = None) -> NDArray[Any] | None:
    """Decode a PNG, JPEG, BMP, WebP or TIFF file with OpenCV: BGR of 8 bits unless `flags` say otherwise.

    flags: of cv2.imdecode. Returns None for another kind of file, or a damaged one.
    Raises PictureTooLargeError, and ImportError without OpenCV.
    """
    import cv2

    if len(content) > MAX_BYTES:
        raise PictureTooLargeError(f"the file is over {MAX_BYTES // 1_000_000} MB: make the picture smaller")
    size = picture_size(content)
    if size is None:
        return None
    check_size(*size)
    try:
        picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR if flags is None else flags)
    except cv2.error:
        return None
    return picture


def check_size(width: int, height: int) -> None:
    """Raise PictureTooLargeError for more than MAX_PIXELS."""
    if width * height > MAX_PIXELS:
        most = MAX_PIXELS // 1_000_000
        raise PictureTooLargeError(
            f"{width} x {height} pixels, and at most {most} million are decoded: make the picture smaller"
        )
