"""Outputs made by hand for tests of calibrations and scores: no weights, no runtime."""

from __future__ import annotations

import cv2
import numpy as np

from anytraverse.frame import Image
from anytraverse.perception.builtin.calibration import Floats
from anytraverse.perception.builtin.network import Outputs
from anytraverse.training.classes import CLASSES
from anytraverse.training.widths import FEATURES, SCALES


def made(
    logits: Floats,
    features: Floats | None = None,
    eighth: Floats | None = None,
    sixteenth: Floats | None = None,
) -> Outputs:
    """Outputs with these logits, (C, h/4, w/4), and zeros for what is not given."""
    rows, columns = logits.shape[1:]

    def zeros(channels: int, step: int) -> Floats:
        return np.zeros((channels, max(1, rows // step), max(1, columns // step)), np.float32)

    return Outputs(
        logits,
        zeros(FEATURES, 1) if features is None else features,
        zeros(SCALES[8], 2) if eighth is None else eighth,
        zeros(SCALES[16], 4) if sixteenth is None else sixteenth,
    )


def by_colour(image: Image) -> Outputs:
    """Know the tiny scene's colours: sky is blue, grass is green, brown is trail, all else is a thing."""
    small = np.asarray(cv2.resize(image, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA), np.float32)
    colours = np.array([(150, 190, 240), (60, 140, 50), (160, 130, 100)], np.float32)
    far = np.linalg.norm(small[None] - colours[:, None, None], axis=-1)
    logits = np.full((len(CLASSES), *small.shape[:2]), -9.0, np.float32)
    for name, distance in zip(("sky", "grass", "smooth trail"), far, strict=True):
        logits[CLASSES.index(name)] = 9.0 - 0.3 * distance
    logits[-1] = -3.0
    return made(logits)


def sky_everywhere(image: Image) -> Outputs:
    """See nothing but sky."""
    logits = np.zeros_like(by_colour(image).logits)
    logits[CLASSES.index("sky")] = 9
    return made(logits)
