"""Paints beds of stones and puddles into frames: ground that must not be driven, as wide as the way."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.frame import Image
from anytraverse.training.classes import CLASSES, GROUND, UNKNOWN
from anytraverse.training.folders import Labels

Rng = np.random.Generator

_PLANT, _GRASS = CLASSES.index("low vegetation"), CLASSES.index("grass")
_ROUGH = CLASSES.index("rough trail")
_WATER = CLASSES.index("water")

_BROWN = np.array([[1.12, 0.98, 0.8], [1.05, 1.0, 0.9], [1.25, 0.88, 0.65], [1.0, 1.0, 1.0]])
_GREEN = np.array([[0.8, 1.1, 0.5], [0.95, 1.1, 0.6], [0.6, 0.85, 0.4]])
"""Colours of dry leaves and of grass: red, green and blue over the ground's light."""


def paste_stones(picture: Image, names: Labels, rng: Rng) -> None:
    """Paint a bed of stones as large as a wheel, or a heap; it is labelled as a thing without a name.

    They are painted from far to near over the dark between them, larger the nearer they lie.
    """
    rows, columns = names.shape
    region = _patch((rows, columns), rng, high=(0.08, 0.4), wide=(0.2, 1.2))
    bottom = int(np.flatnonzero(region.any(axis=1))[-1]) if region.any() else 0
    if bottom < 0.3 * rows:
        return
    level = float(picture[region].mean()) / 255
    grey, tint = rng.uniform(0.5, 1.4), np.exp(rng.normal(0, 0.07, 3) + np.array([0.05, 0.0, -0.05]))
    base = 255 * np.clip(level * grey, 0.1, 0.9) * tint
    largest = rows * math.exp(rng.uniform(math.log(0.06), math.log(0.2)))
    horizon = rng.uniform(0.1, 0.35) * rows
    layer = picture.copy()
    layer[region] = (rng.uniform(0.3, 0.9) * picture[region]).astype(np.uint8)
    count = int(np.clip(3.0 * region.sum() / (largest * 0.5) ** 2, 8, 400))
    at = np.argwhere(region)[np.sort(rng.integers(0, int(region.sum()), count))]
    for y, x in at:
        size = largest * max(0.3, _nearness(y, horizon, bottom)) * math.exp(rng.normal(-0.3, 0.4))
        colour = np.clip(base * math.exp(rng.normal(0, 0.2)), 0, 255)
        _stone(layer, (float(x), float(y)), max(1.5, size), colour, rng)
    layer = np.asarray(cv2.GaussianBlur(layer, (3, 3), 0.6), dtype=np.uint8)
    painted = (np.abs(layer.astype(np.int16) - picture).max(axis=2) > 8) | region
    picture[painted] = layer[painted]
    names[painted] = UNKNOWN


def strew(picture: Image, names: Labels, rng: Rng) -> None:
    """Strew leaves, twigs or chips over a patch of ground, which keeps its name, or let grass grow there.

    They teach that a rough or ragged surface alone makes no stones: leaves and blades have no body.
    """
    rows, columns = names.shape
    region = _patch((rows, columns), rng, high=(0.15, 0.8), wide=(0.4, 2.0)) & np.isin(names, GROUND)
    if region.sum() < 50:
        return
    horizon, bottom = rng.uniform(0.1, 0.35) * rows, int(np.flatnonzero(region.any(axis=1))[-1])
    largest = rows * math.exp(rng.uniform(math.log(0.02), math.log(0.08)))
    level = float(picture[region].mean())
    grows = rng.random() < 0.4
    kinds = _GREEN if grows else _BROWN[rng.integers(0, len(_BROWN), 3)]
    long = rng.uniform(1.2, 2.2) if rng.random() < 0.7 and not grows else rng.uniform(3.0, 8.0)
    spread = rng.uniform(0.15, 0.5)
    layer = picture.copy()
    count = int(np.clip(rng.uniform(0.4, 2.5) * region.sum() / (0.5 * largest) ** 2, 20, 1500))
    at = np.argwhere(region)[np.sort(rng.integers(0, int(region.sum()), count))]
    for y, x in at:
        size = largest * max(0.25, _nearness(y, horizon, bottom)) * math.exp(rng.normal(-0.2, 0.3))
        colour = np.clip(level * kinds[rng.integers(3)] * math.exp(rng.normal(0, spread)), 0, 255)
        axes = max(8, round(8 * size)), max(6, round(8 * size / long * rng.uniform(0.5, 1.0)))
        centre = round(16 * float(x)), round(16 * float(y))
        cv2.ellipse(
            layer, centre, axes, float(rng.uniform(0, 180)), 0, 360, tuple(colour), -1, cv2.LINE_AA, 4
        )
    layer = np.asarray(cv2.GaussianBlur(layer, (3, 3), 0.5), dtype=np.uint8)
    ground = cv2.dilate(region.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    picture[ground] = layer[ground]
    names[region] = np.where(grows | (names[region] == _PLANT), _GRASS if grows else _ROUGH, names[region])


def paste_puddle(picture: Image, names: Labels, rng: Rng) -> None:
    """Paint a puddle, which mirrors what stands behind it or shows mud, and label it as water."""
    rows, columns = names.shape
    region = _patch((rows, columns), rng, high=(0.03, 0.18), wide=(0.15, 0.9))
    lines = np.flatnonzero(region.any(axis=1))
    if not len(lines):
        return
    far = int(lines[0])
    mirrored = np.clip(2 * far - np.arange(rows), 0, rows - 1)
    mirror = cv2.GaussianBlur(picture[mirrored].astype(np.float32), (0, 0), rng.uniform(0.5, 3.0))
    mud = picture[region].mean(axis=0) * rng.uniform(0.5, 1.2) * np.exp(rng.normal(0, 0.08, 3))
    share = np.float32(rng.uniform(0.2, 0.95))
    surface = share * rng.uniform(0.5, 1.0) * mirror + (1 - share) * mud.astype(np.float32)
    ripples = rng.normal(0, 1, (rows, 1, 1)).astype(np.float32) * np.float32(rng.uniform(0, 3))
    soft = cv2.GaussianBlur(region.astype(np.float32), (0, 0), rng.uniform(0.5, 1.5))[..., None]
    mixed = picture * (1 - soft) + (surface + ripples) * soft
    picture[:] = np.clip(mixed, 0, 255).astype(np.uint8)
    names[region] = _WATER


def _nearness(y: float, horizon: float, bottom: float) -> float:
    """Return how large things look in row y: 1 at the bottom, 0 at the horizon."""
    return (y - horizon) / max(bottom - horizon, 1.0)


def _patch(
    shape: tuple[int, int], rng: Rng, high: tuple[float, float], wide: tuple[float, float]
) -> NDArray[np.bool_]:
    """Draw a flat patch with a ragged edge, mostly in the lower half, (rows, columns) bool."""
    rows, columns = shape
    tall = rows * math.exp(rng.uniform(math.log(high[0]), math.log(high[1])))
    across = columns * math.exp(rng.uniform(math.log(wide[0]), math.log(wide[1])))
    foot = np.clip(rng.normal(0.8, 0.15), 0.45, 1.1) * rows
    middle = rng.uniform(0.1, 0.9) * columns
    angles = np.linspace(0, 2 * math.pi, 36, endpoint=False)
    reach = 1 + 0.35 * np.asarray(cv2.GaussianBlur(rng.normal(0, 1, (36 * 3, 1)), (0, 0), 2.5))[36:72, 0] * 2
    x = middle + 0.5 * across * reach * np.cos(angles)
    y = foot - tall / 2 + 0.5 * tall * reach * np.sin(angles)
    mask = np.zeros(shape, dtype=np.uint8)
    cv2.fillPoly(mask, [np.stack([x, y], axis=1).round().astype(np.int32)], 1)
    return mask > 0


def _stone(layer: Image, at: tuple[float, float], size: float, colour: NDArray[np.float64], rng: Rng) -> None:
    """Paint one stone with a shadow below, a body and a lighter top."""
    count = int(rng.integers(6, 10))
    angles = np.sort(rng.uniform(0, 2 * math.pi, count))
    outline = np.stack([np.cos(angles), 0.75 * np.sin(angles)], axis=1) * rng.uniform(0.7, 1.0, (count, 1))
    turn = rng.normal(0, 0.5)
    c, s = math.cos(turn), math.sin(turn)
    outline = outline @ np.array([[c, s], [-s, c]]) * size / 2
    for shift, scale, light in ((0.12, 1.05, 0.4), (0.0, 1.0, 0.8), (-0.08, 0.7, 1.1)):
        corners = np.array(at) + scale * outline + (0, shift * size)
        points = np.round(corners * 16).astype(np.int32)
        cv2.fillConvexPoly(
            layer, cv2.convexHull(points), tuple(np.clip(colour * light, 0, 255)), cv2.LINE_AA, 4
        )
