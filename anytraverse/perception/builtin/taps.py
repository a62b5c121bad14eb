"""Learns a tapped thing from one box and finds it again, by exemplar LDA on the network's features.

Method: Hariharan, Malik and Ramanan, Discriminative decorrelation for clustering and classification (2012):
background statistics are learnt once, so that one example is enough.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import ExampleError
from anytraverse.frame import Image
from anytraverse.perception.builtin.calibration import Calibration, Floats
from anytraverse.perception.builtin.network import Outputs
from anytraverse.regions import Box

Mask = NDArray[np.bool_]

COLOURS = 5
"""Count of the colour and texture values appended to the network's features."""
_DIM = 0.08  # share of the mean light added to all channels: it damps sensor noise in dark ratios
_FLAT = 0.03  # local contrast below which all surfaces count as equally smooth
_LEAST_CELLS = 3
_PURE = 0.5  # share of the box's cells, the most similar ones, taken as the thing; the rest is background
_STRANGE, _STRANGEST = 0.3, 0.9  # a box holds something strange when its quantile 0.9 is at least 0.3
_LOWEST, _HIGHEST = 0.35, 0.8  # limits of the score's threshold; 0 is the background, 1 the tapped thing
_BACKGROUND = 0.99  # quantile of the background's scores in the tapped frame, to stay below the threshold
_BETWEEN = 0.5  # position of the threshold between that quantile (0) and the thing (1)
_SOFT = 0.06  # width of the logistic step at the score's threshold
_LIKENESS = 0.95  # share of the cosine that most cells of the thing have; other things have a lower one
_ALMOST_ALL = 0.3  # quantile of the cosines of the thing's cells that stands for "most"
_SOFT_LIKENESS = 0.03  # width of the logistic step at the cosine's threshold
_AROUND = (13, 13)  # cells that vote: 52 pixels of the network's input, three cells of its coarsest features
_VOTES = 0.1  # share of the strange cells among them that must have been found
_SOFT_VOTES = 0.02  # width of the logistic step at that share

VIEWS: tuple[tuple[float, float, float], ...] = (
    (1.0, 1.0, 1.0),
    (0.55, 0.55, 0.55),
    (0.75, 0.75, 0.75),
    (1.5, 1.5, 1.5),
    (1.15, 1.0, 0.85),
    (0.85, 1.0, 1.15),
)
"""Gains of red, green and blue with which a tapped frame is encoded, so that its light does not count."""


def changed_views(image: Image) -> list[Image]:
    """Return the tapped frame in the light of each of `VIEWS`; the box is the same in all of them."""
    return [np.asarray(np.clip(image * np.asarray(gains), 0, 255), dtype=np.uint8) for gains in VIEWS]


def tap_cells(outputs: Outputs, frame: Floats) -> Floats:
    """Join features and colours, (h, w, T): the decoder's (D, h, w), the backbone's at stride 8, and colours.

    frame: the network's input, (1, 3, H, W).

    The colours are log R/G, log of yellow over blue, log of light over the frame's mean, and the log of the
    contrast within a cell and around it.
    """
    size = outputs.features.shape[2], outputs.features.shape[1]
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
    eighth = np.ascontiguousarray(outputs.eighth.transpose(1, 2, 0))
    textures = cv2.resize(eighth, size, interpolation=cv2.INTER_LINEAR)
    return np.concatenate([outputs.features.transpose(1, 2, 0), textures, colours], axis=-1, dtype=np.float32)


def learn_tap(
    views: Sequence[Floats], box: Box, calibration: Calibration, strange: Floats | None = None
) -> Floats:
    """Learn what the box shows, (T + 2,): a direction w and two thresholds, for whitened cells z.

    The first threshold, on w z, tells the thing from the background. The second, on the cosine of w and z,
    tells it from other things that differ as much from the background.
    views: `tap_cells` of the frame's `changed_views`. strange: how little the named classes explain each
    cell, (h, w) in [0, 1]. Raises ExampleError when the box is too small.
    """
    inside = box.mask(*views[0].shape[:2])
    if inside.sum() < _LEAST_CELLS:
        raise ExampleError("the box is too small to learn from: draw a larger one around the thing")
    if strange is not None:
        inside = strange_part(inside, strange)
    whites = [whitened(cells, calibration) for cells in views]
    direction = _direction(np.mean([white[inside].mean(axis=0) for white in whites], axis=0))
    alike = np.mean([white[inside] @ direction for white in whites], axis=0)
    pure = alike >= np.quantile(alike, 1 - _PURE)
    direction = _direction(np.mean([white[inside][pure].mean(axis=0) for white in whites], axis=0))
    outside = ~box.grown(1.5).mask(*inside.shape)
    scores = [white[outside] @ direction for white in whites]
    background = float(np.quantile(np.concatenate(scores), _BACKGROUND)) if outside.any() else _LOWEST
    threshold = np.clip(background + _BETWEEN * (1.0 - background), _LOWEST, _HIGHEST)
    cosines = np.concatenate([_cosine(white[inside][pure], direction) for white in whites])
    least = _LIKENESS * np.quantile(cosines, _ALMOST_ALL)
    return np.array([*direction, threshold, least], dtype=np.float32)


def strange_part(inside: Mask, strange: Floats) -> Mask:
    """Return the strange part of the box; the whole box where nothing in it is strange.

    In a box with known ground and something strange, the strange part is what the operator meant.
    """
    most = float(np.quantile(strange[inside], _STRANGEST))
    part: Mask = inside & (strange >= 0.5 * most)
    return part if most >= _STRANGE and part.sum() >= _LEAST_CELLS else inside


def likeness(white: Floats, example: NDArray[np.float32]) -> Floats:
    """Calculate how surely each whitened cell shows the same as this example, (h, w) in [0, 1]."""
    direction, threshold, least = example[:-2], example[-2], example[-1]
    surely = _step((white @ direction - threshold) / _SOFT)
    surely *= _step((_cosine(white, direction) - least) / _SOFT_LIKENESS)
    return surely


def whole_thing(found: Floats, strange: Floats) -> Floats:
    """Extend what was found over the rest of the thing, (h, w) in [0, 1]: a vote among strange cells.

    A strange cell belongs to the thing where enough of the strange cells around it were found: parts of a
    thing differ in look, and the backbone's coarse features make a rim of ground around it strange, too. Both
    would call again and again.
    """
    votes = cv2.blur(found * strange, _AROUND, borderType=cv2.BORDER_CONSTANT)
    cells = cv2.blur(strange, _AROUND, borderType=cv2.BORDER_CONSTANT)
    share: Floats = np.asarray(votes / np.maximum(cells, 1e-3), dtype=np.float32)
    surely = _step((share - _VOTES) / _SOFT_VOTES)
    return np.asarray(np.maximum(found, strange * surely), dtype=np.float32)


def _step(x: Floats) -> Floats:
    """Calculate the logistic function."""
    return np.asarray(1 / (1 + np.exp(np.clip(-x, -30, 30))), dtype=np.float32)


def _cosine(white: Floats, direction: Floats) -> Floats:
    lengths = np.linalg.norm(white, axis=-1) * np.linalg.norm(direction)
    return np.asarray(white @ direction / np.maximum(lengths, 1e-6), dtype=np.float32)


def whitened(cells: Floats, calibration: Calibration) -> Floats:
    """Whiten cells, (h, w, T): the background then has the same spread in every direction."""
    return np.asarray((cells - calibration.tap_mean) @ calibration.tap_whitening, dtype=np.float32)


def _direction(mean: Floats) -> Floats:
    """Scale a direction so that the mean itself scores 1 and the background's mean 0."""
    return np.asarray(mean / max(float(mean @ mean), 1e-6), dtype=np.float32)
