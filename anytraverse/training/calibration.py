"""Fits what a network's calibration knows of ground: distances to the classes, and the background of taps."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.perception.builtin.attention import middle_cells
from anytraverse.perception.builtin.calibration import Calibration, Floats
from anytraverse.perception.builtin.network import network_input
from anytraverse.perception.builtin.taps import COLOURS, tap_cells
from anytraverse.training.augment import cast
from anytraverse.training.classes import CLASSES, UNKNOWN
from anytraverse.training.folders import Folder, Labels
from anytraverse.training.scores import VIEWS, Network, gained
from anytraverse.training.widths import FEATURES, MIDDLE, SCALES

SLOPE = 6.0
"""Steepness of the strangeness about its limits."""
RIDGE = 0.3
"""Added to the diagonal of the background's covariance, so that rare directions do not dominate."""
FEWEST_FRAMES = 10
"""Frames that may choose a calibration, at least."""
_FEWEST = 200  # cells of a class from which its centre is calculated
_NEVER = 1e6  # a limit that nothing reaches
_SHARE = 0.15  # of all cells, by which distances are measured
_CENTRE_RIDGE = 1e-3  # of the mean variance


def plain() -> Calibration:
    """Make a calibration that changes nothing, from which fitting begins."""
    taps = FEATURES + SCALES[8] + COLOURS
    return Calibration(
        classes=CLASSES,
        bias=np.zeros(len(CLASSES), np.float32),
        distance_mean=np.zeros(MIDDLE, np.float32),
        distance_whitening=np.eye(MIDDLE, dtype=np.float32),
        distance_centres=np.zeros((1, MIDDLE), np.float32),
        limits=np.full(2, _NEVER, np.float32),
        slope=SLOPE,
        tile=0.5,
        tap_mean=np.zeros(taps, np.float32),
        tap_whitening=np.eye(taps, dtype=np.float32),
        scene_mean=np.zeros(1, np.float32),
        scene_projection=np.ones((1, 1), np.float32),
        scene_threshold=0.5,
        scene_match=np.zeros((0, 2), np.float32),
        surroundings_mean=np.zeros(3 * SCALES[8], np.float32),
        surroundings_whitening=np.eye(3 * SCALES[8], dtype=np.float32),
    )


def fitted_distances(network: Network, training: Folder, start: Calibration, seed: int) -> Calibration:
    """Fit the classes' centres and their common covariance, to frames as filmed and under colour casts.

    Stronger changes, as fog or blur, would make the covariance so wide that things fit into it.
    """
    rng = np.random.default_rng([seed, 7])
    cells, names = [], []
    for frame in training.frames:
        views = [frame.image] if rng.random() < 0.5 else [frame.image, cast(frame.image, rng)]
        for image in views:
            made = middle_cells(network(image))
            labels = _labels_at(frame.labels, made.shape[:2])
            chosen = (rng.random(labels.shape) < _SHARE) & (labels < UNKNOWN)
            cells.append(made[chosen])
            names.append(labels[chosen])
    samples, classes = np.concatenate(cells).astype(np.float64), np.concatenate(names)
    mean, within, centres = samples.mean(axis=0), np.zeros((samples.shape[1],) * 2), []
    counted = 0
    for index in range(UNKNOWN):
        own = samples[classes == index]
        if len(own) >= _FEWEST:
            centres.append(own.mean(axis=0))
            within += (own - centres[-1]).T @ (own - centres[-1])
            counted += len(own)
    within /= max(counted, 1)
    within += _CENTRE_RIDGE * np.trace(within) / len(within) * np.eye(len(within))
    values, axes = np.linalg.eigh(within)
    whitening = (axes * values**-0.5) @ axes.T
    return replace(
        start,
        distance_mean=mean.astype(np.float32),
        distance_whitening=whitening.astype(np.float32),
        distance_centres=((np.array(centres) - mean) @ whitening).astype(np.float32),
    )


def tap_background(network: Network, folder: Folder) -> tuple[Floats, NDArray[np.float32]]:
    """Calculate mean (T,) and whitening (T, T) of the frames' cells, in their own and in other light."""
    cells = []
    for index, frame in enumerate(folder.frames):
        image = gained(frame.image, list(VIEWS.values())[index % len(VIEWS)])
        own = tap_cells(network(image), network_input(image))
        cells.append(own.reshape(-1, own.shape[-1])[::7])
    samples = np.concatenate(cells).astype(np.float64)
    mean, spread = samples.mean(axis=0), samples.std(axis=0) + 1e-3
    standard = (samples - mean) / spread
    values, axes = np.linalg.eigh(standard.T @ standard / len(standard) + RIDGE * np.eye(len(mean)))
    whitening = np.diag(1 / spread) @ (axes * values**-0.5) @ axes.T
    return mean.astype(np.float32), whitening.astype(np.float32)


def _labels_at(labels: Labels, shape: tuple[int, ...]) -> Labels:
    size = (shape[1], shape[0])
    return np.asarray(cv2.resize(labels, size, interpolation=cv2.INTER_NEAREST_EXACT), dtype=np.uint8)
