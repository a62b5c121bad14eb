"""Measures colour, light, roughness and height at each point of a frame, for the lexicon perceiver.

The measurements hardly change with the exposure: colours are ratios of channels, and light is relative to
the frame's own median.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.frame import Image

FEATURES = ("redness", "yellowness", "light", "roughness", "height")
"""redness: log R/G. yellowness: log of (R, G mean)/B. light: log of luminance over the frame's median.
roughness: log of the local contrast of log luminance. height: 0 at the image's top edge, 1 at its bottom."""

LOOK = slice(0, 4)
"""The features that do not depend on where in the image a thing is: all but height."""

GRID = 96  # cells along the image's longer side
_DETAIL = 2  # pixels along a cell's side at which roughness is measured
_WINDOW = 7  # pixels across, over which roughness is measured
_DIM = 0.08  # share of the median luminance added to all channels: it damps sensor noise in dark ratios
_FLAT = 0.03  # local contrast below which all surfaces count as equally smooth

Grid = NDArray[np.float32]


def ground_features(image: Image) -> Grid:
    """Measure FEATURES on a grid of the image's aspect, (h, w, 5) float32; the longer side has 96 cells."""
    height, width = grid_shape(*image.shape[:2])
    size = width * _DETAIL, height * _DETAIL
    detailed = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    averaged = cv2.resize(detailed, (width, height), interpolation=cv2.INTER_AREA).astype(np.float32)
    colours = cv2.GaussianBlur(averaged, (3, 3), 0).reshape(height, width, 3)
    luminance = cv2.transform(colours, _MEAN).reshape(height, width)
    median = float(np.median(luminance)) + 1.0
    dim = _DIM * median + 1.0
    red, green, blue = cv2.split(cv2.log(colours + dim))
    features = np.empty((height, width, len(FEATURES)), dtype=np.float32)
    features[..., 0] = red - green
    features[..., 1] = (red + green) / 2 - blue
    features[..., 2] = cv2.log(luminance + dim).reshape(height, width) - np.log(median + dim)
    features[..., 3] = _roughness(detailed, dim, (width, height))
    features[..., 4] = ((np.arange(height, dtype=np.float32) + 0.5) / height)[:, None]
    return features


def grid_shape(height: int, width: int) -> tuple[int, int]:
    """Return the (rows, columns) of the grid for an image of this size in pixels."""
    scale = GRID / max(height, width)
    return max(1, round(height * scale)), max(1, round(width * scale))


_MEAN = np.full((1, 3), 1 / 3, dtype=np.float32)


def _roughness(detailed: Image, dim: float, size: tuple[int, int]) -> Grid:
    """Measure the log of the local standard deviation of log luminance; size: (width, height) of the grid."""
    tones = cv2.log(cv2.transform(detailed.astype(np.float32), _MEAN) + dim)
    mean = cv2.blur(tones, (_WINDOW, _WINDOW))
    variance = cv2.blur(tones * tones, (_WINDOW, _WINDOW)) - mean * mean
    variance = cv2.resize(np.maximum(variance, 0.0), size, interpolation=cv2.INTER_AREA)
    return np.asarray(0.5 * np.log(variance + _FLAT**2), dtype=np.float32).reshape(size[1], size[0])
