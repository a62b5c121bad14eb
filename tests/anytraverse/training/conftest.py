"""A tiny labelled folder, made by the test: sky above, grass below, a trail in its middle."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

NAMES = ["sky", "grass", "smooth_trail", "obstacle"]


def scene(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """An RGB frame of 96 x 64 and its label ids."""
    labels = np.zeros((64, 96), np.uint8)
    horizon = int(rng.integers(20, 30))
    labels[horizon:] = 1
    left = int(rng.integers(25, 40))
    labels[horizon:, left : left + 30] = 2
    colours = np.array([(150, 190, 240), (60, 140, 50), (160, 130, 100)], np.float64)
    image = colours[labels] + rng.normal(0, 8, (64, 96, 3))
    return np.clip(image, 0, 255).astype(np.uint8), labels


@pytest.fixture(scope="session")
def tiny_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Frames in the blocks 0, 1, 2, 3, six of each, and one in a gap."""
    folder = tmp_path_factory.mktemp("labelled")
    rng = np.random.default_rng(0)
    for number in [100 * block + index for block in range(4) for index in range(6)] + [90]:
        image, labels = scene(rng)
        cv2.imwrite(str(folder / f"{number:04d}.jpg"), image[..., ::-1])
        cv2.imwrite(str(folder / f"{number:04d}.png"), labels)
    (folder / "classes.json").write_text(json.dumps({"ignore": 255, "classes": NAMES}))
    return folder
