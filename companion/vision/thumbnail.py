"""A judged frame as a picture of 1.5 kB: whole, so that fractions of it are fractions of the frame."""

from __future__ import annotations

from typing import TYPE_CHECKING

from anytraverse.assessment import Assessment
from anytraverse.frame import Image
from anytraverse.regions import Box, Region

if TYPE_CHECKING:
    from anytraverse.drawing import Colour

LIMIT = 1500
"""Bytes: 19 short frames, a second or two on a radio."""
WIDTHS = (160, 128, 96)
"""Pixels. A narrower picture shows more than a coarser one."""
FAIR = 25
_FINEST, _COARSEST = 90, 5


def thumbnail(seen: Assessment, region: Region, limit: int = LIMIT) -> bytes:
    """JPEG of at most `limit` bytes. White: the ROI. Yellow: its worst tile, where something is unknown.

    The widest whose quality is fair, else the narrowest. Raises ValueError where even that is too long,
    ImportError without OpenCV.
    """
    for width in WIDTHS:
        coarsest = _COARSEST if width == WIDTHS[-1] else FAIR
        found = _finest(_marked(seen, region, width), coarsest, limit)
        if found is not None:
            return found
    raise ValueError(f"no picture fits {limit} bytes")


def _marked(seen: Assessment, region: Region, width: int) -> Image:
    from anytraverse.drawing import INK, PAPER, YELLOW, fitted
    from anytraverse.panel import looks_unsure

    picture = fitted(seen.frame.image, width)
    _frame(picture, region.bounds, PAPER)
    if seen.tile is not None and looks_unsure(seen):
        _frame(picture, seen.tile.box, INK, around=2)
        _frame(picture, seen.tile.box, YELLOW, around=1)
    return picture


def _frame(picture: Image, box: Box, colour: Colour, around: int = 0) -> None:
    """One pixel wide, `around` pixels outside of `box`: what it points at stays free."""
    import cv2

    height, width = picture.shape[:2]
    first = round(box.left * (width - 1)) - around, round(box.top * (height - 1)) - around
    last = round(box.right * (width - 1)) + around, round(box.bottom * (height - 1)) + around
    cv2.rectangle(picture, first, last, colour, 1)


def _finest(picture: Image, coarsest: int, limit: int) -> bytes | None:
    """The best quality that fits, by halving; None when not even the coarsest does."""
    best = _encoded(picture, coarsest)
    if len(best) > limit:
        return None
    low, high = coarsest, _FINEST
    while low < high:
        middle = (low + high + 1) // 2
        tried = _encoded(picture, middle)
        if len(tried) <= limit:
            low, best = middle, tried
        else:
            high = middle - 1
    return best


def _encoded(picture: Image, quality: int) -> bytes:
    import cv2

    options = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_OPTIMIZE, 1]
    done, encoded = cv2.imencode(".jpg", picture[..., ::-1], options)
    if not done:
        raise ValueError("the picture could not be encoded")
    return encoded.tobytes()
