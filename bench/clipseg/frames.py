"""Makes the pictures for the contestants, the same on every machine, and lists the words to look for."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

SIZES = ((640, 480), (1280, 720))
"""Width and height in pixels."""

PROMPTS = {
    "grass": 1.0,
    "dirt path": 1.0,
    "bush": -0.8,
    "rock": -1.0,
    "gravel": 0.7,
    "puddle": -0.4,
    "tree trunk": -1.0,
    "sky": -0.5,
}
COUNTS = (1, 4, 8)
"""Numbers of prompts."""


def make_frame(width: int, height: int, index: int) -> NDArray[np.uint8]:
    """Makes an RGB frame (height, width, 3): a sky, a ground that darkens, patches of 40 pixels, grain."""
    random = np.random.default_rng((width, height, index))
    sky, ground = random.integers(40, 216, size=(2, 3))
    down = np.linspace(0.0, 1.0, height)[:, None, None]
    horizon = random.uniform(0.3, 0.5)
    base = np.where(down < horizon, sky, ground * (1.3 - 0.6 * down))
    patches = random.normal(0.0, 30.0, size=(height // 40 + 1, width // 40 + 1, 3))
    picture = base + np.kron(patches, np.ones((40, 40, 1)))[:height, :width]
    picture += random.normal(0.0, 6.0, size=(height, width, 1))
    frame: NDArray[np.uint8] = np.clip(picture, 0, 255).astype(np.uint8)
    return frame
