"""Tapped things: a box on a frame becomes a word of its own, by exemplar LDA on the network's features.

After Hariharan, Malik and Ramanan, Discriminative decorrelation for clustering and classification (2012):
background statistics are learnt once, so that one example is enough.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import ExampleError
from anytraverse.frame import Image
from anytraverse.perception.builtin.network import Calibration, Floats
from anytraverse.regions import Box

Mask = NDArray[np.bool_]

COLOURS = 5
"""Numbers about colour and texture that are added to the network's features."""
_DIM = 0.08  # of the mean light: what ratios of dark pixels are damped by, against sensor noise
_FLAT = 0.03  # local contrast below which everything is equally smooth
_LEAST_CELLS = 3
_PURE = 0.5  # of the box's cells, those most alike, are the thing: a box holds some background too
_STRANGE, _STRANGEST = 0.3, 0.9  # a box holds something strange when a tenth of it is stranger than this
_LOWEST, _HIGHEST = 0.35, 0.8  # between which the threshold stays: 0 is background, 1 the tapped thing itself
_BACKGROUND = 0.99  # quantile of the tapped frame's background that must stay below the threshold
_BETWEEN = 0.4  # of the way from that background to the thing lies the threshold
_SOFT = 0.06
_LIKENESS = 0.92  # of the cosine that most cells of the thing reach: below lie other things
_ALMOST_ALL = 0.3  # quantile of the thing's cells that is meant by most
_SOFT_LIKENESS = 0.03

VIEWS: tuple[tuple[float, float, float], ...] = (
    (1.0, 1.0, 1.0),
    (0.55, 0.55, 0.55),
    (0.75, 0.75, 0.75),
    (1.5, 1.5, 1.5),
    (1.15, 1.0, 0.85),
    (0.85, 1.0, 1.15),
)
"""Gains of red, green and blue under which a tapped frame is looked at again: light must not count."""


def changed_views(image: Image) -> list[Image]:
    """The tapped frame in six lights; the box is the same in all of them."""
    return [np.asarray(np.clip(image * np.asarray(gains), 0, 255), dtype=np.uint8) for gains in VIEWS]


def tap_cells(features: Floats, frame: Floats) -> Floats:
    """Features and colours, (h, w, T) from features (D, h, w) and the network's input (1, 3, H, W).

    Colours: log R/G, log of yellow over blue, log of light over the frame's mean, contrast within a cell and
    around it.
    """
    size = features.shape[2], features.shape[1]
    pixels = np.ascontiguousarray(frame[0].transpose(1, 2, 0))
    mean = float(pixels.mean()) + 1.0
    dim = _DIM * mean
    small = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
    red, green, blue = np.moveaxis(np.log(small + dim), 2, 0)
    tones = cv2.log(cv2.transform(pixels, np.full((1, 3), 1 / 3, dtype=np.float32)) + dim)
    local = cv2.resize(tones, size, interpolation=cv2.INTER_AREA)
    squares = cv2.resize(tones * tones, size, interpolation=cv2.INTER_AREA)
    around = cv2.blur(local, (5, 5))
    fine = np.log(np.maximum(squares - local * local, 0.0) + _FLAT**2)
    coarse = np.log(np.maximum(cv2.blur(local * local, (5, 5)) - around * around, 0.0) + _FLAT**2)
    light = np.log(small.mean(axis=2) + dim) - np.log(mean + dim)
    colours = np.stack([red - green, (red + green) / 2 - blue, light, 0.5 * fine, 0.5 * coarse], axis=-1)
    return np.concatenate([features.transpose(1, 2, 0), colours], axis=-1).astype(np.float32)


def learn_tap(
    views: Sequence[Floats], box: Box, calibration: Calibration, strange: Floats | None = None
) -> Floats:
    """What the box shows, (T + 2,): a direction w, and thresholds on w z and on the cosine of w and z, of
    whitened cells z. The first tells the thing from the background, the second from other things that are
    as far from the background.

    views: `tap_cells` of the frame's `changed_views`. strange: how little is known of each cell by name,
    (h, w) in [0, 1]. Raises ExampleError when the box is too small.
    """
    inside = box.mask(*views[0].shape[:2])
    if inside.sum() < _LEAST_CELLS:
        raise ExampleError("the box is too small to learn from: draw a larger one around the thing")
    if strange is not None:
        inside = _strange_part(inside, strange)
    whites = [whitened(cells, calibration) for cells in views]
    direction = _direction(np.mean([white[inside].mean(axis=0) for white in whites], axis=0))
    alike = np.mean([white[inside] @ direction for white in whites], axis=0)
    pure = alike >= np.quantile(alike, 1 - _PURE)
    direction = _direction(np.mean([white[inside][pure].mean(axis=0) for white in whites], axis=0))
    outside = ~box.grown(0.5).mask(*inside.shape)
    scores = [white[outside] @ direction for white in whites]
    background = float(np.quantile(np.concatenate(scores), _BACKGROUND)) if outside.any() else _LOWEST
    threshold = np.clip(background + _BETWEEN * (1.0 - background), _LOWEST, _HIGHEST)
    cosines = np.concatenate([_cosine(white[inside][pure], direction) for white in whites])
    least = _LIKENESS * np.quantile(cosines, _ALMOST_ALL)
    return np.array([*direction, threshold, least], dtype=np.float32)


def _strange_part(inside: Mask, strange: Floats) -> Mask:
    """Where a box holds something strange beside known ground, that is what was meant."""
    most = float(np.quantile(strange[inside], _STRANGEST))
    part: Mask = inside & (strange >= 0.5 * most)
    return part if most >= _STRANGE and part.sum() >= _LEAST_CELLS else inside


def tap_attention(cells: Floats, examples: Sequence[NDArray[np.float32]], calibration: Calibration) -> Floats:
    """How surely each cell is what was tapped, (h, w) in [0, 1]; of several examples the best counts."""
    white = whitened(cells, calibration)
    found = np.zeros(cells.shape[:2], dtype=np.float32)
    for example in examples:
        np.maximum(found, likeness(white, example), out=found)
    return found


def likeness(white: Floats, example: NDArray[np.float32]) -> Floats:
    """How surely each whitened cell is what this one example shows, (h, w) in [0, 1]."""
    direction, threshold, least = example[:-2], example[-2], example[-1]
    surely = _step((white @ direction - threshold) / _SOFT)
    surely *= _step((_cosine(white, direction) - least) / _SOFT_LIKENESS)
    return surely


def _step(x: Floats) -> Floats:
    """From 0 to 1 around 0."""
    return np.asarray(1 / (1 + np.exp(np.clip(-x, -30, 30))), dtype=np.float32)


def _cosine(white: Floats, direction: Floats) -> Floats:
    lengths = np.linalg.norm(white, axis=-1) * np.linalg.norm(direction)
    return np.asarray(white @ direction / np.maximum(lengths, 1e-6), dtype=np.float32)


def whitened(cells: Floats, calibration: Calibration) -> Floats:
    """Cells (h, w, T) in which the background is of equal spread in every direction."""
    return np.asarray((cells - calibration.tap_mean) @ calibration.tap_whitening, dtype=np.float32)


def _direction(mean: Floats) -> Floats:
    """Scaled so that the mean itself scores 1 and the background's mean 0."""
    return np.asarray(mean / max(float(mean @ mean), 1e-6), dtype=np.float32)
