"""Draws the surfaces of pasted things: paint, stripes, bark, pieces of the frame, and their shading."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.frame import Image

Rng = np.random.Generator
Floats = NDArray[np.float32]


def surface(shape: tuple[int, int], source: Image, rng: Rng, *, across: bool) -> Floats:
    """Draw a surface, RGB 0 to 255: paint, stripes, patches, or a piece of the frame in other colours.

    across: it may have a colour of the ground's, as a trunk has, and streaks along it, as bark.
    """
    rows, columns = shape
    colour = _scene_colour(source, rng) if across and rng.random() < 0.4 else _colour(rng)
    kind = rng.random()
    if kind < 0.35:
        drawn = np.broadcast_to(colour, (rows, columns, 3)).astype(np.float32)
    elif kind < 0.5:
        period, angle = rng.uniform(3, 30), rng.uniform(0, math.pi)
        y, x = np.mgrid[:rows, :columns]
        wave = np.sin((x * math.cos(angle) + y * math.sin(angle)) * 2 * math.pi / period + rng.uniform(0, 6))
        share = np.clip(wave * rng.uniform(1, 8) * 0.5 + 0.5, 0, 1)[..., None]
        drawn = (share * colour + (1 - share) * _colour(rng)).astype(np.float32)
    elif kind < 0.7:
        lumps = int(rng.integers(2, 7)), int(rng.integers(2, 7 if not across else max(7, columns // 8)))
        coarse = rng.uniform(size=lumps).astype(np.float32)
        how = cv2.INTER_NEAREST if rng.random() < 0.5 else cv2.INTER_CUBIC
        share = np.clip(np.asarray(cv2.resize(coarse, (columns, rows), interpolation=how)), 0, 1)[..., None]
        other = colour * np.float32(rng.uniform(0.2, 0.8)) if across and rng.random() < 0.5 else _colour(rng)
        drawn = (share * colour + (1 - share) * other).astype(np.float32)
    else:
        drawn = _borrowed(shape, source, rng)
    grain = rng.standard_normal((rows, columns, 1), dtype=np.float32) * np.float32(rng.uniform(0, 0.12))
    if rng.random() < 0.5:
        grain = np.asarray(cv2.GaussianBlur(grain, (0, 0), 1.2), dtype=np.float32)[..., None] * 2
    return np.asarray(drawn * (1 + grain), dtype=np.float32)


def recoloured(colours: NDArray[np.uint8], rng: Rng) -> Floats:
    """Change the colours of a thing: paler or grey, tinted, lighter or darker; RGB 0 to 255."""
    drawn: Floats = colours.astype(np.float32)
    if rng.random() < 0.5:
        grey = drawn.mean(axis=2, keepdims=True)
        drawn = grey + np.float32(rng.uniform(0.0, 1.3)) * (drawn - grey)
    if rng.random() < 0.5:
        drawn = drawn * np.exp(rng.normal(0, 0.25, 3)).astype(np.float32)
    contrast = np.float32(math.exp(rng.normal(0, 0.2)))
    mean = np.float32(drawn.mean())
    return np.asarray(mean + contrast * (drawn - mean), dtype=np.float32)


def relief(shape: tuple[int, int], rng: Rng) -> Floats:
    """Draw the shading of a body: round from side to side and from above, or flat."""
    rows, columns = shape
    if rng.random() < 0.3:
        return np.ones(shape, dtype=np.float32)
    across = np.linspace(-1, 1, columns) - rng.uniform(-0.6, 0.6)
    down = np.linspace(-1, 1, rows) - rng.uniform(-0.8, 0.2)
    round_x, round_y = rng.uniform(0, 0.6), rng.uniform(0, 0.4)
    relief = 1.1 - round_x * across[None] ** 2 - round_y * down[:, None] ** 2
    return np.asarray(relief.clip(0.15), dtype=np.float32)


def _borrowed(shape: tuple[int, int], source: Image, rng: Rng) -> Floats:
    """Copy a piece of the frame at another scale, with changed colours: swapped, negative or tinted."""
    rows, columns = shape
    high, wide = (int(rng.integers(8, side)) for side in source.shape[:2])
    top, left = int(rng.integers(0, source.shape[0] - high)), int(rng.integers(0, source.shape[1] - wide))
    there = source[top : top + high, left : left + wide]
    piece = cv2.resize(there, (columns, rows), interpolation=cv2.INTER_AREA)
    order = rng.permutation([1, 2, 0] if rng.random() < 0.5 else [2, 0, 1])
    drawn: Floats = np.asarray(piece, dtype=np.float32)[..., order]
    if rng.random() < 0.4:
        drawn = 255 - drawn
    painted = drawn.mean(axis=2, keepdims=True) * _colour(rng) / 128
    return np.asarray(0.5 * drawn + 0.5 * painted, dtype=np.float32)


def _scene_colour(source: Image, rng: Rng) -> Floats:
    """Draw a colour that is not far from one of the lower half of the frame, as wood is from earth, (3,)."""
    rows, columns = source.shape[:2]
    seen = source[int(rng.integers(rows // 2, rows)), int(rng.integers(columns))].astype(np.float32)
    return np.asarray(seen * np.exp(rng.normal(0, 0.3) + rng.normal(0, 0.2, 3)), dtype=np.float32)


def _colour(rng: Rng) -> Floats:
    """Draw any colour: vivid, pale, grey, black or white. RGB 0 to 255, (3,)."""
    hue, value = rng.uniform(0, 180), 255 * rng.beta(1.3, 1.1)
    vivid = 255 * (rng.beta(2, 1) if rng.random() < 0.6 else rng.beta(1, 4))
    pixel = np.array([[[hue, vivid, value]]]).astype(np.uint8)
    return np.asarray(cv2.cvtColor(pixel, cv2.COLOR_HSV2RGB)[0, 0], dtype=np.float32)
