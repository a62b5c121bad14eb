"""A drive of the simulated trail, its labels, and a rover's configuration."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.companion.desk.drives.filmed import film


@pytest.fixture(scope="session")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The simulated trail in the forest and then on gravel, with labels; companion.toml is beside it.

    The labels are no truth: the upper half is `tree`, below are `gravel` and a `crate`.
    """
    folder = tmp_path_factory.mktemp("tuning") / "drive"
    folder.mkdir()
    height, width = film(folder, 0.9)
    labels = np.zeros((height, width), np.uint8)
    labels[height // 2 :] = 1
    labels[-height // 4 :, width // 2 :] = 2
    for picture in folder.glob("*.jpg"):
        cv2.imwrite(str(picture.with_suffix(".png")), labels)
    (folder / "classes.json").write_text(json.dumps({"ignore": 255, "classes": ["tree", "gravel", "crate"]}))
    return folder
