"""Lists the pixel formats of raw pictures by FFmpeg's names, and turns such pictures into RGB."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from anytraverse.decoding import check_size
from anytraverse.frame import Image


class PixelFormat(NamedTuple):
    """Describes a raw picture of 8 bits a sample.

    samples: bytes for two pixels. conversion: OpenCV's name of the conversion to RGB, "" for none.
    fourcc: what V4L2 calls it. halved: whether width and height must be even.
    """

    samples: int
    conversion: str
    fourcc: str
    halved: bool = False


PIXEL_FORMATS = {
    "rgb24": PixelFormat(6, "", "RGB3"),
    "bgr24": PixelFormat(6, "COLOR_BGR2RGB", "BGR3"),
    "gray": PixelFormat(2, "COLOR_GRAY2RGB", "GREY"),
    "yuv420p": PixelFormat(3, "COLOR_YUV2RGB_I420", "YU12", halved=True),
    "nv12": PixelFormat(3, "COLOR_YUV2RGB_NV12", "NV12", halved=True),
    "yuyv422": PixelFormat(4, "COLOR_YUV2RGB_YUYV", "YUYV", halved=True),
    "uyvy422": PixelFormat(4, "COLOR_YUV2RGB_UYVY", "UYVY", halved=True),
}
MJPEG = "mjpeg"
"""A compressed format, which a V4L2 device may deliver, and which has no fixed number of bytes."""


def frame_bytes(name: str | None, width: int | None, height: int | None) -> int:
    """Return the bytes of a raw picture.

    Raises ValueError where one of the three is missing, and for a size that is too large or that the format
    cannot have.
    """
    form = PIXEL_FORMATS.get(name or "")
    if form is None or width is None or height is None:
        known = ", ".join(PIXEL_FORMATS)
        raise ValueError(f"a pipe needs [camera] width, height and pixel_format, one of {known}")
    check_size(width, height)
    if form.halved and (width % 2 or height % 2):
        raise ValueError(f"{name} has an even width and height, not {width} x {height}")
    return form.samples * width * height // 2


def to_rgb(raw: NDArray[np.uint8], name: str, width: int, height: int) -> Image:
    """Turn a raw picture, `frame_bytes` uint8 in a row, into RGB: (height, width, 3) uint8.

    For rgb24 the result shares its memory with `raw`.
    """
    form = PIXEL_FORMATS[name]
    if not form.conversion:
        return raw.reshape(height, width, 3)
    import cv2

    shape = {2: (height, width), 3: (height * 3 // 2, width), 4: (height, width, 2), 6: (height, width, 3)}
    return np.asarray(cv2.cvtColor(raw.reshape(shape[form.samples]), getattr(cv2, form.conversion)), np.uint8)
