"""Pictures of the things: painted once by seed, kept at every scale, drawn into a frame with soft edges."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from companion.field import plants, wares
from companion.field.tiles import Bytes, Colour

_PAINTERS: dict[str, tuple[int, Callable[[np.random.Generator, int], plants.Picture]]] = {
    "bush": (4, plants.bush),
    "tree": (5, plants.tree),
    "tuft": (6, plants.tuft),
    "drum": (3, wares.drum),
    "rock": (2, wares.rock),
    "log": (2, wares.log),
}


@dataclass(frozen=True)
class Sprite:
    """A thing's picture: RGBA with colour times alpha, largest first, each scale half the one before."""

    scales: tuple[Bytes, ...]
    wide: float  # of the thing's diameter (a log: of its length) that the picture spans
    high: float  # of the thing's height

    def draw(
        self,
        frame: Bytes,
        foot: tuple[float, float],
        size: tuple[float, float],
        light: float,
        haze: Colour,
        clear: float,
    ) -> tuple[tuple[slice, slice], Bytes] | None:
        """Blend the picture over a frame: `foot` (column, row) and `size` (wide, high) in pixels.

        `light` dims it, and of its colour `clear` (0..1) is left, the rest is `haze`.
        Returns where it lies in the frame and its opacity there (0..255), or None when it lies outside.
        """
        import cv2

        wide, high = size[0] * self.wide, size[1] * self.high
        left, top = foot[0] - wide / 2, foot[1] - high
        x0, x1 = max(0, math.floor(left)), min(frame.shape[1], math.ceil(left + wide) + 1)
        y0, y1 = max(0, math.floor(top)), min(frame.shape[0], math.ceil(foot[1]) + 1)
        if x1 <= x0 or y1 <= y0 or min(wide, high) < 1.2:
            return None
        scale = next((small for small in self.scales[::-1] if small.shape[0] >= high), self.scales[0])
        matrix = np.array([[wide / scale.shape[1], 0, left - x0], [0, high / scale.shape[0], top - y0]])
        warped = cv2.warpAffine(scale, matrix, (x1 - x0, y1 - y0), flags=cv2.INTER_LINEAR)
        patch = np.asarray(warped, np.uint8)
        shown = np.zeros((3, 4))
        shown[:, :3] = np.eye(3) * light * clear
        shown[:, 3] = (1 - clear) * np.asarray(haze) / 255
        hidden = np.array([[0.0, 0, 0, -1, 255]] * 3)
        into = frame[y0:y1, x0:x1]
        behind = cv2.multiply(into, cv2.transform(patch, hidden), scale=1 / 255)
        into[:] = cv2.add(behind, cv2.transform(patch, shown))
        return (slice(y0, y1), slice(x0, x1)), patch[..., 3]


def paint_all(seed: int) -> dict[str, tuple[Sprite, ...]]:
    """The pictures of all kinds of things, one a look."""
    return {
        kind: tuple(paint(kind, look, seed) for look in range(looks))
        for kind, (looks, _) in _PAINTERS.items()
    }


@lru_cache(maxsize=128)
def paint(kind: str, look: int, seed: int) -> Sprite:
    """The picture of a kind of thing in one of its looks, counted from 0."""
    import cv2

    rng = np.random.default_rng([seed, 30, list(_PAINTERS).index(kind), look])
    picture, wide, high = _PAINTERS[kind][1](rng, look)
    rgba = picture.astype(np.float32)
    rgba[..., :3] *= rgba[..., 3:] / 255
    scales = [rgba]
    while min(scales[-1].shape[:2]) > 3:
        rows, columns = scales[-1].shape[:2]
        smaller = cv2.resize(scales[-1], (columns // 2, rows // 2), interpolation=cv2.INTER_AREA)
        scales.append(np.asarray(smaller, np.float32))
    return Sprite(tuple(scale.astype(np.uint8) for scale in scales), wide, high)
