"""Converts pictures to linear light and back, and filters it."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.frame import Image

Light = NDArray[np.float32]
"""Linear light, (height, width, 3), or one figure a pixel, (height, width); 1 for white."""

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)
"""The shares of red, green and blue light in the luminance (sRGB)."""

_CODES = np.arange(256) / 255
_LINEAR = np.where(_CODES <= 0.04045, _CODES / 12.92, ((_CODES + 0.055) / 1.055) ** 2.4).astype(np.float32)
_STEPS = 16384
_LEVELS = np.arange(_STEPS) / (_STEPS - 1)
_CODED = np.rint(
    255 * np.where(_LEVELS <= 0.0031308, 12.92 * _LEVELS, 1.055 * _LEVELS ** (1 / 2.4) - 0.055)
).astype(np.uint8)


def linear(image: Image) -> Light:
    """Return a picture's linear light, [0, 1]."""
    return np.asarray(_LINEAR[image], dtype=np.float32)


def coded(light: Light) -> Image:
    """Return the picture of linear light; what is brighter than 1 is clipped."""
    steps = (np.clip(light, 0.0, 1.0) * np.float32(_STEPS - 1) + np.float32(0.5)).astype(np.uint16)
    return np.asarray(_CODED[steps], dtype=np.uint8)


def blurred(light: Light, sigma: float) -> Light:
    """Blur by a Gaussian; sigma in pixels."""
    soft = cv2.GaussianBlur(light, (0, 0), sigma)
    return np.asarray(soft, dtype=np.float32).reshape(light.shape)


def filtered(light: Light, kernel: Light) -> Light:
    """Filter with a kernel, (n, n); beyond the edge the picture goes on as it ends."""
    soft = cv2.filter2D(light, -1, kernel, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(soft, dtype=np.float32).reshape(light.shape)


def line(length: int, angle: float) -> Light:
    """Return a filter that smears along a line; length in pixels, angle in degrees."""
    side = length | 1
    kernel = np.zeros((side, side), dtype=np.float32)
    half, middle = (length - 1) / 2, side // 2
    dx, dy = half * math.cos(math.radians(angle)), half * math.sin(math.radians(angle))
    ends = [(round(16 * (middle + way * dx)), round(16 * (middle + way * dy))) for way in (-1, 1)]
    cv2.line(kernel, ends[0], ends[1], 1.0, 1, cv2.LINE_AA, 4)
    return np.asarray(kernel / kernel.sum(), dtype=np.float32)
