"""Films the simulated trail from the meadow into the forest, and configures a rover that looks at it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from companion.sim.field.render import Camera
from companion.sim.field.things import World

CONFIG = """
[camera]
source = "folder:pictures"
[vehicle]
file = ""
[perceiver]
threads = 1
[roi]
left = 0.35
top = 0.46
right = 0.65
bottom = 0.95
[words]
grass = 1.0
"dirt path" = 1.0
bush = -1.0
tree = -1.0
sky = -1.0
"""


def film(folder: Path, step: float) -> tuple[int, int]:
    """Write a picture every `step` metres, and companion.toml beside the folder.

    Returns the height and width of the pictures.
    """
    world = World(0)
    camera = Camera(world)
    height = width = 0
    for number, place in enumerate(np.arange(42.0, 56.0, step)):
        image, _ = camera.render(world.trail.pose(float(place)), 0.1 * number)
        cv2.imwrite(str(folder / f"{number:03d}.jpg"), image[..., ::-1])
        height, width = image.shape[:2]
    (folder.parent / "companion.toml").write_text(CONFIG)
    return height, width
