"""Painted plants: bushes, trees and tufts of grass, as RGBA pictures with the ground at their lower edge."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from companion.field.tiles import Bytes, Colour, blank, noise

Picture = tuple[Bytes, float, float]  # RGBA; how much of the thing's diameter and of its height it spans


def _foliage(
    rng: np.random.Generator,
    picture: Bytes,
    clumps: NDArray[np.float64],
    leaves: int,
    dark: Colour,
    bright: Colour,
    size: tuple[float, float],
) -> None:
    """Leaves in clumps (x, y, radius in pixels), brighter to the upper left of each, inside out."""
    import cv2

    weights = clumps[:, 2] ** 2 / (clumps[:, 2] ** 2).sum()
    clump = clumps[rng.choice(len(clumps), leaves, p=weights)]
    angle, reach = rng.uniform(0, 2 * np.pi, leaves), np.sqrt(rng.uniform(0, 1, leaves))
    dx, dy = np.cos(angle) * reach, np.sin(angle) * reach
    light = np.clip(0.45 - 0.25 * dx - 0.4 * dy + rng.normal(0, 0.17, leaves), 0, 1)
    light *= 1 - 0.35 * clump[:, 1] / picture.shape[0]
    order = np.argsort(reach * 0.3 + light + rng.uniform(0, 0.5, leaves))
    colours = np.asarray(dark) + light[:, None] * (np.asarray(bright) - np.asarray(dark))
    for i in order:
        centre = int(clump[i, 0] + dx[i] * clump[i, 2]), int(clump[i, 1] + dy[i] * clump[i, 2])
        long = rng.uniform(*size)
        colour = (*(int(c) for c in colours[i]), 255)
        cv2.ellipse(
            picture, centre, (int(long), int(long * 0.55) + 1), float(rng.uniform(0, 180)), 0, 360, colour, -1
        )


def bush(rng: np.random.Generator, look: int) -> Picture:
    picture = blank(224, 256)
    x, y = rng.uniform(50, 206, 9), rng.uniform(70, 190, 9)
    y += np.abs(x - 128) * 0.25
    clumps = np.stack([x, np.minimum(y, 180), rng.uniform(28, 48, 9)], axis=1)
    clumps = np.vstack([clumps, [[128, 150, 68], [84, 176, 44], [172, 176, 44]]])
    bright = ((96, 128, 62), (84, 120, 52), (118, 136, 66), (78, 112, 60))[look]
    _foliage(rng, picture, clumps, 1500, (18, 32, 16), bright, (3.0, 7.0))
    return picture, 1.15, 1.05


def tree(rng: np.random.Generator, look: int) -> Picture:
    """A trunk that leaves the ground a fifteenth of the picture's width wide, and a crown above it."""
    import cv2

    rows, columns = 640, 320
    picture = blank(rows, columns)
    bark = ((84, 70, 56), (98, 88, 76), (70, 58, 46), (110, 98, 84), (90, 78, 66))[look]
    lean = rng.uniform(-12, 12)
    foot, top = np.array([160.0, rows - 1]), np.array([160.0 + lean, 150.0])
    outline = np.array(
        [foot - (15, 0), foot - (10, 40), top - (4, 0), top - (-4, 0), foot - (-10, 40), foot - (-15, 0)]
    )
    cv2.fillPoly(picture, [outline.astype(np.int32)], (*bark, 255))
    for _ in range(7):
        start = foot + (top - foot) * rng.uniform(0.4, 0.9)
        end = start + np.array([rng.choice([-1, 1]) * rng.uniform(40, 100), -rng.uniform(30, 90)])
        cv2.line(
            picture, tuple(map(int, start)), tuple(map(int, end)), (*(int(c * 0.8) for c in bark), 255), 4
        )
    across = np.clip((np.arange(columns) - 160) / 16, -1, 1)[None, :, None]
    grain = (
        noise(rng, rows, columns, 2, 60)[..., None] * 0.1
        + noise(rng, 1, columns, 2, 8)[0][None, :, None] * 0.14
    )
    shaded = picture[..., :3] * np.clip(1 - 0.35 * across + grain, 0.4, 1.5)
    picture[..., :3] = np.clip(shaded, 0, 255).astype(np.uint8)

    count = 22
    low = (330, 290, 390, 270, 350)[look]
    y = rng.uniform(46, low, count)
    spread = 24 + 84 * np.sin(np.clip((y - 10) / (low + 30), 0, 1) * np.pi) ** 0.8
    clumps = np.stack(
        [160 + lean + rng.uniform(-1, 1, count) * spread, y, rng.uniform(20, 50, count)], axis=1
    )
    bright = ((92, 122, 52), (110, 130, 58), (80, 112, 50), (124, 132, 60), (88, 114, 62))[look]
    _foliage(rng, picture, clumps, 2600, (20, 34, 16), bright, (2.5, 7.0))
    return picture, 320 / 30, 1.0


def tuft(rng: np.random.Generator, look: int) -> Picture:
    """Blades that spread from one foot: green (0, 1), dark fern (2, 3), straw (4, 5)."""
    import cv2

    rows, columns, blades = 96, 120, 70
    picture = blank(rows, columns)
    dark, bright = (
        ((50, 78, 24), (126, 152, 68)),
        ((26, 42, 18), (76, 100, 46)),
        ((118, 106, 66), (196, 182, 126)),
    )[look // 2]
    reach, tall = rng.normal(0, 22, blades), rng.uniform(0.35, 1.0, blades) * (rows - 6)
    part = np.linspace(0, 1, 7)[:, None]
    for i in np.argsort(-tall):
        foot = 60 + rng.normal(0, 7)
        curve = np.hstack(
            [foot + reach[i] * part**1.8, rows - 1 - tall[i] * (part - 0.25 * part**3 * abs(reach[i]) / 40)]
        )
        colour = np.asarray(dark) + rng.uniform(0.1, 1.0) * (np.asarray(bright) - np.asarray(dark))
        thick = 4 if look // 2 == 1 else 2
        cv2.polylines(picture, [curve.astype(np.int32)], False, (*(int(c) for c in colour), 255), thick)  # noqa: FBT003
    return picture, 1.0, 1.0
