"""Pastes cut-outs into frames as a camera of a stated mount would see them at a distance.

A pinhole over level ground: what stands at `distance` has its foot on the row that `GroundCamera.row` tells,
and its top on the row of a camera that is mounted lower by the thing's height.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.frame import Image
from anytraverse.ground import GroundCamera
from anytraverse.regions import Box

HEIGHT, VIEW, TILT = 0.5, 70.0, 0.0
"""The mount: metres above the ground; degrees of horizontal view, and of the axis below the horizon."""
_BRIGHTNESS = 110.0
"""Mean brightness of a photograph that was well exposed, of 255."""
_ADAPTED = 0.8
"""Exponent by which a thing's light follows that of the frame's ground."""
_TINTED = 0.35
"""Likewise for its tint."""
_SHADOW = 0.45
"""Share of the light that a contact shadow takes where it is darkest."""
_SOFT = 4
"""Pixels around a thing over which its edge is soft."""

Floats = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Cutout:
    """Holds a picture of a thing, RGBA (h, w, 4) uint8, and how it is placed.

    height: metres of what stands, or the depth along the ground of what lies flat. source: where it is from.
    """

    picture: NDArray[np.uint8]
    height: float
    source: str
    flat: bool = False

    @property
    def width(self) -> float:
        """Metres across."""
        return self.height * int(self.picture.shape[1]) / int(self.picture.shape[0])


def covered(shape: tuple[int, ...], cutout: Cutout, distance: float, aside: float, bounds: Box) -> float:
    """Return the share of a region's bounds that the thing's box covers in a frame of this shape."""
    box = pasted_box(shape, cutout, distance, aside)
    wide = min(box.right, bounds.right) - max(box.left, bounds.left)
    high = min(box.bottom, bounds.bottom) - max(box.top, bounds.top)
    area = (bounds.right - bounds.left) * (bounds.bottom - bounds.top)
    return float(max(0.0, wide) * max(0.0, high) / area)


def pasted_box(shape: tuple[int, ...], cutout: Cutout, distance: float, aside: float) -> Box:
    """Return the box of what is seen of the thing. Raises RegionError where nothing is."""
    corners = _corners(shape, cutout, distance, aside) / (shape[1], shape[0])
    (left, top), (right, bottom) = np.clip((corners.min(axis=0), corners.max(axis=0)), 0.0, 1.0)
    return Box(float(left), float(top), float(right), float(bottom))


def paste(image: Image, cutout: Cutout, distance: float, aside: float) -> Image:
    """Return the frame with the thing `distance` metres ahead and `aside` metres to the right of the middle.

    It is lit and tinted like the frame's ground, its edges are soft, and it has a shadow where it stands.
    """
    rows, columns = image.shape[:2]
    corners = _corners(image.shape, cutout, distance, aside)
    half = (corners[2, 0] - corners[3, 0]) / 2
    (left, top), (right, bottom) = corners.min(axis=0), corners.max(axis=0)
    left, right = math.floor(left - _SOFT - half), math.ceil(right + _SOFT + half)
    top, bottom = math.floor(top - _SOFT), math.ceil(bottom + _SOFT + 2 * _low(corners))
    x0, x1, y0, y1 = max(0, left), min(columns, right), max(0, top), min(rows, bottom)
    if x1 <= x0 or y1 <= y0:
        return image
    high, wide = cutout.picture.shape[:2]
    shown = max(1.0, min(corners[2, 0] - corners[3, 0], columns)), max(1.0, corners[3, 1] - corners[0, 1])
    source = _premultiplied(cutout.picture)
    if (scale := max(shown[0] / wide, shown[1] / high)) < 1.0:
        size = max(1, round(wide * scale)), max(1, round(high * scale))
        source = np.asarray(cv2.resize(source, size, interpolation=cv2.INTER_AREA), dtype=np.float32)
    high, wide = source.shape[:2]
    full = np.array([(0, 0), (wide, 0), (wide, high), (0, high)], dtype=np.float32)
    matrix = cv2.getPerspectiveTransform(full, (corners - (x0, y0)).astype(np.float32))
    patch = cv2.warpPerspective(source, matrix, (x1 - x0, y1 - y0), flags=cv2.INTER_LINEAR)
    patch = cv2.GaussianBlur(patch, (0, 0), 0.6)
    alpha = patch[..., 3:] / 255
    into = image[y0:y1, x0:x1].astype(np.float32)
    if not cutout.flat:
        into *= 1 - _SHADOW * _shadow(into.shape, corners - (x0, y0))[..., None]
    lit = patch[..., :3] * _light(image)
    out = image.copy()
    out[y0:y1, x0:x1] = np.clip(into * (1 - alpha) + lit, 0, 255).astype(np.uint8)
    return out


def _corners(shape: tuple[int, ...], cutout: Cutout, distance: float, aside: float) -> NDArray[np.float64]:
    """Return the picture's corners in the frame, in pixels: from the upper left clockwise, (4, 2)."""
    rows, columns = shape[:2]
    camera = GroundCamera.pinhole(HEIGHT, TILT, VIEW, columns / rows)
    if cutout.flat:
        near, far = (_across(distance + d, cutout, aside) for d in (0.0, cutout.height))
        below, above = camera.row(distance), camera.row(distance + cutout.height)
    else:
        near = far = _across(distance, cutout, aside)
        below, above = camera.row(distance), replace(camera, height=HEIGHT - cutout.height).row(distance)
    size = columns, rows
    return np.array([(far[0], above), (far[1], above), (near[1], below), (near[0], below)]) * size


def _across(distance: float, cutout: Cutout, aside: float) -> tuple[float, float]:
    """Return the thing's left and right in fractions of the frame's width."""
    per_metre = 0.5 / math.tan(math.radians(VIEW / 2)) / distance
    return 0.5 + (aside - cutout.width / 2) * per_metre, 0.5 + (aside + cutout.width / 2) * per_metre


def _premultiplied(picture: NDArray[np.uint8]) -> Floats:
    values = picture.astype(np.float32)
    values[..., :3] *= values[..., 3:] / 255
    return values


def _light(image: Image) -> Floats:
    """Return the gain of each channel by which a thing is lit like the lower half of the frame."""
    ground = image[image.shape[0] // 2 :: 4, ::4].reshape(-1, 3).mean(axis=0) + 1.0
    gain = np.clip((ground.mean() / _BRIGHTNESS) ** _ADAPTED, 0.3, 1.7)
    whole = image[::4, ::4].reshape(-1, 3).mean(axis=0) + 1.0
    return np.asarray(gain * (whole / whole.mean()) ** _TINTED, dtype=np.float32)


def _shadow(shape: tuple[int, ...], corners: NDArray[np.float64]) -> Floats:
    """Return how dark the ground is below a thing, (h, w) in [0, 1]: an ellipse around its foot."""
    foot = (corners[2] + corners[3]) / 2
    wide = max(1.0, (corners[2, 0] - corners[3, 0]) / 2)
    low = max(1.0, _low(corners))
    x, y = np.arange(shape[1]) - foot[0], np.arange(shape[0]) - foot[1]
    reach = (x[None, :] / wide) ** 2 + (y[:, None] / low) ** 2
    return np.asarray(np.exp(-(reach**2)), dtype=np.float32)


def _low(corners: NDArray[np.float64]) -> float:
    """Return how many pixels a contact shadow reaches below a thing's foot."""
    width, height = corners[2, 0] - corners[3, 0], corners[3, 1] - corners[0, 1]
    return float(min(0.11 * width, 0.12 * height))
