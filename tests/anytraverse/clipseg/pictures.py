"""Made pictures for networks to look at."""

from __future__ import annotations

import numpy as np

from anytraverse.frame import Image


def picture(width: int, height: int, seed: int) -> Image:
    """Much as a camera sees: light from above, ground and sky, things with edges, shade, grain."""
    random = np.random.default_rng((width, height, seed))
    down, across = np.mgrid[0:height, 0:width] / np.array([[[height]], [[width]]])
    sky, ground = random.uniform(60, 220, (2, 3))
    image = np.where(
        (down < random.uniform(0.25, 0.5))[..., None], sky * (1.1 - 0.4 * down[..., None]), ground
    )
    for _ in range(12):
        x, y, wide, high = random.uniform((0, 0.2, 0.02, 0.02), (1, 1, 0.25, 0.2))
        inside = ((across - x) / wide) ** 2 + ((down - y) / high) ** 2 < 1
        image[inside] = random.uniform(20, 235, 3)
    waves = sum(
        random.uniform(2, 12) * np.sin(across * random.uniform(5, 90) + down * random.uniform(5, 90))
        for _ in range(6)
    )
    grain = random.normal(0.0, 5.0, (height, width, 1))
    return np.asarray(np.clip(image + np.asarray(waves)[..., None] + grain, 0, 255), dtype=np.uint8)
