"""Embeds the scene of a frame from the built-in network's features: its place, and its surroundings."""

from __future__ import annotations

import math

import numpy as np

from anytraverse.perception.builtin.calibration import Calibration, Floats
from anytraverse.perception.builtin.network import Outputs

SAME_PLACE = 0.925
"""Cosine below which the scene has changed, as it is in the paper for CLIP's embedding."""

_TOP = 1 / 3
"""Share of the frame's height that is left out at the top: it shows places not yet reached."""
_BANDS = ((0.45, 0.65), (0.65, 1.0))
"""Rows, in fractions of the frame's height: the ground some metres ahead, and the ground at the wheels."""


def scene_summary(outputs: Outputs) -> Floats:
    """Summarise the frame, (P,), by what grows where and by the kinds of ground.

    The former are the means of the backbone's features at stride 16 in the left, middle and right third; the
    latter mean and standard deviation of the decoder's features in each of the `_BANDS`.
    """
    coarse, fine = outputs.sixteenth, outputs.features
    columns, rows = coarse.shape[2], fine.shape[1]
    ground, third = coarse[:, int(_TOP * coarse.shape[1]) :], max(1, columns // 3)
    thirds = (ground[..., :third], ground[..., third : columns - third], ground[..., columns - third :])
    bands = [fine[:, int(top * rows) : math.ceil(bottom * rows)] for top, bottom in _BANDS]
    return np.concatenate(
        [
            *(part.mean(axis=(1, 2)) for part in thirds),
            *(part for band in bands for part in (band.mean(axis=(1, 2)), band.std(axis=(1, 2)))),
        ]
    )


def scene_vector(outputs: Outputs, calibration: Calibration) -> Floats:
    """Make the scene's embedding, (1 + S,), of unit length.

    The summary is whitened and projected to S numbers of unit length. Their cosine c tells places apart at
    the fitted threshold t. A constant first entry maps c to the cosine 1 - (1 - c) 0.075 / (1 - t), so that
    t becomes `SAME_PLACE`, 0.925.
    """
    place = calibration.scene_projection @ (scene_summary(outputs) - calibration.scene_mean)
    place /= max(float(np.linalg.norm(place)), 1e-6)
    varying = (1 - SAME_PLACE) / (1 - calibration.scene_threshold)
    return np.concatenate([[math.sqrt(1 - varying)], math.sqrt(varying) * place]).astype(np.float32)


def surroundings_summary(outputs: Outputs) -> Floats:
    """Summarise the frame, (Q,), by the backbone's features at stride 8: means of top, middle and bottom."""
    return np.concatenate([band.mean(axis=(1, 2)) for band in np.array_split(outputs.eighth, 3, axis=1)])


def surroundings_vector(outputs: Outputs, calibration: Calibration) -> Floats:
    """Make the vector, (Q,), by which `History.strangeness` tells familiar surroundings from foreign ones.

    The summary is whitened by how the frames of one drive vary, and scaled so that most frames of a drive of
    the same region have a strangeness below 1.
    """
    vector = calibration.surroundings_whitening @ (
        surroundings_summary(outputs) - calibration.surroundings_mean
    )
    return np.asarray(vector, dtype=np.float32)
