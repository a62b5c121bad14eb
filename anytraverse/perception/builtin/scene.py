"""Embeds the scene of a frame from the built-in network's features: one place gives similar unit vectors."""

from __future__ import annotations

import math

import numpy as np

from anytraverse.perception.builtin.network import Calibration, Floats

SAME_PLACE = 0.925
"""Cosine below which the scene has changed, as it is in the paper for CLIP's embedding."""


BANDS = ((0.45, 0.65), (0.65, 1.0))
"""Bands of rows, in fractions of the frame's height: the ground some metres ahead with what grows beside it,
and the ground at the wheels. The rows above are left out: they show places not yet reached."""


def scene_summary(features: Floats) -> Floats:
    """Calculate mean and standard deviation of each feature in each of the `BANDS`, (4 D,) from (D, h, w)."""
    rows = features.shape[1]
    parts = []
    for top, bottom in BANDS:
        band = features[:, int(top * rows) : math.ceil(bottom * rows)].reshape(len(features), -1)
        parts += [band.mean(axis=1), band.std(axis=1)]
    return np.concatenate(parts)


def scene_vector(features: Floats, calibration: Calibration) -> Floats:
    """Make the scene's embedding, (1 + S,), of unit length.

    The summary is whitened and projected to S numbers of unit length. Their cosine c tells places apart at
    the fitted threshold t. A constant first entry maps c to the cosine 1 - (1 - c) 0.075 / (1 - t), so that
    t becomes `SAME_PLACE`, 0.925.
    """
    place = calibration.scene_projection @ (scene_summary(features) - calibration.scene_mean)
    place /= max(float(np.linalg.norm(place)), 1e-6)
    varying = (1 - SAME_PLACE) / (1 - calibration.scene_threshold)
    return np.concatenate([[math.sqrt(1 - varying)], math.sqrt(varying) * place]).astype(np.float32)
