"""Frames as PNG, without loss."""

from __future__ import annotations

import numpy as np

from anytraverse.decoding import decode
from anytraverse.frame import Image, is_image


def to_png(image: Image) -> bytes:
    """Raises ValueError for what is no RGB picture, ImportError without OpenCV."""
    import cv2

    if not is_image(image):
        raise ValueError("not an RGB picture of 8 bits a channel")
    done, encoded = cv2.imencode(".png", image[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 1])
    if not done:
        raise ValueError("the picture cannot be encoded")
    return encoded.tobytes()


def from_png(content: bytes) -> Image:
    """Raises ValueError for what is no picture or one too large, ImportError without OpenCV."""
    picture = decode(content)
    if picture is None:
        raise ValueError("the picture is torn")
    return np.ascontiguousarray(picture[..., ::-1], np.uint8)
