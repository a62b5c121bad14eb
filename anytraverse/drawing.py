"""Draws text, lines and colour maps. Pictures are RGB uint8; functions that return None draw in place.

The colours can be told apart by people with red-green blindness, and by lightness in a grey print.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.frame import Image
from anytraverse.regions import Region

Colour = tuple[int, int, int]
Map = NDArray[np.float32]

PAPER: Colour = (255, 255, 255)
INK: Colour = (33, 37, 41)
FAINT: Colour = (110, 117, 125)
GREEN: Colour = (0, 158, 115)
VERMILION: Colour = (213, 94, 0)
VIOLET: Colour = (126, 47, 190)
AMBER: Colour = (230, 159, 0)
YELLOW: Colour = (255, 225, 60)

SIGNED_STOPS: tuple[Colour, ...] = (
    (178, 68, 0),
    (224, 125, 50),
    (244, 243, 238),
    (60, 176, 140),
    (0, 122, 90),
)
UNCERTAINTY_STOPS: tuple[Colour, ...] = ((250, 249, 252), (198, 176, 226), (142, 84, 196), (66, 10, 104))
ATTENTION_STOPS: tuple[Colour, ...] = (
    (13, 22, 48),
    (40, 70, 120),
    (86, 120, 140),
    (178, 170, 110),
    (255, 233, 92),
)


def write(
    canvas: Image, text: str, at: tuple[int, int], size: int = 14, colour: Colour = INK, *, bold: bool = False
) -> None:
    """Write text with its baseline at `at` (x, y), `size` pixels high."""
    if _has_fonts():
        cv2.putText(canvas, text, at, colour, _font(), size, 700 if bold else 400)
    else:
        plain = text.encode("ascii", "replace").decode()
        cv2.putText(canvas, plain, at, _HERSHEY, _hershey_scale(size), colour, 1 + bold, cv2.LINE_AA)


def text_width(text: str, size: int = 14, *, bold: bool = False) -> int:
    """Return the width of a text in pixels."""
    if _has_fonts():
        left, _, width, _ = cv2.getTextSize((1, 1), text, (0, 0), _font(), size, 700 if bold else 400)
        return int(left + width)
    return int(cv2.getTextSize(text, _HERSHEY, _hershey_scale(size), 1 + bold)[0][0])


def shortened(text: str, width: int, size: int = 14, *, bold: bool = False) -> str:
    """Return `text`, cut and with an ellipsis where it would be wider than `width` pixels."""
    if text_width(text, size, bold=bold) <= width:
        return text
    while text and text_width(text + "...", size, bold=bold) > width:
        text = text[:-1]
    return text.rstrip() + "..."


_HERSHEY = cv2.FONT_HERSHEY_SIMPLEX


def _has_fonts() -> bool:
    """Return whether OpenCV draws TrueType fonts, as version 5 does; 4 has only Hershey strokes."""
    return hasattr(cv2, "FontFace")


def _font() -> Any:
    return cv2.FontFace("sans")


def _hershey_scale(size: int) -> float:
    return size / 30


def readable_on(colour: Colour) -> Colour:
    """Return the text's colour that is readable on `colour`."""
    return INK if np.dot(colour, (0.299, 0.587, 0.114)) > 150 or colour == AMBER else PAPER


def ramp(stops: tuple[Colour, ...]) -> Image:
    """Interpolate 256 colours between evenly spaced stops, (256, 3)."""
    places = np.linspace(0, 255, len(stops))
    channels = [np.interp(np.arange(256), places, [stop[c] for stop in stops]) for c in range(3)]
    return np.stack(channels, axis=1).round().astype(np.uint8)


def coloured(values: Map, stops: tuple[Colour, ...], low: float, high: float) -> Image:
    """Return a map in colours, (h, w, 3). Values that are not finite become grey."""
    scaled = (np.nan_to_num(values.astype(np.float32), nan=low) - low) / (high - low)
    picture = ramp(stops)[(scaled.clip(0, 1) * 255).round().astype(np.uint8)]
    picture[~np.isfinite(values)] = FAINT
    return picture


def enlarged(values: Map, width: int, height: int) -> Map:
    """Enlarge a map to the size of a picture, with bicubic interpolation."""
    return np.asarray(cv2.resize(values, (width, height), interpolation=cv2.INTER_CUBIC), dtype=np.float32)


def fitted(image: Image, width: int) -> Image:
    """Resize an image to `width` pixels and keep its aspect, but at most three times as high as wide."""
    height = max(1, min(3 * width, round(image.shape[0] * width / image.shape[1])))
    shrinks = width < image.shape[1]
    method = cv2.INTER_AREA if shrinks else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(image, (width, height), interpolation=method), dtype=np.uint8)


def corner_pixels(canvas: Image, region: Region) -> NDArray[np.int32]:
    """Return the columns and rows of a region's corners, (4, 2); far outside of the canvas they are cut."""
    height, width = canvas.shape[:2]
    places = np.clip(region.corners, -10, 10)
    return np.asarray(np.rint(np.multiply(places, (width - 1, height - 1))), np.int32)


def outline(canvas: Image, region: Region, colour: Colour, thickness: int = 2) -> None:
    """Draw a region with a dark rim, which makes it visible on any background."""
    corners = corner_pixels(canvas, region)
    cv2.polylines(canvas, [corners], True, (20, 20, 20), thickness + 2, cv2.LINE_AA)  # noqa: FBT003
    cv2.polylines(canvas, [corners], True, colour, thickness, cv2.LINE_AA)  # noqa: FBT003


@lru_cache(maxsize=8)
def hatching(height: int, width: int, step: int = 7) -> NDArray[np.bool_]:
    """Return a mask of diagonal stripes, (height, width), which is not to be changed."""
    rows, columns = np.ogrid[:height, :width]
    stripes: NDArray[np.bool_] = (rows + columns) % step < max(2, step // 3)
    stripes.flags.writeable = False
    return stripes


def tint(canvas: Image, colour: Colour, strength: NDArray[np.floating]) -> None:
    """Blend a colour into the canvas; strength: (h, w), in [0, 1]."""
    if not canvas.size:  # OpenCV would return None
        return
    share = strength.clip(0, 1).astype(np.float32, copy=False)
    plain = cv2.resize(np.array([[colour]], np.uint8), canvas.shape[1::-1], interpolation=cv2.INTER_NEAREST)
    canvas[:] = cv2.blendLinear(np.ascontiguousarray(canvas), plain, 1 - share, share)


def write_png(path: str, picture: Image) -> None:
    """Write a picture as a PNG file. Raises OSError."""
    done, data = cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
    if not done:
        raise OSError("the picture cannot be encoded as PNG")
    with open(path, "wb") as file:
        file.write(data.tobytes())
