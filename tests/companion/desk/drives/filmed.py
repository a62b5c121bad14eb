"""Films the simulated trail in the forest and then on gravel, and configures a rover that looks at it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from companion.sim.field.render import PinholeCamera
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
    camera = PinholeCamera(world)
    height = width = 0
    places = np.concatenate([np.arange(42.0, 49.0, step), np.arange(84.0, 91.0, step)])
    for number, place in enumerate(places):
        image, _ = camera.render(world.trail.pose(float(place)), 0.1 * number)
        cv2.imwrite(str(folder / f"{number:03d}.jpg"), image[..., ::-1])
        height, width = image.shape[:2]
    (folder.parent / "companion.toml").write_text(CONFIG)
    return height, width
