"""Fits a network's calibration to frames: bias, limits of strangeness, distances, background of taps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.perception.builtin.attention import distance, middle_cells, softmax
from anytraverse.perception.builtin.calibration import Calibration, Floats
from anytraverse.perception.builtin.network import Outputs, network_input
from anytraverse.perception.builtin.taps import COLOURS, tap_cells
from anytraverse.training.augment import cast
from anytraverse.training.classes import CLASSES, DRIVABLE, UNKNOWN
from anytraverse.training.cutouts import Cutout
from anytraverse.training.folders import Folder, Labels
from anytraverse.training.scores import VIEWS, Network, gained, outputs, resized, score
from anytraverse.training.things import ENOUGH, bounded, recall, seen
from anytraverse.training.widths import FEATURES, MIDDLE, SCALES

ALLOWED = 0.01
"""Share of drivable validation cells beyond each of the two limits of strangeness."""
SLOPE = 6.0
"""Steepness of the strangeness about its limits."""
RIDGE = 0.3
"""Added to the diagonal of the background's covariance, so that rare directions do not dominate."""
FEWEST_FRAMES = 10
"""Frames that may choose a calibration, at least."""
_SEED = 9  # of the pasted things
_SHARES = (1.0, 0.5, 0.0)  # of the change of the bias, the first that does no harm
_BIASES = np.linspace(-1.5, 1.5, 13)
_GAIN = 0.01  # of IoU, for which the network is biased: less is luck, and costs as much elsewhere
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
        tap_mean=np.zeros(taps, np.float32),
        tap_whitening=np.eye(taps, dtype=np.float32),
        scene_mean=np.zeros(1, np.float32),
        scene_projection=np.ones((1, 1), np.float32),
        scene_threshold=0.5,
        scene_match=np.zeros((0, 2), np.float32),
    )


def calibrated(network: Network, validation: Folder, start: Calibration) -> Calibration:
    """Fit bias and limits to these frames, in their own and in other light."""
    results = [pair for gains in VIEWS.values() for pair in outputs(network, validation, gains)]
    biased = replace(start, bias=fitted_bias(results, start))
    return replace(biased, limits=fitted_limits(results, biased))


def recalibrated(
    network: Network,
    validation: Folder,
    start: Calibration,
    cutouts: Sequence[Cutout] = (),
    required: float | None = None,
) -> Calibration:
    """Fit bias and limits; the limits stay so low that enough things pasted into these frames are noticed.

    required: share of them, None: as many as with `start`; no more than `ENOUGH` either way. False alarms on
    few frames say little of things: alone, they raise the limits until things are explained away. A bias
    whose limits are then so low that more of the drivable ground is uncertain than with `start` is taken by
    half, or not at all.
    """
    things = seen(network, validation, _SEED, cutouts)
    least = min(ENOUGH, recall(things, start) if required is None else required)
    results = [pair for gains in VIEWS.values() for pair in outputs(network, validation, gains)]
    filmed = results[: len(validation)]
    before, fitted = score(filmed, start), fitted_bias(results, start)
    for share in _SHARES:
        biased = replace(start, bias=start.bias + np.float32(share) * (fitted - start.bias))
        found = bounded(things, replace(biased, limits=fitted_limits(results, biased)), least)
        now = score(filmed, found)
        if now.iou >= before.iou and now.unexplained <= before.unexplained:
            return found
    return bounded(things, start, least)


def least_recall(
    network: Network, validation: Folder, start: Calibration, cutouts: Sequence[Cutout]
) -> float:
    """Return the share of the same things that another network notices, for `recalibrated`."""
    return recall(seen(network, validation, _SEED, cutouts), start)


def fitted_bias(results: Sequence[tuple[Outputs, Labels]], start: Calibration) -> Floats:
    """Choose one bias for all drivable classes, (C,), by the drivable IoU smoothed over neighbouring biases.

    Nothing is strange here, so that the network alone decides.
    """
    sample = results[:: max(1, len(results) // 300)]
    blind = replace(start, limits=np.full(2, _NEVER, np.float32))
    scores = []
    for raised in _BIASES:
        bias = np.zeros(len(CLASSES), dtype=np.float32)
        bias[list(DRIVABLE)] = raised
        scores.append(score(sample, replace(blind, bias=bias)).iou)
    smooth = np.convolve(np.pad(scores, 1, mode="edge"), [0.25, 0.5, 0.25], mode="valid")
    chosen, none = int(np.argmax(smooth)), len(_BIASES) // 2
    best = np.zeros(len(CLASSES), dtype=np.float32)
    if smooth[chosen] > smooth[none] + _GAIN:
        best[list(DRIVABLE)] = _BIASES[chosen]
    return best


def fitted_limits(
    results: Sequence[tuple[Outputs, Labels]], start: Calibration, allowed: float = ALLOWED
) -> Floats:
    """Find what `allowed` of drivable cells exceed: the probability of a thing, and the distance, (2,)."""
    things, distances = [], []
    for made, labels in results:
        thing = softmax(made.logits + start.bias[:, None, None])[UNKNOWN]
        ground = np.isin(_labels_at(labels, thing.shape), DRIVABLE)
        far = resized(distance(made, start), thing.shape)
        things.append(thing[ground])
        distances.append(far[ground])
    limits = [float(np.quantile(np.concatenate(each), 1 - allowed)) for each in (things, distances)]
    return np.maximum(limits, 1e-3).astype(np.float32)


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
