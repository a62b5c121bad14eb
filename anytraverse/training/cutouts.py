"""Reads photographs of things without a background, which a training pastes into frames."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import TrainingError

Cutout = NDArray[np.uint8]
"""A thing, (h, w, 4): RGB and opacity, 0 to 255."""

_LARGEST = 256  # pixels of the longer side: more than a thing has in any view
_MOST = 5000


def split_cutouts(cutouts: Sequence[Cutout]) -> tuple[tuple[Cutout, ...], tuple[Cutout, ...]]:
    """Split into those for training and every fifth, which is kept to check the fit with."""
    return tuple(one for at, one in enumerate(cutouts) if at % 5), tuple(cutouts[::5])


def read_cutouts(folder: Path) -> tuple[Cutout, ...]:
    """Read all PNG pictures with an opacity channel below a folder, by name.

    Raises TrainingError for fewer than two: one is kept to check the fit with.
    """
    found = []
    for path in sorted(folder.rglob("*.png"))[:_MOST]:
        picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        if picture is None or picture.ndim != 3 or picture.shape[2] != 4 or picture.dtype != np.uint8:
            continue
        scale = min(1.0, _LARGEST / max(picture.shape[:2]))
        size = max(1, round(picture.shape[1] * scale)), max(1, round(picture.shape[0] * scale))
        small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
        found.append(np.asarray(cv2.cvtColor(small, cv2.COLOR_BGRA2RGBA), dtype=np.uint8))
    if len(found) < 2:
        raise TrainingError(
            f"{folder} holds {len(found)} PNG pictures with an opacity channel, and at least 2 are needed, "
            "of which one is kept to check the fit with: give another --cutouts"
        )
    return tuple(found)
