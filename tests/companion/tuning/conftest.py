"""A drive of the simulated trail, its labels, and a rover's configuration."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

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


@pytest.fixture(scope="session")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The simulated trail from the meadow into the forest, with labels; companion.toml is beside it.

    The labels are no truth: the upper half is `tree`, below are `gravel` and a `crate`.
    """
    folder = tmp_path_factory.mktemp("tuning") / "drive"
    folder.mkdir()
    world = World(0)
    camera = Camera(world)
    for number, place in enumerate(np.arange(42.0, 55.6, 0.9)):
        image, _ = camera.render(world.trail.pose(float(place)), 0.1 * number)
        cv2.imwrite(str(folder / f"{number:03d}.jpg"), image[..., ::-1])
        height, width = image.shape[:2]
        labels = np.zeros((height, width), np.uint8)
        labels[height // 2 :] = 1
        labels[-height // 4 :, width // 2 :] = 2
        cv2.imwrite(str(folder / f"{number:03d}.png"), labels)
    (folder / "classes.json").write_text(json.dumps({"ignore": 255, "classes": ["tree", "gravel", "crate"]}))
    (folder.parent / "companion.toml").write_text(CONFIG)
    return folder
