"""Fits a network's calibration (bias, gamma, background of taps) to frames it was not trained on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from anytraverse.perception.builtin.network import Calibration, network_input
from anytraverse.perception.builtin.taps import tap_cells
from anytraverse.training.classes import CLASSES, DRIVABLE
from anytraverse.training.folders import Folder, Labels
from anytraverse.training.scores import VIEWS, Floats, Network, gained, maps, outputs, score

ALLOWED = 0.006
"""Share of drivable validation pixels whose uncertainty may exceed 0.5; on other drives more will."""
RIDGE = 0.3
"""Added to the diagonal of the background's covariance, so that rare directions do not dominate."""
_GAMMAS = (0.5, 24.0)  # limits of plausible values
_BIASES = np.linspace(-1.5, 1.5, 13)


def plain(features: int = 32) -> Calibration:
    """Make a calibration that changes nothing, from which fitting begins."""
    count, wide = len(CLASSES), features + 5
    return Calibration(
        CLASSES,
        np.zeros(count, np.float32),
        1.0,
        np.zeros(wide, np.float32),
        np.eye(wide, dtype=np.float32),
        np.zeros(4 * features, np.float32),
        np.eye(4 * features, dtype=np.float32)[:32],
        0.5,
    )


def calibrated(network: Network, validation: Folder, start: Calibration) -> Calibration:
    """Fit biases and gamma to these frames, in their own and in other light."""
    results = [pair for gains in VIEWS.values() for pair in outputs(network, validation, gains)]
    biased = replace(start, bias=fitted_bias(results, start))
    return replace(biased, gamma=fitted_gamma(results, biased))


def fitted_bias(results: Sequence[tuple[Floats, Labels]], start: Calibration) -> Floats:
    """Choose one bias for all drivable classes, (C,), by the drivable IoU smoothed over neighbouring biases.

    Gamma is close to 0 here, so that every pixel is explained and gamma has no effect.
    """
    sample = results[:: max(1, len(results) // 300)]
    scores = []
    for raised in _BIASES:
        bias = np.zeros(len(CLASSES), dtype=np.float32)
        bias[list(DRIVABLE)] = raised
        scores.append(score(sample, replace(start, bias=bias, gamma=0.05)).iou)
    smooth = np.convolve(np.pad(scores, 1, mode="edge"), [0.25, 0.5, 0.25], mode="valid")
    best = np.zeros(len(CLASSES), dtype=np.float32)
    best[list(DRIVABLE)] = _BIASES[int(np.argmax(smooth))]
    return best


def fitted_gamma(
    results: Sequence[tuple[Floats, Labels]], start: Calibration, allowed: float = ALLOWED
) -> float:
    """Find the largest gamma at which at most `allowed` of drivable pixels are more uncertain than 0.5."""
    explained = []
    for logits, labels in results:
        _, uncertainty = maps(logits, replace(start, gamma=1.0), labels.shape)
        explained.append(1 - uncertainty[::3, ::3][np.isin(labels[::3, ::3], DRIVABLE)])
    least = float(np.quantile(np.concatenate(explained), allowed))
    gamma = math.log(0.5) / math.log(min(max(least, 1e-4), 1 - 1e-6))
    return float(np.clip(gamma, _GAMMAS[0], _GAMMAS[-1]))


def tap_background(network: Network, folder: Folder) -> tuple[Floats, NDArray[np.float32]]:
    """Calculate mean (T,) and whitening (T, T) of the frames' cells, in their own and in other light."""
    cells = []
    for index, frame in enumerate(folder.frames):
        image = gained(frame.image, list(VIEWS.values())[index % len(VIEWS)])
        own = tap_cells(network(image)[1], network_input(image))
        cells.append(own.reshape(-1, own.shape[-1])[::7])
    samples = np.concatenate(cells).astype(np.float64)
    mean, spread = samples.mean(axis=0), samples.std(axis=0) + 1e-3
    standard = (samples - mean) / spread
    values, axes = np.linalg.eigh(standard.T @ standard / len(standard) + RIDGE * np.eye(len(mean)))
    whitening = np.diag(1 / spread) @ (axes * values**-0.5) @ axes.T
    return mean.astype(np.float32), whitening.astype(np.float32)
