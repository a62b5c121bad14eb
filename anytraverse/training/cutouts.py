"""Reads photographs of things without a background, which a training pastes into frames."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import TrainingError

Cutout = NDArray[np.uint8]
"""A thing, (h, w, 4): RGB and opacity, 0 to 255."""

_LARGEST = 256  # pixels of the longer side: more than a thing has in any view
_MOST = 5000


def read_cutouts(folder: Path) -> tuple[Cutout, ...]:
    """Read all PNG pictures with an opacity channel below a folder, by name. Raises TrainingError without."""
    found = []
    for path in sorted(folder.rglob("*.png"))[:_MOST]:
        picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        if picture is None or picture.ndim != 3 or picture.shape[2] != 4 or picture.dtype != np.uint8:
            continue
        scale = min(1.0, _LARGEST / max(picture.shape[:2]))
        size = max(1, round(picture.shape[1] * scale)), max(1, round(picture.shape[0] * scale))
        small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
        found.append(np.asarray(cv2.cvtColor(small, cv2.COLOR_BGRA2RGBA), dtype=np.uint8))
    if not found:
        raise TrainingError(f"{folder} holds no PNG picture with an opacity channel: give another --cutouts")
    return tuple(found)
