"""Shows frames in a low sun, hard shadows, fog and rain, as `degrade` names them.

The ground is a plane 1 m below the camera. Its horizon lies at `HORIZON` of the picture's height.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from anytraverse.evaluation.light import Light, blurred, coded, filtered, line, linear
from anytraverse.frame import Image

Rng = np.random.Generator

HORIZON = 0.4
"""The row of the horizon, 0 top, 1 bottom."""
VIEW = 60.0
"""Degrees that the picture is taken to show from left to right."""


def glare(image: Image, rng: Rng, veil: float = 0.9) -> Image:
    """A low sun outside of the picture, at an upper side: veiling light, flare, and a shorter exposure.

    veil: its share of white at the sun's side; it falls with the square of the distance (at a third of the
    width to a half). 0.08 lies over the whole picture. Ghosts lie on a line through the picture's middle.
    """
    rows, columns = image.shape[:2]
    left = bool(rng.random() < 0.5)
    sun = (-0.05 if left else 1.05, float(rng.uniform(0.0, 0.25)))
    x, y = _grid(rows, columns)
    aspect = rows / columns
    far = ((x - np.float32(sun[0])) ** 2 + ((y - np.float32(sun[1])) * np.float32(aspect)) ** 2) / (
        1 / 3
    ) ** 2
    added = 0.08 + np.float32(veil) / (1 + far)
    for _ in range(int(rng.integers(3, 6))):
        along, radius = float(rng.uniform(0.7, 1.6)), float(rng.uniform(0.02, 0.08))
        at = tuple(one + along * (0.5 - one) for one in sun)
        away = np.sqrt((x - np.float32(at[0])) ** 2 + ((y - np.float32(at[1])) * np.float32(aspect)) ** 2)
        added += float(rng.uniform(0.04, 0.12)) * np.clip((radius - away) * 100 + 1, 0, 1)
    warm_white = np.array([1.0, 0.93, 0.8], dtype=np.float32)
    return coded(linear(image) * np.float32(0.7) + added.astype(np.float32)[..., None] * warm_white)


def shadows(image: Image, rng: Rng, left: float = 0.22, horizon: float = HORIZON) -> Image:
    """Hard shadows of trunks and leaves on the ground, bluish as from the sky.

    left: the share of the light that is left in them.
    """
    rows, columns = image.shape[:2]
    across, ahead, near = _ground(rows, columns, horizon)
    turn, shade = float(rng.uniform(-0.9, 0.9)), np.zeros((rows, columns), dtype=np.float32)
    for at in rng.uniform(1.5, 14.0, 5):
        away = np.abs(ahead - np.float32(at) - np.float32(turn) * across)
        shade = np.maximum(shade, np.clip((float(rng.uniform(0.1, 0.3)) - away) * 15 + 0.5, 0, 1))
    leaves = sum(_leaves(across, ahead, size, rng) for size in (1.2, 3.0))
    place = cv2.resize(
        rng.standard_normal((3, 4), dtype=np.float32), (columns, rows), interpolation=cv2.INTER_CUBIC
    )
    shade = np.maximum(shade, np.clip((leaves + np.float32(1.5) * place - 1) * 4, 0, 1)) * near
    sky = np.float32(left) * np.array([0.864, 1.0, 1.273], dtype=np.float32)
    return coded(linear(image) * (1 - shade[..., None] * (1 - sky)))


def fog(image: Image, visibility: float = 50.0, horizon: float = HORIZON) -> Image:
    """Fog with a visibility in metres: contrast falls with the distance, so towards the top of the picture.

    Koschmieder's law: L = L0 t + A (1 - t), t = exp(-3 d / visibility) (at the meteorological visibility 5 %
    of the contrast are left). The camera is 1 m above the ground; what is above the horizon is 30 m away. A
    is 0.6.
    """
    rows, columns = image.shape[:2]
    _, ahead, _ = _ground(rows, columns, horizon)
    left = np.exp(np.float32(-3 / visibility) / (1 / ahead + np.float32(1 / 30)))[..., None]
    air = np.array([0.58, 0.6, 0.63], dtype=np.float32)
    return coded(linear(image) * left + air * (1 - left))


def rain(image: Image, rng: Rng) -> Image:
    """Rain: light of a covered sky, a soft picture, streaks, and 8 to 16 drops on the lens.

    A drop shows the scene small, blurred and upside down, as a wide-angle lens that is out of focus would.
    """
    rows, columns = image.shape[:2]
    colours = (0.7 * (0.75 * np.eye(3) + 0.25 / 3)).astype(np.float32)
    light = blurred(linear(image) @ colours + np.float32(0.03), max(0.3, columns / 640))
    streaks = (rng.random((rows, columns), dtype=np.float32) > 0.9985).astype(np.float32)
    length = max(3, rows // 10)
    streaks = filtered(streaks, line(length, 90 + float(rng.uniform(-12, 12)))) * np.float32(length)
    light += np.minimum(streaks, 1.0)[..., None] * np.float32(0.1)
    small = np.asarray(cv2.resize(blurred(light, max(0.3, columns / 100)), (64, 64)), dtype=np.float32)
    for _ in range(int(rng.integers(8, 17))):
        _add_drop(light, small[::-1, ::-1], rng)
    return coded(light)


def _grid(rows: int, columns: int) -> tuple[Light, Light]:
    """Return x (1, columns) and y (rows, 1) of the pixels' middles, 0 to 1."""
    x = (np.arange(columns, dtype=np.float32) + np.float32(0.5)) / np.float32(columns)
    y = (np.arange(rows, dtype=np.float32) + np.float32(0.5)) / np.float32(rows)
    return x[None, :], y[:, None]


def _ground(rows: int, columns: int, horizon: float) -> tuple[Light, Light, Light]:
    """Return where each pixel meets the ground: metres to the right, metres ahead, and how near it is.

    All (rows, columns). The camera is 1 m above the ground. From 20 m on `near` falls from 1 to 0 at 40 m.
    """
    x, y = _grid(rows, columns)
    focal = 0.5 / math.tan(math.radians(VIEW / 2))
    below = np.maximum((y - np.float32(horizon)) * np.float32(rows / columns / focal), np.float32(1e-3))
    ahead = np.broadcast_to(1 / below, (rows, columns)).astype(np.float32)
    across = ((x - np.float32(0.5)) / np.float32(focal) * ahead).astype(np.float32)
    return across, ahead, np.clip(2 - ahead / 20, 0.0, 1.0).astype(np.float32)


def _leaves(across: Light, ahead: Light, size: float, rng: Rng) -> Light:
    """Return noise of mean 0 and deviation 1 on the ground, smooth over `size` / 16 metres."""
    noise = blurred(rng.standard_normal((256, 256), dtype=np.float32), size)
    noise /= noise.std()
    x, y = (np.mod(16 * metres, 255).astype(np.float32) for metres in (across + 8, ahead))
    return np.asarray(cv2.remap(noise, x, y, cv2.INTER_LINEAR), dtype=np.float32).reshape(ahead.shape)


def _add_drop(light: Light, seen: Light, rng: Rng) -> None:
    """Draw a drop at a random place of `light`, which shows `seen`, (64, 64, 3)."""
    rows, columns = light.shape[:2]
    radius = max(1.0, columns * float(rng.uniform(0.015, 0.05)))
    middle = float(rng.random()) * columns, float(rng.random()) * rows
    left, top = (max(0, math.floor(at - radius)) for at in middle)
    part = light[top : math.ceil(middle[1] + radius), left : math.ceil(middle[0] + radius)]
    y, x = np.mgrid[: part.shape[0], : part.shape[1]].astype(np.float32)
    over, down = (x + left + 0.5 - middle[0]) / radius, (y + top + 0.5 - middle[1]) / radius
    share = np.clip((1 - np.hypot(over, down)) * 4, 0, 1)[..., None].astype(np.float32)
    column, row = (np.clip(32 + 28 * at, 0, 63).astype(np.int32) for at in (over, down))
    part += share * (seen[row, column] - part)
